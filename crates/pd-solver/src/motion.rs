//! Steps in time, and the derivative through them.

use crate::Solver;
use crate::error::SolverError;
use crate::parameters::Parameters;
use crate::solution::{Adjoint, AdjointOptions, Solution, SolveOptions};
use crate::solver::check_positions;
use crate::spec::TimeScheme;
use crate::vector::NodalVector;
use nalgebra::Vector3;

/// Where a body is and how it moves; or the gradient of a loss by that.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Motion {
    /// Positions of all nodes.
    pub positions: NodalVector,
    /// Velocities of all nodes, length per time.
    pub velocities: NodalVector,
}

impl Motion {
    /// A body that stands still.
    pub fn still(positions: NodalVector) -> Self {
        Self {
            velocities: vec![Vector3::zeros(); positions.len()],
            positions,
        }
    }
}

/// What a moving body keeps while nothing acts on it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Momenta {
    /// Sum of mass times velocity.
    pub linear: Vector3<f64>,
    /// Sum of mass times position cross velocity, about the origin.
    pub angular: Vector3<f64>,
    /// Half the sum of mass times squared velocity.
    pub kinetic_energy: f64,
}

/// A step in time, kept for its derivative.
#[derive(Debug, Clone, PartialEq)]
pub struct TimeStep {
    /// What the solver was given.
    pub parameters: Parameters,
    /// What it found: the end of the step, or for [`TimeScheme::Midpoint`] its middle. Look at its status.
    pub solution: Solution,
    /// Where the body is at the end of the step.
    pub end: Motion,
}

/// The gradient of a loss on the end of a step.
#[derive(Debug, Clone, PartialEq)]
pub struct StepGradient {
    /// By the state before the step.
    pub start: Motion,
    /// By the parameters that [`Solver::time_step`] was given: prescribed positions are those at the end of the step, and the lists of
    /// inertia and damping, which the step sets itself, are empty.
    pub parameters: Parameters,
}

/// How the solved state hangs together with start and end of a step: `solved = start + step velocity` where nothing acts.
struct Rule {
    scheme: TimeScheme,
    /// Time from the start to what is solved for.
    step: f64,
}

impl Solver {
    fn rule(&self) -> Result<Rule, SolverError> {
        match &self.problem().inertia {
            Some(stepping) => Ok(Rule {
                scheme: stepping.scheme,
                step: stepping.solved_step(),
            }),
            None => Err(SolverError::NoInertia),
        }
    }

    /// Length of a step in time; `None` where the list of effects has no `inertia`.
    pub fn time_step_length(&self) -> Option<f64> {
        self.problem().inertia.as_ref().map(|i| i.time_step)
    }

    /// One step in time from `start`. `parameters` are those at the end of the step (prescribed positions above all); their lists `inertia` and
    /// `before` are set by the step.
    ///
    /// # Errors
    /// When the list of effects has no `inertia`, or as [`Solver::solve`]. A step whose solve does not converge is no error: look at the status.
    pub fn time_step(
        &mut self,
        start: &Motion,
        parameters: &Parameters,
        options: &SolveOptions,
    ) -> Result<TimeStep, SolverError> {
        let rule = self.rule()?;
        let n = self.rest().len();
        check_positions("positions", &start.positions, n)?;
        check_positions("velocities", &start.velocities, n)?;
        let mut parameters = parameters.clone();
        let (x, v) = (&start.positions, &start.velocities);
        parameters.inertia = (x.iter().zip(v)).map(|(x, v)| x + v * rule.step).collect();
        if self.problem().rest_parameters.before.is_empty() {
            parameters.before.clear();
        } else {
            parameters.before.clone_from(x);
        }
        if rule.scheme == TimeScheme::Midpoint {
            for (target, &node) in parameters.prescribed.iter_mut().zip(self.prescribed()) {
                *target = (*target + x[node as usize]) / 2.0;
            }
        }
        let solution = self.solve(&parameters, Some(x), options)?;
        let solved = solution.positions.iter().zip(x);
        let end = match rule.scheme {
            TimeScheme::BackwardEuler => Motion {
                velocities: solved.map(|(u, x)| (u - x) / rule.step).collect(),
                positions: solution.positions.clone(),
            },
            TimeScheme::Midpoint => Motion {
                positions: solved.clone().map(|(u, x)| u * 2.0 - x).collect(),
                velocities: (solved.zip(v))
                    .map(|((u, x), v)| (u - x) * (2.0 / rule.step) - v)
                    .collect(),
            },
        };
        Ok(TimeStep {
            parameters,
            solution,
            end,
        })
    }

    /// The gradient of a loss by the start of a step and its parameters, from that by its end. Going through the steps of a motion from the last
    /// one back, with the loss on each state added on the way, gives the gradient of a loss on all of it.
    ///
    /// # Errors
    /// When arrays do not fit. Where the adjoint solve gives no gradient, its status says why, and the gradient is `None`.
    pub fn time_step_adjoint(
        &mut self,
        step: &TimeStep,
        end_bar: &Motion,
        options: &AdjointOptions,
    ) -> Result<(Option<StepGradient>, Adjoint), SolverError> {
        let rule = self.rule()?;
        let (x_bar, v_bar) = (&end_bar.positions, &end_bar.velocities);
        let bars = x_bar.iter().zip(v_bar);
        let h = rule.step;
        let cotangent: NodalVector = match rule.scheme {
            TimeScheme::BackwardEuler => bars.clone().map(|(x, v)| x + v / h).collect(),
            TimeScheme::Midpoint => bars.clone().map(|(x, v)| (x + v / h) * 2.0).collect(),
        };
        let mut adjoint = self.adjoint(&step.parameters, &step.solution, &cotangent, options)?;
        let Some(mut gradient) = adjoint.gradient.take() else {
            return Ok((None, adjoint));
        };
        // What start and end have to do with each other past the solve.
        let mut start = match rule.scheme {
            TimeScheme::BackwardEuler => Motion {
                positions: v_bar.iter().map(|v| -v / h).collect(),
                velocities: vec![Vector3::zeros(); v_bar.len()],
            },
            TimeScheme::Midpoint => Motion {
                positions: bars.map(|(x, v)| -x - v * (2.0 / h)).collect(),
                velocities: v_bar.iter().map(|v| -v).collect(),
            },
        };
        let inertia = std::mem::take(&mut gradient.inertia);
        let before = std::mem::take(&mut gradient.before);
        let moved = start.positions.iter_mut().zip(&mut start.velocities);
        for ((x, v), y) in moved.zip(&inertia) {
            *x += y;
            *v += y * h;
        }
        let positions = start.positions.iter_mut().zip(&before);
        positions.for_each(|(x, b)| *x += b);
        if rule.scheme == TimeScheme::Midpoint {
            for (bar, &node) in gradient.prescribed.iter_mut().zip(self.prescribed()) {
                *bar /= 2.0;
                start.positions[node as usize] += *bar;
            }
        }
        let gradient = StepGradient {
            start,
            parameters: gradient,
        };
        Ok((Some(gradient), adjoint))
    }

    /// Linear and angular momentum and kinetic energy of a moving body; `None` where the list of effects has no `inertia`.
    pub fn momenta(&self, motion: &Motion) -> Option<Momenta> {
        let masses = &self.problem().inertia.as_ref()?.masses;
        let mut out = Momenta {
            linear: Vector3::zeros(),
            angular: Vector3::zeros(),
            kinetic_energy: 0.0,
        };
        let nodes = motion.positions.iter().zip(&motion.velocities);
        for ((x, v), m) in nodes.zip(masses) {
            out.linear += v * *m;
            out.angular += x.cross(v) * *m;
            out.kinetic_energy += 0.5 * m * v.norm_squared();
        }
        Some(out)
    }
}

//! Frames in time: from the parameters of one frame to those of the next, by the steps that inertia takes.

use crate::error::{Result, TrainerError};
use nalgebra::Vector3;
use pd_solver::{Motion, Parameters, Solution, SolveOptions, Solver, Status};

/// How far a number of steps per frame may be from a whole one.
const WHOLE: f64 = 1e-6;

/// A body on its way through time.
pub struct Dynamics {
    state: Motion,
    parameters: Parameters,
    steps: usize,
}

impl Dynamics {
    /// A body that stands still at positions of its nodes, with the parameters of its first frame; `rate` is in frames per second.
    ///
    /// # Errors
    /// When the solver has no inertia, or a frame is no whole number of its steps.
    pub fn new(
        solver: &Solver,
        positions: Vec<Vector3<f64>>,
        parameters: Parameters,
        rate: f64,
    ) -> Result<Self> {
        let step = solver.time_step_length().ok_or(TrainerError::NoInertia)?;
        let steps = (1.0 / (rate * step)).round();
        if steps < 1.0 || (1.0 / (rate * step) / steps - 1.0).abs() > WHOLE {
            return Err(TrainerError::StepsPerFrame { step, rate });
        }
        Ok(Self {
            state: Motion::still(positions),
            parameters,
            steps: steps as usize,
        })
    }

    /// Where the body is and how it moves.
    pub fn state(&self) -> &Motion {
        &self.state
    }

    /// Goes on to the next frame, with its parameters reached in equal parts step by step. What it returns is of the last step, with iterations and
    /// seconds of all and the worst status; its positions are those at the end.
    ///
    /// # Errors
    /// As [`Solver::time_step`].
    pub fn frame(
        &mut self,
        solver: &mut Solver,
        parameters: &Parameters,
        options: &SolveOptions,
    ) -> Result<Solution> {
        let from = self.parameters.clone();
        let (mut iterations, mut seconds) = (0, 0.0);
        let mut status = Status::Converged;
        let mut last = Solution::default();
        for step in 1..=self.steps {
            let at = from.between(parameters, step as f64 / self.steps as f64);
            let taken = solver.time_step(&self.state, &at, options)?;
            self.state = taken.end;
            last = taken.solution;
            iterations += last.stats.iterations;
            seconds += last.stats.seconds;
            if last.status != Status::Converged {
                status = last.status;
            }
        }
        self.parameters.clone_from(parameters);
        last.positions.clone_from(&self.state.positions);
        last.status = status;
        last.stats.iterations = iterations;
        last.stats.seconds = seconds;
        Ok(last)
    }
}

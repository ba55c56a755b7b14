//! The start for the finest grid: the equilibrium of coarser bodies, one after another.

use super::{Preconditioner, Target, Workspace, lbfgs};
use crate::multigrid::{Hierarchy, Multigrid};
use crate::parameters::Parameters;
use crate::problem::Problem;
use crate::vector::{NodalVector, norm};
use nalgebra::Vector3;

/// Gradient, relative to that at rest, at which a coarse equilibrium is near enough: what is left is less than what the coarse
/// grid gets wrong.
const TOLERANCE: f64 = 1e-2;
/// Length of the last step, in edges of a coarse element, at which it is. Slender parts have bent by several elements less than they will
/// when their gradient is small: on a starfish whose arms bend far the finest grid takes 7 instead of 13 iterations.
const STEP: f64 = 0.2;
const MAX_ITERATIONS: usize = 100;

/// The body on a coarse grid.
pub(crate) struct CoarseBody {
    problem: Problem,
    parameters: Parameters,
    /// Finest nodes that the prescribed nodes coincide with, and finest nodes that springs hold instead, as places in the
    /// finest parameters.
    prescribed: Vec<u32>,
    anchored: Vec<u32>,
    u: NodalVector,
    space: Workspace,
}

/// One level's share of the multigrid as a preconditioner.
struct AtLevel<'a> {
    multigrid: &'a mut Multigrid,
    level: usize,
}

impl Preconditioner for AtLevel<'_> {
    fn apply(&mut self, r: &[Vector3<f64>], z: &mut NodalVector) {
        self.multigrid.apply(self.level, r, z);
    }

    fn follows(&self) -> bool {
        true
    }

    fn tells_errors(&self) -> bool {
        true
    }

    fn prepare(&mut self, problem: &mut Problem, u: &[Vector3<f64>]) -> bool {
        self.rebuild(problem, u);
        true
    }

    fn rebuild(&mut self, _problem: &mut Problem, u: &[Vector3<f64>]) {
        self.multigrid.rebuild(self.level, u);
    }

    fn project(&mut self, _problem: &Problem, u: &[Vector3<f64>]) -> bool {
        self.multigrid.project(self.level, u)
    }

    fn strengthen(&mut self, _problem: &Problem, u: &[Vector3<f64>]) -> bool {
        self.multigrid.strengthen(self.level, u);
        true
    }
}

impl CoarseBody {
    /// `prescribed` and `anchored` name places in the list of the finest prescribed nodes, in the order of the problem's own
    /// prescribed nodes and of its last spring targets.
    fn new(problem: Problem, prescribed: Vec<u32>, anchored: Vec<u32>) -> Self {
        Self {
            parameters: problem.rest_parameters.clone(),
            u: problem.rest.clone(),
            space: Workspace::default(),
            prescribed,
            anchored,
            problem,
        }
    }

    fn set_parameters(&mut self, finest: &Parameters, actuation: &[[f64; 6]]) {
        const IDENTITY: [f64; 6] = [1.0, 0.0, 0.0, 1.0, 0.0, 1.0];
        let own = &mut self.parameters;
        for (samples, a) in own.actuation.chunks_mut(8).zip(actuation) {
            samples.fill(std::array::from_fn(|k| a[k] - IDENTITY[k]));
        }
        for (own, &from) in own.prescribed.iter_mut().zip(&self.prescribed) {
            *own = finest.prescribed[from as usize];
        }
        let (springs, anchors) = own.spring_targets.split_at_mut(finest.spring_targets.len());
        springs.copy_from_slice(&finest.spring_targets);
        for (own, &from) in anchors.iter_mut().zip(&self.anchored) {
            *own = finest.prescribed[from as usize];
        }
        own.acceleration.copy_from_slice(&finest.acceleration);
        own.forces.copy_from_slice(&finest.forces);
        own.pressures.copy_from_slice(&finest.pressures);
        self.problem.set_parameters(own);
    }

    /// Finds the equilibrium from the positions in `u`; returns the iterations taken.
    fn solve(&mut self, multigrid: &mut Multigrid, level: usize) -> usize {
        let n = self.problem.len();
        self.space.reserve(n);
        let rest = &mut self.space.scratch;
        rest.copy_from_slice(&self.problem.rest);
        self.problem.impose(&self.parameters, rest);
        self.problem
            .evaluate_at_rest(rest, &mut self.space.gradient);
        let target = Target {
            tell_error: false,
            accuracy: None,
            gradient: (TOLERANCE * norm(&self.space.gradient))
                .max(self.problem.gradient_floor(&self.u)),
            step: STEP * self.problem.element_size,
        };
        multigrid.trust(level);
        let mut pre = AtLevel { multigrid, level };
        lbfgs(
            &mut self.problem,
            &mut pre,
            &mut self.space,
            &mut self.u,
            &target,
            MAX_ITERATIONS,
        )
        .iterations
    }
}

/// Writes positions of the finest nodes that come from the equilibria of all coarser bodies into `u`. Returns the iterations of
/// all levels. The multigrid is left built for a coarse level.
pub(crate) fn start(
    bodies: &mut [CoarseBody],
    multigrid: &mut Multigrid,
    finest: &Parameters,
    finest_rest: &[Vector3<f64>],
    u: &mut NodalVector,
) -> usize {
    let mut iterations = 0;
    for (index, body) in bodies.iter_mut().enumerate() {
        body.set_parameters(finest, multigrid.actuation(index + 1));
    }
    for index in (0..bodies.len()).rev() {
        let (finer, coarser) = bodies.split_at_mut(index + 1);
        let body = &mut finer[index];
        match coarser.first() {
            Some(coarse) => multigrid.hierarchy().transfers[index + 1].interpolate_displacement(
                (&coarse.u, &coarse.problem.rest),
                &body.problem.rest,
                &mut body.u,
            ),
            None => body.u.copy_from_slice(&body.problem.rest),
        }
        body.problem.impose(&body.parameters, &mut body.u);
        iterations += body.solve(multigrid, index + 1);
    }
    if let Some(coarse) = bodies.first() {
        multigrid.hierarchy().transfers[0].interpolate_displacement(
            (&coarse.u, &coarse.problem.rest),
            finest_rest,
            u,
        );
    }
    iterations
}

/// Makes the body of every coarser grid, and the multigrid that serves them all.
///
/// Springs and weight become those of the coarse nodes. Prescribed nodes that coincide with a coarse node prescribe it; the others, which
/// lie inside coarse elements, hold them by springs.
pub(crate) fn carry_down(problem: &Problem, hierarchy: Hierarchy) -> (Multigrid, Vec<CoarseBody>) {
    // All first without the springs of held nodes, which are not to be carried further down.
    let mut problems: Vec<Problem> = Vec::new();
    for level in 0..hierarchy.transfers.len() {
        let finer = problems.last().unwrap_or(problem);
        let Some(coarse) = finer.coarsen(&hierarchy, level) else {
            break;
        };
        problems.push(coarse);
    }
    let mut forms = vec![problem.element_forms(&hierarchy.grids[0].elements)];
    // Prescribed nodes of the body as linear forms over the nodes of the grid at hand, with their place in the parameters.
    let mut held: Vec<(u32, Vec<u32>, Vec<f64>)> = Vec::new();
    for (place, &node) in problem.prescribed.iter().enumerate() {
        held.push((place as u32, vec![node], vec![1.0]));
    }
    let mut bodies = Vec::new();
    for (level, mut coarse) in problems.into_iter().enumerate() {
        for (_, nodes, weights) in &mut held {
            (*nodes, *weights) = hierarchy.transfers[level].restrict_form(nodes, weights);
        }
        let mut prescribed = vec![0; coarse.prescribed.len()];
        let (mut anchored, mut anchors) = (Vec::new(), Vec::new());
        for (place, nodes, weights) in &held {
            match (&nodes[..], coarse.prescribed.binary_search(&nodes[0])) {
                ([_], Ok(own)) => prescribed[own] = *place,
                _ => {
                    anchored.push(*place);
                    anchors.push((nodes.clone(), weights.clone()));
                }
            }
        }
        coarse.anchor(anchors, problem.element_size);
        forms.push(coarse.element_forms(&hierarchy.grids[level + 1].elements));
        bodies.push(CoarseBody::new(coarse, prescribed, anchored));
    }
    forms.resize(hierarchy.grids.len(), Vec::new());
    let samples = problem.rest_parameters.actuation.len() / problem.elements;
    let stiffness = (problem.elastic_stiffness, problem.volume_stiffness());
    let multigrid = Multigrid::new(hierarchy, stiffness, samples, forms);
    (multigrid, bodies)
}

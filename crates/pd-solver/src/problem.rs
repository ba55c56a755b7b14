//! The discrete problem: effects, prescribed nodes and the factored constant matrix, as functions of the nodal positions.

use crate::constant::{ConstantMatrix, ConstantSystem};
use crate::effects::{Batches, Effect, build};
use crate::error::SolverError;
use crate::krylov::LinearOperator;
use crate::solution::Work;
use crate::spec::{EffectSpec, Parameters};
use crate::vector::{NodalVector, zeros};
use hex_mesh::HexMesh;
use nalgebra::Vector3;

/// Everything the methods need to know of a body.
pub(crate) struct Problem {
    effects: Vec<Box<dyn Effect>>,
    pub(crate) system: ConstantSystem,
    pub(crate) prescribed: Vec<u32>,
    pub(crate) rest: NodalVector,
    pub(crate) rest_parameters: Parameters,
    pub(crate) element_size: f64,
    pub(crate) work: Work,
}

impl Problem {
    pub(crate) fn new(mesh: &HexMesh, specs: &[EffectSpec]) -> Result<Self, SolverError> {
        let Batches {
            effects,
            prescribed,
            rest: rest_parameters,
            anchored,
        } = build(mesh, specs)?;
        require_held(mesh, prescribed.iter().chain(&anchored))?;
        let add = |matrix: &mut ConstantMatrix| effects.iter().for_each(|e| e.add_constant(matrix));
        let size = mesh.element_size();
        let mut system = ConstantSystem::new(mesh.nodes().len(), &prescribed, add);
        system.factor(mesh.nodes(), size, add)?;
        let work = Work {
            factorisations: 1,
            matrix_nonzeros: system.nonzeros(),
            factor_entries: system.factor_entries(),
            effect_bytes: effects.iter().map(|e| e.bytes()).sum(),
            ..Work::default()
        };
        Ok(Self {
            effects,
            system,
            prescribed,
            rest: mesh.nodes().to_vec(),
            rest_parameters,
            element_size: size,
            work,
        })
    }

    /// Number of nodes.
    pub(crate) fn len(&self) -> usize {
        self.rest.len()
    }

    pub(crate) fn set_parameters(&mut self, parameters: &Parameters) {
        self.effects
            .iter_mut()
            .for_each(|e| e.set_parameters(parameters));
    }

    /// Writes the prescribed positions into `u`.
    pub(crate) fn impose(&self, parameters: &Parameters, u: &mut [Vector3<f64>]) {
        for (&node, position) in self.prescribed.iter().zip(&parameters.prescribed) {
            u[node as usize] = *position;
        }
    }

    /// Energy at `u`; `gradient` is overwritten, and zero at prescribed nodes.
    pub(crate) fn evaluate(&mut self, u: &[Vector3<f64>], gradient: &mut NodalVector) -> f64 {
        gradient.fill(Vector3::zeros());
        let mut energy = 0.0;
        for effect in &mut self.effects {
            energy += effect.energy_gradient(u, gradient);
            self.work.local_projections += effect.projections();
        }
        self.work.evaluations += 1;
        self.clear_prescribed(gradient);
        energy
    }

    pub(crate) fn linearise(&mut self, u: &[Vector3<f64>]) {
        self.effects.iter_mut().for_each(|e| e.linearise(u));
        self.work.linearisations += 1;
        self.work.smallest_pair_sum = self
            .effects
            .iter()
            .filter_map(|e| e.smallest_pair_sum())
            .reduce(f64::min);
    }

    /// `out = H x` with all rows, those of prescribed nodes too.
    pub(crate) fn full_hessian_product(&mut self, x: &[Vector3<f64>], out: &mut NodalVector) {
        out.fill(Vector3::zeros());
        self.effects
            .iter_mut()
            .for_each(|e| e.hessian_product(x, out));
        self.work.hessian_products += 1;
    }

    /// Adds `-(d gradient / d parameters)^T z` for all parameters but the prescribed positions.
    pub(crate) fn parameter_vjp(
        &mut self,
        u: &[Vector3<f64>],
        z: &[Vector3<f64>],
        out: &mut Parameters,
    ) {
        self.effects
            .iter_mut()
            .for_each(|e| e.parameter_vjp(u, z, out));
    }

    /// `out = K^-1 r`.
    pub(crate) fn constant_solve(&mut self, r: &[Vector3<f64>], out: &mut NodalVector) {
        self.system.solve(r, out);
        self.work.constant_solves += 1;
    }

    pub(crate) fn clear_prescribed(&self, x: &mut [Vector3<f64>]) {
        for &node in &self.prescribed {
            x[node as usize] = Vector3::zeros();
        }
    }

    /// Norm of the gradient over the free nodes at the rest shape, with the prescribed nodes where the parameters put them.
    pub(crate) fn gradient_norm_at_rest(&mut self, parameters: &Parameters) -> f64 {
        let mut u = self.rest.clone();
        self.impose(parameters, &mut u);
        let mut gradient = zeros(u.len());
        self.evaluate(&u, &mut gradient);
        crate::vector::norm(&gradient)
    }

    /// A gradient norm that is roundoff for this body: no method can go below it.
    pub(crate) fn gradient_floor(&self) -> f64 {
        1e-15 * self.system.stiffness_scale() * self.element_size * (self.len() as f64).sqrt()
    }
}

impl LinearOperator for Problem {
    fn apply(&mut self, x: &[Vector3<f64>], out: &mut NodalVector) {
        self.full_hessian_product(x, out);
        self.clear_prescribed(out);
    }

    fn precondition(&mut self, r: &[Vector3<f64>], out: &mut NodalVector) {
        self.constant_solve(r, out);
    }
}

/// Every connected part needs at least one node that is held, or its position is not determined.
fn require_held<'a>(
    mesh: &HexMesh,
    held: impl Iterator<Item = &'a u32>,
) -> Result<(), SolverError> {
    let mut parent: Vec<u32> = (0..mesh.nodes().len() as u32).collect();
    fn root(parent: &mut [u32], mut i: u32) -> u32 {
        while parent[i as usize] != i {
            parent[i as usize] = parent[parent[i as usize] as usize];
            i = parent[i as usize];
        }
        i
    }
    for element in mesh.elements() {
        let a = root(&mut parent, element[0]);
        for &node in &element[1..] {
            let b = root(&mut parent, node);
            parent[b as usize] = a;
        }
    }
    let mut is_held = vec![false; parent.len()];
    for &node in held {
        let r = root(&mut parent, node);
        is_held[r as usize] = true;
    }
    for node in 0..parent.len() {
        let r = root(&mut parent, node as u32);
        if !is_held[r as usize] {
            let count = (0..parent.len() as u32)
                .filter(|&i| root(&mut parent, i) == r)
                .count();
            return Err(SolverError::NotHeld { node, count });
        }
    }
    Ok(())
}

//! Shape-targeting elasticity with actuation: energy, gradient, Hessian products and the derivative by the actuation, as sums
//! over elements and their samples (maths.md "Energy, gradient, Hessian").

use super::Effect;
use super::hourglass::Hourglass;
use crate::constant::ConstantMatrix;
use crate::spec::Parameters;
use crate::vector::NodalVector;
use hex_mesh::{HexMesh, NodeElements};
use nalgebra::{Matrix3, Vector3};
use polar_grad::{Filter, HessianCore, actuation_from_b, actuation_vjp, polar_rotation};
use rayon::prelude::*;

/// Elements per task: large enough to hide the scheduling, small enough to balance two cores on a thousand elements.
const CHUNK: usize = 32;

/// Positions or forces of an element's eight corners.
pub(super) type Corners = [Vector3<f64>; 8];

/// All elements of the body in one batch.
pub(crate) struct Elasticity {
    elements: Vec<[u32; 8]>,
    incidence: NodeElements,
    /// Gradients of the corner weights at each sample; one set serves all elements, which are equal cubes.
    gradients: Vec<Corners>,
    /// Stiffness times volume share of each sample.
    weights: Vec<f64>,
    /// Holds the modes that a single sample does not see.
    hourglass: Option<Hourglass>,
    actuation: Vec<Matrix3<f64>>,
    cores: Vec<HessianCore>,
    forces: Vec<Corners>,
}

impl Elasticity {
    pub(crate) fn new(mesh: &HexMesh, stiffness: f64) -> Self {
        let rule = mesh.quadrature();
        let scale = stiffness * mesh.element_volume();
        let gradients = rule.gradients(mesh.element_size());
        let weights: Vec<f64> = rule.weights.iter().map(|w| w * scale).collect();
        let hourglass = (rule.len() == 1).then(|| Hourglass::new(mesh.element_size(), scale));
        let samples = mesh.elements().len() * rule.len();
        Self {
            elements: mesh.elements().to_vec(),
            incidence: mesh.node_elements(),
            gradients,
            weights,
            hourglass,
            actuation: vec![Matrix3::identity(); samples],
            cores: Vec::new(),
            forces: vec![Corners::default(); mesh.elements().len()],
        }
    }

    /// Runs `kernel(element, corners of x, forces)` over all elements, adds the forces to the nodes, returns the sum of what
    /// the kernel returns. Sums are taken in a fixed order, so the result does not depend on the number of threads.
    fn over_elements(
        &mut self,
        x: &[Vector3<f64>],
        out: &mut NodalVector,
        kernel: impl Fn(&Self, usize, &Corners, &mut Corners) -> f64 + Sync,
    ) -> f64 {
        let mut forces = std::mem::take(&mut self.forces);
        let this = &*self;
        let partial: Vec<f64> = forces
            .par_chunks_mut(CHUNK)
            .enumerate()
            .map(|(chunk, forces)| {
                let mut sum = 0.0;
                for (i, force) in forces.iter_mut().enumerate() {
                    let element = chunk * CHUNK + i;
                    *force = Corners::default();
                    sum += kernel(this, element, &this.gather(element, x), force);
                }
                sum
            })
            .collect();
        out.par_iter_mut()
            .with_min_len(512)
            .enumerate()
            .for_each(|(node, out)| {
                for at in this.incidence.at(node) {
                    *out += forces[at.element as usize][at.corner as usize];
                }
            });
        self.forces = forces;
        partial.iter().sum()
    }

    fn gather(&self, element: usize, x: &[Vector3<f64>]) -> Corners {
        self.elements[element].map(|node| x[node as usize])
    }

    fn samples(&self) -> usize {
        self.weights.len()
    }

    fn add_hourglass(&self, x: &Corners, force: &mut Corners) -> f64 {
        self.hourglass.as_ref().map_or(0.0, |h| h.add(x, force))
    }
}

/// `sum_q w_q g_a . g_b`: one element's block of the constant matrix.
pub(super) fn stiffness_block(gradients: &[Corners], weights: &[f64]) -> [[f64; 8]; 8] {
    let entry = |a: usize, b: usize| -> f64 {
        let samples = gradients.iter().zip(weights);
        samples.map(|(g, w)| w * g[a].dot(&g[b])).sum()
    };
    std::array::from_fn(|a| std::array::from_fn(|b| entry(a, b)))
}

/// F = sum_n x_n (dw_n/dx)^T, the deformation gradient when `x` holds positions.
fn deformation_gradient(x: &Corners, g: &Corners) -> Matrix3<f64> {
    let mut f = Matrix3::zeros();
    for (x, g) in x.iter().zip(g) {
        f.ger(1.0, x, g, 1.0);
    }
    f
}

/// The deformation gradient at every sample, `[elements * samples]`, for positions of all nodes.
///
/// # Panics
/// When `positions` has not one entry per node.
pub fn deformation_gradients(mesh: &HexMesh, positions: &[Vector3<f64>]) -> Vec<Matrix3<f64>> {
    assert_eq!(positions.len(), mesh.nodes().len(), "one position per node");
    let gradients = mesh.quadrature().gradients(mesh.element_size());
    let of_element = |nodes: &[u32; 8]| {
        let x = nodes.map(|node| positions[node as usize]);
        gradients.iter().map(move |g| deformation_gradient(&x, g)).collect::<Vec<_>>()
    };
    mesh.elements().iter().flat_map(of_element).collect()
}

/// Adds `w P g_n` to the force of every corner: the transpose of [`deformation_gradient`].
fn scatter(p: &Matrix3<f64>, w: f64, g: &Corners, force: &mut Corners) {
    let p = p * w;
    for (force, g) in force.iter_mut().zip(g) {
        *force += p * g;
    }
}

impl Effect for Elasticity {
    fn add_constant(&self, matrix: &mut ConstantMatrix) {
        let mut block = stiffness_block(&self.gradients, &self.weights);
        if let Some(hourglass) = &self.hourglass {
            hourglass.add_block(&mut block);
        }
        for nodes in &self.elements {
            matrix.add_block(nodes, |a, b| block[a][b]);
        }
    }

    fn set_parameters(&mut self, parameters: &Parameters) {
        self.actuation
            .par_iter_mut()
            .zip(&parameters.actuation)
            .with_min_len(1024)
            .for_each(|(a, b)| *a = actuation_from_b(b));
    }

    fn energy_gradient(&mut self, u: &[Vector3<f64>], gradient: &mut NodalVector) -> f64 {
        self.over_elements(u, gradient, |this, element, x, force| {
            let mut energy = this.add_hourglass(x, force);
            let first = element * this.samples();
            for (q, (g, &w)) in this.gradients.iter().zip(&this.weights).enumerate() {
                let f = deformation_gradient(x, g);
                let a = &this.actuation[first + q];
                let p = f - polar_rotation(&(f * a)) * a;
                energy += 0.5 * w * p.norm_squared();
                scatter(&p, w, g, force);
            }
            energy
        })
    }

    fn linearise(&mut self, u: &[Vector3<f64>], filter: Filter) {
        let mut cores = std::mem::take(&mut self.cores);
        let samples = self.samples();
        let unset = HessianCore::new(&Matrix3::identity(), &Matrix3::identity());
        cores.resize(self.actuation.len(), unset);
        let this = &*self;
        cores
            .par_chunks_mut(samples)
            .with_min_len(CHUNK)
            .enumerate()
            .for_each(|(element, cores)| {
                let x = this.gather(element, u);
                for (q, (core, g)) in cores.iter_mut().zip(&this.gradients).enumerate() {
                    let a = &this.actuation[element * samples + q];
                    let exact = HessianCore::new(&deformation_gradient(&x, g), a);
                    *core = match filter {
                        Filter::Exact => exact,
                        other => exact.filtered(other),
                    };
                }
            });
        self.cores = cores;
    }

    fn hessian_product(&mut self, x: &[Vector3<f64>], out: &mut NodalVector) {
        self.over_elements(x, out, |this, element, x, force| {
            this.add_hourglass(x, force);
            let first = element * this.samples();
            for (q, (g, &w)) in this.gradients.iter().zip(&this.weights).enumerate() {
                let d_p = this.cores[first + q].apply(&deformation_gradient(x, g));
                scatter(&d_p, w, g, force);
            }
            0.0
        });
    }

    fn parameter_vjp(&mut self, u: &[Vector3<f64>], z: &[Vector3<f64>], out: &mut Parameters) {
        let (this, samples) = (&*self, self.samples());
        out.actuation
            .par_chunks_mut(samples)
            .with_min_len(CHUNK)
            .enumerate()
            .for_each(|(element, out)| {
                let (x, z) = (this.gather(element, u), this.gather(element, z));
                for (q, out) in out.iter_mut().enumerate() {
                    let g = &this.gradients[q];
                    let core = &this.cores[element * samples + q];
                    let (f, y) = (deformation_gradient(&x, g), deformation_gradient(&z, g));
                    let b_bar = actuation_vjp(core, &f, &y);
                    for (out, b) in out.iter_mut().zip(b_bar) {
                        *out += this.weights[q] * b;
                    }
                }
            });
    }

    fn projections(&self) -> u64 {
        self.actuation.len() as u64
    }

    fn smallest_pair_sum(&self) -> Option<f64> {
        let sums = self.cores.iter().map(|c| c.gradient.smallest_pair_sum);
        sums.reduce(f64::min)
    }

    fn bytes(&self) -> usize {
        size_of_val(self.elements.as_slice())
            + size_of_val(self.incidence.corners())
            + size_of_val(self.incidence.offsets())
            + size_of_val(self.actuation.as_slice())
            + self.cores.capacity() * size_of::<HessianCore>()
            + size_of_val(self.forces.as_slice())
    }
}

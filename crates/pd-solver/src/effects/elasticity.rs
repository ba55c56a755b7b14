//! Shape-targeting elasticity with actuation: energy, gradient, Hessian products and the derivative by the actuation, as sums
//! over elements and their samples (maths.md "Energy, gradient, Hessian").

use super::Effect;
use super::hourglass::Hourglass;
use super::kernel::{
    Actuation, GROUP, Linearisation, SampleGroup, deformation_gradient, energy_gradient,
    hessian_product, no_forces,
};
use crate::constant::ConstantMatrix;
use crate::spec::Parameters;
use crate::vector::NodalVector;
use hex_mesh::{HexMesh, NodeElements};
use nalgebra::{Matrix3, Vector3};
use polar_grad::{Filter, HessianCore, actuation_vjp};
use pulp::{Arch, Simd, WithSimd};
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
    /// The same, side by side for the kernels.
    groups: Vec<SampleGroup>,
    /// Holds the modes that a single sample does not see.
    hourglass: Option<Hourglass>,
    /// `[elements * groups]`.
    actuation: Vec<Actuation>,
    /// `[elements * groups]`, empty before the first linearisation.
    linearisation: Vec<Linearisation>,
    smallest_pair_sum: Option<f64>,
    forces: Vec<Corners>,
}

impl Elasticity {
    pub(crate) fn new(mesh: &HexMesh, stiffness: f64) -> Self {
        let rule = mesh.quadrature();
        let scale = stiffness * mesh.element_volume();
        let gradients = rule.gradients(mesh.element_size());
        let weights: Vec<f64> = rule.weights.iter().map(|w| w * scale).collect();
        let hourglass = (rule.len() == 1).then(|| Hourglass::new(mesh.element_size(), scale));
        let groups = SampleGroup::all(&gradients, &weights);
        let elements = mesh.elements().to_vec();
        let at_rest = Actuation::new(&[[0.0; 6]]);
        Self {
            incidence: mesh.node_elements(),
            actuation: vec![at_rest; elements.len() * groups.len()],
            linearisation: Vec::new(),
            smallest_pair_sum: None,
            forces: vec![no_forces(); elements.len()],
            elements,
            gradients,
            weights,
            groups,
            hourglass,
        }
    }

    /// Runs `kernel` over all elements, adds the forces to the nodes, and returns the sum of the energies. Sums are taken in a
    /// fixed order, so the result does not depend on the number of threads.
    fn over_elements(
        &mut self,
        x: &[Vector3<f64>],
        out: &mut NodalVector,
        kernel: impl ElementKernel,
    ) -> f64 {
        let mut forces = std::mem::take(&mut self.forces);
        let this = &*self;
        let arch = Arch::new();
        let partial: Vec<f64> = forces
            .par_chunks_mut(CHUNK)
            .enumerate()
            .map(|(chunk, forces)| {
                let first = chunk * CHUNK;
                arch.dispatch(OverChunk {
                    this,
                    kernel: &kernel,
                    first,
                    x,
                    forces,
                })
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

    #[inline(always)]
    fn gather(&self, element: usize, x: &[Vector3<f64>]) -> Corners {
        self.elements[element].map(|node| x[node as usize])
    }

    fn samples(&self) -> usize {
        self.weights.len()
    }

    /// The core of one sample, exact.
    fn core(&self, element: usize, sample: usize, x: &Corners) -> (Matrix3<f64>, HessianCore) {
        let f = deformation_gradient(x, &self.gradients[sample]);
        let group = element * self.groups.len() + sample / GROUP;
        let a = self.actuation[group].matrix(sample % GROUP);
        (f, HessianCore::new(&f, &a))
    }
}

/// What is done in one element: forces from corner values, and an energy where there is one.
trait ElementKernel: Sync {
    fn run<S: Simd>(
        &self,
        simd: S,
        this: &Elasticity,
        element: usize,
        x: &Corners,
        force: &mut Corners,
    ) -> f64;
}

/// Energy and its gradient.
struct EnergyGradient;

impl ElementKernel for EnergyGradient {
    #[inline(always)]
    fn run<S: Simd>(
        &self,
        simd: S,
        this: &Elasticity,
        element: usize,
        x: &Corners,
        force: &mut Corners,
    ) -> f64 {
        let first = element * this.groups.len();
        let groups = this.groups.iter().zip(&this.actuation[first..]);
        let mut energy = 0.0;
        for (group, actuation) in groups {
            energy += energy_gradient(simd, group, actuation, x, force);
        }
        energy
    }
}

/// The product of the Hessian with a direction.
struct HessianProduct;

impl ElementKernel for HessianProduct {
    #[inline(always)]
    fn run<S: Simd>(
        &self,
        simd: S,
        this: &Elasticity,
        element: usize,
        x: &Corners,
        force: &mut Corners,
    ) -> f64 {
        let first = element * this.groups.len();
        let states = this.actuation[first..]
            .iter()
            .zip(&this.linearisation[first..]);
        for (group, (actuation, at)) in this.groups.iter().zip(states) {
            hessian_product(simd, group, actuation, at, x, force);
        }
        0.0
    }
}

/// A kernel over the elements of one task.
struct OverChunk<'a, K> {
    this: &'a Elasticity,
    kernel: &'a K,
    first: usize,
    x: &'a [Vector3<f64>],
    forces: &'a mut [Corners],
}

impl<K: ElementKernel> WithSimd for OverChunk<'_, K> {
    type Output = f64;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> f64 {
        let mut sum = 0.0;
        for (i, force) in self.forces.iter_mut().enumerate() {
            let x = self.this.gather(self.first + i, self.x);
            *force = no_forces();
            if let Some(hourglass) = &self.this.hourglass {
                sum += hourglass.add(&x, force);
            }
            sum += self.kernel.run(simd, self.this, self.first + i, &x, force);
        }
        sum
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

/// The deformation gradient at every sample, `[elements * samples]`, for positions of all nodes.
///
/// # Panics
/// When `positions` has not one entry per node.
pub fn deformation_gradients(mesh: &HexMesh, positions: &[Vector3<f64>]) -> Vec<Matrix3<f64>> {
    assert_eq!(positions.len(), mesh.nodes().len(), "one position per node");
    let gradients = mesh.quadrature().gradients(mesh.element_size());
    let of_element = |nodes: &[u32; 8]| {
        let x = nodes.map(|node| positions[node as usize]);
        gradients
            .iter()
            .map(move |g| deformation_gradient(&x, g))
            .collect::<Vec<_>>()
    };
    mesh.elements().iter().flat_map(of_element).collect()
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
        let (samples, groups) = (self.samples(), self.groups.len());
        self.actuation
            .par_chunks_mut(groups)
            .zip(parameters.actuation.par_chunks(samples))
            .with_min_len(CHUNK)
            .for_each(|(out, b)| {
                for (out, b) in out.iter_mut().zip(b.chunks(GROUP)) {
                    *out = Actuation::new(b);
                }
            });
    }

    fn energy_gradient(&mut self, u: &[Vector3<f64>], gradient: &mut NodalVector) -> f64 {
        self.over_elements(u, gradient, EnergyGradient)
    }

    fn linearise(&mut self, u: &[Vector3<f64>], filter: Filter) {
        let groups = self.groups.len();
        let linearise = |this: &Self, element: usize| {
            let x = this.gather(element, u);
            let cores: Vec<HessianCore> = (0..this.samples())
                .map(|q| this.core(element, q, &x).1.filtered(filter))
                .collect();
            let sums = cores.iter().map(|c| c.gradient.smallest_pair_sum);
            let smallest = sums.fold(f64::INFINITY, f64::min);
            let of_groups: Vec<_> = cores.chunks(GROUP).map(Linearisation::new).collect();
            (of_groups, smallest)
        };
        let mut all = std::mem::take(&mut self.linearisation);
        all.resize(self.actuation.len(), Linearisation::unset());
        let this = &*self;
        let smallest = all
            .par_chunks_mut(groups)
            .with_min_len(CHUNK)
            .enumerate()
            .map(|(element, out)| {
                let (new, smallest) = linearise(this, element);
                out.copy_from_slice(&new);
                smallest
            })
            .reduce(|| f64::INFINITY, f64::min);
        self.linearisation = all;
        self.smallest_pair_sum = Some(smallest);
    }

    fn hessian_product(&mut self, x: &[Vector3<f64>], out: &mut NodalVector) {
        self.over_elements(x, out, HessianProduct);
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
                    let (f, core) = this.core(element, q, &x);
                    let y = deformation_gradient(&z, &this.gradients[q]);
                    let b_bar = actuation_vjp(&core, &f, &y);
                    for (out, b) in out.iter_mut().zip(b_bar) {
                        *out += this.weights[q] * b;
                    }
                }
            });
    }

    fn projections(&self) -> u64 {
        (self.elements.len() * self.samples()) as u64
    }

    fn smallest_pair_sum(&self) -> Option<f64> {
        self.smallest_pair_sum
    }

    fn bytes(&self) -> usize {
        size_of_val(self.elements.as_slice())
            + size_of_val(self.incidence.corners())
            + size_of_val(self.incidence.offsets())
            + size_of_val(self.actuation.as_slice())
            + size_of_val(self.linearisation.as_slice())
            + size_of_val(self.forces.as_slice())
    }
}

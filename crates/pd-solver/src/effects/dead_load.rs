//! Forces that keep their direction and strength whatever the body does: weight, forces on patches of the surface, wind.

use super::{CoarseView, Effect};
use crate::constant::ConstantMatrix;
use crate::parameters::Parameters;
use crate::surface::EmbeddedSurface;
use crate::vector::NodalVector;
use hex_mesh::HexMesh;
use nalgebra::Vector3;

/// Which list of [`Parameters`] a load takes its vector from.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Loads {
    /// [`Parameters::acceleration`].
    Gravity,
    /// [`Parameters::forces`].
    Forces,
}

impl Loads {
    fn of(self, parameters: &mut Parameters) -> &mut Vec<Vector3<f64>> {
        match self {
            Self::Gravity => &mut parameters.acceleration,
            Self::Forces => &mut parameters.forces,
        }
    }
}

/// Energy `-sum_n s_n vector . u_n` with a share s of each node.
pub(crate) struct DeadLoad {
    shares: Vec<f64>,
    vector: Vector3<f64>,
    list: Loads,
    slot: usize,
}

impl DeadLoad {
    /// `slot` is this effect's place in its list.
    pub(crate) fn new(shares: Vec<f64>, vector: Vector3<f64>, list: Loads, slot: usize) -> Self {
        Self {
            shares,
            vector,
            list,
            slot,
        }
    }

    /// The mass of each node: that of every element shared by its eight nodes, which is the exact integral of a constant density over
    /// trilinear elements.
    pub(crate) fn masses(mesh: &HexMesh, density: f64) -> Vec<f64> {
        let share = density * mesh.element_volume() / 8.0;
        let incidence = mesh.node_elements();
        (0..mesh.nodes().len())
            .map(|node| incidence.at(node).len() as f64 * share)
            .collect()
    }

    /// Shares of a force on a patch of the surface, by the area at rest that each vertex has in the patch; they sum to 1.
    pub(crate) fn shares_of_patch(
        mesh: &HexMesh,
        surface: &EmbeddedSurface,
        patch: &[bool],
    ) -> Vec<f64> {
        let mut shares = on_nodes(mesh, surface, patch, |area| area.norm());
        let total: f64 = shares.iter().sum();
        // A patch of single vertices has no area: these share alike.
        if total <= 0.0 {
            shares = vec![0.0; mesh.nodes().len()];
            let count = patch.iter().filter(|p| **p).count() as f64;
            for (point, _) in surface.points.iter().zip(patch).filter(|(_, p)| **p) {
                add_point(mesh, point, 1.0 / count, &mut shares);
            }
            return shares;
        }
        shares.iter_mut().for_each(|s| *s /= total);
        shares
    }

    /// Area at rest of what faces a wind, across the wind, as shares of the nodes.
    pub(crate) fn areas_facing(
        mesh: &HexMesh,
        surface: &EmbeddedSurface,
        patch: &[bool],
        wind: &Vector3<f64>,
    ) -> Vec<f64> {
        let towards = wind.try_normalize(0.0).unwrap_or_default();
        on_nodes(mesh, surface, patch, |area| (-area.dot(&towards)).max(0.0))
    }
}

/// Sums what `of_area` makes of the area vectors of the triangles in a patch, a third for each vertex, over the nodes that carry them.
fn on_nodes(
    mesh: &HexMesh,
    surface: &EmbeddedSurface,
    patch: &[bool],
    of_area: impl Fn(Vector3<f64>) -> f64,
) -> Vec<f64> {
    let rest = surface.positions(mesh, mesh.nodes());
    let mut shares = vec![0.0; mesh.nodes().len()];
    for triangle in &surface.triangles {
        let [a, b, c] = triangle.map(|v| rest[v as usize]);
        if !triangle.iter().all(|&v| patch[v as usize]) {
            continue;
        }
        let share = of_area((b - a).cross(&(c - a)) / 2.0) / 3.0;
        for &v in triangle {
            add_point(mesh, &surface.points[v as usize], share, &mut shares);
        }
    }
    shares
}

fn add_point(mesh: &HexMesh, point: &hex_mesh::EmbeddedPoint, share: f64, out: &mut [f64]) {
    let corners = mesh.elements()[point.element as usize].iter();
    for (&node, w) in corners.zip(&point.weights) {
        out[node as usize] += share * w;
    }
}

impl Effect for DeadLoad {
    fn add_constant(&self, _matrix: &mut ConstantMatrix) {}

    fn set_parameters(&mut self, parameters: &Parameters) {
        let list = match self.list {
            Loads::Gravity => &parameters.acceleration,
            Loads::Forces => &parameters.forces,
        };
        self.vector = list[self.slot];
    }

    fn energy_gradient(&mut self, u: &[Vector3<f64>], gradient: &mut NodalVector) -> f64 {
        let mut energy = 0.0;
        for ((share, u), g) in self.shares.iter().zip(u).zip(gradient) {
            energy -= share * self.vector.dot(u);
            *g -= self.vector * *share;
        }
        energy
    }

    fn linearise(&mut self, _u: &[Vector3<f64>]) {}

    fn hessian_product(&mut self, _x: &[Vector3<f64>], _out: &mut NodalVector) {}

    fn parameter_vjp(&mut self, _u: &[Vector3<f64>], z: &[Vector3<f64>], out: &mut Parameters) {
        let weighted = self.shares.iter().zip(z).map(|(share, z)| z * *share);
        self.list.of(out)[self.slot] += weighted.sum::<Vector3<f64>>();
    }

    fn coarsen(&self, view: &CoarseView) -> Option<Box<dyn Effect>> {
        Some(Box::new(Self {
            shares: view.transfer.restrict_scalars(&self.shares),
            ..*self
        }))
    }

    fn bytes(&self) -> usize {
        std::mem::size_of_val(self.shares.as_slice())
    }
}

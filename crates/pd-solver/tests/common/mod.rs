//! What the tests of this crate share: small bodies, reproducible numbers, finite differences.
#![allow(dead_code)] // Each test program uses its own part.

use hex_mesh::{HexMesh, Quadrature};
use nalgebra::Vector3;
use pd_solver::{EffectSpec, EmbeddedSurface, NodeSet, Parameters, SolveOptions, Solver, Stop};

/// Reproducible numbers in [-1, 1] (SplitMix64).
pub struct Numbers(u64);

impl Numbers {
    pub fn new(seed: u64) -> Self {
        Self(seed)
    }

    pub fn next(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        ((z ^ (z >> 31)) >> 11) as f64 / (1u64 << 52) as f64 - 1.0
    }

    pub fn vector(&mut self) -> Vector3<f64> {
        Vector3::new(self.next(), self.next(), self.next())
    }

    pub fn vectors(&mut self, n: usize, scale: f64) -> Vec<Vector3<f64>> {
        (0..n).map(|_| self.vector() * scale).collect()
    }

    pub fn actuation(&mut self, n: usize, scale: f64) -> Vec<[f64; 6]> {
        (0..n)
            .map(|_| std::array::from_fn(|_| self.next() * scale))
            .collect()
    }
}

/// A small box of edge 0.25 whose cells are cubes, nodes with x = 0 first in index order.
pub fn small_box(quadrature: Quadrature) -> HexMesh {
    HexMesh::solid_box([4, 3, 2], 0.25, quadrature).expect("a valid box")
}

/// Nodes whose rest position satisfies a condition.
pub fn nodes_where(mesh: &HexMesh, keep: impl Fn(&Vector3<f64>) -> bool) -> Vec<u32> {
    (0..mesh.nodes().len() as u32)
        .filter(|&i| keep(&mesh.nodes()[i as usize]))
        .collect()
}

pub fn elasticity() -> EffectSpec {
    EffectSpec::Elasticity { stiffness: 1.0 }
}

pub fn held(nodes: Vec<u32>) -> EffectSpec {
    EffectSpec::Prescribed {
        nodes: NodeSet::Indices(nodes),
    }
}

/// The box held at x = 0.
pub fn clamped_box(quadrature: Quadrature) -> (HexMesh, Solver) {
    let mesh = small_box(quadrature);
    let wall = nodes_where(&mesh, |x| x.x == 0.0);
    let solver = Solver::new(&mesh, &[elasticity(), held(wall)]).expect("a valid problem");
    (mesh, solver)
}

/// As tight as floating point allows.
pub fn tight() -> SolveOptions {
    SolveOptions::new(Stop::RelativeGradient(1e-13))
}

/// Fourth-order central difference of `f` at zero.
pub fn difference(step: f64, mut f: impl FnMut(f64) -> f64) -> f64 {
    let near = f(step) - f(-step);
    let far = f(2.0 * step) - f(-2.0 * step);
    (8.0 * near - far) / (12.0 * step)
}

pub fn dot(a: &[Vector3<f64>], b: &[Vector3<f64>]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a.dot(b)).sum()
}

pub fn max_distance(a: &[Vector3<f64>], b: &[Vector3<f64>]) -> f64 {
    a.iter()
        .zip(b)
        .map(|(a, b)| (a - b).norm())
        .fold(0.0, f64::max)
}

/// The boundary of a mesh as triangles, counter-clockwise seen from outside, with a vertex at each of its nodes.
pub fn boundary(mesh: &HexMesh) -> EmbeddedSurface {
    EmbeddedSurface::boundary(mesh)
}

/// A column whose ends are pressed together along its axis to a share of its length, with more effects; and where it stays straight, which is a saddle.
pub fn pressed_column(
    pressed: f64,
    extra: Vec<EffectSpec>,
) -> (HexMesh, Solver, Parameters, Vec<Vector3<f64>>) {
    let mesh = HexMesh::solid_box([12, 2, 2], 0.1, Quadrature::Eight).unwrap();
    let ends = nodes_where(&mesh, |x| x.x == 0.0 || x.x > 1.19);
    let mut effects = vec![elasticity(), held(ends)];
    effects.extend(extra);
    let solver = Solver::on_surface(&mesh, &boundary(&mesh), &effects).unwrap();
    let mut parameters = solver.rest_parameters();
    for x in &mut parameters.prescribed {
        x.x *= pressed;
    }
    let straight = { mesh.nodes().iter() }.map(|x| Vector3::new(pressed * x.x, x.y, x.z));
    let straight = straight.collect();
    (mesh, solver, parameters, straight)
}

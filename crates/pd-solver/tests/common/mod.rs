//! What the tests of this crate share: small bodies, reproducible numbers, finite differences.
#![allow(dead_code)] // Each test program uses its own part.

use hex_mesh::{EmbeddedPoint, HexMesh, Quadrature};
use nalgebra::Vector3;
use pd_solver::{EffectSpec, EmbeddedSurface, NodeSet, SolveOptions, Solver, Stop};
use std::collections::BTreeMap;

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
    // Corners of the faces, x slowest; each counter-clockwise from outside.
    const FACES: [[usize; 4]; 6] = [
        [0, 1, 3, 2],
        [4, 6, 7, 5],
        [0, 4, 5, 1],
        [2, 3, 7, 6],
        [0, 2, 6, 4],
        [1, 5, 7, 3],
    ];
    let mut faces: BTreeMap<[u32; 4], ([u32; 4], usize)> = BTreeMap::new();
    for nodes in mesh.elements() {
        for face in FACES {
            let face = face.map(|c| nodes[c]);
            let mut key = face;
            key.sort_unstable();
            faces.entry(key).or_insert((face, 0)).1 += 1;
        }
    }
    let mut vertex = BTreeMap::new();
    let mut points = Vec::new();
    let mut triangles = Vec::new();
    let mut carrier = vec![None; mesh.nodes().len()];
    for (element, nodes) in mesh.elements().iter().enumerate() {
        for (corner, &n) in nodes.iter().enumerate() {
            carrier[n as usize] = Some((element as u32, corner));
        }
    }
    for (face, _) in faces.into_values().filter(|(_, count)| *count == 1) {
        let corners = face.map(|node| {
            *vertex.entry(node).or_insert_with(|| {
                let (element, corner) = carrier[node as usize].expect("a node has an element");
                let mut weights = [0.0; 8];
                weights[corner] = 1.0;
                points.push(EmbeddedPoint { element, weights });
                points.len() as u32 - 1
            })
        });
        let [a, b, c, d] = corners;
        triangles.extend([[a, b, c], [a, c, d]]);
    }
    EmbeddedSurface { points, triangles }
}

//! Bodies of cells with the surface of their boundary, and a test for crossings that knows nothing of the solver's.

#![allow(dead_code)] // Each test program uses its own part.

use hex_mesh::{HexMesh, Quadrature};
use nalgebra::Vector3;
use pd_solver::EmbeddedSurface;

/// Vertices and triangles.
pub type Sheet<'a> = (&'a [Vector3<f64>], &'a [[u32; 3]]);

/// The cells between two corners.
pub fn block(low: [i32; 3], high: [i32; 3]) -> Vec<[i32; 3]> {
    let mut cells = Vec::new();
    for x in low[0]..high[0] {
        for y in low[1]..high[1] {
            cells.extend((low[2]..high[2]).map(|z| [x, y, z]));
        }
    }
    cells
}

/// A body of cells.
pub fn lattice(cells: Vec<[i32; 3]>, size: f64) -> HexMesh {
    HexMesh::from_cells(cells, Vector3::zeros(), size, Quadrature::Eight).expect("a valid body")
}

/// The boundary of a body, each face of a cell as two triangles.
pub fn skin(mesh: &HexMesh) -> EmbeddedSurface {
    EmbeddedSurface::boundary(mesh)
}

/// A box-shaped obstacle between two corners.
pub fn stamp(low: [f64; 3], high: [f64; 3], n: i32) -> (Vec<[f64; 3]>, Vec<[u32; 3]>) {
    let mesh = lattice(block([0, 0, 0], [n, n, n]), 1.0 / f64::from(n));
    let surface = skin(&mesh);
    let vertices = surface.points.iter().map(|p| {
        let corners = mesh.elements()[p.element as usize].iter().zip(&p.weights);
        let x: Vector3<f64> = corners.map(|(&n, w)| mesh.nodes()[n as usize] * *w).sum();
        std::array::from_fn(|k| low[k] + (high[k] - low[k]) * x[k])
    });
    (vertices.collect(), surface.triangles)
}

/// Pairs of triangles that cross: of the surface with itself, or with an obstacle. Each edge of either against the other, by signed volumes, for
/// triangles without a common corner.
pub fn crossings(
    surface: &EmbeddedSurface,
    mesh: &HexMesh,
    u: &[Vector3<f64>],
    obstacle: Option<Sheet>,
) -> usize {
    let at = |p: &hex_mesh::EmbeddedPoint| -> Vector3<f64> {
        let corners = mesh.elements()[p.element as usize].iter().zip(&p.weights);
        corners.map(|(&n, w)| u[n as usize] * *w).sum()
    };
    let mut x: Vec<Vector3<f64>> = surface.points.iter().map(at).collect();
    let mut triangles = surface.triangles.clone();
    let own = triangles.len();
    if let Some((vertices, others)) = obstacle {
        let first = x.len() as u32;
        x.extend_from_slice(vertices);
        triangles.extend(others.iter().map(|t| t.map(|v| v + first)));
    }
    let mut found = 0;
    for (i, s) in triangles.iter().enumerate().take(own) {
        for t in &triangles[i + 1..] {
            if s.iter().any(|v| t.contains(v)) {
                continue;
            }
            let edges = |t: &[u32; 3]| [(t[0], t[1]), (t[1], t[2]), (t[2], t[0])];
            let one = edges(s).iter().any(|e| through(&x, *e, t));
            let other = edges(t).iter().any(|e| through(&x, *e, s));
            found += usize::from(one || other);
        }
    }
    found
}

fn through(x: &[Vector3<f64>], (p, q): (u32, u32), t: &[u32; 3]) -> bool {
    let at = |v: u32| x[v as usize];
    let volume = |a: u32, b: u32, c: u32, d: u32| {
        nalgebra::Matrix3::from_columns(&[at(b) - at(a), at(c) - at(a), at(d) - at(a)])
            .determinant()
    };
    let [a, b, c] = *t;
    let (above, below) = (volume(a, b, c, p), volume(a, b, c, q));
    // Triangles of one plane are on either side of each other by roundoff.
    if above * below >= 0.0 || above.abs().max(below.abs()) < 1e-15 {
        return false;
    }
    let turns = [volume(p, q, a, b), volume(p, q, b, c), volume(p, q, c, a)];
    turns.iter().all(|v| *v >= 0.0) || turns.iter().all(|v| *v <= 0.0)
}

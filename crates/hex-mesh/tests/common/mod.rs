//! What several test files share.
#![allow(dead_code)]

use nalgebra::Vector3;
use surface_mesh::Surface;

/// Small reproducible numbers in [0, 1) without a dependency (splitmix64).
pub struct Numbers(pub u64);

impl Numbers {
    pub fn unit(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ z >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ z >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ z >> 31) >> 11) as f64 / (1_u64 << 53) as f64
    }

    pub fn signed(&mut self) -> f64 {
        2.0 * self.unit() - 1.0
    }

    pub fn vector(&mut self) -> Vector3<f64> {
        Vector3::from_fn(|_, _| self.signed())
    }

    pub fn vectors(&mut self, count: usize) -> Vec<Vector3<f64>> {
        (0..count).map(|_| self.vector()).collect()
    }
}

/// The surface moved by an offset.
pub fn moved(surface: &Surface, offset: Vector3<f64>) -> Surface {
    let vertices = surface.vertices().iter().map(|v| v + offset).collect();
    surface.with_vertices(vertices).unwrap()
}

/// Both surfaces as one.
pub fn joined(a: &Surface, b: &Surface) -> Surface {
    let shift = a.vertices().len() as u32;
    let shifted = b.triangles().iter().map(|t| t.map(|vertex| vertex + shift));
    let vertices = [a.vertices(), b.vertices()].concat();
    let triangles = a.triangles().iter().copied().chain(shifted).collect();
    Surface::from_triangles(vertices, triangles).unwrap()
}

/// A shared shape, or `None` with a note when the data set is not there.
pub fn data_shape(path: &str) -> Option<Surface> {
    let root = concat!(env!("CARGO_MANIFEST_DIR"), "/../../../shared/data");
    let file = std::path::Path::new(root).join(path);
    if !file.exists() {
        eprintln!("skipped: no {path} in the shared data");
        return None;
    }
    Some(surface_mesh::read_obj(&file).unwrap())
}

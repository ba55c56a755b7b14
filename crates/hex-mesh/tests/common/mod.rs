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

/// A file of the shared data, or `None` with a note when it is not there.
pub fn data_file(path: &str) -> Option<std::path::PathBuf> {
    let root = concat!(env!("CARGO_MANIFEST_DIR"), "/../../../shared/data");
    let file = std::path::Path::new(root).join(path);
    if !file.exists() {
        eprintln!("skipped: no {path} in the shared data");
        return None;
    }
    Some(file)
}

/// A shared shape, or `None` with a note when the data set is not there.
pub fn data_shape(path: &str) -> Option<Surface> {
    Some(surface_mesh::read_obj(data_file(path)?).unwrap())
}

/// The boundary of the blocks for which `filled` holds, between planes along each axis. Planes need not rise: where they turn back,
/// the body overlaps itself.
pub fn blocks(planes: [&[f64]; 3], filled: impl Fn([usize; 3]) -> bool) -> Surface {
    let counts = planes.map(<[f64]>::len);
    let index = |p: [usize; 3]| ((p[0] * counts[1] + p[1]) * counts[2] + p[2]) as u32;
    let is_filled = |block: [usize; 3]| (0..3).all(|a| block[a] + 1 < counts[a]) && filled(block);
    let mut vertices = Vec::new();
    let mut triangles = Vec::new();
    for code in 0..counts.iter().product::<usize>() {
        let at = [
            code / counts[2] / counts[1],
            code / counts[2] % counts[1],
            code % counts[2],
        ];
        vertices.push(Vector3::from_fn(|a, _| planes[a][at[a]]));
        for axis in 0..3 {
            let mut below = at;
            below[axis] = below[axis].wrapping_sub(1);
            let sides = [at[axis] > 0 && is_filled(below), is_filled(at)];
            if sides[0] == sides[1] {
                continue;
            }
            let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
            let corner = |du: usize, dv: usize| {
                let mut corner = at;
                corner[u] += du;
                corner[v] += dv;
                index(corner)
            };
            let mut quad = [corner(0, 0), corner(1, 0), corner(1, 1), corner(0, 1)];
            if sides[1] {
                quad.reverse();
            }
            let [a, b, c, d] = quad;
            triangles.extend([[a, b, c], [a, c, d]]);
        }
    }
    let used: std::collections::BTreeSet<u32> = triangles.iter().flatten().copied().collect();
    let rank = |vertex: u32| used.range(..vertex).count() as u32;
    let triangles = triangles.iter().map(|t| t.map(rank)).collect();
    let vertices = used.iter().map(|&vertex| vertices[vertex as usize]);
    Surface::from_triangles(vertices.collect(), triangles).unwrap()
}

/// Whether two elements have a node in common.
pub fn share_node(mesh: &hex_mesh::HexMesh, a: u32, b: u32) -> bool {
    let [a, b] = [a, b].map(|element| mesh.elements()[element as usize]);
    a.iter().any(|node| b.contains(node))
}

/// The shortest path from one element to another, both included, over elements that share a node; empty when there is none.
pub fn path(mesh: &hex_mesh::HexMesh, from: u32, to: u32) -> Vec<u32> {
    let around = mesh.node_elements();
    let mut before = vec![u32::MAX; mesh.elements().len()];
    before[to as usize] = to;
    let mut queue = std::collections::VecDeque::from([to]);
    while let Some(element) = queue.pop_front() {
        for &node in &mesh.elements()[element as usize] {
            for corner in around.at(node as usize) {
                if before[corner.element as usize] == u32::MAX {
                    before[corner.element as usize] = element;
                    queue.push_back(corner.element);
                }
            }
        }
    }
    let mut path = Vec::new();
    let mut at = from;
    while before[at as usize] != u32::MAX {
        path.push(at);
        if at == to {
            return path;
        }
        at = before[at as usize];
    }
    Vec::new()
}

//! Triangle quality on an implicit surface: edge flips towards Delaunay, tangential smoothing, Newton projection.

use std::collections::HashSet;

use nalgebra::Vector3;

use crate::StarfishBody;

const ROUNDS: usize = 12;
const SMOOTHINGS_PER_ROUND: usize = 4;
/// Newton steps after each smoothing; the last projection goes on to rounding.
const ROUGH_STEPS: usize = 2;
const FINAL_STEPS: usize = 30;

/// Splits quads along their shorter diagonals.
pub(crate) fn split(vertices: &[Vector3<f64>], quads: &[[u32; 4]]) -> Vec<[u32; 3]> {
    let distance = |i: u32, j: u32| (vertices[i as usize] - vertices[j as usize]).norm_squared();
    quads
        .iter()
        .flat_map(|&[a, b, c, d]| {
            if distance(a, c) <= distance(b, d) {
                [[a, b, c], [a, c, d]]
            } else {
                [[a, b, d], [b, c, d]]
            }
        })
        .collect()
}

/// Moves vertices along the surface and flips edges until the triangles are about equilateral; vertices end on the surface.
pub(crate) fn improve(
    body: &StarfishBody,
    vertices: &mut [Vector3<f64>],
    triangles: &mut [[u32; 3]],
) {
    project(body, vertices, FINAL_STEPS);
    for _ in 0..ROUNDS {
        flip_edges(vertices, triangles);
        for _ in 0..SMOOTHINGS_PER_ROUND {
            smooth(body, vertices, triangles);
            project(body, vertices, ROUGH_STEPS);
        }
    }
    flip_edges(vertices, triangles);
    project(body, vertices, FINAL_STEPS);
}

fn project(body: &StarfishBody, vertices: &mut [Vector3<f64>], steps: usize) {
    for vertex in vertices {
        for _ in 0..steps {
            let (value, gradient) = body.value_and_gradient(vertex);
            let next = *vertex - gradient * (value / gradient.norm_squared());
            if next == *vertex {
                break;
            }
            *vertex = next;
        }
    }
}

/// Moves vertices to the area-weighted mean of their triangles' centres, in the tangent plane.
fn smooth(body: &StarfishBody, vertices: &mut [Vector3<f64>], triangles: &[[u32; 3]]) {
    let mut sums = vec![(Vector3::zeros(), 0.0); vertices.len()];
    for triangle in triangles {
        let [a, b, c] = triangle.map(|i| vertices[i as usize]);
        let area = (b - a).cross(&(c - a)).norm();
        for &corner in triangle {
            let (sum, weight) = &mut sums[corner as usize];
            *sum += (a + b + c) * (area / 3.0);
            *weight += area;
        }
    }
    for (vertex, (sum, weight)) in vertices.iter_mut().zip(sums) {
        let normal = body.value_and_gradient(vertex).1.normalize();
        let step = sum / weight - *vertex;
        *vertex += step - normal * normal.dot(&step);
    }
}

/// An edge with the two triangles beside it.
struct InnerEdge {
    ends: [u32; 2],
    /// Triangle and opposite corner, on the side where the edge runs from `ends[0]` to `ends[1]` and on the other one.
    sides: [(usize, u32); 2],
}

/// Flips edges whose opposite angles sum to more than half a turn, in passes until none is left (or 20 passes).
fn flip_edges(vertices: &[Vector3<f64>], triangles: &mut [[u32; 3]]) {
    for _ in 0..20 {
        if flip_pass(vertices, triangles) == 0 {
            break;
        }
    }
}

fn flip_pass(vertices: &[Vector3<f64>], triangles: &mut [[u32; 3]]) -> usize {
    let edges = inner_edges(triangles);
    let mut present: HashSet<[u32; 2]> = edges.iter().map(|edge| edge.ends).collect();
    let mut touched = vec![false; triangles.len()];
    let mut flips = 0;
    for InnerEdge { ends, sides } in edges {
        let [(left, c), (right, d)] = sides;
        let new_ends = [c.min(d), c.max(d)];
        if touched[left] || touched[right] || present.contains(&new_ends) {
            continue;
        }
        let [a, b] = ends;
        let [pa, pb, pc, pd] = [a, b, c, d].map(|i| vertices[i as usize]);
        let opposite = (pa - pc).angle(&(pb - pc)) + (pa - pd).angle(&(pb - pd));
        let normals = [(pd - pa).cross(&(pc - pa)), (pc - pb).cross(&(pd - pb))];
        let old = (pb - pa).cross(&(pc - pa)) + (pd - pa).cross(&(pb - pa));
        if opposite > std::f64::consts::PI + 1e-9 && normals.iter().all(|n| n.dot(&old) > 0.0) {
            triangles[left] = [a, d, c];
            triangles[right] = [b, c, d];
            touched[left] = true;
            touched[right] = true;
            present.remove(&ends);
            present.insert(new_ends);
            flips += 1;
        }
    }
    flips
}

/// The edges between two triangles, by rising ends.
fn inner_edges(triangles: &[[u32; 3]]) -> Vec<InnerEdge> {
    let mut half_edges: Vec<([u32; 2], bool, usize, u32)> = triangles
        .iter()
        .enumerate()
        .flat_map(|(index, &[a, b, c])| {
            [(a, b, c), (b, c, a), (c, a, b)].map(|(from, to, opposite)| {
                ([from.min(to), from.max(to)], from > to, index, opposite)
            })
        })
        .collect();
    half_edges.sort_unstable();
    half_edges
        .chunk_by(|x, y| x.0 == y.0)
        .filter_map(|group| match group {
            [(ends, false, left, c), (_, true, right, d)] => Some(InnerEdge {
                ends: *ends,
                sides: [(*left, *c), (*right, *d)],
            }),
            _ => None,
        })
        .collect()
}

//! Closed surfaces with known areas and volumes, facing outwards: for tests, examples and first scenes.

use std::collections::HashMap;
use std::f64::consts::TAU;

use nalgebra::Vector3;

use crate::Surface;

/// A sphere about the origin: an icosahedron whose triangles are split in four `subdivisions` times, every vertex at
/// distance `radius`. It has `10 * 4^subdivisions + 2` vertices and `20 * 4^subdivisions` triangles.
///
/// # Panics
/// When `radius` is not positive and finite, or `subdivisions` is above 12 (336 million triangles).
pub fn icosphere(subdivisions: u32, radius: f64) -> Surface {
    assert!(
        radius > 0.0 && radius.is_finite(),
        "the radius must be positive and finite"
    );
    assert!(subdivisions <= 12, "at most 12 subdivisions");
    let (mut directions, mut triangles) = icosahedron();
    for _ in 0..subdivisions {
        triangles = split_in_four(&mut directions, &triangles);
    }
    let vertices = directions.into_iter().map(|d| d * radius).collect();
    valid(Surface::from_triangles(vertices, triangles))
}

/// A box of 8 vertices and 6 quads. Vertex `i` has its upper x, y, z where bit 0, 1, 2 of `i` is set.
///
/// # Panics
/// When `min` is not below `max` along every axis, or either is not finite.
pub fn cuboid(min: Vector3<f64>, max: Vector3<f64>) -> Surface {
    assert!(
        (0..3).all(|axis| min[axis] < max[axis]),
        "min must lie below max along every axis"
    );
    let corner = |i: usize| {
        Vector3::from_fn(|axis, _| {
            if i >> axis & 1 == 1 {
                max[axis]
            } else {
                min[axis]
            }
        })
    };
    let quads = [
        [0, 4, 6, 2],
        [1, 3, 7, 5],
        [0, 1, 5, 4],
        [2, 6, 7, 3],
        [0, 2, 3, 1],
        [4, 5, 7, 6],
    ];
    let polygons = quads.iter().map(|quad| quad.to_vec()).collect();
    valid(Surface::from_polygons(
        (0..8).map(corner).collect(),
        polygons,
    ))
}

/// A torus of quads about the z axis: `major_segments` around the axis at distance `major_radius`, `minor_segments`
/// around the tube of radius `minor_radius`.
///
/// # Panics
/// When a segment count is below 3, the radii are not positive and finite, or `minor_radius >= major_radius`.
pub fn torus(
    major_radius: f64,
    minor_radius: f64,
    major_segments: usize,
    minor_segments: usize,
) -> Surface {
    assert!(
        major_segments >= 3 && minor_segments >= 3,
        "a torus needs 3 segments or more each way"
    );
    assert!(
        0.0 < minor_radius && minor_radius < major_radius && major_radius.is_finite(),
        "radii must satisfy 0 < minor < major < infinity"
    );
    let mut vertices = Vec::with_capacity(major_segments * minor_segments);
    let mut polygons = Vec::with_capacity(major_segments * minor_segments);
    for i in 0..major_segments {
        let (sin_i, cos_i) = (TAU * i as f64 / major_segments as f64).sin_cos();
        for j in 0..minor_segments {
            let (sin_j, cos_j) = (TAU * j as f64 / minor_segments as f64).sin_cos();
            let distance = major_radius + minor_radius * cos_j;
            vertices.push(Vector3::new(
                distance * cos_i,
                distance * sin_i,
                minor_radius * sin_j,
            ));
            let at = |i: usize, j: usize| {
                (i % major_segments * minor_segments + j % minor_segments) as u32
            };
            polygons.push(vec![at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)]);
        }
    }
    valid(Surface::from_polygons(vertices, polygons))
}

fn icosahedron() -> (Vec<Vector3<f64>>, Vec<[u32; 3]>) {
    let golden = (1.0 + 5.0_f64.sqrt()) / 2.0;
    let mut directions = Vec::with_capacity(12);
    for axis in 0..3 {
        for (one, long) in [
            (1.0, golden),
            (-1.0, golden),
            (1.0, -golden),
            (-1.0, -golden),
        ] {
            let mut corner = Vector3::zeros();
            corner[axis] = one;
            corner[(axis + 1) % 3] = long;
            directions.push(corner.normalize());
        }
    }
    // Neighbours on the icosahedron are at the smallest distance: dot product 1 / sqrt 5, all others are negative.
    let near = |i: usize, j: usize| directions[i].dot(&directions[j]) > 0.0;
    let mut triangles = Vec::with_capacity(20);
    for a in 0..12 {
        for b in a + 1..12 {
            for c in b + 1..12 {
                if near(a, b) && near(b, c) && near(c, a) {
                    let outwards = directions[a].dot(&directions[b].cross(&directions[c])) > 0.0;
                    let (b, c) = if outwards { (b, c) } else { (c, b) };
                    triangles.push([a as u32, b as u32, c as u32]);
                }
            }
        }
    }
    (directions, triangles)
}

fn split_in_four(directions: &mut Vec<Vector3<f64>>, triangles: &[[u32; 3]]) -> Vec<[u32; 3]> {
    let mut midpoints = HashMap::with_capacity(triangles.len() * 3 / 2);
    let mut midpoint = |i: u32, j: u32| {
        *midpoints.entry((i.min(j), i.max(j))).or_insert_with(|| {
            directions.push((directions[i as usize] + directions[j as usize]).normalize());
            (directions.len() - 1) as u32
        })
    };
    let mut split = Vec::with_capacity(triangles.len() * 4);
    for &[a, b, c] in triangles {
        let (ab, bc, ca) = (midpoint(a, b), midpoint(b, c), midpoint(c, a));
        split.extend([[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]);
    }
    split
}

fn valid(surface: Result<Surface, crate::SurfaceError>) -> Surface {
    surface.unwrap_or_else(|error| panic!("the shape's size is out of range: {error}"))
}

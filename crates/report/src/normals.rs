//! Smooth vertex normals, and how hollow the surface is about each vertex.

use nalgebra::Vector3;

/// Unit normals: the sum of the adjacent triangles' normals, each weighted by its angle at the vertex (Thuermer and
/// Wuethrich 1998), which does not depend on how flat parts happen to be cut into triangles. Zero where nothing is adjacent.
pub(crate) fn vertex_normals(
    vertices: &[Vector3<f64>],
    triangles: &[[u32; 3]],
) -> Vec<Vector3<f64>> {
    let mut normals = vec![Vector3::zeros(); vertices.len()];
    for triangle in triangles {
        let corners = triangle.map(|vertex| vertices[vertex as usize]);
        let across = (corners[1] - corners[0]).cross(&(corners[2] - corners[0]));
        let Some(normal) = across.try_normalize(0.0) else {
            continue;
        };
        for corner in 0..3 {
            let to_next = corners[(corner + 1) % 3] - corners[corner];
            let to_last = corners[(corner + 2) % 3] - corners[corner];
            normals[triangle[corner] as usize] += normal * to_next.angle(&to_last);
        }
    }
    for normal in &mut normals {
        *normal = normal.try_normalize(0.0).unwrap_or_else(Vector3::zeros);
    }
    normals
}

/// Radius of curvature, as a part of the mesh's diagonal, at which a hollow gets its full shadow.
const HOLLOW_RADIUS: f64 = 0.015;
/// Rounds of averaging over neighbours: a hollow's shadow ends softly.
const SOFTENING: usize = 2;

/// How hollow the surface is at each vertex, from 0 (flat or bulging) to 1 (a narrow groove or hole).
///
/// Along an edge d the surface bends towards its normal n by the curvature 2 n.d / |d|^2; the mean over the edges of a vertex is
/// taken. It stands in for the light that does not reach folds, nostrils and the like.
pub(crate) fn hollowness(
    vertices: &[Vector3<f64>],
    triangles: &[[u32; 3]],
    normals: &[Vector3<f64>],
) -> Vec<f32> {
    let low = vertices
        .iter()
        .fold(Vector3::repeat(f64::INFINITY), |low, v| low.inf(v));
    let high = vertices
        .iter()
        .fold(Vector3::repeat(f64::NEG_INFINITY), |high, v| high.sup(v));
    let radius = HOLLOW_RADIUS * (high - low).norm();
    let bend = |from: usize, to: usize| {
        let edge = vertices[to] - vertices[from];
        let square = edge.norm_squared();
        if square > 0.0 {
            2.0 * radius * normals[from].dot(&edge) / square
        } else {
            0.0
        }
    };
    let mut hollow = edge_means(vertices.len(), triangles, bend);
    for value in &mut hollow {
        *value = value.clamp(0.0, 1.0);
    }
    for _ in 0..SOFTENING {
        let around = edge_means(vertices.len(), triangles, |_, to| hollow[to]);
        for (value, mean) in hollow.iter_mut().zip(around) {
            *value = 0.5 * (*value + mean);
        }
    }
    hollow.iter().map(|&value| value as f32).collect()
}

/// For each vertex the mean of `value(vertex, neighbour)`; neighbours count once for each triangle they share.
fn edge_means(
    vertices: usize,
    triangles: &[[u32; 3]],
    value: impl Fn(usize, usize) -> f64,
) -> Vec<f64> {
    let mut sums = vec![(0.0, 0.0); vertices];
    for triangle in triangles {
        let corners = triangle.map(|vertex| vertex as usize);
        for corner in 0..3 {
            for other in [corners[(corner + 1) % 3], corners[(corner + 2) % 3]] {
                let sum = &mut sums[corners[corner]];
                sum.0 += value(corners[corner], other);
                sum.1 += 1.0;
            }
        }
    }
    sums.iter()
        .map(|&(sum, count)| if count > 0.0 { sum / count } else { 0.0 })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A paraboloid z = bend (x^2 + y^2) over a grid; upwards is outside.
    fn bowl(bend: f64) -> (Vec<Vector3<f64>>, Vec<[u32; 3]>) {
        let mut vertices = Vec::new();
        let mut triangles = Vec::new();
        for row in 0..9_u32 {
            for column in 0..9_u32 {
                let (x, y) = (f64::from(column) - 4.0, f64::from(row) - 4.0);
                vertices.push(Vector3::new(x, y, bend * (x * x + y * y)));
                if row < 8 && column < 8 {
                    let corner = 9 * row + column;
                    triangles.push([corner, corner + 1, corner + 10]);
                    triangles.push([corner, corner + 10, corner + 9]);
                }
            }
        }
        (vertices, triangles)
    }

    #[test]
    fn normals_of_a_bowl_point_along_its_gradient() {
        let (vertices, triangles) = bowl(0.05);
        let normals = vertex_normals(&vertices, &triangles);
        for index in [40, 31, 49, 50] {
            let v = vertices[index];
            let exact = Vector3::new(-0.1 * v.x, -0.1 * v.y, 1.0).normalize();
            assert!(normals[index].angle(&exact) < 0.01);
        }
    }

    #[test]
    fn bowls_are_hollow_and_hills_and_planes_are_not() {
        let middle = |bend| {
            let (vertices, triangles) = bowl(bend);
            hollowness(
                &vertices,
                &triangles,
                &vertex_normals(&vertices, &triangles),
            )[40]
        };
        assert!(middle(0.2) > 0.02);
        assert_eq!((middle(0.0), middle(-0.2)), (0.0, 0.0));
    }
}

//! Smooth vertex normals.

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

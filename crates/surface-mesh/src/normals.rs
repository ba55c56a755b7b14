//! Area-weighted vertex normals and their exact cotangent.

use nalgebra::Vector3;

/// Unit vertex normals, each triangle weighted by its area.
///
/// With `m_v = sum over triangles (a, b, c) around v of (b - a) x (c - a)`, the normal is `n_v = m_v / |m_v|`. A vertex
/// whose `m_v` is zero (unused, or only in triangles without area) gets the zero vector.
///
/// # Panics
/// When a triangle names a vertex that does not exist.
pub fn vertex_normals(vertices: &[Vector3<f64>], triangles: &[[u32; 3]]) -> Vec<Vector3<f64>> {
    let mut normals = summed_area_normals(vertices, triangles);
    for normal in &mut normals {
        *normal = unit_and_length(normal).0;
    }
    normals
}

/// Cotangent of [`vertex_normals`]: given `normals_bar = dL/dn` per vertex, returns `dL/dx` per vertex.
///
/// `m_bar = (n_bar - n (n . n_bar)) / |m|`, zero where the normal is zero; then each triangle with
/// `g = m_bar_a + m_bar_b + m_bar_c` adds `(c - a) x g` to b, `g x (b - a)` to c, and minus their sum to a.
///
/// # Panics
/// When a triangle names a vertex that does not exist, or `normals_bar` has not one entry per vertex.
pub fn vertex_normals_vjp(
    vertices: &[Vector3<f64>],
    triangles: &[[u32; 3]],
    normals_bar: &[Vector3<f64>],
) -> Vec<Vector3<f64>> {
    assert_eq!(
        vertices.len(),
        normals_bar.len(),
        "one normal cotangent per vertex"
    );
    let mut sums_bar = summed_area_normals(vertices, triangles);
    for (sum, normal_bar) in sums_bar.iter_mut().zip(normals_bar) {
        let (normal, length) = unit_and_length(sum);
        *sum = if length > 0.0 {
            (normal_bar - normal * normal.dot(normal_bar)) / length
        } else {
            Vector3::zeros()
        };
    }
    let mut vertices_bar = vec![Vector3::zeros(); vertices.len()];
    for triangle in triangles {
        let [a, b, c] = triangle.map(|vertex| vertex as usize);
        let area_bar = sums_bar[a] + sums_bar[b] + sums_bar[c];
        let b_bar = (vertices[c] - vertices[a]).cross(&area_bar);
        let c_bar = area_bar.cross(&(vertices[b] - vertices[a]));
        vertices_bar[a] -= b_bar + c_bar;
        vertices_bar[b] += b_bar;
        vertices_bar[c] += c_bar;
    }
    vertices_bar
}

fn summed_area_normals(vertices: &[Vector3<f64>], triangles: &[[u32; 3]]) -> Vec<Vector3<f64>> {
    let mut sums = vec![Vector3::zeros(); vertices.len()];
    for triangle in triangles {
        let [a, b, c] = triangle.map(|vertex| vertex as usize);
        let doubled = (vertices[b] - vertices[a]).cross(&(vertices[c] - vertices[a]));
        sums[a] += doubled;
        sums[b] += doubled;
        sums[c] += doubled;
    }
    sums
}

/// Direction and length of a vector; the zero vector has the direction zero.
fn unit_and_length(vector: &Vector3<f64>) -> (Vector3<f64>, f64) {
    // Squares of the areas of a tiny mesh would underflow: scale by the largest entry first.
    let scale = vector.amax();
    if scale == 0.0 {
        return (Vector3::zeros(), 0.0);
    }
    let scaled = vector / scale;
    let length = scaled.norm();
    (scaled / length, scale * length)
}

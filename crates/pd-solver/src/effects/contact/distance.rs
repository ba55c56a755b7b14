//! Squared distances between points, edges and triangles, with their exact derivatives.
//!
//! All of them are `D = min |q|^2` over the parameters of the nearest points, with `q = sum_i beta_i x_i` and `beta` linear in the parameters.
//! By the envelope theorem the gradient is `2 beta_i q`; the Hessian is that at fixed parameters less what the parameters give way,
//! `H_xx - H_xg H_gg^-1 H_gx`, over those parameters that are inside their range. D is once continuously differentiable where the nearest
//! features change, but for edges that are parallel; there the [mollifier](super::barrier) makes up for it (Li et al. 2020, 5).

use nalgebra::{Matrix2, Matrix3, SMatrix, SVector, Vector3};

/// The four points of a pair.
pub(crate) type Quad = [Vector3<f64>; 4];
/// A derivative by the four points.
pub(crate) type Gradient = SVector<f64, 12>;
/// A second derivative by the four points.
pub(crate) type Hessian = SMatrix<f64, 12, 12>;

/// What two things are near each other.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Kind {
    /// The first point, and the triangle of the others.
    VertexTriangle,
    /// The edge of the first two points, and that of the others.
    EdgeEdge,
}

impl Kind {
    /// How many of the points are those of the first thing.
    pub(crate) fn first(self) -> usize {
        match self {
            Kind::VertexTriangle => 1,
            Kind::EdgeEdge => 2,
        }
    }
}

/// The nearest points of a pair: `q = sum_i beta[i] x[i]` leads from one to the other.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Nearest {
    pub(crate) beta: [f64; 4],
    /// Derivatives of beta by the parameters that are inside their range.
    slopes: [[f64; 4]; 2],
    free: usize,
    pub(crate) q: Vector3<f64>,
}

impl Nearest {
    fn new(x: &Quad, beta: [f64; 4], slopes: &[[f64; 4]]) -> Self {
        let mut all = [[0.0; 4]; 2];
        all[..slopes.len()].copy_from_slice(slopes);
        Self {
            beta,
            slopes: all,
            free: slopes.len(),
            q: combine(x, &beta),
        }
    }

    pub(crate) fn of(kind: Kind, x: &Quad) -> Self {
        match kind {
            Kind::VertexTriangle => vertex_triangle(x),
            Kind::EdgeEdge => edge_edge(x),
        }
    }

    /// The squared distance.
    pub(crate) fn squared(&self) -> f64 {
        self.q.norm_squared()
    }

    /// The gradient of the squared distance.
    pub(crate) fn gradient(&self) -> Gradient {
        Gradient::from_fn(|i, _| 2.0 * self.beta[i / 3] * self.q[i % 3])
    }

    /// The Hessian of the squared distance.
    pub(crate) fn hessian(&self, x: &Quad) -> Hessian {
        let mut hessian = Hessian::from_fn(|i, j| match i % 3 == j % 3 {
            true => 2.0 * self.beta[i / 3] * self.beta[j / 3],
            false => 0.0,
        });
        if self.free == 0 {
            return hessian;
        }
        let slopes = &self.slopes[..self.free];
        let t = |a: usize| combine(x, &slopes[a]);
        let mixed = |a: usize| {
            let t = t(a);
            Gradient::from_fn(|i, _| {
                2.0 * (slopes[a][i / 3] * self.q[i % 3] + self.beta[i / 3] * t[i % 3])
            })
        };
        if self.free == 1 {
            let (mixed, t) = (mixed(0), t(0));
            hessian -= mixed * mixed.transpose() / (2.0 * t.norm_squared());
            return hessian;
        }
        let (t, m) = ([t(0), t(1)], [mixed(0), mixed(1)]);
        let gram = Matrix2::from_fn(|a, b| 2.0 * t[a].dot(&t[b]));
        let Some(inverse) = gram.try_inverse() else {
            return hessian;
        };
        for a in 0..2 {
            for b in 0..2 {
                hessian -= m[a] * m[b].transpose() * inverse[(a, b)];
            }
        }
        hessian
    }
}

/// The squared distance alone, for where many are too far to matter.
pub(crate) fn squared_distance(kind: Kind, x: &Quad) -> f64 {
    match kind {
        Kind::VertexTriangle => squared_to_triangle(x),
        Kind::EdgeEdge => squared_between_edges(x),
    }
}

/// The square of a vertex's distance from an edge.
fn squared_to_edge(p: &Vector3<f64>, a: &Vector3<f64>, b: &Vector3<f64>) -> f64 {
    let (t, _) = on_edge(p, a, b);
    (p - a - (b - a) * t).norm_squared()
}

fn squared_to_triangle(x: &Quad) -> f64 {
    if let Some((_, _, q)) = over_triangle(x) {
        return q.norm_squared();
    }
    let [p, a, b, c] = x;
    let of_edges = squared_to_edge(p, a, b).min(squared_to_edge(p, b, c));
    of_edges.min(squared_to_edge(p, c, a))
}

fn squared_between_edges(x: &Quad) -> f64 {
    if let Some((_, _, q)) = between_insides(x) {
        return q.norm_squared();
    }
    let [a, b, c, d] = x;
    let of_first = squared_to_edge(a, c, d).min(squared_to_edge(b, c, d));
    let of_second = squared_to_edge(c, a, b).min(squared_to_edge(d, a, b));
    of_first.min(of_second)
}

/// Whether boxes around both are at least this far apart, along one axis: a quick no.
pub(crate) fn boxes_apart(kind: Kind, x: &Quad, distance: f64) -> bool {
    let (one, other) = x.split_at(kind.first());
    (0..3).any(|axis| {
        let low = |part: &[Vector3<f64>]| part.iter().fold(f64::INFINITY, |a, x| a.min(x[axis]));
        let high =
            |part: &[Vector3<f64>]| part.iter().fold(f64::NEG_INFINITY, |a, x| a.max(x[axis]));
        low(other) - high(one) >= distance || low(one) - high(other) >= distance
    })
}

fn combine(x: &Quad, beta: &[f64; 4]) -> Vector3<f64> {
    x[0] * beta[0] + x[1] * beta[1] + x[2] * beta[2] + x[3] * beta[3]
}

/// Where on the edge from `a` to `b` the point nearest to `p` is, and whether inside it.
fn on_edge(p: &Vector3<f64>, a: &Vector3<f64>, b: &Vector3<f64>) -> (f64, bool) {
    let edge = b - a;
    let square = edge.norm_squared();
    let t = edge.dot(&(p - a)) / square;
    if square > 0.0 && t > 0.0 && t < 1.0 {
        (t, true)
    } else {
        (if t >= 1.0 { 1.0 } else { 0.0 }, false)
    }
}

/// The point `x[0]` and the edge between two others.
fn vertex_edge(x: &Quad, a: usize, b: usize) -> Nearest {
    let (t, inside) = on_edge(&x[0], &x[a], &x[b]);
    let mut beta = [1.0, 0.0, 0.0, 0.0];
    beta[a] = t - 1.0;
    beta[b] = -t;
    let mut slope = [0.0; 4];
    (slope[a], slope[b]) = (1.0, -1.0);
    Nearest::new(x, beta, &[slope][..usize::from(inside)])
}

fn nearer(a: Nearest, b: Nearest) -> Nearest {
    if b.squared() < a.squared() { b } else { a }
}

/// Where the vertex is over the inside of the triangle, by two of the weights of its corners, and what leads from there to it.
fn over_triangle(x: &Quad) -> Option<(f64, f64, Vector3<f64>)> {
    let (e1, e2, p) = (x[2] - x[1], x[3] - x[1], x[0] - x[1]);
    let normal = e1.cross(&e2);
    let square = normal.norm_squared();
    let u = p.cross(&e2).dot(&normal);
    let v = e1.cross(&p).dot(&normal);
    // Across the plane exactly: roundoff of the parameters would be seen along it.
    let inside = square > 0.0 && u > 0.0 && v > 0.0 && u + v < square;
    inside.then(|| (u / square, v / square, normal * (p.dot(&normal) / square)))
}

fn vertex_triangle(x: &Quad) -> Nearest {
    if let Some((u, v, q)) = over_triangle(x) {
        let beta = [1.0, u + v - 1.0, -u, -v];
        let slopes = [[0.0, 1.0, -1.0, 0.0], [0.0, 1.0, 0.0, -1.0]];
        let nearest = Nearest::new(x, beta, &slopes);
        return Nearest { q, ..nearest };
    }
    let of_edges = [(1, 2), (2, 3), (3, 1)].map(|(a, b)| vertex_edge(x, a, b));
    let [a, b, c] = of_edges;
    nearer(nearer(a, b), c)
}

/// A point of one edge and the other edge.
fn end_and_edge(x: &Quad, end: usize, a: usize, b: usize) -> Nearest {
    let (t, inside) = on_edge(&x[end], &x[a], &x[b]);
    // From the second edge to the first.
    let sign = if end < 2 { 1.0 } else { -1.0 };
    let (mut beta, mut slope) = ([0.0; 4], [0.0; 4]);
    beta[end] = sign;
    beta[a] = sign * (t - 1.0);
    beta[b] = -sign * t;
    (slope[a], slope[b]) = (sign, -sign);
    Nearest::new(x, beta, &[slope][..usize::from(inside)])
}

/// Where two edges are nearest inside both, by the shares of either, and what leads from the second to the first.
fn between_insides(x: &Quad) -> Option<(f64, f64, Vector3<f64>)> {
    let (u, v, w) = (x[1] - x[0], x[3] - x[2], x[0] - x[2]);
    let normal = u.cross(&v);
    let square = normal.norm_squared();
    let s = v.cross(&w).dot(&normal);
    let t = u.cross(&w).dot(&normal);
    let inside = square > 0.0 && s > 0.0 && s < square && t > 0.0 && t < square;
    inside.then(|| (s / square, t / square, normal * (w.dot(&normal) / square)))
}

fn edge_edge(x: &Quad) -> Nearest {
    if let Some((s, t, q)) = between_insides(x) {
        let beta = [1.0 - s, s, t - 1.0, -t];
        let slopes = [[-1.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, -1.0]];
        let nearest = Nearest::new(x, beta, &slopes);
        return Nearest { q, ..nearest };
    }
    let ends = [(0, 2, 3), (1, 2, 3), (2, 0, 1), (3, 0, 1)];
    let [a, b, c, d] = ends.map(|(end, a, b)| end_and_edge(x, end, a, b));
    nearer(nearer(a, b), nearer(c, d))
}

/// `|(x1 - x0) x (x3 - x2)|^2`, which tells how nearly parallel two edges are, with its derivatives where asked for.
pub(crate) fn crossing(x: &Quad) -> f64 {
    (x[1] - x[0]).cross(&(x[3] - x[2])).norm_squared()
}

/// The gradient of [`crossing`].
pub(crate) fn crossing_gradient(x: &Quad) -> Gradient {
    let (u, v) = (x[1] - x[0], x[3] - x[2]);
    let uv = u.dot(&v);
    let by_u = (u * v.norm_squared() - v * uv) * 2.0;
    let by_v = (v * u.norm_squared() - u * uv) * 2.0;
    let mut out = Gradient::zeros();
    for k in 0..3 {
        (out[k], out[3 + k]) = (-by_u[k], by_u[k]);
        (out[6 + k], out[9 + k]) = (-by_v[k], by_v[k]);
    }
    out
}

/// The Hessian of [`crossing`].
pub(crate) fn crossing_hessian(x: &Quad) -> Hessian {
    let (u, v) = (x[1] - x[0], x[3] - x[2]);
    let identity = Matrix3::identity();
    let uu = identity * (2.0 * v.norm_squared()) - v * v.transpose() * 2.0;
    let vv = identity * (2.0 * u.norm_squared()) - u * u.transpose() * 2.0;
    let uv = u * v.transpose() * 4.0 - v * u.transpose() * 2.0 - identity * (2.0 * u.dot(&v));
    Hessian::from_fn(|i, j| {
        let (a, b) = (i / 3, j / 3);
        let sign = if a % 2 == b % 2 { 1.0 } else { -1.0 };
        let (i, j) = (i % 3, j % 3);
        sign * match (a / 2, b / 2) {
            (0, 0) => uu[(i, j)],
            (1, 1) => vv[(i, j)],
            (0, _) => uv[(i, j)],
            _ => uv[(j, i)],
        }
    })
}

#[cfg(test)]
pub(super) mod tests;

//! The loss on the embedded surface (supplement, 10.3): positions, and normals where wanted.

use crate::body::Body;
use crate::inversion::add_inversion;
use crate::scene::LossSettings;
use nalgebra::{DMatrix, Vector3};
use std::borrow::Cow;
use surface_mesh::{vertex_normals, vertex_normals_vjp};

/// Distances are counted in hundredths of the bounding-box diagonal, so that a loss of 1 is an error that one sees.
pub const UNIT: f64 = 0.01;

/// A target on the surface, with the normals it needs.
pub struct Loss<'a> {
    body: &'a Body,
    target: Cow<'a, [Vector3<f64>]>,
    /// What each vertex counts.
    weights: Cow<'a, [f64]>,
    /// alpha.
    normal_weight: f64,
    /// Target normals, where anything needs them.
    normals: Vec<Vector3<f64>>,
    /// Whether the target of a vertex follows it along the target's tangent plane.
    slides: bool,
    inversion_weight: f64,
    far: Far,
}

/// What vertices far off their targets count more.
#[derive(Clone, Copy)]
struct Far {
    weight: f64,
    /// far^2.
    squared: f64,
}

impl Far {
    fn new(body: &Body, settings: &LossSettings) -> Self {
        Self {
            weight: settings.far_weight,
            squared: (settings.far * body.diagonal).powi(2),
        }
    }

    /// What the squared distance `q` counts, `q (1 + weight q / (q + far^2))`, and its derivative by `q`.
    fn count(self, q: f64) -> (f64, f64) {
        let share = q / (q + self.squared);
        let value = q * (1.0 + self.weight * share);
        (value, 1.0 + self.weight * share * (2.0 - share))
    }
}

impl<'a> Loss<'a> {
    /// The loss against one target shape.
    pub fn new(body: &'a Body, target: &'a [Vector3<f64>], settings: &LossSettings) -> Self {
        let normal_weight = settings.normal_weight;
        let normals = match normal_weight > 0.0 {
            true => vertex_normals(target, body.surface.triangles()),
            false => Vec::new(),
        };
        Self {
            body,
            target: target.into(),
            weights: body.vertex_weights.as_slice().into(),
            normal_weight,
            normals,
            inversion_weight: settings.inversion_weight,
            far: Far::new(body, settings),
            slides: false,
        }
    }

    /// The loss against the places of another surface where it is nearest to the vertices: positions, unit normals there, and what each
    /// vertex counts instead of [`Body::vertex_weights`].
    pub fn on_surface(
        body: &'a Body,
        target: Vec<Vector3<f64>>,
        normals: Vec<Vector3<f64>>,
        weights: Vec<f64>,
        settings: &LossSettings,
    ) -> Self {
        Self {
            body,
            target: target.into(),
            weights: weights.into(),
            normal_weight: settings.normal_weight,
            normals,
            slides: true,
            inversion_weight: settings.inversion_weight,
            far: Far::new(body, settings),
        }
    }

    /// Value and gradient by the surface's vertices:
    /// `sum_v a_v (q(|x_v - t_v|^2) / (1 % of the diagonal)^2 + alpha |n_v - m_v|^2)` with weights a_v (area shares, unless said otherwise).
    /// `q` is the squared distance itself, or counts more where a vertex is far off ([`LossSettings::far_weight`]).
    pub fn surface(&self, x: &[Vector3<f64>]) -> (f64, Vec<Vector3<f64>>) {
        let scale = squared_unit(self.body).recip();
        let mut value = 0.0;
        let mut gradient = Vec::with_capacity(x.len());
        for ((x, t), a) in x.iter().zip(&*self.target).zip(&*self.weights) {
            let off = x - t;
            let (counted, slope) = self.far.count(off.norm_squared());
            value += a * scale * counted;
            gradient.push(off * (2.0 * a * scale * slope));
        }
        let alpha = self.normal_weight;
        if alpha > 0.0 {
            let triangles = self.body.surface.triangles();
            let normals = vertex_normals(x, triangles);
            let mut normals_bar = Vec::with_capacity(x.len());
            for ((n, m), a) in normals.iter().zip(&self.normals).zip(&*self.weights) {
                let off = n - m;
                value += alpha * a * off.norm_squared();
                normals_bar.push(off * (2.0 * alpha * a));
            }
            let more = vertex_normals_vjp(x, triangles, &normals_bar);
            gradient.iter_mut().zip(more).for_each(|(g, m)| *g += m);
        }
        (value, gradient)
    }

    /// The Gauss-Newton matrix of the value at `x` for variables whose first-order effects on the vertices are `effects`: `2 J^T J` of the
    /// residuals whose squares the value sums, far vertices counted like all others. Where targets slide, only distances along their
    /// normals count.
    pub fn gauss_newton(&self, x: &[Vector3<f64>], effects: &[Vec<Vector3<f64>>]) -> DMatrix<f64> {
        let scale = squared_unit(self.body).recip();
        let per_vertex = if self.normal_weight > 0.0 { 6 } else { 3 };
        let mut residuals = DMatrix::zeros(per_vertex * x.len(), effects.len());
        for (mut column, effect) in residuals.column_iter_mut().zip(effects) {
            for (v, (s, a)) in effect.iter().zip(&*self.weights).enumerate() {
                let along = match self.slides {
                    true => self.normals[v] * self.normals[v].dot(s),
                    false => *s,
                };
                let part = along * (a * scale).sqrt();
                column.rows_mut(per_vertex * v, 3).copy_from(&part);
            }
            if self.normal_weight > 0.0 {
                let triangles = self.body.surface.triangles();
                // Small beside an edge, so that the difference is the slope.
                let largest = effect
                    .iter()
                    .map(|s| s.norm())
                    .fold(f64::MIN_POSITIVE, f64::max);
                let h = 1e-6 * self.body.diagonal / largest;
                let moved = |h: f64| {
                    let moved = x.iter().zip(effect).map(|(x, s)| x + s * h);
                    vertex_normals(&moved.collect::<Vec<_>>(), triangles)
                };
                for (v, (up, down)) in moved(h).iter().zip(moved(-h)).enumerate() {
                    let factor = (self.normal_weight * self.weights[v]).sqrt() / (2.0 * h);
                    let part = (up - down) * factor;
                    column.rows_mut(per_vertex * v + 3, 3).copy_from(&part);
                }
            }
        }
        residuals.tr_mul(&residuals) * 2.0
    }

    /// Value and gradient by the nodes: the loss on the surface, and what inverted material costs.
    pub fn nodes(&self, nodes: &[Vector3<f64>]) -> (f64, Vec<Vector3<f64>>) {
        let (mut value, surface_bar) = self.surface(&self.body.surface_positions(nodes));
        let mut node_bar = vec![Vector3::zeros(); nodes.len()];
        let embedding = &self.body.embedding;
        embedding.transpose_into(&surface_bar, &mut node_bar);
        if self.inversion_weight > 0.0 {
            let scale = self.inversion_weight / (UNIT * self.body.diagonal).powi(3);
            value += add_inversion(&self.body.mesh, nodes, scale, &mut node_bar);
        }
        (value, node_bar)
    }
}

/// The squared distance that the loss counts as 1.
fn squared_unit(body: &Body) -> f64 {
    (UNIT * body.diagonal).powi(2)
}

/// Mean and largest distance between vertices.
pub fn distances(a: &[Vector3<f64>], b: &[Vector3<f64>]) -> (f64, f64, Vec<f64>) {
    let all: Vec<f64> = a.iter().zip(b).map(|(a, b)| (a - b).norm()).collect();
    let mean = all.iter().sum::<f64>() / all.len() as f64;
    let max = all.iter().copied().fold(0.0, f64::max);
    (mean, max, all)
}

/// Mean over the vertices that count, by what they count; weights sum to 1.
pub fn mean_distance(a: &[Vector3<f64>], b: &[Vector3<f64>], weights: &[f64]) -> f64 {
    let distances = a.iter().zip(b).map(|(a, b)| (a - b).norm());
    distances.zip(weights).map(|(d, w)| d * w).sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use surface_mesh::primitives::icosphere;

    #[test]
    fn the_gradient_is_the_slope_of_the_loss() {
        let body = Body::new("sphere", icosphere(2, 1.0), 0.3, 1).unwrap();
        let wave = |k: f64| {
            move |(i, x): (usize, &Vector3<f64>)| {
                let t = i as f64 * k;
                x + Vector3::new(t.sin(), t.cos(), (2.0 * t).sin()) * 0.05
            }
        };
        let target: Vec<_> = body
            .surface
            .vertices()
            .iter()
            .enumerate()
            .map(wave(0.7))
            .collect();
        let nodes: Vec<_> = body
            .mesh
            .nodes()
            .iter()
            .enumerate()
            .map(wave(1.3))
            .collect();
        for alpha in [0.0, 1.0] {
            let settings = LossSettings {
                normal_weight: alpha,
                inversion_weight: alpha,
                far_weight: 8.0 * alpha,
                far: 0.02,
                ..LossSettings::default()
            };
            let loss = Loss::new(&body, &target, &settings);
            let (_, gradient) = loss.nodes(&nodes);
            let direction: Vec<_> = (0..nodes.len())
                .map(|i| Vector3::new((i as f64).cos(), (i as f64 * 0.3).sin(), 0.5))
                .collect();
            let at = |t: f64| {
                let moved = nodes.iter().zip(&direction).map(|(x, d)| x + d * t);
                loss.nodes(&moved.collect::<Vec<_>>()).0
            };
            let h = 1e-4;
            let slope = (8.0 * (at(h) - at(-h)) - (at(2.0 * h) - at(-2.0 * h))) / (12.0 * h);
            let exact: f64 = gradient.iter().zip(&direction).map(|(g, d)| g.dot(d)).sum();
            assert!(
                (slope - exact).abs() < 1e-8 * exact.abs(),
                "{slope} {exact}"
            );
        }
    }

    /// Where nothing is off, the Gauss-Newton matrix is the Hessian.
    #[test]
    fn the_gauss_newton_matrix_is_the_curvature_at_the_target() {
        let body = Body::new("sphere", icosphere(2, 1.0), 0.3, 1).unwrap();
        let x = body.surface.vertices().to_vec();
        let effects: Vec<Vec<Vector3<f64>>> = [0.7, 1.9]
            .map(|k: f64| {
                let effect = |i: usize| Vector3::new((i as f64 * k).sin(), (i as f64).cos(), k);
                (0..x.len()).map(effect).collect()
            })
            .to_vec();
        for alpha in [0.0, 1.0] {
            let settings = LossSettings {
                normal_weight: alpha,
                ..LossSettings::default()
            };
            let loss = Loss::new(&body, &x, &settings);
            let matrix = loss.gauss_newton(&x, &effects);
            let at = |a: f64, b: f64| {
                let moved = x.iter().zip(&effects[0]).zip(&effects[1]);
                let moved: Vec<_> = moved.map(|((x, s), t)| x + s * a + t * b).collect();
                loss.surface(&moved).0
            };
            let h = 1e-4;
            for (i, j, found) in [
                (0, 0, (at(h, 0.0) + at(-h, 0.0)) / (h * h)),
                (1, 1, (at(0.0, h) + at(0.0, -h)) / (h * h)),
                (
                    0,
                    1,
                    (at(h, h) - at(h, -h) - at(-h, h) + at(-h, -h)) / (4.0 * h * h),
                ),
            ] {
                let exact = matrix[(i, j)];
                assert!(
                    (found - exact).abs() < 1e-4 * matrix.norm(),
                    "{found} {exact}"
                );
                assert_eq!(matrix[(j, i)], exact);
            }
        }
    }

    #[test]
    fn sliding_along_a_surface_is_free() {
        let body = Body::new("sphere", icosphere(2, 1.0), 0.3, 1).unwrap();
        let x = body.surface.vertices().to_vec();
        let outwards: Vec<_> = x.iter().map(|x| x.normalize()).collect();
        let around: Vec<_> = x.iter().map(|x| Vector3::y().cross(x)).collect();
        let weights = body.vertex_weights.clone();
        let settings = LossSettings::default();
        assert_eq!(settings.normal_weight, 0.0);
        let loss = Loss::on_surface(&body, x.clone(), outwards.clone(), weights, &settings);
        let matrix = loss.gauss_newton(&x, &[outwards, around]);
        let whole = 2.0 / squared_unit(&body);
        assert!((matrix[(0, 0)] - whole).abs() < 1e-9 * whole);
        assert!(matrix[(1, 1)].abs() < 1e-9 * whole);
    }
}

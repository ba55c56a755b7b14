//! A basis of surface displacements and the bounded weights that best reproduce a given one.

use crate::active_set::{Activity, BoundedProgram};
use crate::error::RigError;
use crate::joint_fit::check_finite;
use nalgebra::{DMatrix, DVector, Vector3};

/// Ridge that is always added to the diagonal of the normal matrix, relative to the mean of that diagonal.
///
/// It decides between equally good weights (shapes that repeat or combine each other) in favour of the smallest ones, and
/// shifts well-determined weights by a relative 1e-12 times the condition of the normal matrix.
pub const RIDGE: f64 = 1e-12;

/// Slopes below this, relative to |shape| |target|, are rounding.
const SLOPE_TOLERANCE: f64 = 1e-13;

/// Displacement shapes over one mesh, with their normal matrix formed once.
///
/// A fit then costs two passes over the shapes and a program with one unknown for each shape.
#[derive(Clone, Debug)]
pub struct BlendBasis {
    /// Column k is shape k as x, y, z of vertex 0, then of vertex 1 and so on, each times the root of its vertex weight.
    shapes: DMatrix<f64>,
    normal: DMatrix<f64>,
    /// Roots of the vertex weights, or nothing when all are 1.
    roots: Option<Vec<f64>>,
    weight_sum: f64,
}

/// The interval each blend weight must stay in.
#[derive(Clone, Debug, PartialEq)]
pub struct Bounds {
    /// Least allowed weight for each shape; negative infinity for none.
    pub lower: Vec<f64>,
    /// Largest allowed weight for each shape; infinity for none.
    pub upper: Vec<f64>,
}

impl Bounds {
    /// The same interval for each of `count` shapes; blend weights usually live in 0 to 1.
    pub fn uniform(count: usize, lower: f64, upper: f64) -> Self {
        Self {
            lower: vec![lower; count],
            upper: vec![upper; count],
        }
    }

    fn check(&self, shapes: usize) -> Result<(), RigError> {
        if self.lower.len() != shapes || self.upper.len() != shapes {
            return Err(RigError::BoundCount {
                lower: self.lower.len(),
                upper: self.upper.len(),
                shapes,
            });
        }
        for (shape, (&lower, &upper)) in self.lower.iter().zip(&self.upper).enumerate() {
            let finite_inside = lower < f64::INFINITY && upper > f64::NEG_INFINITY;
            if !(lower <= upper && finite_inside) {
                return Err(RigError::CrossedBounds {
                    shape,
                    lower,
                    upper,
                });
            }
        }
        Ok(())
    }
}

/// Blend weights and how well they reproduce the target.
#[derive(Clone, Debug, PartialEq)]
pub struct BlendFit {
    /// One weight for each shape; bounds are met exactly.
    pub weights: Vec<f64>,
    /// Where each weight came to rest.
    pub activity: Vec<Activity>,
    /// Root mean square over the vertices (weighted by the vertex weights) of the distance left over, in length units.
    pub residual_rms: f64,
    /// Largest distance left over at a vertex of positive weight, in length units.
    pub residual_max: f64,
    /// Linear systems solved.
    pub iterations: usize,
    /// True when the optimality conditions hold to rounding; false when the iteration limit stopped the search, and the
    /// weights are feasible but perhaps not best.
    pub converged: bool,
}

impl BlendBasis {
    /// A basis of K shapes over n vertices: `deltas[k][v]` is the displacement of vertex v at weight 1 of shape k.
    ///
    /// # Errors
    /// When there are no shapes or vertices, the shapes differ in vertex count, a coordinate is not finite, or squares of
    /// displacements overflow or vanish.
    pub fn new(deltas: Vec<Vec<Vector3<f64>>>) -> Result<Self, RigError> {
        Self::build(deltas, None)
    }

    /// As [`BlendBasis::new`], with vertex v counting `vertex_weights[v]` times in every fit (say, its share of the area).
    ///
    /// # Errors
    /// As [`BlendBasis::new`]; and when the weights differ in number from the vertices, one is negative or not finite, or
    /// all are zero.
    pub fn weighted(
        deltas: Vec<Vec<Vector3<f64>>>,
        vertex_weights: &[f64],
    ) -> Result<Self, RigError> {
        Self::build(deltas, Some(vertex_weights))
    }

    fn build(
        deltas: Vec<Vec<Vector3<f64>>>,
        vertex_weights: Option<&[f64]>,
    ) -> Result<Self, RigError> {
        let vertices = check_shapes(&deltas)?;
        let roots = vertex_weights
            .map(|weights| check_vertex_weights(weights, vertices))
            .transpose()?;
        let mut shapes = DMatrix::zeros(3 * vertices, deltas.len());
        for (shape, mut column) in deltas.iter().zip(shapes.column_iter_mut()) {
            flatten_into(shape, roots.as_deref(), column.as_mut_slice());
        }
        let normal = shapes.tr_mul(&shapes);
        check_scale(&shapes, &normal)?;
        Ok(Self {
            normal,
            shapes,
            weight_sum: vertex_weights.map_or(vertices as f64, |weights| weights.iter().sum()),
            roots,
        })
    }

    /// Number of shapes K.
    pub fn shape_count(&self) -> usize {
        self.shapes.ncols()
    }

    /// Number of vertices n.
    pub fn vertex_count(&self) -> usize {
        self.shapes.nrows() / 3
    }

    /// The weights w inside `bounds` that minimise
    ///
    /// ```text
    /// sum_v c_v |sum_k w_k delta_kv - delta_v|^2  +  (regularisation + RIDGE) m |w|^2
    /// ```
    ///
    /// with the vertex weights c_v (1 unless given) and m the mean diagonal of the normal matrix, so that
    /// `regularisation` has no unit: 0 for the plain fit, 1e-3 to prefer small weights where shapes resemble each other.
    ///
    /// # Errors
    /// When vertex or bound counts do not match the basis, a coordinate is not finite, a lower bound is above its upper
    /// one, or `regularisation` is negative or not finite.
    pub fn fit(
        &self,
        delta: &[Vector3<f64>],
        bounds: &Bounds,
        regularisation: f64,
    ) -> Result<BlendFit, RigError> {
        self.check_target(delta)?;
        bounds.check(self.shape_count())?;
        if !(regularisation >= 0.0 && regularisation.is_finite()) {
            return Err(RigError::Regularisation {
                value: regularisation,
            });
        }
        let mut target = vec![0.0; 3 * delta.len()];
        flatten_into(delta, self.roots.as_deref(), &mut target);
        let target = DVector::from_vec(target);
        let target_norm = target.norm();
        let linear = self.shapes.tr_mul(&target);
        if !target_norm.is_finite() || linear.iter().any(|value| !value.is_finite()) {
            return Err(RigError::TargetScale);
        }
        let hessian = self.ridged_normal(regularisation);
        let slope_tolerance: Vec<f64> = hessian
            .diagonal()
            .iter()
            .map(|square| (SLOPE_TOLERANCE * square.sqrt() * target_norm).max(f64::MIN_POSITIVE))
            .collect();
        let solution = BoundedProgram {
            hessian: &hessian,
            linear: &linear,
            lower: &bounds.lower,
            upper: &bounds.upper,
            slope_tolerance: &slope_tolerance,
        }
        .solve();
        let (residual_rms, residual_max) = self.residual(target, &solution.weights);
        Ok(BlendFit {
            weights: solution.weights.as_slice().to_vec(),
            activity: solution.activity,
            residual_rms,
            residual_max,
            iterations: solution.iterations,
            converged: solution.converged,
        })
    }

    fn check_target(&self, delta: &[Vector3<f64>]) -> Result<(), RigError> {
        if delta.len() != self.vertex_count() {
            return Err(RigError::TargetVertexCount {
                found: delta.len(),
                expected: self.vertex_count(),
            });
        }
        delta
            .iter()
            .enumerate()
            .try_for_each(|(vertex, displacement)| check_finite(vertex, displacement))
    }

    fn ridged_normal(&self, regularisation: f64) -> DMatrix<f64> {
        let mean = self.normal.diagonal().mean();
        // A basis of nothing but zero shapes still needs a definite matrix; any positive number serves.
        let unit = if mean > 0.0 { mean } else { 1.0 };
        let mut hessian = self.normal.clone();
        for index in 0..hessian.nrows() {
            hessian[(index, index)] += (regularisation + RIDGE) * unit;
        }
        hessian
    }

    /// Root mean square and maximum of what the weights leave, from the shapes themselves: the normal equations would lose
    /// half the digits of a small residual.
    fn residual(&self, mut rest: DVector<f64>, weights: &DVector<f64>) -> (f64, f64) {
        self.subtract_blend(weights, rest.as_mut_slice());
        let rms = (rest.norm_squared() / self.weight_sum).sqrt();
        let largest = rest
            .as_slice()
            .chunks_exact(3)
            .enumerate()
            .map(|(vertex, part)| {
                let square = part.iter().map(|value| value * value).sum::<f64>();
                match &self.roots {
                    None => square,
                    Some(roots) if roots[vertex] > 0.0 => square / (roots[vertex] * roots[vertex]),
                    Some(_) => 0.0,
                }
            })
            .fold(0.0, f64::max);
        (rms, largest.sqrt())
    }

    /// rest -= sum_k w_k shape_k, four shapes at a time: the pass is bound by memory, and this touches `rest` less often.
    fn subtract_blend(&self, weights: &DVector<f64>, rest: &mut [f64]) {
        let rows = rest.len();
        let column = |index: usize| &self.shapes.as_slice()[index * rows..][..rows];
        let used: Vec<usize> = (0..weights.len())
            .filter(|&index| weights[index] != 0.0)
            .collect();
        let groups = used.chunks_exact(4);
        for &index in groups.remainder() {
            for (value, shape) in rest.iter_mut().zip(column(index)) {
                *value -= weights[index] * shape;
            }
        }
        for group in groups {
            let [a, b, c, d] = std::array::from_fn(|place| column(group[place]));
            let [wa, wb, wc, wd] = std::array::from_fn(|place| weights[group[place]]);
            for ((((value, a), b), c), d) in rest.iter_mut().zip(a).zip(b).zip(c).zip(d) {
                *value -= (wa * a + wb * b) + (wc * c + wd * d);
            }
        }
    }
}

fn check_shapes(deltas: &[Vec<Vector3<f64>>]) -> Result<usize, RigError> {
    let expected = deltas.first().ok_or(RigError::EmptyBasis)?.len();
    if expected == 0 {
        return Err(RigError::NoVertices);
    }
    for (shape, delta) in deltas.iter().enumerate() {
        if delta.len() != expected {
            return Err(RigError::ShapeVertexCount {
                shape,
                found: delta.len(),
                expected,
            });
        }
        for (vertex, displacement) in delta.iter().enumerate() {
            if let Some(&value) = displacement.iter().find(|value| !value.is_finite()) {
                return Err(RigError::NonFiniteShape {
                    shape,
                    vertex,
                    value,
                });
            }
        }
    }
    Ok(expected)
}

fn check_scale(shapes: &DMatrix<f64>, normal: &DMatrix<f64>) -> Result<(), RigError> {
    for (shape, column) in shapes.column_iter().enumerate() {
        let square = normal[(shape, shape)];
        let vanished = square < f64::MIN_POSITIVE / f64::EPSILON && column.amax() > 0.0;
        if vanished || !square.is_finite() {
            return Err(RigError::ShapeScale { shape });
        }
    }
    Ok(())
}

fn check_vertex_weights(weights: &[f64], vertices: usize) -> Result<Vec<f64>, RigError> {
    if weights.len() != vertices {
        return Err(RigError::VertexWeightCount {
            found: weights.len(),
            expected: vertices,
        });
    }
    if let Some(vertex) = weights
        .iter()
        .position(|weight| !(*weight >= 0.0 && weight.is_finite()))
    {
        return Err(RigError::VertexWeight {
            vertex,
            weight: weights[vertex],
        });
    }
    if weights.iter().all(|&weight| weight == 0.0) {
        return Err(RigError::NoVertexWeight);
    }
    Ok(weights.iter().map(|weight| weight.sqrt()).collect())
}

fn flatten_into(delta: &[Vector3<f64>], roots: Option<&[f64]>, flat: &mut [f64]) {
    for (vertex, (displacement, target)) in delta.iter().zip(flat.chunks_exact_mut(3)).enumerate() {
        let root = roots.map_or(1.0, |roots| roots[vertex]);
        for axis in 0..3 {
            target[axis] = root * displacement[axis];
        }
    }
}

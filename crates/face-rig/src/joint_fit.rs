//! Fits of the joint: its parameters to moved points or to a motion, and its pivot to several motions.

use crate::error::RigError;
use crate::joint::{Joint, JointParameters};
use nalgebra::{Isometry3, Matrix3, Vector3};

/// Parameters of a joint that carry one point set onto another, and what is left over.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct JointFit {
    /// The parameters with the least squared distance, angles in (-pi, pi].
    pub parameters: JointParameters,
    /// Root mean square over the points of the remaining distance, in length units.
    pub residual_rms: f64,
    /// Largest remaining distance, in length units.
    pub residual_max: f64,
}

/// Parameters of a joint nearest to a rigid motion.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MotionFit {
    /// The parameters; the pivot is carried exactly where the motion carries it.
    pub parameters: JointParameters,
    /// Angle between the two rotations in radians: the roll that the joint cannot follow.
    pub residual_angle: f64,
}

/// A pivot from several motions.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PivotFit {
    /// The joint with the fitted pivot.
    pub joint: Joint,
    /// Root mean square over the motions of |T(pivot) - pivot|: how far the joint must still slide, in length units.
    pub slide_rms: f64,
    /// Number of directions (0 to 3) in which the motions fix the pivot; along the others it stays as near as possible
    /// to the point given. A pure hinge fixes 2.
    pub determined: usize,
}

/// A direction in which the motions move a point less than this, per unit of distance and relative to the direction
/// they move most, does not say where the pivot is: there, measurement noise would throw it far away.
const UNDETERMINED: f64 = 1e-3;

/// Starting yaws of the global search, a multiple of 4 so that 0 and pi are among them. The reduced objective has at most
/// two harmonics under its root, hence far fewer maxima than this.
const YAW_SAMPLES: usize = 64;

impl Joint {
    /// The parameters that minimise `sum |transform(from_i) - to_i|^2`.
    ///
    /// The translation drops out with the means, and for a given yaw the best pitch is known in closed form, so what
    /// remains is one function of the yaw. It is scanned over the whole circle and polished by Newton's method:
    /// the result is the global minimum, and exact motions of any angle are recovered to rounding. Where points leave a
    /// rotation open (a single point, a line along its axis) that angle is 0.
    ///
    /// # Errors
    /// When the sets are empty, differ in length or hold a coordinate that is not finite.
    pub fn fit(&self, from: &[Vector3<f64>], to: &[Vector3<f64>]) -> Result<JointFit, RigError> {
        if from.len() != to.len() {
            return Err(RigError::PointCount {
                from: from.len(),
                to: to.len(),
            });
        }
        if from.is_empty() {
            return Err(RigError::NoPoints);
        }
        for (index, (before, after)) in from.iter().zip(to).enumerate() {
            check_finite(index, before)?;
            check_finite(index, after)?;
        }
        let (from_mean, to_mean) = (mean(from), mean(to));
        let mut correlation = Matrix3::zeros();
        for (before, after) in from.iter().zip(to) {
            correlation += (after - to_mean) * (before - from_mean).transpose();
        }
        let [pitch, yaw] = nearest_angles(&correlation);
        let rotation = Joint::rotation([pitch, yaw, 0.0, 0.0, 0.0]);
        let slide = to_mean - self.pivot - rotation * (from_mean - self.pivot);
        let parameters = [pitch, yaw, slide.x, slide.y, slide.z];
        let (residual_rms, residual_max) = distances(&self.positions(parameters, from), to);
        Ok(JointFit {
            parameters,
            residual_rms,
            residual_max,
        })
    }

    /// The parameters nearest to `motion`: the rotation nearest in the Frobenius norm, and the translation that carries
    /// the pivot exactly where `motion` does.
    ///
    /// # Errors
    /// When a coordinate of `motion` is not finite.
    pub fn fit_motion(&self, motion: &Isometry3<f64>) -> Result<MotionFit, RigError> {
        check_motion(0, motion)?;
        let rotation = motion.rotation.to_rotation_matrix().into_inner();
        let [pitch, yaw] = nearest_angles(&rotation);
        let slide = slide_of(motion, self.pivot);
        let parameters = [pitch, yaw, slide.x, slide.y, slide.z];
        let residual_angle = self
            .transform(parameters)
            .rotation
            .angle_to(&motion.rotation);
        Ok(MotionFit {
            parameters,
            residual_angle,
        })
    }

    /// The pivot that makes the joint slide least: it minimises `sum_k |T_k(pivot) - pivot|^2` over the motions T_k.
    ///
    /// As the joint may slide freely, every pivot describes every motion equally well; this is the one that explains as
    /// much as possible by turning, the mean hinge. Along directions the motions leave open (the axis of a
    /// pure hinge) the result is the point nearest to `near`.
    ///
    /// # Errors
    /// When there are no motions or a coordinate is not finite.
    pub fn fit_pivot(motions: &[Isometry3<f64>], near: Vector3<f64>) -> Result<PivotFit, RigError> {
        if motions.is_empty() {
            return Err(RigError::NoMotions);
        }
        check_finite(motions.len(), &near)?;
        let mut normal = Matrix3::zeros();
        let mut right_side = Vector3::zeros();
        for (index, motion) in motions.iter().enumerate() {
            check_motion(index, motion)?;
            let moved = motion.rotation.to_rotation_matrix().into_inner() - Matrix3::identity();
            normal += moved.transpose() * moved;
            right_side -= moved.transpose() * slide_of(motion, near);
        }
        let spectrum = normal.symmetric_eigen();
        let floor = spectrum.eigenvalues.max() * UNDETERMINED * UNDETERMINED;
        let mut pivot = near;
        let mut determined = 0;
        for (axis, &value) in spectrum.eigenvalues.iter().enumerate() {
            if value > floor.max(f64::MIN_POSITIVE) {
                let direction = spectrum.eigenvectors.column(axis).into_owned();
                pivot += direction * (direction.dot(&right_side) / value);
                determined += 1;
            }
        }
        let squares: f64 = motions
            .iter()
            .map(|motion| slide_of(motion, pivot).norm_squared())
            .sum();
        Ok(PivotFit {
            joint: Joint::new(pivot),
            slide_rms: (squares / motions.len() as f64).sqrt(),
            determined,
        })
    }
}

/// `[pitch, yaw]` of the R = R_y R_x that maximises trace(R^T B).
///
/// Written out, trace(R^T B) = C(yaw) cos pitch + S(yaw) sin pitch + B_00 cos yaw - B_20 sin yaw, so that the best pitch is
/// atan2(S, C).
fn nearest_angles(correlation: &Matrix3<f64>) -> [f64; 2] {
    let b = correlation;
    let harmonics = |yaw: f64| {
        let (sin, cos) = yaw.sin_cos();
        let along_cos = b[(0, 2)] * sin + b[(1, 1)] + b[(2, 2)] * cos;
        let along_sin = b[(0, 1)] * sin - b[(1, 2)] + b[(2, 1)] * cos;
        (along_cos, along_sin, b[(0, 0)] * cos - b[(2, 0)] * sin)
    };
    let score = |yaw: f64| {
        let (along_cos, along_sin, rest) = harmonics(yaw);
        along_cos.hypot(along_sin) + rest
    };
    // Rounding must not choose among equals: a later sample wins only by a clear margin, and yaw 0 comes first.
    let margin = 1e-12 * correlation.norm();
    let step = std::f64::consts::TAU / YAW_SAMPLES as f64;
    let mut yaw = 0.0;
    for sample in 1..YAW_SAMPLES {
        let half = sample.div_ceil(2) as f64;
        let candidate = if sample % 2 == 1 {
            half * step
        } else {
            -half * step
        };
        if score(candidate) > score(yaw) + margin {
            yaw = candidate;
        }
    }
    let (along_cos, along_sin, _) = harmonics(yaw);
    polish(b, [along_sin.atan2(along_cos), yaw])
}

/// Newton's method on trace(R^T B) over both angles; every step must climb, so it cannot leave the maximum it starts at.
fn polish(b: &Matrix3<f64>, mut angles: [f64; 2]) -> [f64; 2] {
    for _ in 0..50 {
        let rotation = Joint::rotation([angles[0], angles[1], 0.0, 0.0, 0.0]);
        let (gradient, hessian) = trace_derivatives(b, &rotation);
        let Some(step) = ascent_step(gradient, hessian) else {
            break;
        };
        let next = climb(b, angles, step);
        let change = (next[0] - angles[0]).abs().max((next[1] - angles[1]).abs());
        angles = next;
        if change <= f64::EPSILON {
            break;
        }
    }
    angles.map(|angle| {
        let (sin, cos) = angle.sin_cos();
        if angle.abs() <= std::f64::consts::PI {
            angle
        } else {
            sin.atan2(cos)
        }
    })
}

/// Gradient and Hessian of trace(R^T B) in `(pitch, yaw)`, the latter as `[pitch pitch, pitch yaw, yaw yaw]`.
///
/// R' by pitch is R [e_x]_x and by yaw is [e_y]_x R.
fn trace_derivatives(b: &Matrix3<f64>, rotation: &Matrix3<f64>) -> ([f64; 2], [f64; 3]) {
    let pitch = Vector3::x().cross_matrix();
    let yaw = Vector3::y().cross_matrix();
    let by_pitch = rotation * pitch;
    let by_yaw = yaw * rotation;
    (
        [by_pitch.dot(b), by_yaw.dot(b)],
        [
            (by_pitch * pitch).dot(b),
            (by_yaw * pitch).dot(b),
            (yaw * by_yaw).dot(b),
        ],
    )
}

/// The Newton step towards a maximum, or a scaled gradient step where the Hessian is not negative definite.
fn ascent_step(gradient: [f64; 2], hessian: [f64; 3]) -> Option<[f64; 2]> {
    let [pp, py, yy] = hessian;
    let size = pp.abs().max(py.abs()).max(yy.abs());
    if size == 0.0 {
        return None;
    }
    let determinant = pp * yy - py * py;
    if pp < 0.0 && determinant > 1e-12 * size * size {
        return Some([
            (py * gradient[1] - yy * gradient[0]) / determinant,
            (py * gradient[0] - pp * gradient[1]) / determinant,
        ]);
    }
    Some([gradient[0] / size, gradient[1] / size])
}

/// Shortens the step until the trace does not fall.
fn climb(b: &Matrix3<f64>, angles: [f64; 2], step: [f64; 2]) -> [f64; 2] {
    let trace = |at: [f64; 2]| Joint::rotation([at[0], at[1], 0.0, 0.0, 0.0]).dot(b);
    // Near the top the trace is flat to rounding while the angles can still improve, hence the slack.
    let least = trace(angles) - 4.0 * f64::EPSILON * b.norm();
    let mut scale = 1.0;
    while scale > 1e-6 {
        let next = [angles[0] + scale * step[0], angles[1] + scale * step[1]];
        if trace(next) >= least {
            return next;
        }
        scale *= 0.5;
    }
    angles
}

fn slide_of(motion: &Isometry3<f64>, point: Vector3<f64>) -> Vector3<f64> {
    motion.rotation * point - point + motion.translation.vector
}

fn mean(points: &[Vector3<f64>]) -> Vector3<f64> {
    points.iter().sum::<Vector3<f64>>() / points.len() as f64
}

fn distances(found: &[Vector3<f64>], wanted: &[Vector3<f64>]) -> (f64, f64) {
    let squares = || {
        found
            .iter()
            .zip(wanted)
            .map(|(a, b)| (a - b).norm_squared())
    };
    let rms = (squares().sum::<f64>() / found.len() as f64).sqrt();
    (rms, squares().fold(0.0, f64::max).sqrt())
}

pub(crate) fn check_finite(index: usize, vector: &Vector3<f64>) -> Result<(), RigError> {
    match vector.iter().find(|value| !value.is_finite()) {
        Some(&value) => Err(RigError::NonFinite { index, value }),
        None => Ok(()),
    }
}

fn check_motion(index: usize, motion: &Isometry3<f64>) -> Result<(), RigError> {
    check_finite(index, &motion.translation.vector)?;
    match motion
        .rotation
        .coords
        .iter()
        .find(|value| !value.is_finite())
    {
        Some(&value) => Err(RigError::NonFinite { index, value }),
        None => Ok(()),
    }
}

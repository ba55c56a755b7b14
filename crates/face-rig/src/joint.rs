//! The mandible joint: five parameters to a rigid motion, and its exact cotangents.

use nalgebra::{Isometry3, Matrix3, Translation3, UnitQuaternion, Vector3};

/// Parameters of the joint: `[theta_x, theta_y, t_x, t_y, t_z]`, angles in radians, translations in length units.
pub type JointParameters = [f64; 5];

/// A jaw joint that pitches about x (opening), yaws about y (chewing) and slides.
///
/// With `theta = [theta_x, theta_y, t_x, t_y, t_z]` and R = R_y(theta_y) R_x(theta_x) it moves
///
/// ```text
/// x  ->  R (x - pivot) + pivot + t
/// ```
///
/// The axes are those of the coordinates: x from ear to ear, y up. Any real angles are allowed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Joint {
    /// The point both rotations turn about, in length units.
    pub pivot: Vector3<f64>,
}

impl Joint {
    /// The parameters that move nothing.
    pub const REST: JointParameters = [0.0; 5];

    /// A joint that turns about `pivot` (length units).
    pub fn new(pivot: Vector3<f64>) -> Self {
        Self { pivot }
    }

    /// The rotation R_y(theta_y) R_x(theta_x) as a matrix.
    pub fn rotation(theta: JointParameters) -> Matrix3<f64> {
        let (sin_x, cos_x) = theta[0].sin_cos();
        let (sin_y, cos_y) = theta[1].sin_cos();
        Matrix3::new(
            cos_y,
            sin_y * sin_x,
            sin_y * cos_x,
            0.0,
            cos_x,
            -sin_x,
            -sin_y,
            cos_y * sin_x,
            cos_y * cos_x,
        )
    }

    /// The rigid motion x -> R (x - pivot) + pivot + t.
    pub fn transform(&self, theta: JointParameters) -> Isometry3<f64> {
        let rotation = UnitQuaternion::from_axis_angle(&Vector3::y_axis(), theta[1])
            * UnitQuaternion::from_axis_angle(&Vector3::x_axis(), theta[0]);
        Isometry3::from_parts(Translation3::from(self.offset(theta)), rotation)
    }

    /// The constant c = pivot + t - R pivot of the motion x -> R x + c.
    fn offset(&self, theta: JointParameters) -> Vector3<f64> {
        self.pivot - Self::rotation(theta) * self.pivot + translation(theta)
    }

    /// Where the motion takes each of `points` (length units); one result for each point, in order.
    pub fn positions(&self, theta: JointParameters, points: &[Vector3<f64>]) -> Vec<Vector3<f64>> {
        let mut moved = vec![Vector3::zeros(); points.len()];
        self.positions_into(theta, points, &mut moved);
        moved
    }

    /// As [`Joint::positions`], into the caller's buffer.
    ///
    /// # Panics
    /// When `moved` and `points` differ in length.
    pub fn positions_into(
        &self,
        theta: JointParameters,
        points: &[Vector3<f64>],
        moved: &mut [Vector3<f64>],
    ) {
        assert_eq!(moved.len(), points.len(), "one buffer entry for each point");
        let rotation = Self::rotation(theta);
        // One constant for all points: at rest it is exactly zero, and nothing moves by a rounding error.
        let offset = self.offset(theta);
        for (target, point) in moved.iter_mut().zip(points) {
            *target = rotation * point + offset;
        }
    }

    /// The velocity of each point when the parameters change at the rate `d_theta`: the tangent (Jacobian times vector)
    /// of [`Joint::positions`].
    ///
    /// With r = R (x - pivot) it is `(d_theta_x R e_x + d_theta_y e_y) x r + d_t`.
    pub fn tangent(
        &self,
        theta: JointParameters,
        d_theta: JointParameters,
        points: &[Vector3<f64>],
    ) -> Vec<Vector3<f64>> {
        let rotation = Self::rotation(theta);
        let spin = rotation.column(0) * d_theta[0] + Vector3::y() * d_theta[1];
        let slide = translation(d_theta);
        points
            .iter()
            .map(|point| spin.cross(&(rotation * (point - self.pivot))) + slide)
            .collect()
    }

    /// The cotangent of the parameters (plus Jacobian-transpose product of [`Joint::positions`]).
    ///
    /// `points_bar[i]` is dL / d position of point i; the result is dL / d theta. Because a rotation of all points about
    /// one axis does work only through their common torque, two sums suffice: with r_i = R (x_i - pivot),
    /// the force f = sum points_bar_i and the torque m = sum r_i x points_bar_i,
    ///
    /// ```text
    /// theta_bar = [ (R e_x) . m,  e_y . m,  f_x, f_y, f_z ]
    /// ```
    ///
    /// # Panics
    /// When `points_bar` and `points` differ in length.
    pub fn vjp(
        &self,
        theta: JointParameters,
        points: &[Vector3<f64>],
        points_bar: &[Vector3<f64>],
    ) -> JointParameters {
        assert_eq!(
            points_bar.len(),
            points.len(),
            "one cotangent for each point"
        );
        let rotation = Self::rotation(theta);
        let mut force = Vector3::zeros();
        let mut torque = Vector3::zeros();
        for (point, point_bar) in points.iter().zip(points_bar) {
            force += point_bar;
            torque += (rotation * (point - self.pivot)).cross(point_bar);
        }
        [
            rotation.column(0).dot(&torque),
            torque.y,
            force.x,
            force.y,
            force.z,
        ]
    }

    /// The cotangent of the parameters from that of the motion x -> R x + c of [`Joint::transform`], where
    /// c = pivot + t - R pivot: `rotation_bar[(i, j)]` is dL / d R_ij and `translation_bar[i]` is dL / d c_i.
    pub fn transform_vjp(
        &self,
        theta: JointParameters,
        rotation_bar: &Matrix3<f64>,
        translation_bar: &Vector3<f64>,
    ) -> JointParameters {
        let rotation = Self::rotation(theta);
        let total = rotation_bar - translation_bar * self.pivot.transpose();
        let torque = (0..3)
            .map(|axis| rotation.column(axis).cross(&total.column(axis)))
            .fold(Vector3::zeros(), |sum, part| sum + part);
        [
            rotation.column(0).dot(&torque),
            torque.y,
            translation_bar.x,
            translation_bar.y,
            translation_bar.z,
        ]
    }
}

fn translation(theta: JointParameters) -> Vector3<f64> {
    Vector3::new(theta[2], theta[3], theta[4])
}

//! The starfish as the negative side of a smooth function: a disc and tapered arms, blended.

use nalgebra::Vector3;

use crate::{ShapeError, StarfishShape};

/// Depth of the underside as a part of the height of the top.
const UNDERSIDE: f64 = 0.75;
/// Half width of the band in which top and underside go over into each other, as a part of the height.
const UNDERSIDE_BAND: f64 = 0.3;
/// Where the axis of an arm's cone starts, as a part of the disc radius: within the disc, so that no groove rings it.
const ARM_START: f64 = 0.5;
/// Blend length of the smooth minimum, as a part of the arm's half width.
const BLEND: f64 = 0.25;

/// The body of a starfish as an implicit function: negative inside, zero on the surface, positive outside.
///
/// Near the surface the value is of the size of the distance, but not equal to it. The function is the smooth minimum
/// `-k log(sum_i exp(-f_i / k))` of a flat ellipsoid (the disc) and of one round cone for each arm, the cones being
/// flattened by stretching y. It is symmetric under the turns that exchange arms.
#[derive(Clone, Debug)]
pub struct StarfishBody {
    directions: Vec<[f64; 2]>,
    disc_radius: f64,
    height: f64,
    arm_stretch: f64,
    arm: RoundCone,
    blend: f64,
    underside_scale: f64,
}

impl StarfishBody {
    /// Prepares the function of a shape.
    ///
    /// # Errors
    /// As [`StarfishShape::check`].
    pub fn new(shape: &StarfishShape) -> Result<Self, ShapeError> {
        shape.check()?;
        let directions = (0..shape.arms)
            .map(|arm| {
                let (sin, cos) = shape.arm_angle(arm).sin_cos();
                [cos, sin]
            })
            .collect();
        let mut body = Self {
            directions,
            disc_radius: shape.disc_radius,
            height: shape.thickness,
            arm_stretch: shape.arm_width / shape.arm_height(),
            arm: arm_cone(shape),
            blend: BLEND * shape.arm_width,
            underside_scale: 1.0,
        };
        body.underside_scale = shape.thickness / body.flattened(shape.thickness)[0];
        Ok(body)
    }

    /// The function's value at a point.
    pub fn value(&self, point: &Vector3<f64>) -> f64 {
        self.value_and_gradient(point).0
    }

    /// The function's value and gradient at a point.
    pub fn value_and_gradient(&self, point: &Vector3<f64>) -> (f64, Vector3<f64>) {
        let [y, d_y] = self.flattened(point.y);
        let (disc, disc_gradient) = self.disc(point, y, d_y);
        let mut sum = SmoothMin::new(self.blend, disc, disc_gradient);
        let y_arm = y * self.arm_stretch;
        let d_y_arm = d_y * self.arm_stretch;
        for &[cos, sin] in &self.directions {
            let along = cos * point.x + sin * point.z;
            let across = cos * point.z - sin * point.x;
            let radial = across.hypot(y_arm);
            let (value, [by_along, by_radial]) = self.arm.value_and_gradient(along, radial);
            let by_radial = if radial > 0.0 {
                by_radial / radial
            } else {
                0.0
            };
            let by_across = by_radial * across;
            sum.add(
                value,
                Vector3::new(
                    by_along * cos - by_across * sin,
                    by_radial * y_arm * d_y_arm,
                    by_along * sin + by_across * cos,
                ),
            );
        }
        sum.finish()
    }

    /// A height, enlarged below the plane, so that the shape is flatter there; and the derivative.
    fn flattened(&self, y: f64) -> [f64; 2] {
        let excess = 0.5 * (1.0 / UNDERSIDE - 1.0);
        let band = UNDERSIDE_BAND * self.height;
        let root = y.hypot(band);
        [
            self.underside_scale * (y + excess * (y - root + band)),
            self.underside_scale * (1.0 + excess * (1.0 - y / root)),
        ]
    }

    fn disc(&self, point: &Vector3<f64>, y: f64, d_y: f64) -> (f64, Vector3<f64>) {
        let radius = self.disc_radius;
        let flat = radius / self.height;
        let square = point.x * point.x + point.z * point.z + (flat * y).powi(2);
        (
            0.5 * (square / radius - radius),
            Vector3::new(point.x, flat * flat * y * d_y, point.z) / radius,
        )
    }
}

/// The cone that has the arm's half width where it leaves the disc.
fn arm_cone(shape: &StarfishShape) -> RoundCone {
    let start = ARM_START * shape.disc_radius;
    let end = shape.radius - shape.tip_width;
    let taper = (shape.arm_width - shape.tip_width) / (end - shape.disc_radius);
    let start_width = shape.tip_width + taper * (end - start);
    RoundCone::new([start, end], [start_width, shape.tip_width])
}

/// The distance from a cone with spherical ends, in its half plane (along, radial).
#[derive(Clone, Debug)]
struct RoundCone {
    start: f64,
    length: f64,
    radii: [f64; 2],
    /// Sine and cosine of half the opening angle.
    sin: f64,
    cos: f64,
}

impl RoundCone {
    fn new([start, end]: [f64; 2], radii: [f64; 2]) -> Self {
        let length = end - start;
        let sin = (radii[0] - radii[1]) / length;
        Self {
            start,
            length,
            radii,
            sin,
            cos: (1.0 - sin * sin).sqrt(),
        }
    }

    /// The signed distance and its gradient by (along, radial).
    fn value_and_gradient(&self, along: f64, radial: f64) -> (f64, [f64; 2]) {
        let from_start = along - self.start;
        let foot = self.cos * from_start - self.sin * radial;
        if foot < 0.0 {
            sphere(from_start, radial, self.radii[0])
        } else if foot > self.cos * self.length {
            sphere(from_start - self.length, radial, self.radii[1])
        } else {
            (
                self.cos * radial + self.sin * from_start - self.radii[0],
                [self.sin, self.cos],
            )
        }
    }
}

fn sphere(along: f64, radial: f64, radius: f64) -> (f64, [f64; 2]) {
    let distance = along.hypot(radial);
    let scale = if distance > 0.0 { 1.0 / distance } else { 0.0 };
    (distance - radius, [along * scale, radial * scale])
}

/// `-k log(sum_i exp(-f_i / k))` with its gradient, shifted by the least value so far: no overflow.
struct SmoothMin {
    blend: f64,
    least: f64,
    sum: f64,
    gradient_sum: Vector3<f64>,
}

impl SmoothMin {
    fn new(blend: f64, value: f64, gradient: Vector3<f64>) -> Self {
        Self {
            blend,
            least: value,
            sum: 1.0,
            gradient_sum: gradient,
        }
    }

    fn add(&mut self, value: f64, gradient: Vector3<f64>) {
        if value < self.least {
            let shrink = ((value - self.least) / self.blend).exp();
            self.sum *= shrink;
            self.gradient_sum *= shrink;
            self.least = value;
        }
        let weight = ((self.least - value) / self.blend).exp();
        self.sum += weight;
        self.gradient_sum += gradient * weight;
    }

    fn finish(self) -> (f64, Vector3<f64>) {
        (
            self.least - self.blend * self.sum.ln(),
            self.gradient_sum / self.sum,
        )
    }
}

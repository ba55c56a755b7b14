//! Poses: each arm bends along a curved centreline that carries its cross-sections.

use std::f64::consts::PI;

use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

use crate::{ShapeError, StarfishShape};

/// The held radius as a part of the disc radius.
const HELD: f64 = 0.8;
/// Length over which bending sets in, as a part of the arm's length.
const ONSET: f64 = 1.0 / 8.0;
/// A lift's bending lasts this many onsets, and one more to fade: 5/8 of the arm in all.
const LIFT_ONSETS: f64 = 4.0;
/// An arm moves fully up to this part of its half sector's width, and not at all at the border.
const FULL_SECTOR: f64 = 0.7;
/// Centreline integrals are tabulated at this many places in each onset length.
const PANELS_PER_ONSET: usize = 8;
/// Gauss-Legendre nodes on [0, 1] and weights, exact to degree 7.
const GAUSS: [[f64; 2]; 4] = [
    [0.069_431_844_202_973_71, 0.173_927_422_568_726_93],
    [0.330_009_478_207_571_87, 0.326_072_577_431_273_07],
    [0.669_990_521_792_428_1, 0.326_072_577_431_273_07],
    [0.930_568_155_797_026_3, 0.173_927_422_568_726_93],
];

/// How one arm is bent; all angles in degrees, zero by default.
///
/// With the default shape, |curl| and |twist| up to 120, |lift| up to 60 and |sway| up to 40 may come together: nothing
/// turns over and no arm meets another when all arms do the same.
#[derive(Clone, Copy, Debug, Default, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields, default)]
pub struct ArmPose {
    /// Upward bending of constant curvature: the angle between root and tip.
    pub curl: f64,
    /// Bending of constant curvature in the plane of the body, positive from +x towards +z (for arm 0).
    pub sway: f64,
    /// Rotation of the tip about the arm's own axis, right-handed, growing evenly from the root.
    pub twist: f64,
    /// Upward bending within the first 5/8 of the arm: the rest rises at this angle.
    pub lift: f64,
}

/// How a starfish is bent: one entry for each arm, missing ones are straight.
#[derive(Clone, Debug, Default, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields, default)]
pub struct StarfishPose {
    /// The arms, in the order of [`StarfishShape`].
    pub arms: Vec<ArmPose>,
}

impl StarfishPose {
    /// Checks that the pose fits the shape.
    ///
    /// # Errors
    /// [`ShapeError::PoseArmCount`] or [`ShapeError::PoseAngle`], or as [`StarfishShape::check`].
    pub fn check(&self, shape: &StarfishShape) -> Result<(), ShapeError> {
        shape.check()?;
        if self.arms.len() > shape.arms {
            return Err(ShapeError::PoseArmCount {
                given: self.arms.len(),
                arms: shape.arms,
            });
        }
        for (arm, pose) in self.arms.iter().enumerate() {
            for (field, value) in [
                ("curl", pose.curl),
                ("sway", pose.sway),
                ("twist", pose.twist),
                ("lift", pose.lift),
            ] {
                if !value.is_finite() {
                    return Err(ShapeError::PoseAngle { arm, field, value });
                }
            }
        }
        Ok(())
    }
}

/// The distance from the axis within which no pose moves anything: 0.8 of the disc radius.
pub fn held_radius(shape: &StarfishShape) -> f64 {
    HELD * shape.disc_radius
}

/// Moves points of the body, or near it, by a pose; they may lie on the surface or anywhere inside.
///
/// A point of arm `i` has coordinates (s, y, t) along the arm, up and across. With `held` the [`held_radius`], bending
/// angles `a(s)` (up), `b(s)` (in the plane) and the twist `c(s)` grow from zero at s = `held`, their rates being
/// continuously differentiable. Then
/// `x(s, y, t) = held e_s + int_held^s T ds + (y cos c - t sin c) N + (y sin c + t cos c) B` with the orthonormal frame
/// `T = (cos a cos b, sin a, cos a sin b)`, `N = (-sin a cos b, cos a, -sin a sin b)`, `B = (-sin b, 0, cos b)`.
/// Its Jacobian determinant is 1 less the curvature times the offset towards the centre of curvature. Displacements fade to zero towards
/// the border between two arms, where the body has only its disc, so the map is continuous.
///
/// # Panics
/// When [`StarfishPose::check`] fails.
pub fn pose(
    shape: &StarfishShape,
    pose: &StarfishPose,
    points: &[Vector3<f64>],
) -> Vec<Vector3<f64>> {
    if let Err(error) = pose.check(shape) {
        panic!("a pose that does not fit its shape: {error}");
    }
    let arms: Vec<Arm> = (0..shape.arms)
        .map(|arm| Arm::new(shape, arm, pose.arms.get(arm).copied().unwrap_or_default()))
        .collect();
    let sector = 2.0 * PI / shape.arms as f64;
    points
        .iter()
        .map(|point| {
            let turn = (point.z.atan2(point.x) / sector).round() as isize;
            arms[turn.rem_euclid(shape.arms as isize) as usize].moved(point)
        })
        .collect()
}

/// One arm, ready to move points.
struct Arm {
    along: [f64; 2],
    held: f64,
    length: f64,
    /// Tangent of half the sector's angle.
    half_sector: f64,
    bend: Option<Bend>,
}

impl Arm {
    fn new(shape: &StarfishShape, arm: usize, pose: ArmPose) -> Self {
        let (sin, cos) = shape.arm_angle(arm).sin_cos();
        let held = held_radius(shape);
        let length = shape.radius - held;
        Self {
            along: [cos, sin],
            held,
            length,
            half_sector: (PI / shape.arms as f64).tan(),
            bend: (pose != ArmPose::default()).then(|| Bend::new(pose)),
        }
    }

    fn moved(&self, point: &Vector3<f64>) -> Vector3<f64> {
        let [cos, sin] = self.along;
        let along = cos * point.x + sin * point.z;
        let across = cos * point.z - sin * point.x;
        let Some(bend) = &self.bend else {
            return *point;
        };
        if along <= self.held {
            return *point;
        }
        let local = Vector3::new(
            (along - self.held) / self.length,
            point.y / self.length,
            across / self.length,
        );
        let border = across.abs() / (along * self.half_sector);
        let weight = 1.0 - smooth_step((border - FULL_SECTOR) / (1.0 - FULL_SECTOR));
        let [d_along, d_y, d_across] =
            ((bend.moved(&local) - local) * (weight * self.length)).into();
        point
            + Vector3::new(
                cos * d_along - sin * d_across,
                d_y,
                sin * d_along + cos * d_across,
            )
    }
}

/// The bending of an arm of length 1 that starts at the origin.
struct Bend {
    curl: f64,
    sway: f64,
    twist: f64,
    lift: f64,
    /// The centreline at the ends of the panels.
    centres: Vec<Vector3<f64>>,
}

impl Bend {
    fn new(pose: ArmPose) -> Self {
        let mut bend = Self {
            curl: pose.curl.to_radians(),
            sway: pose.sway.to_radians(),
            twist: pose.twist.to_radians(),
            lift: pose.lift.to_radians(),
            centres: vec![Vector3::zeros()],
        };
        let panels = (1.0 / PANEL).round() as usize;
        for panel in 0..panels {
            let next = bend.centre_from(panel, (panel + 1) as f64 * PANEL);
            bend.centres.push(next);
        }
        bend
    }

    fn moved(&self, local: &Vector3<f64>) -> Vector3<f64> {
        let s = local.x;
        let panel = ((s / PANEL) as usize).min(self.centres.len() - 1);
        let (sin_c, cos_c) = (self.twist * evenly(s)).sin_cos();
        let up = local.y * cos_c - local.z * sin_c;
        let across = local.y * sin_c + local.z * cos_c;
        let (sin_a, cos_a) = self.rise(s).sin_cos();
        let (sin_b, cos_b) = self.turn(s).sin_cos();
        let normal = Vector3::new(-sin_a * cos_b, cos_a, -sin_a * sin_b);
        let binormal = Vector3::new(-sin_b, 0.0, cos_b);
        self.centre_from(panel, s) + normal * up + binormal * across
    }

    /// The centreline at `s`, integrated from the start of a panel.
    fn centre_from(&self, panel: usize, s: f64) -> Vector3<f64> {
        let start = panel as f64 * PANEL;
        GAUSS
            .iter()
            .fold(self.centres[panel], |centre, &[node, weight]| {
                let at = start + node * (s - start);
                let (sin_a, cos_a) = self.rise(at).sin_cos();
                let (sin_b, cos_b) = self.turn(at).sin_cos();
                let tangent = Vector3::new(cos_a * cos_b, sin_a, cos_a * sin_b);
                centre + tangent * (weight * (s - start))
            })
    }

    fn rise(&self, s: f64) -> f64 {
        self.curl * evenly(s) + self.lift * at_root(s)
    }

    fn turn(&self, s: f64) -> f64 {
        self.sway * evenly(s)
    }
}

const PANEL: f64 = ONSET / PANELS_PER_ONSET as f64;

/// Grows from 0 at s = 0 to 1 at s = 1, evenly after the onset.
fn evenly(s: f64) -> f64 {
    smooth_ramp(s / ONSET) / (1.0 / ONSET - 0.5)
}

/// Grows from 0 at s = 0 to 1 at the end of the lift's bending, and stays there.
fn at_root(s: f64) -> f64 {
    let u = s / ONSET;
    (smooth_ramp(u) - smooth_ramp(u - LIFT_ONSETS)) / LIFT_ONSETS
}

/// The integral of [`smooth_step`] from 0.
fn smooth_ramp(u: f64) -> f64 {
    let inside = u.clamp(0.0, 1.0);
    inside.powi(3) * (1.0 - 0.5 * inside) + (u - 1.0).max(0.0)
}

/// 0 up to u = 0, 1 from u = 1, once continuously differentiable.
fn smooth_step(u: f64) -> f64 {
    let inside = u.clamp(0.0, 1.0);
    inside * inside * (3.0 - 2.0 * inside)
}

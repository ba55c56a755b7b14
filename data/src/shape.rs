//! The measures of a starfish.

use std::f64::consts::PI;

use serde::{Deserialize, Serialize};

use crate::ShapeError;

const MIN_ARMS: usize = 3;
const MAX_ARMS: usize = 12;
/// Height of an arm's root as a part of the height at the centre.
const ARM_HEIGHT: f64 = 0.75;

/// The measures of a starfish that lies in the plane y = 0, Y up, with arm 0 along +x and arm `i` turned from there by
/// `i / arms` of a full turn towards +z. All lengths are in one unit of the user's choice.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields, default)]
pub struct StarfishShape {
    /// Number of arms, 3 to 12.
    pub arms: usize,
    /// Distance of the arm tips from the centre.
    pub radius: f64,
    /// Radius of the disc that the arms grow from.
    pub disc_radius: f64,
    /// Half width of an arm at its root.
    pub arm_width: f64,
    /// Radius of the rounded tip of an arm, seen from above.
    pub tip_width: f64,
    /// Height of the domed top above the plane y = 0 at the centre. The underside is flatter, and arms get lower towards
    /// their tips as they get narrower.
    pub thickness: f64,
    /// Length of the triangle edges, on average.
    pub resolution: f64,
}

impl Default for StarfishShape {
    fn default() -> Self {
        Self {
            arms: 5,
            radius: 1.0,
            disc_radius: 0.3,
            arm_width: 0.16,
            tip_width: 0.06,
            thickness: 0.14,
            resolution: 0.03,
        }
    }
}

impl StarfishShape {
    /// Checks that the measures describe a starfish.
    ///
    /// # Errors
    /// [`ShapeError::ArmCount`], [`ShapeError::NotPositive`] or [`ShapeError::TooLarge`], naming the field.
    pub fn check(&self) -> Result<(), ShapeError> {
        if !(MIN_ARMS..=MAX_ARMS).contains(&self.arms) {
            return Err(ShapeError::ArmCount {
                arms: self.arms,
                min: MIN_ARMS,
                max: MAX_ARMS,
            });
        }
        for (field, value) in [
            ("radius", self.radius),
            ("disc_radius", self.disc_radius),
            ("arm_width", self.arm_width),
            ("tip_width", self.tip_width),
            ("thickness", self.thickness),
            ("resolution", self.resolution),
        ] {
            if !(value > 0.0 && value.is_finite()) {
                return Err(ShapeError::NotPositive { field, value });
            }
        }
        self.check_proportions()
    }

    fn check_proportions(&self) -> Result<(), ShapeError> {
        let half_sector = PI / self.arms as f64;
        for (field, value, limit, reason) in [
            (
                "disc_radius",
                self.disc_radius,
                0.5 * self.radius,
                "half of `radius`",
            ),
            (
                "arm_width",
                self.arm_width,
                self.disc_radius * half_sector.tan().min(1.0),
                "where neighbouring arms touch at `disc_radius`",
            ),
            (
                "tip_width",
                self.tip_width,
                self.arm_width,
                "`arm_width`: arms taper",
            ),
            (
                "thickness",
                self.thickness,
                self.arm_width,
                "`arm_width`: arms are flat, so that they can bend",
            ),
            (
                "resolution",
                self.resolution,
                self.tip_height(),
                "the half height of the arm tips, 3/4 `thickness` `tip_width` / `arm_width`",
            ),
        ] {
            if value >= limit {
                return Err(ShapeError::TooLarge {
                    field,
                    value,
                    limit,
                    reason,
                });
            }
        }
        Ok(())
    }

    /// Half the height of an arm where its half width is `arm_width`, not counting that the underside is flatter.
    pub(crate) fn arm_height(&self) -> f64 {
        ARM_HEIGHT * self.thickness
    }

    fn tip_height(&self) -> f64 {
        self.arm_height() * self.tip_width / self.arm_width
    }

    /// The angle of arm `arm` about the axis, in radians from +x towards +z.
    pub(crate) fn arm_angle(&self, arm: usize) -> f64 {
        2.0 * PI * arm as f64 / self.arms as f64
    }
}

//! Where a picture is taken from.

use crate::error::ReportError;
use nalgebra::{Matrix3, Vector3};

/// Free space left on each side of a framed object, as a part of its half width or height.
const MARGIN: f64 = 0.05;

/// A view that keeps its framing whatever it shows, so that pictures of several shapes can be compared.
///
/// Its window fits into a picture of any width and height, centred and undistorted.
#[derive(Clone, Debug, PartialEq)]
pub struct Camera {
    /// Rows: right, up, backwards (towards the viewer).
    axes: Matrix3<f64>,
    /// The eye, or for an orthographic view any point.
    origin: Vector3<f64>,
    perspective: bool,
    /// Middle of the window in units of the projected plane.
    centre: [f64; 2],
    /// Half width and height of the window.
    half: [f64; 2],
}

/// A point as the camera sees it.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Projected {
    /// Right and up on the projected plane.
    pub plane: [f64; 2],
    /// Grows towards the viewer and is affine over the picture of a plane: minus the depth, or one over it.
    pub nearness: f64,
}

impl Camera {
    /// An orthographic view along `direction` (from the viewer into the scene) that just holds all `points`.
    ///
    /// `up` need not be at right angles to `direction`. For several shapes chain their vertices:
    ///
    /// ```
    /// # use nalgebra::Vector3;
    /// # let (first, second) = ([Vector3::new(0.0, 1.0, 2.0)], [Vector3::new(1.0, 0.0, 0.0)]);
    /// let camera = report::Camera::framing(first.iter().chain(&second), -Vector3::z(), Vector3::y())?;
    /// # Ok::<(), report::ReportError>(())
    /// ```
    ///
    /// # Errors
    /// When there are no points, one is not finite, or the two directions do not span a view.
    pub fn framing<'a>(
        points: impl IntoIterator<Item = &'a Vector3<f64>>,
        direction: Vector3<f64>,
        up: Vector3<f64>,
    ) -> Result<Self, ReportError> {
        let mut camera = Self {
            axes: view_axes(direction, up)?,
            origin: Vector3::zeros(),
            perspective: false,
            centre: [0.0; 2],
            half: [1.0; 2],
        };
        let bounds = Bounds::of(points.into_iter().map(|point| camera.axes * point))?;
        // Depths are kept in single precision, so they are counted from the middle of the object.
        let middle = 0.5 * (bounds.low + bounds.high);
        camera.origin = camera.axes.transpose() * middle;
        camera.set_window(bounds.low - middle, bounds.high - middle);
        Ok(camera)
    }

    /// As [`Camera::framing`], in perspective: the eye stands so far away that the points span about
    /// `field_of_view` (radians; 0.35 looks natural for a face).
    ///
    /// # Errors
    /// As [`Camera::framing`]; and when the field of view is not between 0 and pi.
    pub fn framing_perspective<'a>(
        points: impl IntoIterator<Item = &'a Vector3<f64>, IntoIter: Clone>,
        direction: Vector3<f64>,
        up: Vector3<f64>,
        field_of_view: f64,
    ) -> Result<Self, ReportError> {
        if !(field_of_view > 0.0 && field_of_view < std::f64::consts::PI) {
            return Err(ReportError::FieldOfView {
                radians: field_of_view,
            });
        }
        let points = points.into_iter();
        let mut camera = Self::framing(points.clone(), direction, up)?;
        let centred = |point| camera.axes * (point - camera.origin);
        let bounds = Bounds::of(points.clone().map(centred))?;
        let radius = camera.half[0].max(camera.half[1]);
        let distance = radius / (0.5 * field_of_view).tan();
        camera.origin += camera.axes.row(2).transpose() * (bounds.high.z + distance);
        camera.perspective = true;
        let plane = |point| {
            let [x, y] = camera
                .project(point)
                .map_or([0.0; 2], |projected| projected.plane);
            Vector3::new(x, y, 0.0)
        };
        let window = Bounds::of(points.map(plane))?;
        camera.set_window(window.low, window.high);
        Ok(camera)
    }

    /// Width over height of the framed window: the shape of a picture without empty sides.
    pub fn aspect(&self) -> f64 {
        self.half[0] / self.half[1]
    }

    fn set_window(&mut self, low: Vector3<f64>, high: Vector3<f64>) {
        for axis in 0..2 {
            self.centre[axis] = 0.5 * (low[axis] + high[axis]);
            self.half[axis] = 0.5 * (high[axis] - low[axis]) * (1.0 + MARGIN);
        }
        // A flat or single-point object still needs an area to look at.
        let largest = self.half[0].max(self.half[1]);
        let least = if largest > 0.0 { 1e-3 * largest } else { 1.0 };
        self.half = self.half.map(|half| half.max(least));
    }

    /// Turns a direction of the scene into right, up, backwards.
    pub(crate) fn turn(&self, direction: &Vector3<f64>) -> Vector3<f64> {
        self.axes * direction
    }

    /// The point on the projected plane; nothing where it is not in front of the eye.
    pub(crate) fn project(&self, point: &Vector3<f64>) -> Option<Projected> {
        let seen = self.axes * (point - self.origin);
        if !self.perspective {
            return Some(Projected {
                plane: [seen.x, seen.y],
                nearness: seen.z,
            });
        }
        let depth = -seen.z;
        (depth > 0.0).then(|| Projected {
            plane: [seen.x / depth, seen.y / depth],
            nearness: 1.0 / depth,
        })
    }

    /// True when [`Projected::nearness`] is one over the depth.
    pub(crate) fn is_perspective(&self) -> bool {
        self.perspective
    }

    /// Scale and offset `(s, [x, y])` that take the projected plane to pixels of a picture: x s + x_0 and y_0 - y s.
    pub(crate) fn to_pixels(&self, width: usize, height: usize) -> (f64, [f64; 2]) {
        let (width, height) = (width as f64, height as f64);
        let scale = (0.5 * width / self.half[0]).min(0.5 * height / self.half[1]);
        (
            scale,
            [
                0.5 * width - scale * self.centre[0],
                0.5 * height + scale * self.centre[1],
            ],
        )
    }
}

/// Right, up and backwards as the rows of a rotation.
fn view_axes(direction: Vector3<f64>, up: Vector3<f64>) -> Result<Matrix3<f64>, ReportError> {
    let failed = ReportError::CameraAxes {
        direction: direction.into(),
        up: up.into(),
    };
    let Some(forwards) = direction
        .try_normalize(0.0)
        .filter(|v| v.iter().all(|x| x.is_finite()))
    else {
        return Err(failed);
    };
    let Some(upwards) = up
        .try_normalize(0.0)
        .filter(|v| v.iter().all(|x| x.is_finite()))
    else {
        return Err(failed);
    };
    let Some(right) = forwards.cross(&upwards).try_normalize(1e-9) else {
        return Err(failed);
    };
    let upright = right.cross(&forwards);
    Ok(Matrix3::from_rows(&[
        right.transpose(),
        upright.transpose(),
        -forwards.transpose(),
    ]))
}

struct Bounds {
    low: Vector3<f64>,
    high: Vector3<f64>,
}

impl Bounds {
    fn of(points: impl Iterator<Item = Vector3<f64>>) -> Result<Self, ReportError> {
        let mut bounds = Self {
            low: Vector3::repeat(f64::INFINITY),
            high: Vector3::repeat(f64::NEG_INFINITY),
        };
        for (vertex, point) in points.enumerate() {
            if let Some(&value) = point.iter().find(|value| !value.is_finite()) {
                return Err(ReportError::NonFiniteVertex { vertex, value });
            }
            bounds.low = bounds.low.inf(&point);
            bounds.high = bounds.high.sup(&point);
        }
        if bounds.low.x > bounds.high.x {
            return Err(ReportError::NothingToFrame);
        }
        Ok(bounds)
    }
}

//! Sample points for the tests.

use nalgebra::Vector3;
use scene_shapes::{StarfishBody, StarfishShape};

/// Evenly spread points of [0, 1)^3: Roberts's R3 sequence.
pub fn spread(index: usize) -> Vector3<f64> {
    Vector3::new(
        0.819_172_513_396_164_4,
        0.671_043_606_703_789_2,
        0.549_700_477_901_970_2,
    )
    .map(|step: f64| (0.5 + step * (index + 1) as f64).fract())
}

/// Points inside the body among `count` spread over its bounding box.
pub fn inside(shape: &StarfishShape, count: usize) -> Vec<Vector3<f64>> {
    let body = StarfishBody::new(shape).expect("a valid shape");
    let half = Vector3::new(shape.radius, 1.3 * shape.thickness, shape.radius);
    (0..count)
        .map(|index| (2.0 * spread(index) - Vector3::repeat(1.0)).component_mul(&half))
        .filter(|point| body.value(point) < 0.0)
        .collect()
}

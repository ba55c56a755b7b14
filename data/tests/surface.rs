//! The starfish's surface: topology, symmetry, quality, and what bad measures lead to.

mod common;

use std::collections::HashMap;

use nalgebra::{Rotation3, Vector3};
use scene_shapes::{ShapeError, StarfishBody, StarfishShape, starfish};
use serde::Deserialize;
use serde::de::value::{Error as ValueError, MapDeserializer};
use surface_mesh::{Surface, report};

fn angles(surface: &Surface) -> Vec<f64> {
    let v = surface.vertices();
    surface
        .triangles()
        .iter()
        .flat_map(|t| {
            [0, 1, 2].map(|i| {
                let [a, b, c] = [0, 1, 2].map(|k| v[t[(i + k) % 3] as usize]);
                (b - a).angle(&(c - a)).to_degrees()
            })
        })
        .collect()
}

fn edge_lengths(surface: &Surface) -> Vec<f64> {
    let v = surface.vertices();
    surface
        .triangles()
        .iter()
        .flat_map(|t| [0, 1, 2].map(|i| (v[t[i] as usize] - v[t[(i + 1) % 3] as usize]).norm()))
        .collect()
}

fn least(values: &[f64]) -> f64 {
    values.iter().copied().fold(f64::INFINITY, f64::min)
}

#[test]
fn the_default_surface_is_a_sphere_of_good_triangles_on_the_zero_set() {
    let shape = StarfishShape::default();
    let surface = starfish(&shape).unwrap();
    let body = StarfishBody::new(&shape).unwrap();
    let findings = report(&surface);
    assert!(findings.is_solid());
    assert_eq!(findings.components.len(), 1);
    assert!(findings.unused_vertices.is_empty() && findings.duplicate_vertices.is_empty());
    let vertices = surface.vertex_count();
    assert!((3000..6000).contains(&vertices), "{vertices} vertices");
    assert_eq!(2 * vertices, surface.triangles().len() + 4, "genus 0");

    let off = surface
        .vertices()
        .iter()
        .map(|v| body.value(v).abs())
        .fold(0.0, f64::max);
    assert!(off < 1e-14, "{off:e} off the zero set");
    let angle = least(&angles(&surface));
    assert!(angle > 25.0, "least angle {angle}");
    let edges = edge_lengths(&surface);
    let mean = edges.iter().sum::<f64>() / edges.len() as f64;
    assert!(
        (mean / shape.resolution - 1.0).abs() < 0.05,
        "mean edge {mean}"
    );
    let normals_agree = surface.triangles().iter().all(|t| {
        let [a, b, c] = t.map(|i| surface.vertices()[i as usize]);
        let outward = body.value_and_gradient(&((a + b + c) / 3.0)).1;
        outward.angle(&(b - a).cross(&(c - a))) < 0.5
    });
    assert!(normals_agree);
    eprintln!(
        "{vertices} vertices, least angle {angle:.1} degrees, mean edge {mean:.4}, off {off:.1e}"
    );
}

#[test]
fn measures_are_those_asked_for() {
    let shape = StarfishShape::default();
    let surface = starfish(&shape).unwrap();
    let body = StarfishBody::new(&shape).unwrap();
    let tip = body.value(&Vector3::new(shape.radius, 0.0, 0.0));
    assert!(tip.abs() < 1e-9, "tip off by {tip:e}");
    let (low, high) = surface.bounding_box();
    assert!(
        (high.y / shape.thickness - 1.0).abs() < 0.1,
        "top at {}",
        high.y
    );
    assert!(
        low.y < -0.6 * shape.thickness && low.y > -0.95 * high.y,
        "underside at {}",
        low.y
    );
    let (mut from, mut to) = (0.5 * shape.arm_width, 2.0 * shape.arm_width);
    for _ in 0..50 {
        let middle = 0.5 * (from + to);
        let inside = body.value(&Vector3::new(1.3 * shape.disc_radius, 0.0, middle)) < 0.0;
        *if inside { &mut from } else { &mut to } = middle;
    }
    assert!(
        (from / shape.arm_width - 1.0).abs() < 0.1,
        "half width {from}"
    );
}

#[test]
fn the_volume_is_that_of_the_body() {
    let shape = StarfishShape::default();
    let volume = starfish(&shape).unwrap().signed_volume();
    let samples = 400_000;
    let hits = common::inside(&shape, samples).len();
    let box_volume = 8.0 * 1.3 * shape.thickness * shape.radius.powi(2);
    let expected = box_volume * hits as f64 / samples as f64;
    assert!(
        (volume / expected - 1.0).abs() < 0.01,
        "{volume} against {expected}"
    );
}

#[test]
fn the_volume_converges_at_second_order() {
    let volume = |resolution| {
        let shape = StarfishShape {
            resolution,
            ..StarfishShape::default()
        };
        starfish(&shape).unwrap().signed_volume()
    };
    let [coarse, middle, fine] = [0.032, 0.016, 0.008].map(volume);
    let ratio = (middle - coarse) / (fine - middle);
    assert!((3.0..5.5).contains(&ratio), "error ratio {ratio}");
}

#[test]
fn the_body_is_symmetric_and_its_gradient_exact() {
    let shape = StarfishShape::default();
    let body = StarfishBody::new(&shape).unwrap();
    let turn = Rotation3::from_axis_angle(&Vector3::y_axis(), 72_f64.to_radians());
    for index in 0..2000 {
        let point = (2.0 * common::spread(index) - Vector3::repeat(1.0))
            .component_mul(&Vector3::new(1.1, 0.2, 1.1));
        let (value, gradient) = body.value_and_gradient(&point);
        assert!((body.value(&(turn * point)) - value).abs() < 1e-13);
        let step = 1e-6;
        let difference = Vector3::from_fn(|axis, _| {
            let mut shift = Vector3::zeros();
            shift[axis] = step;
            (body.value(&(point + shift)) - body.value(&(point - shift))) / (2.0 * step)
        });
        assert!(
            (difference - gradient).norm() < 1e-4 * (1.0 + gradient.norm()),
            "at {point}"
        );
    }
}

#[test]
fn the_same_shape_gives_the_same_bits() {
    let shape = StarfishShape {
        resolution: 0.035,
        ..StarfishShape::default()
    };
    assert_eq!(starfish(&shape).unwrap(), starfish(&shape).unwrap());
}

#[test]
fn other_shapes_are_spheres_too() {
    let default = StarfishShape::default();
    for (arms, scale) in [(3, 1.0), (4, 1000.0), (6, 0.1), (8, 1.0), (12, 1.0)] {
        let width = scale * 0.16_f64.min(0.27 * (std::f64::consts::PI / arms as f64).tan());
        let shape = StarfishShape {
            arms,
            radius: scale,
            disc_radius: scale * default.disc_radius,
            arm_width: width,
            tip_width: 0.5 * width.min(0.15 * scale),
            thickness: 0.8 * width,
            resolution: 0.2 * width.min(0.15 * scale),
        };
        let surface = starfish(&shape).unwrap_or_else(|error| panic!("{arms} arms: {error}"));
        let angle = least(&angles(&surface));
        eprintln!(
            "{arms} arms: {} vertices, least angle {angle}",
            surface.vertex_count()
        );
        assert!(angle > 15.0, "{arms} arms: least angle {angle}");
    }
}

#[test]
fn bad_measures_give_errors_that_name_the_field() {
    let default = StarfishShape::default;
    let bad = [
        (
            "arms",
            StarfishShape {
                arms: 2,
                ..default()
            },
        ),
        (
            "arms",
            StarfishShape {
                arms: 13,
                ..default()
            },
        ),
        (
            "radius",
            StarfishShape {
                radius: f64::NAN,
                ..default()
            },
        ),
        (
            "disc_radius",
            StarfishShape {
                disc_radius: -0.1,
                ..default()
            },
        ),
        (
            "disc_radius",
            StarfishShape {
                disc_radius: 0.7,
                ..default()
            },
        ),
        (
            "arm_width",
            StarfishShape {
                arm_width: 0.25,
                ..default()
            },
        ),
        (
            "tip_width",
            StarfishShape {
                tip_width: 0.2,
                ..default()
            },
        ),
        (
            "tip_width",
            StarfishShape {
                tip_width: f64::INFINITY,
                ..default()
            },
        ),
        (
            "thickness",
            StarfishShape {
                thickness: 0.0,
                ..default()
            },
        ),
        (
            "thickness",
            StarfishShape {
                thickness: 0.5,
                ..default()
            },
        ),
        (
            "resolution",
            StarfishShape {
                resolution: 0.1,
                ..default()
            },
        ),
        (
            "resolution",
            StarfishShape {
                resolution: 1e-5,
                ..default()
            },
        ),
    ];
    for (field, shape) in bad {
        let error = starfish(&shape).expect_err(field);
        assert!(error.to_string().contains(&format!("`{field}`")), "{error}");
    }
    let too_fine = StarfishShape {
        resolution: 1e-5,
        ..default()
    };
    assert!(matches!(
        starfish(&too_fine),
        Err(ShapeError::TooFine { .. })
    ));
}

#[test]
fn missing_fields_have_defaults_and_unknown_ones_are_refused() {
    let read = |field: &'static str| {
        let map: HashMap<&str, f64> = HashMap::from([(field, 0.2)]);
        StarfishShape::deserialize(MapDeserializer::<_, ValueError>::new(map.into_iter()))
    };
    let shape = read("disc_radius").unwrap();
    assert_eq!(
        shape,
        StarfishShape {
            disc_radius: 0.2,
            ..StarfishShape::default()
        }
    );
    assert!(
        read("disk_radius")
            .unwrap_err()
            .to_string()
            .contains("disk_radius")
    );
}

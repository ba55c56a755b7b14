//! Poses of the starfish: what stays still, how much is stretched, and that nothing meets or turns over.

mod common;

use std::collections::HashMap;

use nalgebra::{Matrix3, Rotation3, Vector3};
use scene_shapes::{ArmPose, ShapeError, StarfishPose, StarfishShape, held_radius, pose, starfish};

const NONE: ArmPose = ArmPose {
    curl: 0.0,
    sway: 0.0,
    twist: 0.0,
    lift: 0.0,
};

fn all(arm: ArmPose) -> StarfishPose {
    StarfishPose { arms: vec![arm; 5] }
}

/// All sign patterns of the largest angles.
fn extremes() -> impl Iterator<Item = StarfishPose> {
    (0..81).map(|pattern| {
        let sign = |place: u32| f64::from(pattern / 3_i32.pow(place) % 3 - 1);
        all(ArmPose {
            curl: 120.0 * sign(0),
            sway: 40.0 * sign(1),
            twist: 120.0 * sign(2),
            lift: 60.0 * sign(3),
        })
    })
}

/// Deformation gradients at points, by central differences.
fn gradients(
    shape: &StarfishShape,
    posed: &StarfishPose,
    points: &[Vector3<f64>],
) -> Vec<Matrix3<f64>> {
    let step = 1e-5;
    let columns = [0, 1, 2].map(|axis| {
        let moved = |sign: f64| {
            let shifted: Vec<_> = points
                .iter()
                .map(|point| {
                    let mut point = *point;
                    point[axis] += sign * step;
                    point
                })
                .collect();
            pose(shape, posed, &shifted)
        };
        let (plus, minus) = (moved(1.0), moved(-1.0));
        plus.iter()
            .zip(&minus)
            .map(|(p, m)| (p - m) / (2.0 * step))
            .collect::<Vec<_>>()
    });
    (0..points.len())
        .map(|i| Matrix3::from_columns(&[columns[0][i], columns[1][i], columns[2][i]]))
        .collect()
}

#[test]
fn no_pose_moves_nothing() {
    let shape = StarfishShape::default();
    let points = common::inside(&shape, 5000);
    assert_eq!(pose(&shape, &StarfishPose::default(), &points), points);
    assert_eq!(pose(&shape, &all(NONE), &points), points);
}

#[test]
fn the_disc_stays_still() {
    let shape = StarfishShape::default();
    let held = held_radius(&shape);
    assert!((0.2..=0.25).contains(&(held / shape.radius)));
    let points: Vec<_> = common::inside(&shape, 50_000)
        .into_iter()
        .filter(|point| point.x.hypot(point.z) <= held)
        .collect();
    assert!(points.len() > 1000);
    for posed in extremes() {
        assert_eq!(pose(&shape, &posed, &points), points);
    }
}

#[test]
fn angles_are_those_asked_for() {
    let shape = StarfishShape::default();
    let axis: Vec<_> = [0.999_999, 1.0].map(|x| Vector3::new(x, 0.0, 0.0)).to_vec();
    let direction = |arm: ArmPose| {
        let moved = pose(&shape, &StarfishPose { arms: vec![arm] }, &axis);
        (moved[1] - moved[0]).normalize()
    };
    for degrees in [-50.0_f64, 30.0] {
        let (sin, cos) = degrees.to_radians().sin_cos();
        let up = Vector3::new(cos, sin, 0.0);
        assert!(
            (direction(ArmPose {
                lift: degrees,
                ..NONE
            }) - up)
                .norm()
                < 1e-5
        );
        assert!(
            (direction(ArmPose {
                curl: degrees,
                ..NONE
            }) - up)
                .norm()
                < 1e-5
        );
        let side = Vector3::new(cos, 0.0, sin);
        assert!(
            (direction(ArmPose {
                sway: degrees,
                ..NONE
            }) - side)
                .norm()
                < 1e-5
        );
        let ends = [Vector3::new(1.0, 0.0, 0.0), Vector3::new(1.0, 0.0, 0.01)];
        let arms = vec![ArmPose {
            twist: degrees,
            ..NONE
        }];
        let moved = pose(&shape, &StarfishPose { arms }, &ends);
        let turned = Vector3::new(0.0, -0.01 * sin, 0.01 * cos);
        assert!((moved[1] - moved[0] - turned).norm() < 1e-12);
    }
}

#[test]
fn centrelines_keep_their_length() {
    let shape = StarfishShape::default();
    let count = 20_000;
    let axis: Vec<_> = (0..=count)
        .map(|i| Vector3::new(f64::from(i) / f64::from(count), 0.0, 0.0))
        .collect();
    let arm = ArmPose {
        curl: 120.0,
        sway: -40.0,
        twist: 50.0,
        lift: 60.0,
    };
    let moved = pose(&shape, &StarfishPose { arms: vec![arm] }, &axis);
    let length: f64 = moved
        .windows(2)
        .map(|pair| (pair[1] - pair[0]).norm())
        .sum();
    // What remains is the polygon's own chord error.
    assert!((length - 1.0).abs() < 2e-8, "length {length}");
}

#[test]
fn moderate_poses_are_nearly_isometric() {
    let shape = StarfishShape::default();
    let points = common::inside(&shape, 40_000);
    for arm in [
        ArmPose { curl: 30.0, ..NONE },
        ArmPose { lift: 20.0, ..NONE },
        ArmPose { sway: 20.0, ..NONE },
        ArmPose {
            twist: 30.0,
            ..NONE
        },
        ArmPose {
            curl: -20.0,
            sway: 10.0,
            twist: 20.0,
            lift: 10.0,
        },
    ] {
        let mut worst: f64 = 0.0;
        let mut sum = 0.0;
        for gradient in gradients(&shape, &all(arm), &points) {
            let strain = 0.5 * (gradient.transpose() * gradient - Matrix3::identity());
            worst = worst.max(strain.norm());
            sum += strain.norm_squared();
        }
        let mean = (sum / points.len() as f64).sqrt();
        eprintln!("{arm:?}: strain at most {worst:.3}, mean {mean:.4}");
        assert!(worst < 0.2 && mean < 0.05, "{arm:?}: {worst}, {mean}");
    }
}

#[test]
fn extreme_poses_turn_no_volume_over() {
    let shape = StarfishShape::default();
    let mut points = common::inside(&shape, 20_000);
    points.extend(starfish(&shape).unwrap().vertices());
    let least = extremes()
        .flat_map(|posed| gradients(&shape, &posed, &points))
        .map(|gradient| gradient.determinant())
        .fold(f64::INFINITY, f64::min);
    eprintln!("least determinant {least:.3}");
    assert!(least > 0.3, "least determinant {least}");
}

#[test]
fn the_map_is_continuous_across_sector_borders() {
    let shape = StarfishShape::default();
    let unlike = StarfishPose {
        arms: vec![
            ArmPose {
                curl: 120.0,
                lift: 60.0,
                ..NONE
            },
            ArmPose {
                curl: -120.0,
                lift: -60.0,
                ..NONE
            },
        ],
    };
    for i in 0..200 {
        for j in 0..20 {
            let (radius, y) = (1.2 * f64::from(i) / 200.0, 0.02 * f64::from(j - 10));
            let sides = [36.0 - 1e-7, 36.0 + 1e-7].map(|angle: f64| {
                let (sin, cos) = angle.to_radians().sin_cos();
                Vector3::new(radius * cos, y, radius * sin)
            });
            let moved = pose(&shape, &unlike, &sides);
            assert!((moved[0] - moved[1]).norm() < 1e-8);
            assert!(
                (moved[0] - sides[0]).norm() < 1e-8,
                "the border stays still"
            );
        }
    }
}

#[test]
fn arms_are_interchangeable() {
    let shape = StarfishShape::default();
    let points = common::inside(&shape, 5000);
    let arm = ArmPose {
        curl: 70.0,
        sway: -20.0,
        twist: 50.0,
        lift: 30.0,
    };
    let first = pose(&shape, &StarfishPose { arms: vec![arm] }, &points);
    for index in 1..5 {
        // Arms follow each other from +x towards +z, which is a negative turn about +y.
        let turn =
            Rotation3::from_axis_angle(&Vector3::y_axis(), -(72.0 * index as f64).to_radians());
        let mut arms = vec![NONE; index];
        arms.push(arm);
        let turned: Vec<_> = points.iter().map(|point| turn * point).collect();
        let other = pose(&shape, &StarfishPose { arms }, &turned);
        for (expected, found) in first.iter().zip(&other) {
            assert!((turn * expected - found).norm() < 1e-13);
        }
    }
}

#[test]
fn curling_keeps_the_volume_and_the_triangles() {
    let shape = StarfishShape::default();
    let surface = starfish(&shape).unwrap();
    for curl in [60.0, -60.0] {
        let vertices = pose(&shape, &all(ArmPose { curl, ..NONE }), surface.vertices());
        let posed = surface.with_vertices(vertices).unwrap();
        let change = posed.signed_volume() / surface.signed_volume() - 1.0;
        eprintln!("curl {curl}: volume change {:.2} %", 100.0 * change);
        assert!(change.abs() < 0.05);
    }
    for posed in extremes() {
        let moved = pose(&shape, &posed, surface.vertices());
        let gradients = gradients(&shape, &posed, surface.vertices());
        for t in surface.triangles() {
            let normal = |v: &[Vector3<f64>]| {
                let [a, b, c] = t.map(|i| v[i as usize]);
                (b - a).cross(&(c - a))
            };
            // Normals transform by the cofactor matrix.
            let gradient = gradients[t[0] as usize];
            let carried = gradient.try_inverse().unwrap().transpose() * normal(surface.vertices());
            let turned = carried.angle(&normal(&moved)).to_degrees();
            assert!(
                turned < 60.0,
                "{posed:?}: a triangle turned by {turned} degrees"
            );
        }
    }
}

#[test]
fn extreme_poses_do_not_intersect_themselves() {
    let shape = StarfishShape {
        resolution: 0.035,
        ..StarfishShape::default()
    };
    let surface = starfish(&shape).unwrap();
    assert_eq!(crossings(surface.vertices(), surface.triangles()), 0);
    let towards = StarfishPose {
        arms: vec![
            ArmPose { sway: 40.0, ..NONE },
            ArmPose {
                sway: -40.0,
                ..NONE
            },
        ],
    };
    for posed in extremes().chain([towards]) {
        let moved = pose(&shape, &posed, surface.vertices());
        let count = crossings(&moved, surface.triangles());
        assert_eq!(count, 0, "{:?}", posed.arms[0]);
    }
}

#[test]
fn the_check_of_crossings_finds_a_planted_one() {
    let v = |x: f64, y: f64, z: f64| Vector3::new(x, y, z);
    let vertices = [
        v(0.0, 0.0, 0.0),
        v(0.1, 0.0, 0.0),
        v(0.0, 0.1, 0.0),
        v(0.03, 0.03, -0.05),
        v(0.03, 0.03, 0.05),
        v(0.1, 0.1, 0.05),
    ];
    // One edge of each goes through the other.
    assert_eq!(crossings(&vertices, &[[0, 1, 2], [3, 4, 5]]), 2);
}

/// Number of pairs of an edge that pierces a triangle without sharing a corner.
fn crossings(vertices: &[Vector3<f64>], triangles: &[[u32; 3]]) -> usize {
    let size = 0.08;
    let cells = |corners: &[u32]| {
        let bound = |pick: fn(f64, f64) -> f64| {
            let mut corners = corners.iter().map(|&i| vertices[i as usize]);
            let first = corners.next().unwrap();
            corners
                .fold(first, |a, b| a.zip_map(&b, pick))
                .map(|x| (x / size).floor() as i64)
        };
        let (low, high) = (bound(f64::min), bound(f64::max));
        (low.x..=high.x).flat_map(move |x| {
            (low.y..=high.y).flat_map(move |y| (low.z..=high.z).map(move |z| [x, y, z]))
        })
    };
    let mut at: HashMap<[i64; 3], Vec<[u32; 3]>> = HashMap::new();
    for triangle in triangles {
        for cell in cells(triangle) {
            at.entry(cell).or_default().push(*triangle);
        }
    }
    let mut found = std::collections::HashSet::new();
    for &[a, b, c] in triangles {
        for edge in [[a, b], [b, c], [c, a]] {
            let edge = [edge[0].min(edge[1]), edge[0].max(edge[1])];
            for cell in cells(&edge) {
                for triangle in at.get(&cell).into_iter().flatten() {
                    if !triangle.iter().any(|i| edge.contains(i))
                        && pierces(vertices, edge, *triangle)
                    {
                        found.insert((edge, *triangle));
                    }
                }
            }
        }
    }
    found.len()
}

/// Whether a segment meets a triangle: its ends lie on both sides, and its line passes within.
fn pierces(vertices: &[Vector3<f64>], edge: [u32; 2], triangle: [u32; 3]) -> bool {
    let [p, q] = edge.map(|i| vertices[i as usize]);
    let [a, b, c] = triangle.map(|i| vertices[i as usize]);
    let volume = |a: Vector3<f64>, b: Vector3<f64>, c: Vector3<f64>, d: Vector3<f64>| {
        (b - a).cross(&(c - a)).dot(&(d - a))
    };
    let sides = [volume(p, q, a, b), volume(p, q, b, c), volume(p, q, c, a)];
    volume(a, b, c, p) * volume(a, b, c, q) < 0.0
        && (sides.iter().all(|s| *s > 0.0) || sides.iter().all(|s| *s < 0.0))
}

#[test]
fn a_pose_that_does_not_fit_is_refused() {
    let shape = StarfishShape::default();
    let six = StarfishPose {
        arms: vec![NONE; 6],
    };
    assert!(matches!(
        six.check(&shape),
        Err(ShapeError::PoseArmCount { given: 6, arms: 5 })
    ));
    let endless = StarfishPose {
        arms: vec![
            NONE,
            ArmPose {
                twist: f64::NAN,
                ..NONE
            },
        ],
    };
    let error = endless.check(&shape).unwrap_err().to_string();
    assert!(error.contains("`twist` of arm 1"), "{error}");
}

//! Surfaces: what constructors refuse, and areas and volumes with known answers.

use std::f64::consts::PI;

use nalgebra::Vector3;
use surface_mesh::{MorphTarget, MorphedSurface, Surface, SurfaceError, primitives};

fn square() -> Vec<Vector3<f64>> {
    vec![
        Vector3::new(0.0, 0.0, 0.0),
        Vector3::new(1.0, 0.0, 0.0),
        Vector3::new(1.0, 1.0, 0.0),
        Vector3::new(0.0, 1.0, 0.0),
    ]
}

#[test]
fn constructors_refuse_bad_data_and_say_where() {
    let mut broken = square();
    broken[2].y = f64::NAN;
    assert!(matches!(
        Surface::from_triangles(broken, vec![[0, 1, 2]]),
        Err(SurfaceError::NonFiniteVertex { vertex: 2, .. })
    ));
    assert!(matches!(
        Surface::from_polygons(square(), vec![vec![0, 1, 2, 3], vec![0, 1, 4]]),
        Err(SurfaceError::IndexOutOfRange {
            polygon: 1,
            index: 4,
            vertices: 4
        })
    ));
    assert!(matches!(
        Surface::from_polygons(square(), vec![vec![0, 1, 2], vec![0, 1]]),
        Err(SurfaceError::TooFewCorners {
            polygon: 1,
            corners: 2
        })
    ));
    assert!(matches!(
        Surface::from_polygons(square(), vec![]),
        Err(SurfaceError::NoPolygons)
    ));
    assert!(matches!(
        Surface::from_triangles(vec![], vec![[0, 1, 2]]),
        Err(SurfaceError::NoVertices)
    ));
    let surface = Surface::from_polygons(square(), vec![vec![0, 1, 2, 3]]).unwrap();
    assert!(matches!(
        surface.with_vertices(square()[1..].to_vec()),
        Err(SurfaceError::VertexCount {
            expected: 4,
            found: 3
        })
    ));
}

#[test]
fn polygons_are_kept_and_fanned() {
    let polygons = vec![vec![0, 1, 2, 3], vec![3, 2, 0]];
    let surface = Surface::from_polygons(square(), polygons.clone()).unwrap();
    assert!(surface.polygons().eq(polygons.iter().map(Vec::as_slice)));
    assert_eq!(surface.polygon_count(), 2);
    assert_eq!(surface.triangles(), [[0, 1, 2], [0, 2, 3], [3, 2, 0]]);
    let raised = square().iter().map(|v| v + Vector3::z()).collect();
    let moved = surface.with_vertices(raised).unwrap();
    assert!(moved.polygons().eq(surface.polygons()));
    assert_eq!(
        moved.bounding_box(),
        (Vector3::new(0.0, 0.0, 1.0), Vector3::new(1.0, 1.0, 1.0))
    );
    assert_eq!(moved.diagonal(), 2.0_f64.sqrt());
}

#[test]
fn box_area_and_volume_are_exact_wherever_it_lies() {
    for offset in [0.0, 1024.0] {
        let min = Vector3::repeat(offset);
        let shape = primitives::cuboid(min, min + Vector3::new(1.0, 2.0, 4.0));
        assert_eq!(shape.signed_volume(), 8.0);
        assert_eq!(shape.area(), 28.0);
        assert_eq!(shape.vertex_areas().iter().sum::<f64>(), 28.0);
    }
}

#[test]
fn sphere_converges_at_second_order() {
    let error = |subdivisions| {
        let sphere = primitives::icosphere(subdivisions, 2.0);
        assert_eq!(sphere.vertex_count(), 10 * 4_usize.pow(subdivisions) + 2);
        assert!(
            sphere
                .vertices()
                .iter()
                .all(|v| (v.norm() - 2.0).abs() < 1e-15 * 8.0)
        );
        let volume = 4.0 / 3.0 * PI * 8.0;
        let area = 4.0 * PI * 4.0;
        (
            (sphere.signed_volume() - volume).abs() / volume,
            (sphere.area() - area).abs() / area,
        )
    };
    let (coarse, fine) = (error(3), error(4));
    assert!(
        (3.9..4.1).contains(&(coarse.0 / fine.0)),
        "{coarse:?} {fine:?}"
    );
    assert!(
        (3.9..4.1).contains(&(coarse.1 / fine.1)),
        "{coarse:?} {fine:?}"
    );
    assert!(fine.0 < 3e-3);
}

#[test]
fn torus_matches_pappus() {
    let torus = primitives::torus(3.0, 1.0, 256, 128);
    let (volume, area) = (2.0 * PI * PI * 3.0, 4.0 * PI * PI * 3.0);
    assert!((torus.signed_volume() / volume - 1.0).abs() < 1e-3);
    assert!((torus.area() / area - 1.0).abs() < 1e-3);
    assert_eq!(torus.polygon_count(), 256 * 128);
}

#[test]
fn blends_add_weighted_deltas() {
    let surface = primitives::cuboid(Vector3::zeros(), Vector3::repeat(1.0));
    let target = |name: &str, delta: Vector3<f64>| MorphTarget {
        name: name.into(),
        deltas: vec![delta; 8],
    };
    let targets = vec![target("x", Vector3::x()), target("y", Vector3::y())];
    let morphed = MorphedSurface::new(surface.clone(), targets).unwrap();
    assert_eq!(morphed.target_index("y"), Some(1));
    assert_eq!(morphed.target_index("z"), None);
    assert_eq!(morphed.shape(1)[0], Vector3::y());
    assert_eq!(morphed.blend(&[0.5, -2.0])[7], Vector3::new(1.5, -1.0, 1.0));
    assert_eq!(morphed.blend(&[0.0, 0.0]), surface.vertices());

    let mut short = target("short", Vector3::x());
    short.deltas.pop();
    assert!(matches!(
        MorphedSurface::new(surface.clone(), vec![short]),
        Err(SurfaceError::TargetLength {
            expected: 8,
            found: 7,
            ..
        })
    ));
    let mut infinite = target("infinite", Vector3::x());
    infinite.deltas[3].z = f64::INFINITY;
    assert!(matches!(
        MorphedSurface::new(surface, vec![infinite]),
        Err(SurfaceError::NonFiniteDelta { vertex: 3, .. })
    ));
}

//! What a scene may say of a contact, and what comes of it.

use super::super::tests::{DHAT, INDEX, all_obstacles, blocks, contact, made, planes};
use super::*;

fn refused(obstacle: Obstacle) -> String {
    let mesh = blocks(2);
    let surface = EmbeddedSurface::boundary(&mesh);
    // The second: places are those in the list.
    let all = [planes()[0].clone(), obstacle];
    match made(&mesh, &surface, true, DHAT, &all) {
        Err(error) => error.to_string(),
        Ok(_) => panic!("an obstacle that is none"),
    }
}

#[test]
fn obstacles_that_are_none_are_refused() {
    let plane = |normal, offset| Obstacle::Plane { normal, offset };
    for (plane, part) in [
        (plane([0.0, f64::NAN, 1.0], 0.0), "`plane` is NaN"),
        (plane([0.0, 0.0, 1.0], f64::INFINITY), "`plane` is inf"),
        (plane([0.0; 3], 0.0), "`normal` is 0"),
    ] {
        let text = refused(plane);
        assert!(text.contains(part), "{text}");
    }
    let far = vec![[9.0, 0.0, 0.0], [9.0, 1.0, 0.0], [9.0, 0.0, 1.0]];
    let surface = |triangle| Obstacle::Surface {
        vertices: far.clone(),
        triangles: vec![[0, 1, 2], triangle],
    };
    let text = refused(surface([0, 3, 1]));
    assert!(
        text.contains("vertex of an obstacle") && text.contains('3'),
        "{text}"
    );
    let mut lost = far.clone();
    lost[1][2] = f64::NEG_INFINITY;
    let triangles = vec![[0, 1, 2]];
    let text = refused(Obstacle::Surface {
        vertices: lost,
        triangles,
    });
    assert!(text.contains("`vertices` is -inf"), "{text}");
    let name = "table".to_string();
    assert!(refused(Obstacle::Named { name }).contains("table"));
    // The last vertex there is may be named.
    let mesh = blocks(2);
    let skin = EmbeddedSurface::boundary(&mesh);
    assert!(made(&mesh, &skin, true, DHAT, &[surface([0, 2, 1])]).is_ok());
}

/// Normals of any length give distances; obstacles keep their places in the list, and their triangles follow those of the body.
#[test]
fn obstacles_become_planes_and_one_surface() {
    let (contact, rest) = contact(2, true, &all_obstacles());
    let x = Vector3::new(0.3, -0.4, 1.5);
    let distances = contact.planes.iter().map(|p| (p.obstacle, p.distance(&x)));
    let off = distances.zip([(0, 1.7), (3, 1.05)]);
    for ((obstacle, distance), (place, expected)) in off {
        assert!(obstacle == place && (distance - expected).abs() < 1e-14);
    }
    let t = &contact.topology;
    let own = t.own_triangles as u32;
    assert_eq!(contact.obstacles, [(own, 1), (own + 1, 2)]);
    let first = t.own_points as u32;
    let of_obstacles = [[0, 1, 2], [3, 4, 5], [3, 5, 6]].map(|t| t.map(|v| first + v));
    assert_eq!(t.triangles[t.own_triangles..], of_obstacles);
    assert_eq!(t.own_points, rest.len() - 2);
}

/// A quarter of the barrier's distance or of an edge, whichever is more.
#[test]
fn the_margin_is_for_the_distance_and_for_the_edges() {
    let mesh = blocks(2);
    let surface = EmbeddedSurface::boundary(&mesh);
    let margin = |distance| {
        let contact = made(&mesh, &surface, true, distance, &[]).unwrap();
        (contact.margin, contact.topology.mean_edge())
    };
    let (small, edge) = margin(0.3);
    assert!(edge > 0.5 && small == 0.25 * edge);
    assert_eq!(margin(4.0).0, 1.0);
}

/// Only triangles all of whose corners may touch.
#[test]
fn a_part_of_the_surface_touches() {
    let mesh = blocks(2);
    let surface = EmbeddedSurface::boundary(&mesh);
    let x = surface.positions(&mesh, mesh.nodes());
    let with = |touching: &[bool]| {
        let settings = ContactSettings {
            touching,
            distance: DHAT,
            stiffness: 1.0,
            own: true,
            obstacles: &[],
            first: 0,
        };
        Contact::new(&mesh, &surface, &settings, INDEX)
    };
    let upper: Vec<bool> = x.iter().map(|x| x.z > 1.7).collect();
    let contact = with(&upper).unwrap();
    let all = 0..surface.triangles.len() as u32;
    let touches = |t: &u32| {
        surface.triangles[*t as usize]
            .iter()
            .all(|v| upper[*v as usize])
    };
    assert_eq!(contact.triangles, all.filter(touches).collect::<Vec<_>>());
    assert_eq!(contact.topology.own_triangles, contact.triangles.len());
    for (own, t) in contact.topology.triangles.iter().zip(&contact.triangles) {
        let there = surface.triangles[*t as usize].map(|v| x[v as usize]);
        assert_eq!(own.map(|p| contact.topology.rest[p as usize]), there);
    }
    let Err(error) = with(&vec![false; x.len()]) else {
        panic!("nothing that touches");
    };
    assert!(matches!(
        error,
        SolverError::EmptyRegion { index: INDEX, .. }
    ));
}

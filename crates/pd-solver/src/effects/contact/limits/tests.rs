//! What passes through what, and by which names it is told.

use super::super::tests::{DHAT, INDEX, all_obstacles, blocks, contact, made, positions};
use super::super::{Contact, Effect};
use super::*;
use crate::spec::Obstacle;
use crate::surface::EmbeddedSurface;
use crate::vector::NodalVector;

/// The surface's triangle, what it passes through, and where.
fn refused(contact: &mut Contact, u: &[Vector3<f64>]) -> Option<(usize, String, [f64; 3])> {
    match contact.intersection(u)? {
        SolverError::Intersects {
            index,
            triangle,
            what,
            near,
        } => {
            assert_eq!(index, INDEX);
            Some((triangle, what, near))
        }
        other => panic!("{other}"),
    }
}

/// The node that is nearest to a place.
fn node(u: &[Vector3<f64>], at: [f64; 3]) -> usize {
    let off = |i: &usize| (u[*i] - Vector3::from(at)).norm_squared();
    let nearest = (0..u.len()).min_by(|i, j| off(i).total_cmp(&off(j)));
    nearest.expect("there are nodes")
}

#[test]
fn a_vertex_on_a_plane_or_behind_it_is_refused() {
    let (mut contact, rest) = contact(2, true, &all_obstacles());
    assert_eq!(refused(&mut contact, &rest), None);
    for (obstacle, place, lowest, axis) in [
        (0, [0.0, 0.0, 0.0], -0.2, 2),
        (3, [-0.5, 0.0, 0.5], -0.75, 0),
    ] {
        let moved = node(&rest, place);
        let mut at = |x: f64| {
            let mut u = rest.clone();
            u[moved][axis] = x;
            (refused(&mut contact, &u), u[moved])
        };
        assert_eq!(at(lowest + 1e-12).0, None);
        for x in [lowest, lowest - 0.1] {
            let (found, where_it_is) = at(x);
            let (triangle, what, near) = found.unwrap();
            assert_eq!(what, format!("the plane that is obstacle {obstacle}"));
            assert_eq!(near, <[f64; 3]>::from(where_it_is));
            let surface = EmbeddedSurface::boundary(&blocks(2));
            let corners = surface.triangles[triangle].map(|v| surface.points[v as usize]);
            let mesh = blocks(2);
            let has = corners.iter().any(|point| {
                let k = point.weights.iter().position(|w| *w == 1.0).unwrap();
                mesh.elements()[point.element as usize][k] as usize == moved
            });
            assert!(has, "triangle {triangle}");
        }
    }
}

/// Whether a segment passes through a triangle, by the signs of volumes.
fn through([p, q]: [Vector3<f64>; 2], [a, b, c]: [Vector3<f64>; 3]) -> bool {
    let volume = |a: Vector3<f64>, b: Vector3<f64>, c: Vector3<f64>, d: Vector3<f64>| {
        (b - a).cross(&(c - a)).dot(&(d - a))
    };
    let turns = [volume(p, q, a, b), volume(p, q, b, c), volume(p, q, c, a)];
    let is_inside = turns.iter().all(|v| *v >= 0.0) || turns.iter().all(|v| *v <= 0.0);
    volume(a, b, c, p) * volume(a, b, c, q) < 0.0 && is_inside
}

/// Whether an edge of one triangle passes through the other.
fn cross(one: [Vector3<f64>; 3], other: [Vector3<f64>; 3]) -> bool {
    let any = |[a, b, c]: [Vector3<f64>; 3], other| {
        let mut edges = [[a, b], [b, c], [c, a]].into_iter();
        edges.any(|edge| through(edge, other))
    };
    any(one, other) || any(other, one)
}

/// Blocks in each other, and each sheet in a block: both triangles are named, the surface's first.
#[test]
fn triangles_that_cross_are_named() {
    let obstacles = all_obstacles();
    let (mut contact, rest) = contact(2, true, &obstacles);
    let own = contact.topology.own_triangles;
    // Halfway off each other, so that borders cross.
    let moved = |from: f64, way: [f64; 3]| -> NodalVector {
        let way = Vector3::from(way);
        let of = |x: &Vector3<f64>| if x.z >= from { x + way } else { *x };
        rest.iter().map(of).collect()
    };
    let cases = [
        (moved(1.25, [0.13, 0.17, -0.71]), "the surface", 0),
        (moved(0.0, [0.31, 0.5, 0.0]), "obstacle 1", own),
        (moved(1.25, [0.5, 0.0, 0.31]), "obstacle 2", own + 1),
    ];
    // The middle of a side, through the triangle beside it: no edge of that meets the body.
    let mut spike = rest.clone();
    spike[node(&rest, [0.5, 0.0, 0.5])].x = 0.72;
    let cases = cases.into_iter().chain([(spike, "obstacle 1", own)]);
    for (u, of, first) in cases {
        let (triangle, what, near) = refused(&mut contact, &u).unwrap();
        let words = what.strip_prefix("triangle ").unwrap();
        let (number, name) = words.split_once(" of ").unwrap();
        assert_eq!(name, of);
        let other = first + number.parse::<usize>().unwrap();
        assert!(triangle < own && other < contact.topology.triangles.len());
        let x = positions(&contact, &u);
        let corners = |t: usize| contact.topology.triangles[t].map(|p| x[p as usize]);
        assert!(
            cross(corners(triangle), corners(other)),
            "{triangle} {what}"
        );
        let is_there = |t: usize| corners(t).iter().any(|x| near == <[f64; 3]>::from(*x));
        assert!(is_there(triangle) || is_there(other));
    }
}

/// A corner on a face and an edge across an edge touch without passing through; a little above they do not.
#[test]
fn what_touches_is_refused_as_what_crosses() {
    let sheet = |vertices: [[f64; 3]; 3]| Obstacle::Surface {
        vertices: vertices.to_vec(),
        triangles: vec![[0, 1, 2]],
    };
    let corner = |z| sheet([[0.1, 0.07, z], [0.3, 0.1, z + 0.3], [0.2, 0.3, z + 0.4]]);
    let edge = |z| {
        sheet([
            [0.3, 0.13, z + 0.2],
            [0.7, 0.13, z - 0.2],
            [0.9, 0.13, z + 0.7],
        ])
    };
    let mesh = blocks(2);
    let surface = EmbeddedSurface::boundary(&mesh);
    let corner = &corner as &dyn Fn(f64) -> Obstacle;
    let cases = [("corner", 1e-12, corner), ("edge", 1e-6, &edge)];
    for (name, above, obstacle) in cases {
        let above = made(&mesh, &surface, true, DHAT, &[obstacle(2.5 + above)]);
        assert!(above.is_ok(), "{name}");
        let Err(error) = made(&mesh, &surface, true, DHAT, &[obstacle(2.5)]) else {
            panic!("{name}");
        };
        let SolverError::Intersects {
            triangle,
            what,
            near,
            ..
        } = error
        else {
            panic!("{error}");
        };
        assert_eq!(what, "triangle 0 of obstacle 0");
        let top = surface.triangles[triangle]
            .iter()
            .all(|&v| surface.positions(&mesh, mesh.nodes())[v as usize].z > 2.4);
        assert!(top, "{name}: triangle {triangle} near {near:?}");
    }
}

/// The blocks with a flap of the lower one that reaches into the upper one.
fn with_flap() -> (hex_mesh::HexMesh, EmbeddedSurface) {
    let mesh = blocks(2);
    let mut surface = EmbeddedSurface::boundary(&mesh);
    let flap = [[-0.2, -0.2, 1.0], [-0.15, -0.2, 1.7], [-0.2, -0.14, 1.7]].map(Vector3::from);
    let first = surface.points.len() as u32;
    let embedded = hex_mesh::embed(&mesh, &flap).unwrap();
    surface.points.extend_from_slice(embedded.vertices());
    surface.triangles.push([first, first + 1, first + 2]);
    (mesh, surface)
}

/// Triangles that pass through each other at rest are left out, and so are the points of edges and triangles that do; where only obstacles are
/// asked for nothing is.
#[test]
fn crossings_at_rest_are_left_out_of_own_contact_alone() {
    let (mesh, surface) = with_flap();
    let x = surface.positions(&mesh, mesh.nodes());
    let corners = |t: usize| surface.triangles[t].map(|v| x[v as usize]);
    let flap = surface.triangles.len() - 1;
    let crossed = (0..flap).filter(|t| cross(corners(*t), corners(flap)));
    let mut expected: Vec<u32> = crossed.map(|t| t as u32).collect();
    assert!(!expected.is_empty());
    expected.push(flap as u32);
    let contact = made(&mesh, &surface, true, DHAT, &all_obstacles()).unwrap();
    assert_eq!(contact.left_out, expected);
    let t = &contact.topology;
    let mut points = vec![false; t.rest.len()];
    for ends in &t.edges[..t.own_edges] {
        for corners in &t.triangles[..t.own_triangles] {
            let [edge, face] = [&ends[..], &corners[..]];
            let shares = edge.iter().any(|p| face.contains(p));
            let x = |p: u32| t.rest[p as usize];
            if !shares && through(ends.map(x), corners.map(x)) {
                let all = edge.iter().chain(face);
                all.for_each(|p| points[*p as usize] = true);
            }
        }
    }
    assert_eq!(t.left_out, points);
    let others = made(&mesh, &surface, false, DHAT, &all_obstacles()).unwrap();
    assert!(others.left_out.is_empty() && !others.topology.left_out.contains(&true));
}

/// An obstacle in the body at rest is refused, and leaves nothing out.
#[test]
fn obstacles_that_cross_at_rest_are_refused() {
    let mesh = blocks(2);
    let surface = EmbeddedSurface::boundary(&mesh);
    let obstacle = Obstacle::Surface {
        vertices: vec![[0.1, 0.1, 2.3], [0.2, 0.1, 2.8], [0.1, 0.3, 2.8]],
        triangles: vec![[0, 1, 2]],
    };
    for own in [true, false] {
        let Err(error) = made(&mesh, &surface, own, DHAT, std::slice::from_ref(&obstacle)) else {
            panic!("an obstacle in the body");
        };
        assert!(
            error.to_string().contains("triangle 0 of obstacle 0"),
            "{error}"
        );
    }
}

/// Where more boxes meet on a way than are worth a look, half of it is looked at, and half of that.
#[test]
fn a_way_on_which_too_much_meets_is_shortened() {
    let (mut contact, rest) = contact(4, true, &[]);
    // All of it together at the end: pairs that are near at the start would let it go three quarters of the way.
    let together: NodalVector = rest.iter().map(|x| x * 0.02).collect();
    let share = contact.step_limit(&rest, &together);
    assert!((0.01..0.4).contains(&share), "{share}");
}

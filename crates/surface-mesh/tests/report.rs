//! The report, on shapes with planted faults.

use nalgebra::Vector3;
use surface_mesh::{Surface, SurfaceError, primitives, report};

fn unit_box() -> Surface {
    primitives::cuboid(Vector3::zeros(), Vector3::repeat(1.0))
}

fn polygons(surface: &Surface) -> Vec<Vec<u32>> {
    surface.polygons().map(<[u32]>::to_vec).collect()
}

fn rebuilt(surface: &Surface, polygons: Vec<Vec<u32>>) -> Surface {
    Surface::from_polygons(surface.vertices().to_vec(), polygons).unwrap()
}

/// Both surfaces in one, the second's indices after the first's.
fn joined(a: &Surface, b: &Surface) -> Surface {
    let shift = a.vertex_count() as u32;
    let vertices = a.vertices().iter().chain(b.vertices()).copied().collect();
    let shifted = b
        .polygons()
        .map(|polygon| polygon.iter().map(|v| v + shift).collect());
    Surface::from_polygons(vertices, polygons(a).into_iter().chain(shifted).collect()).unwrap()
}

#[test]
fn primitives_are_solid() {
    for shape in [
        unit_box(),
        primitives::icosphere(2, 0.1),
        primitives::torus(2.0, 0.5, 8, 6),
    ] {
        let findings = report(&shape);
        assert!(findings.is_solid(), "{findings}");
        assert!(findings.degenerate_polygons.is_empty() && findings.duplicate_vertices.is_empty());
        assert!(findings.unused_vertices.is_empty());
        assert_eq!(findings.components.len(), 1);
        assert_eq!(findings.components[0].vertices, shape.vertex_count());
        findings.require_closed("shape").unwrap();
    }
}

#[test]
fn missing_polygons_leave_one_loop_each() {
    let mut sides = polygons(&unit_box());
    // The first two are opposite sides, x = 0 and x = 1.
    sides.drain(..2);
    let findings = report(&rebuilt(&unit_box(), sides));
    assert_eq!(findings.open_edges.len(), 8);
    assert_eq!(findings.open_loops, 2);
    assert!(!findings.is_closed() && !findings.is_solid());
    assert_eq!(findings.open_edges[0].vertices, [0, 2]);
    assert_eq!(
        findings.open_edges[0].positions[1],
        Vector3::new(0.0, 1.0, 0.0)
    );
    let error = findings.require_closed("box.obj").unwrap_err();
    assert!(matches!(
        error,
        SurfaceError::NotClosed {
            open_edges: 8,
            edge: [0, 2],
            ..
        }
    ));
    insta::assert_snapshot!(error, @"box.obj is not closed: 8 open edges, e.g. between vertices 0 (0, 0, 0) and 2 (0, 1, 0); fill the hole there, or weld the vertices if two sheets only touch");
    insta::assert_snapshot!(findings, @r"
    8 vertices, 4 polygons (8 triangles), 1 piece: NOT closed; volume 0.6667
      8 open edges in 2 loops, e.g. vertices 0-2 at (0, 0, 0) - (0, 1, 0): fill the hole there, or weld vertices that lie together
    ");
}

#[test]
fn turned_polygons_are_found_at_their_edges() {
    let mut sides = polygons(&unit_box());
    sides[3].reverse();
    let findings = report(&rebuilt(&unit_box(), sides));
    assert_eq!(findings.inconsistent_edges.len(), 4);
    assert!(findings.is_closed() && !findings.is_solid() && !findings.is_inside_out());
}

#[test]
fn inside_out_is_told_by_the_volume() {
    let turned = polygons(&unit_box())
        .into_iter()
        .map(|p| p.into_iter().rev().collect())
        .collect();
    let findings = report(&rebuilt(&unit_box(), turned));
    assert!(findings.is_inside_out() && findings.is_closed() && !findings.is_solid());
    assert_eq!(findings.signed_volume, -1.0);
    insta::assert_snapshot!(findings, @r"
    8 vertices, 6 polygons (12 triangles), 1 piece: closed, but not a clean solid; volume -1.000
      inside out (negative volume): flip all polygons
    ");
}

/// Two boxes that share an edge have four polygons there: not manifold, but closed.
#[test]
fn touching_boxes_are_closed_but_not_manifold() {
    let far = primitives::cuboid(Vector3::new(1.0, 1.0, 0.0), Vector3::new(2.0, 2.0, 1.0));
    // The common edge is (1, 1, 0) - (1, 1, 1): vertices 3, 7 of the first box and 0, 4 of the second.
    let names: Vec<u32> = vec![3, 8, 9, 10, 7, 11, 12, 13];
    let mut vertices = unit_box().vertices().to_vec();
    vertices.extend([1, 2, 3, 5, 6, 7].map(|v| far.vertices()[v]));
    let mut sides = polygons(&unit_box());
    sides.extend(
        far.polygons()
            .map(|p| p.iter().map(|&v| names[v as usize]).collect::<Vec<_>>()),
    );
    let findings = report(&Surface::from_polygons(vertices.clone(), sides.clone()).unwrap());
    assert_eq!(findings.non_manifold_edges.len(), 1);
    assert_eq!(
        (
            findings.non_manifold_edges[0].vertices,
            findings.non_manifold_edges[0].uses
        ),
        ([3, 7], 4)
    );
    assert!(findings.is_closed() && !findings.is_solid());
    assert_eq!(
        (findings.components.len(), findings.signed_volume),
        (1, 2.0)
    );

    // A fin on that edge has five polygons there, and three open edges besides.
    sides.push(vec![3, 7, 0]);
    let findings = report(&Surface::from_polygons(vertices, sides).unwrap());
    assert_eq!(findings.non_manifold_edges[0].uses, 5);
    assert!(
        findings
            .open_edges
            .iter()
            .any(|edge| edge.vertices == [3, 7])
    );
}

#[test]
fn pieces_and_cavities_are_listed() {
    let hole = polygons(&unit_box())
        .into_iter()
        .map(|p| p.into_iter().rev().collect())
        .collect();
    let outer = primitives::cuboid(Vector3::repeat(-1.0), Vector3::repeat(3.0));
    let hollow = joined(&outer, &rebuilt(&unit_box(), hole));
    let findings = report(&joined(&hollow, &primitives::icosphere(0, 0.1)));
    let sizes: Vec<_> = findings
        .components
        .iter()
        .map(|c| (c.first_vertex, c.vertices, c.polygons))
        .collect();
    assert_eq!(sizes, [(0, 8, 6), (8, 8, 6), (16, 12, 20)]);
    assert_eq!(findings.components[0].signed_volume, 64.0);
    assert!((findings.components[1].signed_volume + 1.0).abs() < 1e-15);
    assert!(findings.is_solid());
}

#[test]
fn degenerate_polygons_unused_and_duplicate_vertices_are_listed() {
    let mut vertices = unit_box().vertices().to_vec();
    vertices.push(Vector3::new(7.0, 7.0, 7.0));
    vertices.push(Vector3::new(-0.0, 0.0, 0.0));
    let mut sides = polygons(&unit_box());
    sides.push(vec![0, 1, 1]);
    sides.push(vec![4, 4, 4]);
    let findings = report(&Surface::from_polygons(vertices, sides).unwrap());
    assert_eq!(findings.degenerate_polygons, [6, 7]);
    assert_eq!(findings.unused_vertices, [8, 9]);
    assert_eq!(findings.duplicate_vertices, [9]);
    // Polygons folded onto an edge leave the box as closed and manifold as it was.
    assert!(findings.is_solid(), "{findings}");
    insta::assert_snapshot!(findings, @r"
    10 vertices, 8 polygons (14 triangles), 1 piece: solid (closed, consistently turned, facing outwards); volume 1.000
      2 polygons without area or with a repeated corner, e.g. polygon 6: delete or collapse
      2 vertices in no polygon, e.g. vertex 8: harmless, delete to save space
      1 vertex at the place of another, e.g. vertex 9: weld where an edge is open between them
    ");
}

#[test]
fn slivers_are_degenerate_only_when_their_area_is_rounding() {
    let third = Vector3::new(1.0 / 3.0, 0.2, 0.7);
    let line = |t: f64| third * t + Vector3::new(5.0, 5.0, 5.0);
    let sliver = |height: f64| {
        let vertices = vec![line(0.0), line(1.0), line(0.3) + Vector3::x() * height];
        report(&Surface::from_triangles(vertices, vec![[0, 1, 2]]).unwrap())
            .degenerate_polygons
            .len()
    };
    assert_eq!(sliver(0.0), 1);
    assert_eq!(sliver(1e-9), 0);
}

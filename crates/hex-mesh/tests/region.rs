//! Regions of nodes: what they hold, and what they refuse.

mod common;

use common::{data_shape, moved};
use hex_mesh::{
    Axis, HexMesh, HexMeshError, Keep, NodeRegion, Quadrature, VoxelOptions, nodes_near, voxelise,
};
use nalgebra::Vector3;
use surface_mesh::Surface;
use surface_mesh::primitives::{cuboid, icosphere};

/// Nodes at 0, 0.1, .. 1 along each axis.
fn unit_box() -> HexMesh {
    HexMesh::solid_box([10, 10, 10], 0.1, Quadrature::One).unwrap()
}

fn count(region: NodeRegion) -> usize {
    region.select(&unit_box()).unwrap().len()
}

#[test]
fn bounds_are_inclusive_whatever_the_rounding() {
    let (min, max) = ([0.1, 0.2, 0.3], [0.3, 0.6, 0.7]);
    assert_eq!(count(NodeRegion::Box { min, max }), 3 * 5 * 5);
    let face = NodeRegion::Plane {
        axis: Axis::Y,
        value: 0.3,
    };
    assert_eq!(count(face), 121);
    let corner = NodeRegion::HalfSpace {
        normal: [-2.0, -2.0, -2.0],
        offset: -0.6,
    };
    // i + j + k <= 3.
    assert_eq!(count(corner), 20);
    let star = NodeRegion::Sphere {
        center: [0.5, 0.5, 0.5],
        radius: 0.1,
    };
    assert_eq!(count(star), 7);
}

#[test]
fn nodes_rise_and_lie_inside() {
    let mesh = unit_box();
    let sphere = NodeRegion::Sphere {
        center: [0.0, 1.0, 0.0],
        radius: 0.45,
    };
    let nodes = sphere.select(&mesh).unwrap();
    assert!(nodes.is_sorted());
    let inside = |node: &Vector3<f64>| (node - Vector3::y()).norm() <= 0.45;
    assert_eq!(
        nodes.len(),
        mesh.nodes().iter().filter(|n| inside(n)).count()
    );
    assert!(
        nodes
            .iter()
            .all(|&node| inside(&mesh.nodes()[node as usize]))
    );
}

#[test]
fn an_empty_region_says_how_far_it_missed() {
    let mesh = unit_box();
    let ball = NodeRegion::Sphere {
        center: [1.0, 1.0, 3.0],
        radius: 0.5,
    };
    let HexMeshError::RegionEmpty {
        node,
        position,
        distance,
    } = ball.select(&mesh).unwrap_err()
    else {
        panic!("expected an empty region")
    };
    assert_eq!(node, mesh.nodes().len() - 1);
    assert_eq!(position, mesh.nodes()[node]);
    assert!((distance - 1.5).abs() < 1e-12);

    let speck = cuboid(Vector3::repeat(0.42), Vector3::new(0.43, 0.43, 0.49));
    let missed = NodeRegion::Surface.select_with_surface(&mesh, &speck);
    let Err(HexMeshError::RegionEmpty { distance, .. }) = missed else {
        panic!("expected an empty region")
    };
    let expected = (0.02_f64.powi(2) * 2.0 + 0.01_f64.powi(2)).sqrt();
    assert!((distance - expected).abs() < 1e-12);
}

#[test]
fn nodes_inside_a_surface_are_those_of_the_analytic_ball() {
    let centre = Vector3::new(0.031, 0.007, -0.011);
    let skin = voxelise(&icosphere(4, 1.0), &VoxelOptions::new(0.07))
        .unwrap()
        .mesh;
    let bone = moved(&icosphere(5, 0.6), centre);
    let selected = NodeRegion::Surface
        .select_with_surface(&skin, &bone)
        .unwrap();
    for (index, node) in (0..).zip(skin.nodes()) {
        match (node - centre).norm() / 0.6 {
            r if r < 0.998 => assert!(selected.contains(&index)),
            r if r > 1.0 => assert!(!selected.contains(&index)),
            _ => {}
        }
    }
}

#[test]
fn a_surface_region_wants_its_surface_and_a_closed_one() {
    let mesh = unit_box();
    let refused = NodeRegion::Surface.select(&mesh);
    assert_eq!(refused, Err(HexMeshError::RegionNeedsSurface));
    let ball = icosphere(1, 0.4);
    let open = surface_mesh::Surface::from_triangles(
        ball.vertices().to_vec(),
        ball.triangles()[3..].to_vec(),
    );
    let refused = NodeRegion::Surface.select_with_surface(&mesh, &open.unwrap());
    assert!(matches!(refused, Err(HexMeshError::OpenSurface { .. })));
}

#[test]
fn invalid_regions_name_their_field() {
    let nan = f64::NAN;
    let (min, max) = ([0.0; 3], [1.0; 3]);
    let origin = [0.0; 3];
    let cases = [
        (
            NodeRegion::Box {
                min: [0.0, nan, 0.0],
                max,
            },
            "min",
        ),
        (
            NodeRegion::Box {
                min,
                max: [1.0, nan, 1.0],
            },
            "max",
        ),
        (NodeRegion::Box { min: max, max: min }, "min"),
        (
            NodeRegion::Sphere {
                center: [nan; 3],
                radius: 1.0,
            },
            "center",
        ),
        (
            NodeRegion::Sphere {
                center: origin,
                radius: -1.0,
            },
            "radius",
        ),
        (
            NodeRegion::Plane {
                axis: Axis::X,
                value: f64::INFINITY,
            },
            "value",
        ),
        (
            NodeRegion::HalfSpace {
                normal: origin,
                offset: 0.0,
            },
            "normal",
        ),
        (
            NodeRegion::HalfSpace {
                normal: [1.0; 3],
                offset: nan,
            },
            "offset",
        ),
    ];
    for (region, expected) in cases {
        match region.select(&unit_box()) {
            Err(HexMeshError::RegionInvalid { field, .. }) => assert_eq!(field, expected),
            other => panic!("{region:?} gave {other:?}"),
        }
    }
}

#[test]
fn bones_hold_nodes_of_the_face() {
    let (Some(skin), Some(skull), Some(mandible)) = (
        data_shape("face_ict/neutral_skin.obj"),
        data_shape("face_ict/skull_cranium.obj"),
        data_shape("face_ict/mandible.obj"),
    ) else {
        return;
    };
    let mesh = voxelise(&skin, &VoxelOptions::new(0.4)).unwrap().mesh;
    for bone in [skull, mandible] {
        let selected = NodeRegion::Surface.select_with_surface(&mesh, &bone);
        // Nodes are the cell centres of the grid shifted by half a cell.
        let half = Vector3::repeat(0.5 * mesh.element_size());
        let shifted = VoxelOptions {
            origin: Some(mesh.origin() - half),
            keep: Keep::All,
            ..VoxelOptions::new(mesh.element_size())
        };
        let bone_cells = voxelise(&bone, &shifted).unwrap().mesh.cell_index();
        let in_bone = |node: &Vector3<f64>| {
            let place = (node - mesh.origin()) / mesh.element_size();
            let cell = place.map(|x| x.round() as i32).into();
            bone_cells.elements(cell).next().is_some()
        };
        let nodes = (0..).zip(mesh.nodes());
        let expected: Vec<u32> = nodes
            .filter(|(_, node)| in_bone(node))
            .map(|(index, _)| index)
            .collect();
        assert_eq!(selected, Ok(expected));
    }
}

/// Near an open sheet lie the nodes of the layers within reach, beyond its rim as well.
#[test]
fn nodes_near_an_open_surface() {
    let corners = [[0.0, 0.0, 0.51], [0.5, 0.0, 0.51], [0.0, 0.5, 0.51]];
    let sheet = Surface::from_triangles(corners.map(Vector3::from).to_vec(), vec![[0, 1, 2]]);
    let near = |reach| nodes_near(&unit_box(), sheet.as_ref().unwrap(), reach);
    // i + j <= 5 at the layer 0.01 away.
    assert_eq!(near(0.02).unwrap().len(), 21);
    // The layers above and below too; in the plane, 0.1 / sqrt(2) beyond the slanted side: i + j = 6, and along the others i or j = 5.
    let within = near(0.1).unwrap();
    assert!(within.len() > 2 * 21 && within.is_sorted());
    assert_eq!(near(0.0).unwrap(), Vec::<u32>::new());
    assert!(matches!(
        near(f64::NAN),
        Err(HexMeshError::RegionInvalid { .. })
    ));
    assert!(matches!(
        near(-1.0),
        Err(HexMeshError::RegionInvalid { .. })
    ));
}

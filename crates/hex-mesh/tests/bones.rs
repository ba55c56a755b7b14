//! Bodies with bones: cells inside bones are no flesh, and the nodes around them are the bones'.

mod common;

use common::{blocks, data_shape};
use hex_mesh::{
    HexMesh, HexMeshError, Keep, NodeRegion, VoxelOptions, voxelise, voxelise_with_bones,
};
use nalgebra::Vector3;
use surface_mesh::Surface;
use surface_mesh::primitives::{cuboid, icosphere};

fn at_zero(size: f64) -> VoxelOptions {
    VoxelOptions {
        origin: Some(Vector3::zeros()),
        ..VoxelOptions::new(size)
    }
}

fn cube(min: [f64; 3], max: [f64; 3]) -> Surface {
    cuboid(min.into(), max.into())
}

/// Corners of the cells that are in `whole` but not in `flesh`, as places, and whether a node lies on one.
fn on_missing_cell(whole: &HexMesh, flesh: &HexMesh, node: &Vector3<f64>) -> bool {
    let index = flesh.cell_index();
    let size = whole.element_size();
    let missing = (0..whole.elements().len()).filter(|&element| {
        let cell = whole.cells()[element];
        index.elements(cell).next().is_none()
    });
    { missing }.any(|element| {
        let xi = (node - whole.element_corner(element)) / size;
        xi.iter().all(|x| (-1e-9..=1.0 + 1e-9).contains(x))
    })
}

#[test]
fn the_nodes_around_a_bone_are_its_own() {
    let body = cube([0.0; 3], [8.0; 3]);
    let bone = cube([1.9, 1.7, 1.6], [5.2, 4.3, 6.4]);
    let found = voxelise_with_bones(&body, &[bone], &at_zero(1.0)).unwrap();
    assert_eq!(found.mesh.elements().len(), 512 - 3 * 2 * 4);
    assert_eq!(found.report.bone_elements, 24);
    // The nodes strictly inside the bone are in no element.
    assert_eq!(found.mesh.nodes().len(), 729 - 2 * 3);
    let region = NodeRegion::Box {
        min: [2.0; 3],
        max: [5.0, 4.0, 6.0],
    };
    assert_eq!(found.bone_nodes, vec![region.select(&found.mesh).unwrap()]);
    assert!(found.report.to_string().contains("24 elements left out"));
}

#[test]
fn without_bones_nothing_changes() {
    let body = icosphere(3, 1.0);
    let [with, without] = [
        voxelise_with_bones(&body, &[], &at_zero(0.1)).unwrap(),
        voxelise(&body, &at_zero(0.1)).unwrap(),
    ];
    assert!(with == without);
    assert!(with.bone_nodes.is_empty());
}

/// A bone that reaches the skin is covered by one layer of elements where that is wanted; its own nodes in there are still its own.
#[test]
fn bones_under_the_skin_can_be_covered() {
    let body = cube([0.0; 3], [6.0; 3]);
    let bone = cube([-0.5, 1.9, 1.9], [4.1, 4.1, 4.1]);
    let bones = [bone];
    let bare = voxelise_with_bones(&body, &bones, &at_zero(1.0)).unwrap();
    assert_eq!(bare.report.bone_elements, 4 * 2 * 2);
    let options = VoxelOptions {
        cover_bones: true,
        ..at_zero(1.0)
    };
    let covered = voxelise_with_bones(&body, &bones, &options).unwrap();
    assert_eq!(covered.report.bone_elements, 3 * 2 * 2);
    let skin = NodeRegion::Box {
        min: [0.0, 2.0, 2.0],
        max: [0.0, 4.0, 4.0],
    };
    for node in skin.select(&covered.mesh).unwrap() {
        assert!(covered.bone_nodes[0].contains(&node));
    }
    let embedding = covered.embed_surface(&body).unwrap();
    assert!(embedding.max_outside_distance() < 1e-9);
}

/// A bone so thin that no cell is inside it still holds the nodes inside it.
#[test]
fn thin_bones_hold_the_nodes_inside_them() {
    let body = cube([0.0; 3], [4.0; 3]);
    let plate = cube([0.9, 0.9, 1.9], [3.1, 3.1, 2.1]);
    let found = voxelise_with_bones(&body, &[plate], &at_zero(1.0)).unwrap();
    assert_eq!(found.report.bone_elements, 0);
    assert_eq!(found.bone_nodes[0].len(), 9);
}

/// Nodes in two bones go to the first, and that they overlap is said.
#[test]
fn every_node_has_one_bone() {
    let body = cube([0.0; 3], [9.0, 3.0, 3.0]);
    let left = cube([0.9, 0.9, 0.9], [4.1, 2.1, 2.1]);
    let right = cube([3.8, 0.8, 0.8], [7.1, 2.2, 2.2]);
    let found = voxelise_with_bones(&body, &[left, right], &at_zero(1.0)).unwrap();
    // The cell from 4 to 5 has corners of either.
    assert_eq!(found.mesh.elements().len(), 81 - 5);
    let [left, right] = &found.bone_nodes[..] else {
        panic!("two bones")
    };
    assert!(left.iter().all(|node| !right.contains(node)));
    let x = |nodes: &[u32]| -> Vec<f64> {
        nodes
            .iter()
            .map(|&node| found.mesh.nodes()[node as usize].x)
            .collect()
    };
    // Four nodes each at x = 1, 2, 3 and 4, where both are and the first wins; then at 5, 6 and 7.
    assert_eq!(found.report.shared_points, 4);
    assert!(
        found
            .report
            .to_string()
            .contains("4 grid points lie in several")
    );
    assert_eq!(left.len(), 16);
    assert!(x(left).iter().all(|x| (1.0..=4.0).contains(x)));
    assert_eq!(right.len(), 12);
    assert!(x(right).iter().all(|x| (5.0..=7.0).contains(x)));
}

/// A bone in one prong holds no node of the other one, though these lie at the same places.
#[test]
fn a_bone_holds_its_side_of_a_gap() {
    let x = [0.0, 1.99, 2.01, 4.0];
    let planes: [&[f64]; 3] = [&x, &[0.0, 2.0], &[0.0, 2.0, 6.0]];
    let fork = blocks(planes, |[x, _, z]| x != 1 || z == 0);
    let bone = cube([0.5, -0.1, 3.9], [1.98, 2.1, 5.1]);
    let found = voxelise_with_bones(&fork, &[bone], &at_zero(1.0)).unwrap();
    assert_eq!(found.report.bone_elements, 0);
    assert_eq!(found.bone_nodes[0].len(), 6);
    let corners = found.mesh.node_elements();
    for &node in &found.bone_nodes[0] {
        for corner in corners.at(node as usize) {
            assert!(found.mesh.cells()[corner.element as usize][0] < 2);
        }
    }
}

#[test]
fn flesh_that_bones_cut_off_is_dropped_or_kept() {
    let body = cube([0.0; 3], [9.0, 2.0, 2.0]);
    let bone = cube([1.9, -1.0, -1.0], [4.1, 3.0, 3.0]);
    let bones = [bone];
    let found = voxelise_with_bones(&body, &bones, &at_zero(1.0)).unwrap();
    assert_eq!((found.report.pieces, found.report.elements), (2, 20));
    assert_eq!(found.report.dropped[0].elements, 8);
    assert_eq!(found.bone_nodes[0].len(), 9);
    let all = VoxelOptions {
        keep: Keep::All,
        ..at_zero(1.0)
    };
    let found = voxelise_with_bones(&body, &bones, &all).unwrap();
    assert_eq!(found.report.elements, 28);
    assert_eq!(found.bone_nodes[0].len(), 18);
}

#[test]
fn bad_bones_are_refused_by_their_index() {
    let body = cube([0.0; 3], [4.0; 3]);
    let ball = icosphere(1, 0.4);
    let open = Surface::from_triangles(ball.vertices().to_vec(), ball.triangles()[3..].to_vec());
    let bones = [ball, open.unwrap()];
    let refused = voxelise_with_bones(&body, &bones, &at_zero(1.0)).unwrap_err();
    let HexMeshError::Bone { bone: 1, source } = &refused else {
        panic!("{refused}")
    };
    assert!(matches!(**source, HexMeshError::OpenSurface { .. }));
    let all = [cube([-1.0; 3], [5.0; 3])];
    let refused = voxelise_with_bones(&body, &all, &at_zero(1.0)).unwrap_err();
    assert_eq!(refused, HexMeshError::NoFlesh { cells: 64 });
}

#[test]
fn skull_and_mandible_hold_the_face() {
    let files = ["neutral_skin", "skull_cranium", "mandible"];
    let [Some(skin), Some(skull), Some(mandible)] =
        files.map(|file| data_shape(&format!("face_ict/{file}.obj")))
    else {
        return;
    };
    let options = VoxelOptions::new(0.5);
    let whole = voxelise(&skin, &options).unwrap();
    let start = std::time::Instant::now();
    let found = voxelise_with_bones(&skin, &[skull, mandible], &options).unwrap();
    eprintln!("{:?}\n{}", start.elapsed(), found.report);
    let [skull, mandible] = &found.bone_nodes[..] else {
        panic!("two bones")
    };
    eprintln!(
        "{} nodes of the skull, {} of the mandible",
        skull.len(),
        mandible.len()
    );
    assert!(skull.len() > 1000 && mandible.len() > 300);
    let bone =
        |node: u32| skull.binary_search(&node).is_ok() || mandible.binary_search(&node).is_ok();
    // Nodes are sorted, and none has two bones.
    assert!(
        skull
            .iter()
            .all(|node| mandible.binary_search(node).is_err())
    );
    // Every flesh node that touches a left-out cell is a bone node; a sample of them suffices.
    for node in (0..found.mesh.nodes().len() as u32).step_by(97) {
        let place = &found.mesh.nodes()[node as usize];
        if bone(node) {
            continue;
        }
        let dropped = found.report.dropped.iter().any(|piece| {
            let inside =
                |a: usize| piece.min[a] - 1e-9 <= place[a] && place[a] <= piece.max[a] + 1e-9;
            (0..3).all(inside)
        });
        assert!(
            dropped || !on_missing_cell(&whole.mesh, &found.mesh, place),
            "{place}"
        );
    }
}

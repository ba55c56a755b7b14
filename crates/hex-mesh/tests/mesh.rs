//! Boxes and lists of cells: order, volume, incidence, refusals.

use hex_mesh::{HexMesh, HexMeshError, MAX_GRID_CELLS, Quadrature, corner_offset};
use nalgebra::Vector3;

fn lexicographic(position: [usize; 3], counts: [usize; 3]) -> usize {
    (position[0] * counts[1] + position[1]) * counts[2] + position[2]
}

#[test]
fn a_box_is_exact_and_in_lexicographic_order() {
    let counts = [3, 4, 5];
    let mesh = HexMesh::solid_box(counts, 0.25, Quadrature::Eight).unwrap();
    assert_eq!(mesh.elements().len(), 60);
    assert_eq!(mesh.nodes().len(), 4 * 5 * 6);
    assert_eq!(mesh.volume(), 60.0 / 64.0);
    assert_eq!(mesh.element_volume(), 1.0 / 64.0);
    assert_eq!(mesh.origin(), Vector3::zeros());
    for x in 0..=3 {
        for y in 0..=4 {
            for z in 0..=5 {
                let node = mesh.nodes()[lexicographic([x, y, z], [4, 5, 6])];
                assert_eq!(node, Vector3::new(x as f64, y as f64, z as f64) * 0.25);
            }
        }
    }
    for (element, &cell) in mesh.cells().iter().enumerate() {
        assert_eq!(lexicographic(cell.map(|i| i as usize), counts), element);
        for corner in 0..8 {
            let offset = corner_offset(corner).map(|o| o as f64 * 0.25);
            let node = mesh.elements()[element][corner] as usize;
            let expected = mesh.element_corner(element) + Vector3::from(offset);
            assert_eq!(mesh.nodes()[node], expected);
        }
    }
}

#[test]
fn corners_run_with_x_slowest() {
    assert_eq!(corner_offset(1), [0, 0, 1]);
    assert_eq!(corner_offset(2), [0, 1, 0]);
    assert_eq!(corner_offset(4), [1, 0, 0]);
}

#[test]
fn touching_cells_share_exactly_the_nodes_they_touch_in() {
    let shared = |second: [i32; 3]| {
        let cells = vec![[-7, 0, 3], second];
        let mesh = HexMesh::from_cells(cells, Vector3::zeros(), 1.0, Quadrature::One).unwrap();
        16 - mesh.nodes().len()
    };
    assert_eq!(shared([-7, 0, 4]), 4);
    assert_eq!(shared([-7, -1, 4]), 2);
    assert_eq!(shared([-6, 1, 2]), 1);
    assert_eq!(shared([-5, 0, 3]), 0);
}

#[test]
fn cells_keep_their_order_and_place() {
    let cells = vec![[2, -1, 0], [0, 0, 0], [2, 0, 0]];
    let origin = Vector3::new(1.0, 2.0, 3.0);
    let mesh = HexMesh::from_cells(cells.clone(), origin, 0.5, Quadrature::One).unwrap();
    assert_eq!(mesh.cells(), cells);
    assert_eq!(mesh.elements()[0], [0, 1, 2, 3, 4, 5, 6, 7]);
    assert_eq!(mesh.element_corner(0), Vector3::new(2.0, 1.5, 3.0));
    assert_eq!(mesh.origin(), origin);
    let index = mesh.cell_index();
    assert_eq!(index.elements([2, 0, 0]).collect::<Vec<_>>(), [2]);
    assert_eq!(index.elements([1, 0, 0]).count(), 0);
}

#[test]
fn incidence_is_the_transpose_of_the_elements() {
    let mesh = HexMesh::solid_box([3, 2, 2], 1.0, Quadrature::One).unwrap();
    let incidence = mesh.node_elements();
    assert_eq!(incidence.corners().len(), 8 * mesh.elements().len());
    assert_eq!(incidence.offsets().len(), mesh.nodes().len() + 1);
    for node in 0..mesh.nodes().len() {
        let meeting = incidence.at(node);
        assert!(meeting.is_sorted_by_key(|at| at.element));
        for at in meeting {
            let corner = mesh.elements()[at.element as usize][at.corner as usize];
            assert_eq!(corner as usize, node);
        }
    }
    assert_eq!(incidence.at(lexicographic([1, 1, 1], [4, 3, 3])).len(), 8);
    assert_eq!(incidence.at(0).len(), 1);
}

#[test]
fn samples_lie_in_their_elements_in_order() {
    let mesh = HexMesh::solid_box([2, 1, 1], 2.0, Quadrature::Eight).unwrap();
    let samples = mesh.sample_positions();
    assert_eq!(samples.len(), 16);
    let low = 1.0 - 1.0 / 3.0_f64.sqrt();
    assert!((samples[0] - Vector3::repeat(low)).norm() < 1e-15);
    assert!((samples[1] - Vector3::new(low, low, 2.0 - low)).norm() < 1e-15);
    assert!((samples[12] - Vector3::new(4.0 - low, low, low)).norm() < 1e-15);
}

#[test]
fn bad_boxes_and_cells_are_refused() {
    let solid = |cells, size| HexMesh::solid_box(cells, size, Quadrature::One).unwrap_err();
    for size in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        assert!(matches!(
            solid([1, 1, 1], size),
            HexMeshError::ElementSize { .. }
        ));
    }
    let empty = HexMeshError::EmptyBox { cells: [2, 0, 2] };
    assert_eq!(solid([2, 0, 2], 1.0), empty);
    for cells in [[MAX_GRID_CELLS + 1, 1, 1], [usize::MAX; 3]] {
        assert!(matches!(
            solid(cells, 1.0),
            HexMeshError::GridTooLarge { .. }
        ));
    }

    let of_cells = |cells: &[[i32; 3]]| {
        HexMesh::from_cells(cells.to_vec(), Vector3::zeros(), 1.0, Quadrature::One).unwrap_err()
    };
    assert_eq!(of_cells(&[]), HexMeshError::NoCellsGiven);
    let duplicate = HexMeshError::DuplicateCell {
        cell: [1, 2, 3],
        entry: 2,
    };
    assert_eq!(of_cells(&[[1, 2, 3], [0, 0, 0], [1, 2, 3]]), duplicate);
    for far in [[i32::MAX - 1; 3], [i32::MAX; 3]] {
        assert!(matches!(
            of_cells(&[[i32::MIN; 3], far]),
            HexMeshError::GridTooLarge { .. }
        ));
    }
    let origin = Vector3::new(0.0, f64::NAN, 0.0);
    assert!(matches!(
        HexMesh::from_cells(vec![[0; 3]], origin, 1.0, Quadrature::One),
        Err(HexMeshError::Origin { .. })
    ));
}

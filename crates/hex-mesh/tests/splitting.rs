//! Cells that hold separate parts of a body: one element for each part, with nodes of its own.

mod common;

use common::{Numbers, blocks, joined, moved, path, share_node};
use hex_mesh::{
    EmbeddedPoint, HexMesh, HexMeshError, Keep, Splitting, VoxelOptions, Voxelised, voxelise,
};
use nalgebra::Vector3;
use surface_mesh::Surface;
use surface_mesh::primitives::{cuboid, icosphere, torus};

/// Cubes of edge 1 with corners at whole numbers, all pieces.
fn unit_cells() -> VoxelOptions {
    VoxelOptions {
        keep: Keep::All,
        origin: Some(Vector3::zeros()),
        ..VoxelOptions::new(1.0)
    }
}

fn voxels(surface: &Surface) -> Voxelised {
    voxelise(surface, &unit_cells()).unwrap()
}

/// The surface with its triangles facing the other way, as the wall of a cavity does.
fn flipped(surface: &Surface) -> Surface {
    let triangles = surface.triangles().iter().map(|&[a, b, c]| [a, c, b]);
    Surface::from_triangles(surface.vertices().to_vec(), triangles.collect()).unwrap()
}

fn elements_of(mesh: &HexMesh, cell: [i32; 3]) -> Vec<u32> {
    mesh.cell_index().elements(cell).collect()
}

fn shared_nodes(mesh: &HexMesh, a: u32, b: u32) -> usize {
    let [a, b] = [a, b].map(|element| mesh.elements()[element as usize]);
    a.iter().filter(|node| b.contains(node)).count()
}

/// Elements are cubes on eight nodes each, and no two are the same.
fn check_elements(mesh: &HexMesh) {
    let mut all = mesh.elements().to_vec();
    for (nodes, cell) in all.iter().zip(mesh.cells()) {
        for (corner, &node) in nodes.iter().enumerate() {
            let offset = hex_mesh::corner_offset(corner);
            let place = std::array::from_fn(|a| f64::from(cell[a]) + offset[a] as f64);
            let expected = mesh.origin() + mesh.element_size() * Vector3::from(place);
            assert!((mesh.nodes()[node as usize] - expected).norm() < 1e-12);
        }
    }
    all.sort_unstable();
    assert!(all.windows(2).all(|pair| pair[0] != pair[1]));
    let used: std::collections::HashSet<_> = all.iter().flatten().collect();
    assert_eq!(used.len(), mesh.nodes().len());
}

/// Slabs of 4 x 4 x (about 2.5) cells, 1/20 of a cell apart, `at` above a cell's lower face.
fn slabs(at: f64) -> Surface {
    let (gap, side) = (2.0 + at, [0.0, 4.0]);
    let planes: [&[f64]; 3] = [&side, &side, &[0.0, gap, gap + 0.05, 5.0]];
    blocks(planes, |[_, _, z]| z != 1)
}

#[test]
fn slabs_at_a_narrow_gap_share_no_node() {
    for step in 0..=19 {
        let at = f64::from(step) * 0.05;
        let Voxelised { mesh, report, .. } = voxels(&slabs(at));
        check_elements(&mesh);
        assert_eq!(report.pieces, 2, "{at}: {report}");
        let lower = mesh.cell_index().elements([0, 0, 0]).next().unwrap();
        let upper = mesh.cell_index().elements([3, 3, 4]).next().unwrap();
        assert!(path(&mesh, lower, upper).is_empty(), "{at}");
        // Two layers each, and one or both of them in the layer between.
        let layer = elements_of(&mesh, [1, 1, 2]).len();
        assert!((1..=2).contains(&layer), "{at}: {layer}");
        assert_eq!(report.split_cells, if layer == 2 { 16 } else { 0 });
        assert_eq!(mesh.elements().len(), 16 * (4 + layer));
        if (0.3..0.7).contains(&at) {
            assert_eq!(layer, 2, "{at}");
        }
        assert_eq!(mesh.nodes().len(), 25 * (4 + layer + 2), "{at}");
    }
}

#[test]
fn without_splitting_the_gap_is_bridged() {
    let options = VoxelOptions {
        split: None,
        ..unit_cells()
    };
    let Voxelised { mesh, report, .. } = voxelise(&slabs(0.2), &options).unwrap();
    assert_eq!((report.pieces, report.split_cells), (1, 0));
    assert_eq!(mesh.nodes().len(), 25 * 6);
}

/// Every vertex follows the slab that it lies on, however near the other one is.
#[test]
fn vertices_are_carried_by_their_own_slab() {
    for step in 0..=19 {
        let at = f64::from(step) * 0.05;
        let surface = slabs(at);
        let voxelised = voxels(&surface);
        let mesh = &voxelised.mesh;
        let upper = mesh.cell_index().elements([3, 3, 4]).next().unwrap();
        let lifted: Vec<_> = (0..mesh.elements().len() as u32)
            .filter(|&element| !path(mesh, element, upper).is_empty())
            .flat_map(|element| mesh.elements()[element as usize])
            .collect();
        let mut nodes = mesh.nodes().to_vec();
        for &node in &lifted {
            nodes[node as usize].z = mesh.nodes()[node as usize].z + 1.0;
        }
        let embedding = voxelised.embed_surface(&surface).unwrap();
        assert!(embedding.max_outside_distance() < 1.0);
        let carried = embedding.positions(&nodes, mesh);
        for (before, after) in surface.vertices().iter().zip(carried) {
            let lift = if before.z > 2.02 + at { 1.0 } else { 0.0 };
            let expected = before + Vector3::z() * lift;
            assert!((after - expected).norm() < 1e-12, "{at}: {before}");
        }
    }
}

/// Two prongs in one cell's width on a base of two layers; the prongs end at `x` 0.5 but for a gap (or an overlap, if negative).
fn fork(gap: f64) -> Surface {
    let x = [0.0, 0.5 - gap / 2.0, 0.5 + gap / 2.0, 1.0];
    blocks([&x, &[0.0, 3.0], &[0.0, 2.0, 5.0]], |[x, _, z]| {
        x != 1 || z == 0
    })
}

#[test]
fn prongs_connect_at_their_base_only() {
    // The last closes the gap until the prongs overlap.
    for gap in [0.1, 0.01, 1e-4, -0.04] {
        let Voxelised { mesh, report, .. } = voxels(&fork(gap));
        check_elements(&mesh);
        assert_eq!(mesh.elements().len(), 3 * (2 + 2 * 3), "{gap}");
        assert_eq!((report.split_cells, report.pieces), (9, 1), "{gap}");
        for y in 0..3 {
            let [a, b] = elements_of(&mesh, [0, y, 4])[..] else {
                panic!("{gap}")
            };
            assert_eq!(path(&mesh, a, b).len(), 6, "down one prong, up the other");
            let [a, b] = elements_of(&mesh, [0, y, 2])[..] else {
                panic!("{gap}")
            };
            assert_eq!(shared_nodes(&mesh, a, b), 4, "the top of the base");
            for (low, high) in [(2, 3), (3, 4)] {
                let [low, high] = [low, high].map(|z| elements_of(&mesh, [0, y, z]));
                assert_eq!(shared_nodes(&mesh, low[0], high[0]), 4);
                assert_eq!(shared_nodes(&mesh, low[1], high[1]), 4);
                assert_eq!(shared_nodes(&mesh, low[0], high[1]), 0);
            }
        }
    }
}

/// The gap lies in the faces between cells, so that no cell holds both prongs.
#[test]
fn prongs_in_neighbouring_cells_connect_at_their_base_only() {
    let x = [0.0, 0.99, 1.01, 2.0];
    let planes: [&[f64]; 3] = [&x, &[0.0, 2.0], &[0.0, 2.0, 5.0]];
    let surface = blocks(planes, |[x, _, z]| x != 1 || z == 0);
    let Voxelised { mesh, report, .. } = voxels(&surface);
    check_elements(&mesh);
    assert_eq!((report.split_cells, report.pieces), (0, 1));
    let at = |x, z| elements_of(&mesh, [x, 0, z])[0];
    assert_eq!(shared_nodes(&mesh, at(0, 1), at(1, 1)), 4);
    assert_eq!(shared_nodes(&mesh, at(0, 2), at(1, 2)), 2);
    assert_eq!(shared_nodes(&mesh, at(0, 3), at(1, 3)), 0);
    assert_eq!(path(&mesh, at(0, 4), at(1, 4)).len(), 6);
}

/// A ring of which the last bit is missing: around, not across.
#[test]
fn a_horseshoe_stays_open() {
    for gap in [0.1, 0.001, -0.05] {
        let (x, z) = ([0.0, 2.0, 5.0, 7.0], [0.0, 2.0, 3.4, 3.4 + gap, 5.0, 7.0]);
        // All around the hole in the middle, but for the gap in the last column.
        let ring = |[x, _, z]: [usize; 3]| match x {
            0 => true,
            1 => z == 0 || z == 4,
            _ => z != 2,
        };
        let Voxelised { mesh, report, .. } = voxels(&blocks([&x, &[0.0, 2.0], &z], ring));
        check_elements(&mesh);
        assert_eq!(report.pieces, 1, "{gap}: {report}");
        let [below, above] = [2, 4].map(|z| elements_of(&mesh, [6, 0, z])[0]);
        let around = path(&mesh, below, above);
        let leftmost = around.iter().map(|&e| mesh.cells()[e as usize][0]).min();
        assert!(leftmost < Some(2), "{gap}: {around:?}");
    }
}

/// Four fingers, two of them in each cell's width, on a palm.
#[test]
fn fingers_do_not_fuse() {
    let mut x = vec![0.0];
    for finger in 0..4 {
        x.extend([0.02, 0.48].map(|side| f64::from(finger) * 0.5 + side));
    }
    x.push(2.0);
    let planes: [&[f64]; 3] = [&x, &[0.0, 1.0], &[0.0, 2.0, 6.0]];
    let surface = blocks(planes, |[x, _, z]| z == 0 || x % 2 == 1);
    let voxelised = voxels(&surface);
    let mesh = &voxelised.mesh;
    check_elements(mesh);
    assert_eq!(mesh.elements().len(), 2 * 2 + 4 * 4);
    let tips: Vec<u32> = [0, 1]
        .iter()
        .flat_map(|&x| elements_of(mesh, [x, 0, 5]))
        .collect();
    for (i, &a) in tips.iter().enumerate() {
        for &b in &tips[..i] {
            assert!(path(mesh, a, b).len() >= 8, "{a} and {b}");
        }
    }
    // Each finger tip's vertices have one carrier, each its own.
    let embedding = voxelised.embed_surface(&surface).unwrap();
    let vertices = surface.vertices().iter().zip(embedding.vertices());
    for (vertex, carrier) in vertices.filter(|(vertex, _)| vertex.z == 6.0) {
        if (0.01..1.99).contains(&vertex.x) {
            assert_eq!(carrier.element, tips[(2.0 * vertex.x) as usize], "{vertex}");
        }
    }
}

#[test]
fn bodies_without_gaps_are_as_without_splitting() {
    let bodies = [
        icosphere(4, 1.0),
        cuboid(Vector3::new(-1.0, -0.7, 0.1), Vector3::new(1.0, 0.4, 0.8)),
        torus(1.0, 0.35, 48, 24),
        joined(&icosphere(4, 1.0), &flipped(&icosphere(4, 0.6))),
    ];
    let mut numbers = Numbers(21);
    for surface in &bodies {
        for size in [0.29, 0.2, 0.1, 0.05] {
            let origin = Some(numbers.vector());
            for origin in [None, origin] {
                let split = VoxelOptions {
                    origin,
                    ..VoxelOptions::new(size)
                };
                let whole = VoxelOptions {
                    split: None,
                    ..split
                };
                let [split, whole] = [split, whole].map(|o| voxelise(surface, &o).unwrap());
                assert!(split.mesh == whole.mesh, "{size} {origin:?}");
                assert_eq!(split.report, whole.report);
                let embedding = split.embed_surface(surface).unwrap();
                let nearest = hex_mesh::embed(&whole.mesh, surface.vertices()).unwrap();
                // Through material, another cube may be reached first that is nearly as near.
                let outside = |carrier: &EmbeddedPoint, vertex: &Vector3<f64>| {
                    let corner = whole.mesh.element_corner(carrier.element as usize);
                    let xi = (vertex - corner) / size;
                    (xi - xi.map(|x| x.clamp(0.0, 1.0))).norm()
                };
                let carriers = embedding.vertices().iter().zip(nearest.vertices());
                let mut farther = 0;
                for (vertex, (by_part, by_cube)) in surface.vertices().iter().zip(carriers) {
                    let [by_part, by_cube] = [by_part, by_cube].map(|c| outside(c, vertex));
                    assert!(by_part < by_cube + 0.1, "{size} {origin:?} {vertex}");
                    farther += usize::from(by_part > by_cube + 1e-9);
                }
                assert!(farther * 100 <= surface.vertex_count(), "{farther}");
            }
        }
    }
}

/// A crack inside the body that parts one cell, but opens no corner of it, is no reason for two elements in the same nodes.
#[test]
fn a_crack_within_one_cell_parts_nothing() {
    let (across, z) = ([0.0, 0.9, 2.1, 3.0], [0.0, 1.49, 1.51, 3.0]);
    let surface = blocks([&across, &across, &z], |block| block != [1; 3]);
    let Voxelised { mesh, report, .. } = voxels(&surface);
    check_elements(&mesh);
    assert_eq!((mesh.elements().len(), report.split_cells), (27, 0));
    assert_eq!(mesh.nodes().len(), 64);
}

/// What fills little of a cell is no element of its own, and does not tear its neighbours.
#[test]
fn slivers_are_no_elements() {
    let x = [0.0, 2.9, 2.95, 4.0];
    let surface = blocks([&x, &[0.0, 2.0], &[0.0, 2.0]], |[x, _, _]| x != 1);
    let Voxelised { mesh, report, .. } = voxels(&surface);
    assert_eq!((mesh.elements().len(), report.split_cells), (16, 0));
    assert_eq!(report.pieces, 2);
    check_elements(&mesh);
}

/// A rod between cell centres that grows out of a block: left out, or covered all along and held by the block.
#[test]
fn thin_parts_are_covered_on_demand() {
    let planes: [&[f64]; 3] = [
        &[0.0, 3.0, 9.0],
        &[0.0, 1.1, 1.4, 3.0],
        &[0.0, 1.6, 1.9, 3.0],
    ];
    let surface = blocks(planes, |[x, y, z]| x == 0 || y == 1 && z == 1);
    let cover = |cover_thin| {
        let split = Splitting {
            cover_thin,
            ..Splitting::default()
        };
        let options = VoxelOptions {
            split: Some(split),
            ..unit_cells()
        };
        let voxelised = voxelise(&surface, &options).unwrap();
        check_elements(&voxelised.mesh);
        let embedding = voxelised.embed_surface(&surface).unwrap();
        (voxelised, embedding.max_outside_distance())
    };
    let (without, outside) = cover(false);
    assert_eq!((without.mesh.elements().len(), outside), (27, 6.0));
    let (with, outside) = cover(true);
    assert_eq!((with.mesh.elements().len(), outside), (27 + 6, 0.0));
    assert_eq!(with.report.pieces, 1);
}

#[test]
fn separate_bodies_in_one_cell_are_separate_pieces() {
    let ball = icosphere(3, 0.98);
    let surface = joined(&ball, &moved(&ball, Vector3::new(1.97, 0.0, 0.0)));
    for size in [0.5, 0.31, 0.2, 0.1] {
        let options = VoxelOptions {
            keep: Keep::All,
            ..VoxelOptions::new(size)
        };
        let Voxelised { mesh, report, .. } = voxelise(&surface, &options).unwrap();
        check_elements(&mesh);
        assert_eq!(report.pieces, 2, "{size}: {report}");
        let ends = [f64::min, f64::max].map(|pick| {
            let x = mesh.nodes().iter().map(|node| node.x);
            let end = x.reduce(pick).unwrap();
            let at_end = |&e: &usize| {
                let [low, high] = [0, 7].map(|c| mesh.nodes()[mesh.elements()[e][c] as usize].x);
                low == end || high == end
            };
            (0..mesh.elements().len()).find(at_end).unwrap() as u32
        });
        assert!(path(&mesh, ends[0], ends[1]).is_empty());
    }
}

/// Boxes anywhere, however near: no element and no node is of two of them, and every vertex is carried by its own.
#[test]
fn random_boxes_have_nothing_in_common() {
    let mut numbers = Numbers(5);
    for _ in 0..30 {
        let mut boxes: Vec<[Vector3<f64>; 2]> = Vec::new();
        while boxes.len() < 12 {
            let low = numbers.vector() * 4.0;
            let high = low + Vector3::from_fn(|_, _| 1.05 + 2.0 * numbers.unit());
            // Not nearer than 1/100 of a cell along at least one axis.
            let apart = |[l, h]: &[Vector3<f64>; 2]| {
                (0..3).any(|a| low[a] > h[a] + 0.01 || high[a] < l[a] - 0.01)
            };
            if boxes.iter().all(apart) {
                boxes.push([low, high]);
            }
        }
        let surfaces = boxes.iter().map(|&[low, high]| cuboid(low, high));
        let surface = surfaces.reduce(|a, b| joined(&a, &b)).unwrap();
        let voxelised = voxels(&surface);
        let mesh = &voxelised.mesh;
        check_elements(mesh);
        let embedding = voxelised.embed_surface(&surface).unwrap();
        let carriers: Vec<_> = embedding.vertices().iter().map(|v| v.element).collect();
        for (i, own) in carriers.chunks(8).enumerate() {
            assert!(
                own.iter()
                    .all(|&element| !path(mesh, own[0], element).is_empty())
            );
            for other in carriers.chunks(8).skip(i + 1) {
                assert!(path(mesh, own[0], other[0]).is_empty());
            }
        }
        assert!(voxelised.report.pieces >= 12);
    }
}

#[test]
fn threads_do_not_change_a_bit() {
    let surface = fork(0.02);
    let run = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads);
        pool.build().unwrap().install(|| {
            let options = VoxelOptions::new(0.24);
            let voxelised = voxelise(&surface, &options).unwrap();
            let embedding = voxelised.embed_surface(&surface).unwrap();
            (voxelised, embedding)
        })
    };
    let (one, four) = (run(1), run(4));
    assert!(one == four);
    assert!(!share_node(
        &one.0.mesh,
        0,
        one.0.mesh.elements().len() as u32 - 1
    ));
}

#[test]
fn bad_options_are_refused() {
    let with = |samples, least_fraction| VoxelOptions {
        split: Some(Splitting {
            samples,
            least_fraction,
            ..Splitting::default()
        }),
        ..unit_cells()
    };
    for samples in [0, 1, 4, 9] {
        let refused = voxelise(&slabs(0.5), &with(samples, 0.2)).unwrap_err();
        assert_eq!(refused, HexMeshError::SplitSamples { samples });
    }
    for fraction in [0.0, -0.1, 0.51, f64::NAN] {
        let refused = voxelise(&slabs(0.5), &with(5, fraction)).unwrap_err();
        assert!(matches!(refused, HexMeshError::SplitFraction { .. }));
    }
    for samples in [3, 5, 7] {
        let voxelised = voxelise(&slabs(0.5), &with(samples, 0.2)).unwrap();
        assert_eq!(voxelised.report.split_cells, 16);
    }
}

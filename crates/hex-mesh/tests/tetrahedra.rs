//! Random tetrahedra with small integer vertices against exact integer arithmetic. Cell centres are integers too, so that rays run
//! through vertices and along edges and faces all the time.

use hex_mesh::{HexMeshError, Keep, VoxelOptions, voxelise};
use nalgebra::Vector3;
use proptest::prelude::*;
use surface_mesh::Surface;

type Point = [i64; 3];

/// Six times the signed volume of a tetrahedron.
fn volume(a: Point, b: Point, c: Point, d: Point) -> i64 {
    let [p, q, r] = [b, c, d].map(|x| Vector3::from(x) - Vector3::from(a));
    p.dot(&q.cross(&r))
}

/// Whether a point is strictly inside (`Some(true)`), strictly outside, or on the boundary (`None`).
fn is_inside([a, b, c, d]: [Point; 4], point: Point) -> Option<bool> {
    let orientation = volume(a, b, c, d).signum();
    let parts = [
        volume(point, b, c, d),
        volume(a, point, c, d),
        volume(a, b, point, d),
        volume(a, b, c, point),
    ];
    let signs = parts.map(|part| part.signum() * orientation);
    if signs.contains(&-1) {
        Some(false)
    } else if signs.contains(&0) {
        None
    } else {
        Some(true)
    }
}

const SIDE: i64 = 9;

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::with_cases(2000) })]

    #[test]
    fn every_cell_is_judged_exactly(corners in prop::array::uniform4(prop::array::uniform3(0..SIDE))) {
        let [a, b, c, d] = corners;
        prop_assume!(volume(a, b, c, d) != 0);
        let vertices = corners.map(|x| Vector3::from(x.map(|i| i as f64)));
        let triangles = vec![[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]];
        let surface = Surface::from_triangles(vertices.to_vec(), triangles).unwrap();
        let options = VoxelOptions {
            origin: Some(Vector3::repeat(-0.5)),
            keep: Keep::All,
            ..VoxelOptions::new(1.0)
        };
        let index = match voxelise(&surface, &options) {
            Ok(body) => Some(body.mesh.cell_index()),
            Err(HexMeshError::NoCells { .. }) => None,
            Err(error) => panic!("{error}"),
        };
        for code in 0..SIDE.pow(3) {
            let point = [code / SIDE / SIDE, code / SIDE % SIDE, code % SIDE];
            let found = index.as_ref().is_some_and(|index| index.elements(point.map(|i| i as i32)).next().is_some());
            if let Some(expected) = is_inside(corners, point) {
                prop_assert_eq!(found, expected, "{:?}", point);
            }
        }
    }
}

//! The PLY writer, read back by hand.

use std::fs;

use nalgebra::Vector3;
use surface_mesh::{PlyAttributes, Surface, SurfaceError, primitives, write_ply};

fn written(surface: &Surface, attributes: &PlyAttributes) -> (String, Vec<u8>) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("test.ply");
    write_ply(&path, surface, attributes).unwrap();
    let bytes = fs::read(path).unwrap();
    let end = b"end_header\n";
    let start = bytes.windows(end.len()).position(|w| w == end).unwrap() + end.len();
    (
        String::from_utf8(bytes[..start].into()).unwrap(),
        bytes[start..].into(),
    )
}

#[test]
fn every_property_is_where_the_header_says() {
    let shape = primitives::cuboid(Vector3::zeros(), Vector3::repeat(1.0));
    let quality: Vec<f64> = (0..8).map(|i| f64::from(i) / 7.0).collect();
    let colors: Vec<[u8; 3]> = (0..8).map(|i| [i, 2 * i, 255]).collect();
    let attributes = PlyAttributes {
        quality: Some(&quality),
        colors: Some(&colors),
    };
    let (header, body) = written(&shape, &attributes);
    insta::assert_snapshot!(header, @r"
    ply
    format binary_little_endian 1.0
    element vertex 8
    property double x
    property double y
    property double z
    property uchar red
    property uchar green
    property uchar blue
    property double quality
    element face 6
    property list uchar uint vertex_indices
    end_header
    ");
    let row = 24 + 3 + 8;
    assert_eq!(body.len(), 8 * row + 6 * (1 + 16));
    let double = |at: usize| f64::from_le_bytes(body[at..at + 8].try_into().unwrap());
    assert_eq!(double(5 * row), 1.0);
    assert_eq!(body[5 * row + 24..][..3], [5, 10, 255]);
    assert_eq!(double(5 * row + 27), 5.0 / 7.0);
    assert_eq!(body[8 * row], 4);
    let second = shape.polygons().next().unwrap()[1];
    assert_eq!(body[8 * row + 5..][..4], second.to_le_bytes());
}

#[test]
fn large_polygons_get_a_wide_count() {
    let ring = |i: u32| Vector3::new(f64::from(i).cos(), f64::from(i).sin(), 0.0);
    let surface =
        Surface::from_polygons((0..300).map(ring).collect(), vec![(0..300).collect()]).unwrap();
    let (header, body) = written(&surface, &PlyAttributes::default());
    assert!(header.contains("property list uint uint vertex_indices"));
    assert_eq!(body.len(), 300 * 24 + 4 + 300 * 4);
}

#[test]
fn attributes_need_one_entry_per_vertex() {
    let shape = primitives::icosphere(0, 1.0);
    let attributes = PlyAttributes {
        quality: Some(&[1.0]),
        colors: None,
    };
    let error = write_ply("never_written.ply", &shape, &attributes).unwrap_err();
    assert!(matches!(
        error,
        SurfaceError::AttributeLength {
            attribute: "quality",
            expected: 12,
            found: 1
        }
    ));
}

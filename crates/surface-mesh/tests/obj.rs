//! The OBJ reader and writer.

use std::fs;
use std::path::PathBuf;

use nalgebra::Vector3;
use proptest::prelude::*;
use surface_mesh::{
    ObjProblem, Surface, SurfaceError, parse_obj, primitives, read_obj, read_surface, write_obj,
};
use tempfile::TempDir;

fn file(content: &[u8]) -> (TempDir, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("test.OBJ");
    fs::write(&path, content).unwrap();
    (folder, path)
}

fn read(content: impl AsRef<[u8]>) -> Result<Surface, SurfaceError> {
    let (_folder, path) = file(content.as_ref());
    read_obj(path)
}

#[track_caller]
fn check(content: &str, vertices: usize, polygons: &[&[u32]]) -> Surface {
    let surface = read(content).unwrap();
    assert_eq!(surface.vertex_count(), vertices);
    assert_eq!(surface.polygons().collect::<Vec<_>>(), polygons);
    surface
}

#[track_caller]
fn check_error(content: impl AsRef<[u8]>, expected_line: usize, expected: ObjProblem) {
    match read(content) {
        Err(SurfaceError::Obj { line, problem, .. }) => {
            assert_eq!((line, problem), (expected_line, expected));
        }
        other => panic!("{other:?}"),
    }
}

const TRIANGLE: &str = "v 0 0 0\nv 1 0 0\nv 0 1 0\n";

#[test]
fn every_form_of_corner_is_read() {
    let text = format!(
        "{TRIANGLE}vt 0 0\nvn 0 0 1\nf 1 2 3\nf 1/1 2/1 3/1\nf 1//1 2//1 3//1\nf 1/1/1 2/1/1 3/1/1\n"
    );
    check(&text, 3, &[&[0, 1, 2][..]; 4]);
}

#[test]
fn order_and_unused_vertices_are_kept() {
    let surface = check(
        "v 9 9 9\nv 0 1 0 # top\nv 0 0 0\nv 1 0 0\nf 3 4 2\n",
        4,
        &[&[2, 3, 1]],
    );
    assert_eq!(surface.vertices()[0], Vector3::new(9.0, 9.0, 9.0));
    assert_eq!(surface.vertices()[1], Vector3::new(0.0, 1.0, 0.0));
}

#[test]
fn quads_and_larger_polygons_are_kept() {
    let text = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv -1 .5 0\nf 1 2 3 4 5\nf 1 2 3 4\n";
    check(text, 5, &[&[0, 1, 2, 3, 4], &[0, 1, 2, 3]]);
}

#[test]
fn negative_indices_count_back_from_their_line() {
    let text = format!("{TRIANGLE}f -3 -2 -1\nv 5 5 5\nf -1 -2 -3\n");
    check(&text, 4, &[&[0, 1, 2], &[3, 2, 1]]);
}

#[test]
fn faces_may_come_before_their_vertices() {
    check(&format!("f 1 2 3\n{TRIANGLE}"), 3, &[&[0, 1, 2]]);
    check_error(
        format!("f 1 2 4\n{TRIANGLE}"),
        1,
        ObjProblem::IndexOutOfRange {
            index: 4,
            vertices: 3,
        },
    );
}

#[test]
fn windows_line_ends_tabs_and_a_byte_order_mark_are_read() {
    let text =
        "\u{feff}# made by hand\r\nv\t0 0 0\r\nv 1 0 0 \r\n\r\n  v 0 1 0\r\ng a b\r\nf 1 2 3";
    check(text, 3, &[&[0, 1, 2]]);
}

#[test]
fn lines_continue_after_a_backslash() {
    check(
        "v 0 \\\n0 0\nv 1 0 \\\r\n 0\nv 0 1 0\nf 1 \\\n2\\\n3\n",
        3,
        &[&[0, 1, 2]],
    );
    check_error(
        "v 0 0 0\nv 1 0 \\\n\\\nzero\nv 0 1 0\nf 1 2 3\n",
        2,
        ObjProblem::BadNumber {
            text: "zero".into(),
        },
    );
}

/// A comment that named a Windows folder ended in a backslash; joining the next line would lose its vertex and shift
/// all others.
#[test]
fn comments_do_not_continue() {
    check(
        &format!("# C:\\models\\\n{TRIANGLE}f 1 2 3\n"),
        3,
        &[&[0, 1, 2]],
    );
}

#[test]
fn colours_weights_and_other_statements_are_skipped() {
    let text = "mtllib a.mtl\no thing\nv 0 0 0 1 0.5 0.25\nv 1 0 0 1.0\nv 0 1 0\nvp 1\ns off\nusemtl m\nl 1 2\nf 1 2 3\n";
    check(text, 3, &[&[0, 1, 2]]);
    check_error(
        "v 0 0 0 red\n",
        1,
        ObjProblem::BadNumber { text: "red".into() },
    );
}

#[test]
fn errors_name_the_line_and_the_word() {
    let text = |line: &str| format!("{TRIANGLE}\n# comment\n{line}\nf 1 2 3\n");
    let word = |word: &str| word.to_string();
    let cases = [
        ("v 0 0", ObjProblem::TooFewCoordinates { found: 2 }),
        ("v", ObjProblem::TooFewCoordinates { found: 0 }),
        ("v 0 0,5 1", ObjProblem::BadNumber { text: word("0,5") }),
        ("v 0 nan 0", ObjProblem::NonFinite { text: word("nan") }),
        ("v 0 0 -inf", ObjProblem::NonFinite { text: word("-inf") }),
        (
            "v 0 0 1e999",
            ObjProblem::NonFinite {
                text: word("1e999"),
            },
        ),
        ("f 1 2", ObjProblem::TooFewCorners { found: 2 }),
        ("f", ObjProblem::TooFewCorners { found: 0 }),
        ("f 0 1 2", ObjProblem::IndexZero { text: word("0") }),
        (
            "f 1 2 4",
            ObjProblem::IndexOutOfRange {
                index: 4,
                vertices: 3,
            },
        ),
        (
            "f 1 2 -4",
            ObjProblem::IndexOutOfRange {
                index: -4,
                vertices: 3,
            },
        ),
        (
            "f 1 2 99999999999",
            ObjProblem::IndexOutOfRange {
                index: 99999999999,
                vertices: 3,
            },
        ),
        ("f 1 2 3.0", ObjProblem::BadCorner { text: word("3.0") }),
        ("f 1 2 3/x", ObjProblem::BadCorner { text: word("3/x") }),
        (
            "f 1 2 3/1/1/1",
            ObjProblem::BadCorner {
                text: word("3/1/1/1"),
            },
        ),
        ("f 1 2 /3", ObjProblem::BadCorner { text: word("/3") }),
        (
            "face 1 2 3",
            ObjProblem::UnknownStatement {
                keyword: word("face"),
            },
        ),
        ("v 0 0 0\u{1}", ObjProblem::NotText { byte: 1 }),
    ];
    for (line, problem) in cases {
        check_error(text(line), 6, problem);
    }
    check_error("", 0, ObjProblem::NoVertices);
    check_error("f 1 2 3\n", 1, ObjProblem::NoVertices);
    check_error(TRIANGLE, 3, ObjProblem::NoFaces);
    check_error(
        b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR",
        1,
        ObjProblem::UnknownStatement {
            keyword: "\u{fffd}PNG".into(),
        },
    );
    check_error(b"glTF\x02\0\0\0", 1, ObjProblem::NotText { byte: 2 });
}

#[test]
fn messages_read_well() {
    let error = read(format!("{TRIANGLE}f 1 2 4\n"))
        .unwrap_err()
        .to_string();
    assert!(
        error.ends_with("test.OBJ:4: vertex 4 does not exist: there are 3 vertices in the file"),
        "{error}"
    );
    let error = read_obj("no/such/file.obj").unwrap_err().to_string();
    assert!(
        error.starts_with("cannot read no/such/file.obj: "),
        "{error}"
    );
    let error = read_surface("shape.stl").unwrap_err().to_string();
    assert!(error.contains(".obj, .glb or .gltf"), "{error}");
}

#[test]
fn truncation_at_every_byte_never_panics() {
    let shape = primitives::cuboid(Vector3::repeat(-0.25), Vector3::repeat(1.0 / 3.0));
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("box.obj");
    write_obj(&path, &shape).unwrap();
    let whole = fs::read(&path).unwrap();
    let mut readable = 0;
    for length in 0..whole.len() {
        // A face cut between or within its corners may still be a legal one; only the last line's end is not missed.
        if let Ok(surface) = read(&whole[..length]) {
            readable += 1;
            assert!(surface != shape || length + 1 == whole.len());
        }
    }
    assert!(readable < whole.len() / 3, "{readable} of {}", whole.len());
}

#[test]
fn writing_keeps_polygons_and_every_bit_of_positions() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("torus.obj");
    let torus = primitives::torus(1e5, 1e-3, 7, 5);
    write_obj(&path, &torus).unwrap();
    assert_eq!(read_obj(&path).unwrap(), torus);
    // Nothing but the file itself is left in the folder.
    assert_eq!(fs::read_dir(&folder).unwrap().count(), 1);
    let error = write_obj(folder.path().join("missing/torus.obj"), &torus).unwrap_err();
    assert!(matches!(error, SurfaceError::Write { .. }));
}

#[cfg(unix)]
#[test]
fn written_files_follow_the_umask() {
    use std::os::unix::fs::PermissionsExt;
    let folder = tempfile::tempdir().unwrap();
    let (ours, plain) = (folder.path().join("a.obj"), folder.path().join("b"));
    write_obj(&ours, &primitives::icosphere(0, 1.0)).unwrap();
    fs::write(&plain, "").unwrap();
    let mode = |path| fs::metadata(path).unwrap().permissions().mode();
    assert_eq!(mode(&ours), mode(&plain));
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn any_finite_positions_survive_a_round_trip(
        coordinates in prop::collection::vec(prop::array::uniform3(prop::num::f64::NORMAL | prop::num::f64::SUBNORMAL | prop::num::f64::ZERO), 3..20)
    ) {
        let vertices: Vec<_> = coordinates.into_iter().map(Vector3::from).collect();
        let surface = Surface::from_triangles(vertices, vec![[2, 0, 1]]).unwrap();
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("random.obj");
        write_obj(&path, &surface).unwrap();
        let again = read_obj(&path).unwrap();
        let bits = |s: &Surface| s.vertices().iter().flatten().map(|x| x.to_bits()).collect::<Vec<_>>();
        prop_assert_eq!(bits(&again), bits(&surface));
    }

    #[test]
    fn arbitrary_bytes_never_panic(bytes in prop::collection::vec(any::<u8>(), 0..200)) {
        let _ = read(bytes);
    }

    #[test]
    fn arbitrary_statements_never_panic(text in "([vf#g\\\\ \r\n/.0-9-]|nan|1e9){0,200}") {
        let _ = read(text);
    }
}

#[test]
fn content_at_hand_reads_as_the_file_does() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.obj");
    let text = b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n";
    std::fs::write(&path, text).unwrap();
    assert_eq!(
        parse_obj(text, "not/there.obj").unwrap(),
        read_obj(&path).unwrap()
    );
    let error = parse_obj(b"v 0 0\n", "archive.zip/b.obj").unwrap_err();
    assert!(
        error.to_string().starts_with("archive.zip/b.obj:1: "),
        "{error}"
    );
}

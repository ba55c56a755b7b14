//! Input made to do harm: refused, without the memory, the stack or the files that it is after.

use nalgebra::Vector3;
use std::fs;
use std::path::Path;
use surface_mesh::{MorphTarget, MorphedSurface, primitives};
use trainer::files::{parse_json, write_whole};
use trainer::frames::parse_frames;
use trainer::npy::parse_f64;
use trainer::rig::{Jaw, Rig, parse_motions};
use trainer::run::{Metrics, Run};
use trainer::scene::Scene;

const SCENE: &str = "name = \"cube\"\nunit = \"cm\"\neffects = []\n[surface]\nfile = \"cube.obj\"\n[mesh]\nelement_size = 0.1\n\
    [network]\nwidth = 64\n";

fn units() -> MorphedSurface {
    let surface = primitives::icosphere(0, 1.0);
    let target = |name: &str| MorphTarget {
        name: name.into(),
        deltas: vec![Vector3::x(); surface.vertex_count()],
    };
    MorphedSurface::new(surface.clone(), vec![target("long"), target("bent")]).unwrap()
}

fn frames(text: &str, name: &str) -> String {
    let read = parse_frames(text, Path::new(name), &units());
    read.unwrap_err().to_string()
}

#[test]
fn json_that_is_nested_without_end_is_refused_before_the_stack_ends() {
    for (open, close) in [("[", "]"), ("{\"a\":", "}")] {
        let deep = open.repeat(200_000) + "0" + &close.repeat(200_000);
        for text in [
            deep.clone(),
            format!("{{\"frames\": {deep}}}"),
            format!("{{\"note\": {deep}, \"frames\": []}}"),
            format!("{{\"frames\": [{{\"weights\": {{\"long\": {deep}}}}}]}}"),
        ] {
            let message = frames(&text, "deep.json");
            assert!(message.starts_with("deep.json"), "{message}");
            assert!(message.len() < 500, "{message}");
            let path = Path::new("deep.json");
            // What stands under other names is passed over, however deep, and not followed.
            drop(parse_motions(&text, path, "cm"));
            assert!(parse_json::<Jaw>(&text, path).is_err());
        }
    }
}

#[test]
fn a_scene_that_is_nested_without_end_is_refused_before_the_stack_ends() {
    for open in ["[", "{ a = ", "{ a.a = [", "a."] {
        let text = format!("{SCENE}deep = {}\n", open.repeat(20_000));
        Scene::parse(&text, Path::new("deep.toml")).unwrap_err();
        let text = format!("{SCENE}{}b = 1\n", open.repeat(20_000));
        Scene::parse(&text, Path::new("deep.toml")).unwrap_err();
    }
}

/// The library made room for as many bytes as the header claimed: 4 GiB for a file of twenty.
#[test]
fn an_array_whose_header_claims_four_gigabytes_is_refused_at_once() {
    let mut bytes = b"\x93NUMPY\x02\x00\xff\xff\xff\xff{'descr'".to_vec();
    let told = |bytes: &[u8]| {
        let refused = parse_f64(bytes, Path::new("a.npy"), &[2]).unwrap_err();
        refused.to_string()
    };
    assert!(told(&bytes).contains("its header claims 4294967295 bytes"));
    // As many as there are, but no array of numbers has them.
    bytes[8..12].copy_from_slice(&100_000_u32.to_le_bytes());
    bytes.resize(200_000, b' ');
    assert!(told(&bytes).contains("its header claims 100000 bytes"));
    for length in 0..12 {
        assert!(told(&bytes[..length]).contains("a.npy"));
    }
}

/// The library followed brackets by recursion: a few thousand of them ended the process.
#[test]
fn an_array_whose_header_is_nested_without_end_is_refused_before_the_stack_ends() {
    for open in ["(", "[", "{1: ", "(1, ["] {
        let header = format!(
            "{{'descr': '<f8', 'shape': {}",
            open.repeat(4000 / open.len())
        );
        let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
        bytes.extend((header.len() as u16).to_le_bytes());
        bytes.extend(header.as_bytes());
        let refused = parse_f64(&bytes, Path::new("a.npy"), &[2]).unwrap_err();
        assert!(refused.to_string().contains("nested too deep"), "{refused}");
    }
}

/// Sizes were multiplied without looking: an array of 2^64 entries passed for an empty one, and with the checks of arithmetic on it panicked.
#[test]
fn an_array_of_more_entries_than_there_can_be_is_refused() {
    for shape in [
        "(4294967296, 4294967296)",
        "(18446744073709551616,)",
        "(9223372036854775807, 0, 3)",
    ] {
        let header = format!("{{'descr': '<f8', 'fortran_order': False, 'shape': {shape}, }}\n");
        let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
        bytes.extend((header.len() as u16).to_le_bytes());
        bytes.extend(header.as_bytes());
        let refused = parse_f64(&bytes, Path::new("a.npy"), &[0]).unwrap_err();
        assert!(
            refused
                .to_string()
                .contains("more entries than there can be"),
            "{refused}"
        );
    }
}

/// Every column was compared with every other: a header of a megabyte took minutes.
#[test]
fn many_columns_are_read_in_a_moment() {
    let names: Vec<String> = (0..200_000).map(|i| format!("n{i}")).collect();
    let header = names.join(",");
    let message = frames(&format!("{header}\n0\n"), "a.csv");
    assert!(message.contains("200000 columns"), "{message}");
    let message = frames(&format!("{header},n7\n0\n"), "a.csv");
    assert!(message.contains("columns 8 and 200001 are both called `n7`"));
    let weights: Vec<String> = names.iter().map(|n| format!("\"{n}\": 0")).collect();
    let weights = weights.join(",");
    let message = frames(
        &format!("{{\"frames\": [{{\"weights\": {{{weights}}}}}]}}"),
        "a.json",
    );
    assert!(message.contains("there is no shape `n0`"), "{message}");
    let twice = format!("{{\"frames\": [{{\"weights\": {{{weights},\"n7\":0}}}}]}}");
    assert!(frames(&twice, "a.json").contains("`n7` stands twice"));
}

/// All its beginnings were tried as numbers, each of them in full: a text of a megabyte took hours.
#[test]
fn a_length_that_never_ends_is_refused_in_a_moment() {
    for digit in ["9", "0.", "e", "\u{e9}"] {
        let text = format!("accuracy = \"{}\"\n{SCENE}", digit.repeat(1_000_000));
        Scene::parse(&text, Path::new("a.toml")).unwrap_err();
    }
    let text = format!("accuracy = \"0.05 mm\"\n{SCENE}");
    Scene::parse(&text, Path::new("a.toml")).unwrap();
}

#[test]
fn a_unit_that_does_more_than_print_is_refused() {
    let text = SCENE.replace("\"cm\"", "\"\\u001b[2Jcm\\n\"");
    let message = Scene::parse(&text, Path::new("a.toml"))
        .unwrap_err()
        .to_string();
    assert!(
        message.contains("`unit` is \"\\u{1b}[2Jcm\\n\""),
        "{message}"
    );
}

/// Outputs are written beside their place and renamed: a link is replaced, and what it points to is nobody's output.
#[cfg(unix)]
#[test]
fn an_output_replaces_a_symbolic_link_and_spares_what_it_points_to() {
    let folder = tempfile::tempdir().unwrap();
    let (precious, link) = (
        folder.path().join("precious"),
        folder.path().join("out.json"),
    );
    fs::write(&precious, "mine").unwrap();
    std::os::unix::fs::symlink(&precious, &link).unwrap();
    write_whole(&link, b"new").unwrap();
    assert!(!link.is_symlink());
    assert_eq!(fs::read_to_string(&link).unwrap(), "new");
    assert_eq!(fs::read_to_string(&precious).unwrap(), "mine");
    // A folder in the way is no file to replace: it stays, and nothing is left beside it.
    let target = folder.path().join("folder");
    fs::create_dir(&target).unwrap();
    write_whole(&target, b"new").unwrap_err();
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 3);
}

/// The lock and the metrics are written in place. In a run folder from elsewhere they could be links, and opening the run emptied whatever
/// file of the user the lock pointed to.
#[cfg(unix)]
#[test]
fn links_in_a_run_folder_do_not_reach_other_files() {
    let folder = tempfile::tempdir().unwrap();
    let (run, precious) = (folder.path().join("run"), folder.path().join("precious"));
    fs::write(&precious, "mine").unwrap();
    let held = Run::create(&run, SCENE, &units(), &Rig::default(), None).unwrap();
    std::os::unix::fs::symlink(&precious, held.metrics_path()).unwrap();
    let refused = Metrics::open(&held, 1).map(drop).unwrap_err().to_string();
    assert!(
        refused.contains("metrics.jsonl") && refused.contains("remove the link"),
        "{refused}"
    );
    drop(held);
    fs::remove_file(run.join(".lock")).unwrap();
    std::os::unix::fs::symlink(&precious, run.join(".lock")).unwrap();
    let refused = Run::open(&run).map(drop).unwrap_err().to_string();
    assert!(
        refused.contains(".lock") && refused.contains("remove the link"),
        "{refused}"
    );
    assert_eq!(fs::read_to_string(&precious).unwrap(), "mine");
}

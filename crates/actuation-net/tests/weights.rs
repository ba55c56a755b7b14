//! Weights files: exact round trips, and every kind of damage named with its place.

mod common;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use actuation_net::{ActuationNet, AdamState, Error, NetworkConfig, TensorFile, Width};
use common::{lively_net, scatter};

struct Folder(tempfile::TempDir);

impl Folder {
    fn new() -> Self {
        Self(tempfile::tempdir().unwrap())
    }

    fn file(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }
}

fn bits(net: &ActuationNet) -> Vec<u32> {
    net.parameters().iter().map(|p| p.to_bits()).collect()
}

/// The file of a small network after `damage`.
fn damaged(damage: impl FnOnce(&mut TensorFile)) -> Result<ActuationNet, Error> {
    let mut file = TensorFile::new();
    lively_net(Width::W64, 3).insert_into(&mut file, "");
    damage(&mut file);
    let folder = Folder::new();
    file.write(folder.file("net.safetensors")).unwrap();
    ActuationNet::load(folder.file("net.safetensors"))
}

#[test]
fn saved_networks_come_back_bit_for_bit() {
    let folder = Folder::new();
    let path = folder.file("net.safetensors");
    for width in [Width::W64, Width::W128, Width::W256] {
        let mut net = lively_net(width, 23);
        let mut parameters = net.parameters();
        parameters[0] = -0.0;
        parameters[1] = f32::MIN_POSITIVE / 8.0;
        net.set_parameters(&parameters).unwrap();
        net.save(&path).unwrap();
        let loaded = ActuationNet::load(&path).unwrap();
        assert_eq!(loaded.config(), net.config());
        assert_eq!(bits(&loaded), bits(&net));
        assert_eq!(
            bits(&ActuationNet::load_with(&path, net.config()).unwrap()),
            bits(&net)
        );
    }
}

#[test]
fn equal_networks_give_equal_files() {
    let folder = Folder::new();
    let write = |name: &str| {
        let mut file = TensorFile::new();
        lively_net(Width::W64, 3).insert_into(&mut file, "net.");
        for key in ["epoch", "scene", "seed", "version"] {
            file.insert_metadata(key, "1");
        }
        file.write(folder.file(name)).unwrap();
        std::fs::read(folder.file(name)).unwrap()
    };
    assert_eq!(write("a"), write("b"));
}

#[test]
fn a_checkpoint_holds_networks_and_optimisers_under_prefixes() {
    let (first, second) = (lively_net(Width::W64, 3), lively_net(Width::W128, 5));
    let state = AdamState {
        step: u64::MAX - 3,
        m: scatter(9, 1),
        v: scatter(9, 2),
    };
    let mut file = TensorFile::new();
    first.insert_into(&mut file, "first.");
    second.insert_into(&mut file, "second.");
    state.insert_into(&mut file, "adam.");
    file.insert_metadata("epoch", "17");
    let folder = Folder::new();
    file.write(folder.file("checkpoint")).unwrap();

    let read = TensorFile::read(folder.file("checkpoint")).unwrap();
    assert_eq!(
        bits(&ActuationNet::from_file(&read, "first.").unwrap()),
        bits(&first)
    );
    assert_eq!(
        bits(&ActuationNet::from_file(&read, "second.").unwrap()),
        bits(&second)
    );
    assert_eq!(AdamState::from_file(&read, "adam.", 9).unwrap(), state);
    assert_eq!(read.metadata("epoch").unwrap(), "17");
    let found = AdamState::from_file(&read, "adam.", 8);
    assert!(matches!(found, Err(Error::TensorShape { .. })));
    let found = ActuationNet::from_file(&read, "");
    assert!(matches!(found, Err(Error::MissingMetadata { .. })));
}

#[test]
fn missing_and_truncated_files_are_named() {
    let folder = Folder::new();
    let found = ActuationNet::load(folder.file("none")).unwrap_err();
    assert!(matches!(found, Error::Read { .. }));
    assert!(found.to_string().contains("none"));

    lively_net(Width::W64, 3).save(folder.file("net")).unwrap();
    let whole = std::fs::read(folder.file("net")).unwrap();
    let cuts = (0..40)
        .map(|i| i * whole.len() / 40)
        .chain([3, 8, whole.len() - 1]);
    for length in cuts {
        std::fs::write(folder.file("cut"), &whole[..length]).unwrap();
        let found = ActuationNet::load(folder.file("cut")).unwrap_err();
        assert!(
            matches!(found, Error::Malformed { .. }),
            "{length}: {found}"
        );
    }
    // A header that claims to be longer than any file.
    std::fs::write(folder.file("cut"), u64::MAX.to_le_bytes()).unwrap();
    let found = ActuationNet::load(folder.file("cut")).unwrap_err();
    assert!(matches!(found, Error::Malformed { .. }), "{found}");
}

#[test]
fn a_wrong_width_names_file_tensor_and_both_shapes() {
    let folder = Folder::new();
    let path = folder.file("wide.safetensors");
    lively_net(Width::W128, 3).save(&path).unwrap();
    let config = NetworkConfig::new(3, Width::W64);
    let found = ActuationNet::load_with(&path, &config).unwrap_err();
    let Error::TensorShape {
        tensor,
        found: found_shape,
        expected,
        ..
    } = &found
    else {
        panic!("{found}");
    };
    assert_eq!(tensor, "sine.0.weight");
    assert_eq!(
        (&found_shape[..], &expected[..]),
        (&[128, 3][..], &[64, 3][..])
    );
    let text = found.to_string();
    for part in ["wide.safetensors", "[128, 3]", "[64, 3]", "width"] {
        assert!(text.contains(part), "{text}");
    }
}

#[test]
fn another_frequency_is_a_mismatch() {
    let folder = Folder::new();
    let net = lively_net(Width::W64, 3);
    net.save(folder.file("net")).unwrap();
    let mut config = net.config().clone();
    config.omega = 15.0;
    let found = ActuationNet::load_with(folder.file("net"), &config);
    assert!(matches!(
        found,
        Err(Error::ConfigMismatch { field: "omega", .. })
    ));
}

#[test]
fn damaged_contents_are_named() {
    let found = damaged(|file| {
        let mut values = vec![0.0; 6];
        values[4] = f32::NAN;
        file.insert_f32("head.bias", &[6], &values);
    });
    assert!(
        matches!(&found, Err(Error::NonFiniteTensor { tensor, index: 4, .. }) if tensor == "head.bias"),
        "{found:?}"
    );
    let found = damaged(|file| file.insert_f32("extra", &[1], &[1.0]));
    assert!(
        matches!(&found, Err(Error::UnknownTensor { tensor, .. }) if tensor == "extra"),
        "{found:?}"
    );
    let found = damaged(|file| file.insert_u64("head.bias", &[6], &[0; 6]));
    assert!(
        matches!(&found, Err(Error::TensorType { tensor, .. }) if tensor == "head.bias"),
        "{found:?}"
    );
    let found = damaged(|file| {
        let config = r#"{"descriptor":3,"width":64,"resolution":true}"#;
        file.insert_metadata("config", config);
    });
    assert!(
        matches!(&found, Err(Error::MalformedConfig { .. })),
        "{found:?}"
    );
    let found = damaged(|file| file.insert_metadata("config", r#"{"descriptor":0,"width":64}"#));
    assert!(
        matches!(&found, Err(Error::DescriptorSize { .. })),
        "{found:?}"
    );

    let mut all_but_one = TensorFile::new();
    let net = lively_net(Width::W64, 3);
    all_but_one.insert_metadata("config", r#"{"descriptor":3,"width":64}"#);
    for tensor in net.parameter_layout() {
        if tensor.name != "joint.1.bias" {
            let values = &net.parameters()[tensor.range.clone()];
            all_but_one.insert_f32(&tensor.name, &tensor.shape, values);
        }
    }
    let found = ActuationNet::from_file(&all_but_one, "");
    assert!(
        matches!(&found, Err(Error::MissingTensor { tensor, .. }) if tensor == "joint.1.bias"),
        "{found:?}"
    );
}

#[test]
fn a_failed_write_leaves_the_older_file() {
    let folder = Folder::new();
    let net = lively_net(Width::W64, 3);
    // A folder stands where the file should go, so that renaming must fail.
    std::fs::create_dir_all(folder.file("taken/inside")).unwrap();
    assert!(matches!(
        net.save(folder.file("taken")),
        Err(Error::Write { .. })
    ));
    assert!(matches!(
        net.save(folder.file("no/such/folder")),
        Err(Error::Write { .. })
    ));
    let names: Vec<_> = std::fs::read_dir(folder.0.path()).unwrap().collect();
    assert_eq!(names.len(), 1, "no temporary file is left: {names:?}");
}

#[cfg(unix)]
#[test]
fn saved_files_follow_the_umask() {
    use std::os::unix::fs::PermissionsExt;
    let folder = Folder::new();
    let mode = |path: &Path| std::fs::metadata(path).unwrap().permissions().mode();
    lively_net(Width::W64, 3).save(folder.file("net")).unwrap();
    std::fs::write(folder.file("plain"), "").unwrap();
    assert_eq!(mode(&folder.file("net")), mode(&folder.file("plain")));
}

#[test]
fn the_safetensors_crate_reads_what_is_written() {
    let folder = Folder::new();
    let net = lively_net(Width::W64, 3);
    net.save(folder.file("net")).unwrap();
    let bytes = std::fs::read(folder.file("net")).unwrap();
    let file = safetensors::SafeTensors::deserialize(&bytes).unwrap();
    let shapes: BTreeMap<_, _> = file
        .iter()
        .map(|(n, t)| (n.to_string(), t.shape().to_vec()))
        .collect();
    assert_eq!(shapes.len(), net.parameter_layout().len());
    for tensor in net.parameter_layout() {
        assert_eq!(shapes[&tensor.name], tensor.shape);
    }
}

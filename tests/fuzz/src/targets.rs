//! The readers, what they are given, and what they may take.

use std::path::Path;

use actuation_net::{ActuationNet, ExplicitDecoder, TensorFile};
use nalgebra::Vector3;
use rand::seq::IndexedRandom;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use serde_json::Value;
use surface_mesh::{MorphTarget, MorphedSurface, primitives};
use trainer::checkpoint::Checkpoint;
use trainer::rig::Jaw;
use trainer::scene::Scene;
use trainer::shapes::ChosenBasis;

use crate::damage::damage;
use crate::formats::{glb, json, npy, tensors, text, toml, zip};

/// Memory that any reader may take, however small its input is: tables, messages, the buffers of parsers. In bytes.
pub const SLACK: usize = 1 << 16;

/// What a reader said of an input.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Outcome {
    /// Whether the input was accepted.
    pub accepted: bool,
    /// The error, for people.
    pub message: String,
}

impl Outcome {
    fn of<T, E: std::fmt::Display>(result: Result<T, E>) -> Self {
        Self {
            accepted: result.is_ok(),
            message: result.err().map(|e| e.to_string()).unwrap_or_default(),
        }
    }

    /// The error without numbers and names: outcomes of one kind have it in common.
    pub fn kind(&self) -> String {
        let parts = self.message.split(['`', '"']).step_by(2);
        let words = parts
            .flat_map(str::chars)
            .filter(|c| c.is_ascii_alphabetic() || *c == ' ');
        words.take(80).collect()
    }
}

/// Runs a reader on an input.
type Read = Box<dyn Fn(&[u8]) -> Outcome + Send + Sync>;
/// Builds an input of a format.
type Generate = Box<dyn Fn(&mut ChaCha8Rng) -> Vec<u8> + Send + Sync>;

/// A reader under test.
pub struct Target {
    /// Its name on the command line and of its corpus.
    pub name: &'static str,
    /// The reader.
    pub read: Read,
    /// The most bytes that it may hold at once for an input.
    pub allowance: fn(&[u8]) -> usize,
    /// Whole files of the format.
    pub seeds: Vec<Vec<u8>>,
    /// Makes files of the format with values replaced.
    generate: Generate,
}

impl Target {
    /// Where its inputs come from: generated files, the seeds, and the corpus.
    pub fn source(&self, seed: u64) -> Source<'_> {
        let mut bytes = self.seeds.clone();
        bytes.extend(kept(self.name).into_iter().map(|(_, input)| input));
        Source {
            target: self,
            bytes,
            seed,
        }
    }
}

/// The inputs of a target's corpus by the names of their files, in alphabetical order.
pub fn kept(target: &str) -> Vec<(String, Vec<u8>)> {
    let folder = crate::corpus().join(target);
    let files = std::fs::read_dir(folder).into_iter().flatten().flatten();
    let mut kept: Vec<_> = files
        .filter_map(|file| {
            let name = file.file_name().into_string().ok()?;
            Some((name, std::fs::read(file.path()).ok()?))
        })
        .collect();
    kept.sort();
    kept
}

/// Makes the inputs of a target.
pub struct Source<'a> {
    target: &'a Target,
    bytes: Vec<Vec<u8>>,
    seed: u64,
}

impl Source<'_> {
    /// Input number `index`; the same for the same seed and corpus, whatever was made before.
    pub fn input(&self, index: u64) -> Vec<u8> {
        let mut rng = ChaCha8Rng::seed_from_u64(self.seed);
        rng.set_stream(index);
        let mut seed = || {
            self.bytes
                .choose(&mut rng)
                .expect("every target has a seed")
                .clone()
        };
        let (mut input, other) = (seed(), seed());
        match rng.random_range(0..8_u32) {
            0..=2 => (self.target.generate)(&mut rng),
            3 => {
                input = (self.target.generate)(&mut rng);
                damage(&mut input, &other, &mut rng);
                input
            }
            _ => {
                damage(&mut input, &other, &mut rng);
                input
            }
        }
    }
}

/// Ten times the input, and what any reader may take besides.
pub fn tenfold(input: &[u8]) -> usize {
    10 * input.len() + SLACK
}

/// Besides: an item of two letters (a cell, a key, an element of a list, a line) becomes a structure of up to 256 bytes, the list of which doubles
/// as it grows. This is the share of the parser of JSON, and of frames, which are dense over all shapes.
fn tree_allowance(input: &[u8]) -> usize {
    let is_item = |byte: &&u8| b",[{=.\n".contains(*byte);
    tenfold(input) + 256 * input.iter().filter(is_item).count()
}

/// The parser of TOML takes up to 256 bytes for a byte, where it has a lot to complain of; so a scene ends at 1 MiB.
fn toml_allowance(input: &[u8]) -> usize {
    tenfold(input) + 256 * input.len()
}

/// Besides: morph targets are sparse in the file and dense in memory, up to 64 times the file; and every object of the JSON becomes a
/// structure of the `gltf` crate of up to half a kilobyte, held twice while a list of them grows.
fn glb_allowance(input: &[u8]) -> usize {
    let objects = input.iter().filter(|&&byte| byte == b'{').count();
    tenfold(input) + (64 * input.len()).max(1 << 20) + 1024 * objects
}

/// Besides: entries are packed, and an entry may be 64 times as large as it is packed, in a buffer that doubles as it grows.
fn zip_allowance(input: &[u8]) -> usize {
    tenfold(input) + 2 * (64 * input.len() + (1 << 20))
}

/// The shapes that curves and frames are over.
fn units() -> MorphedSurface {
    let surface = primitives::icosphere(0, 1.0);
    let target = |name: &&str| MorphTarget {
        name: name.to_string(),
        deltas: vec![Vector3::x(); surface.vertex_count()],
    };
    let targets = ["bent", "long", "a \"b\", c"].iter().map(target).collect();
    MorphedSurface::new(surface.clone(), targets).expect("one delta per vertex")
}

fn text_of(input: &[u8], read: impl FnOnce(&str) -> Outcome) -> Outcome {
    match std::str::from_utf8(input) {
        Ok(text) => read(text),
        Err(error) => Outcome::of::<(), _>(Err(error)),
    }
}

/// Changes one of some JSON documents in a few places.
fn json_like(documents: Vec<Value>) -> Generate {
    Box::new(move |rng| {
        let mut document = documents.choose(rng).expect("there are documents").clone();
        json::change(&mut document, rng.random_range(0..5), rng);
        serde_json::to_vec(&document).expect("JSON is written")
    })
}

/// A reader of text, with the whole files that it begins with.
fn of_text(
    name: &'static str,
    allowance: fn(&[u8]) -> usize,
    seeds: &[&str],
    generate: Generate,
    read: impl Fn(&str) -> Outcome + Send + Sync + 'static,
) -> Target {
    Target {
        name,
        read: Box::new(move |input| text_of(input, &read)),
        allowance,
        seeds: seeds.iter().map(|s| s.as_bytes().to_vec()).collect(),
        generate,
    }
}

/// A reader of JSON.
fn of_json(
    name: &'static str,
    seeds: &[&str],
    read: impl Fn(&str) -> Outcome + Send + Sync + 'static,
) -> Target {
    let documents = seeds
        .iter()
        .map(|text| serde_json::from_str(text).expect("a seed is whole"));
    of_text(
        name,
        tree_allowance,
        seeds,
        json_like(documents.collect()),
        read,
    )
}

/// A reader of safetensors files.
fn of_tensors(
    name: &'static str,
    seeds: Vec<Vec<u8>>,
    read: impl Fn(TensorFile) -> Outcome + Send + Sync + 'static,
) -> Target {
    let own = seeds.clone();
    Target {
        name,
        read: Box::new(
            move |input| match TensorFile::parse(input, "a.safetensors") {
                Ok(file) => read(file),
                Err(error) => Outcome::of::<(), _>(Err(error)),
            },
        ),
        allowance: tree_allowance,
        seeds,
        generate: Box::new(move |rng| {
            let seed = own.choose(rng).expect("there are seeds");
            tensors::generate(seed, rng)
        }),
    }
}

const FRAMES: &str = r#"{ "note": "x", "frames": [
    { "name": "a", "weights": { "bent": 0.25, "long": 1 }, "jaw": { "rms_cm": 0.0 } }, { "weights": {} } ] }"#;
const MOTIONS: &str = r#"{ "open": { "rotation_rowmajor": [1, 0, 0, 0, 0, -1, 0, 1, 0], "translation_cm": [0, 1, 2] } }"#;
const MOTIONS_OF_FRAMES: &str = r#"{
    "unit_jaw": { "open": { "rotation_rowmajor": [1, 0, 0, 0, 1, 0, 0, 0, 1], "translation": [0, 1, 2], "rms_cm": 0.1 } },
    "frames": [{ "name": "a", "jaw": { "rotation_rowmajor": [1, 0, 0, 0, 1, 0, 0, 0, 1], "translation_cm": [0, 1, 2] } }, {}] }"#;
const JAW: &str =
    r#"{ "pivot": [0, 1, 2], "shapes": {}, "residual_angle": 0.0, "residual_max": 0.1 }"#;
const BASIS: &str = r#"{ "basis": ["a", "b"], "left_out": [["c", 0.5]] }"#;

/// Every reader that user files reach.
pub fn targets() -> Vec<Target> {
    [
        surface_targets(),
        run_targets(),
        tensor_targets(),
        import_targets(),
    ]
    .into_iter()
    .flatten()
    .collect()
}

fn surface_targets() -> Vec<Target> {
    let read_obj = |input: &[u8]| Outcome::of(surface_mesh::parse_obj(input, "a.obj"));
    let read_glb =
        |input: &[u8]| Outcome::of(surface_mesh::parse_gltf(input, "no-such-folder/a.glb"));
    vec![
        Target {
            name: "obj",
            read: Box::new(read_obj),
            allowance: tenfold,
            seeds: vec![text::OBJ.into()],
            generate: Box::new(text::obj),
        },
        Target {
            name: "glb",
            read: Box::new(read_glb),
            allowance: glb_allowance,
            seeds: vec![glb::seed()],
            generate: Box::new(glb::generate),
        },
    ]
}

fn run_targets() -> Vec<Target> {
    let scenes = toml::scenes();
    let seeds: Vec<&str> = scenes.iter().map(String::as_str).collect();
    let documents = seeds
        .iter()
        .map(|text| ::toml::from_str(text).expect("a scene is whole"));
    let documents: Vec<Value> = documents.collect();
    let effects = [::toml::from_str(toml::EFFECTS).expect("effects are whole")];
    let units = units();
    let same_units = units.clone();
    let npy = |input: &[u8]| {
        Outcome::of(trainer::npy::parse_f64(
            input,
            Path::new("a.npy"),
            &npy::SHAPE,
        ))
    };
    vec![
        of_text(
            "scene",
            toml_allowance,
            &seeds,
            Box::new(move |rng| toml::generate(&documents, rng)),
            |text| Outcome::of(Scene::parse(text, Path::new("a.toml"))),
        ),
        of_text(
            "effects",
            toml_allowance,
            &[toml::EFFECTS],
            Box::new(move |rng| toml::generate(&effects, rng)),
            |text| Outcome::of(trainer::scene::parse_effects(text, Path::new("a.toml"))),
        ),
        of_text(
            "paint",
            tenfold,
            &[text::PAINT],
            Box::new(text::paint),
            |text| Outcome::of(trainer::props::parse_paint(text, Path::new("a.txt"))),
        ),
        Target {
            name: "npy",
            read: Box::new(npy),
            allowance: tenfold,
            seeds: vec![npy::seed()],
            generate: Box::new(npy::generate),
        },
        of_json("frames", &[FRAMES], move |text| {
            Outcome::of(trainer::frames::parse_frames(
                text,
                Path::new("a.json"),
                &units,
            ))
        }),
        of_text(
            "curves",
            tree_allowance,
            &[text::CURVES],
            Box::new(text::curves),
            move |text| {
                Outcome::of(trainer::frames::parse_frames(
                    text,
                    Path::new("a.csv"),
                    &same_units,
                ))
            },
        ),
        of_json("motions", &[MOTIONS, MOTIONS_OF_FRAMES], |text| {
            Outcome::of(trainer::rig::parse_motions(text, Path::new("a.json"), "cm"))
        }),
        of_json("kept", &[JAW, BASIS], |text| {
            let path = Path::new("a.json");
            let jaw = trainer::files::parse_json::<Jaw>(text, path);
            let basis = trainer::files::parse_json::<ChosenBasis>(text, path);
            Outcome::of(jaw.map(drop).or(basis.map(drop)))
        }),
        of_text(
            "metrics",
            tenfold,
            &[text::METRICS],
            json_like(metrics()),
            |text| {
                let points = [1, 2].map(|stage| trainer::sheets::loss_points(text, stage));
                let any = points.iter().any(|p| !p.is_empty());
                Outcome::of(any.then_some(()).ok_or("no points"))
            },
        ),
    ]
}

fn metrics() -> Vec<Value> {
    let lines = text::METRICS.lines();
    lines
        .filter_map(|line| serde_json::from_str(line).ok())
        .collect()
}

fn tensor_targets() -> Vec<Target> {
    let networks = vec![tensors::network_seed(), tensors::decoder_seed()];
    vec![
        of_tensors("safetensors", vec![tensors::small_seed()], |file| {
            let a = file.f32_tensor("a", &[2, 3]).map(drop);
            Outcome::of(a.and_then(|()| file.u64_tensor("b", &[2])))
        }),
        of_tensors("network", networks, |file| {
            let net = ActuationNet::from_file(&file, "").map(drop);
            Outcome::of(net.or_else(|_| ExplicitDecoder::from_file(&file, "").map(drop)))
        }),
        of_tensors("checkpoint", vec![tensors::checkpoint_seed()], |file| {
            Outcome::of(Checkpoint::from_file(&file, &tensors::config()))
        }),
    ]
}

fn import_targets() -> Vec<Target> {
    let origin = import::Origin {
        marker: zip::MARKER,
        roots: &[""],
        obtain: "",
    };
    let read_zip = move |input: &[u8]| {
        // What the reader holds is not its own: the copy counts as input.
        let source = import::Source::from_archive(input.to_vec(), Path::new("a.zip"), origin);
        let read = source.and_then(|mut source| {
            for name in source.list("data")? {
                source.read(&format!("data/{name}"))?;
            }
            source.read_json::<Value>("data/b.json")
        });
        Outcome::of(read)
    };
    vec![
        Target {
            name: "zip",
            read: Box::new(read_zip),
            allowance: zip_allowance,
            seeds: vec![zip::seed()],
            generate: Box::new(zip::generate),
        },
        of_text(
            "target",
            tenfold,
            &[text::TARGET],
            Box::new(text::target),
            |text| Outcome::of(import::parse_target(text, Path::new("a.target"), 100)),
        ),
    ]
}

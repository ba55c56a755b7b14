//! Scene files with values replaced one by one.

use rand::Rng;
use rand::seq::IndexedRandom;
use rand_chacha::ChaCha8Rng;
use serde_json::Value;

use super::json::change;

/// A file of effects.
pub const EFFECTS: &str = r#"
[[obstacle]]
name = "teeth"
file = "teeth.obj"
region = { type = "box", min = [-4, -4.5, 7], max = [4, -1.3, 13] }
moves = true
[[paint]]
name = "scar"
file = "scar.txt"
[[effects]]
type = "contact"
distance = 0.05
obstacles = ["teeth", { type = "plane", normal = [0, 1, 0], offset = -9 }, { type = "named", name = "teeth" }]
[[effects]]
type = "activation"
elements = "scar"
scale = 0
[[effects]]
type = "stiffness"
elements = [0, 0.5, 1]
factor = 2
[[effects]]
type = "inertia"
density = 1
time_step = 0.05
[motion]
frames = 6
rate = 10
[[motion.key]]
frame = 3
obstacles = { shift = [0, 0.4, 0] }
"#;

/// The scenes that come with the workspace.
pub fn scenes() -> Vec<String> {
    let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../data/scenes");
    let files = std::fs::read_dir(folder)
        .expect("the scenes are there")
        .flatten();
    let mut paths: Vec<_> = files.map(|file| file.path()).collect();
    // The order of a folder differs from machine to machine.
    paths.sort();
    let texts = paths.iter().map(std::fs::read_to_string);
    texts.collect::<Result<_, _>>().expect("scenes are read")
}

/// One of some documents with values replaced; now and then with a word of TOML in the middle.
pub fn generate(documents: &[Value], rng: &mut ChaCha8Rng) -> Vec<u8> {
    let document = documents.choose(rng).expect("there are scenes");
    let mut times = rng.random_range(0..4_u32);
    loop {
        let mut changed = document.clone();
        change(&mut changed, times, rng);
        // TOML has no null and no top level but a table: try again with less.
        if let Ok(text) = ::toml::to_string(&changed) {
            return spoiled(text, rng).into_bytes();
        }
        times = times.saturating_sub(1);
    }
}

fn spoiled(mut text: String, rng: &mut ChaCha8Rng) -> String {
    const LINES: [&str; 12] = [
        "[a]\n",
        "[[pose]]\n",
        "a.b.c.d = 1\n",
        "seed = 0xffffffffffffffff\n",
        "x = 1979-05-27T07:32:00Z\n",
        "checkpoint_seconds = nan\n",
        "accuracy = \"1e-5 mm\"\n",
        "accuracy = \"inf\"\n",
        "accuracy = -inf\n",
        "[mesh]\n",
        "'''",
        "\"\\u0000\" = 1\n",
    ];
    let at = rng.random_range(0..=text.lines().count());
    let at: usize = text.split_inclusive('\n').take(at).map(str::len).sum();
    match rng.random_range(0..4_u32) {
        0 => text.insert_str(at, LINES.choose(rng).expect("there are lines")),
        1 => {
            let depth = 1 << rng.random_range(0..13_u32);
            let open = ["[", "{a=", "a."].choose(rng).expect("there are brackets");
            text.insert_str(at, &format!("deep = {}\n", open.repeat(depth)));
        }
        _ => {}
    }
    text
}

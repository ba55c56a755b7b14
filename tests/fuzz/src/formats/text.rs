//! Formats of lines: OBJ, curves in CSV, MakeHuman's targets, metrics.

use rand::Rng;
use rand::seq::IndexedRandom;
use rand_chacha::ChaCha8Rng;

use crate::damage::NUMBERS;

/// A tetrahedron, with what else stands in OBJ files.
pub const OBJ: &str = "# a tetrahedron\nmtllib a.mtl\no body\nv 0 0 0\nv 1 0 0 1.0\nv 0 1 0 0.5 0.5 0.5\nv 0 0 1\nvt 0 0\nvn 0 0 1\n\
    usemtl skin\ns off\nf 1 3 2\nf 1/1 2/1 4/1\nf 1//1 4//1 3//1\nf -3/1/1 \\\n -2/1/1 -1/1/1\nl 1 2\n";

/// Curves over the shapes `bent`, `long` and `a "b", c`.
pub const CURVES: &str =
    "frame,bent,long,\"a \"\"b\"\", c\"\none,0,0.5,1\n\n\"two, too\",1,0,0.25\n,0,0,1e-3\n";

/// A target of MakeHuman.
pub const TARGET: &str = "# basemesh hm08\n0 0.1 -0.2 .003\n17 0 0 1e-3\n  99 1 2 3 # the last\n";

/// Paint on six vertices.
pub const PAINT: &str = "# a scar\n0\n1\n0.25 # half\n\n1e-3\n.5\n0.0\n";

/// Metrics of a run.
pub const METRICS: &str = "{\"stage\":1,\"epoch\":1,\"loss\":0.5}\n{\"stage\":1,\"epoch\":2,\"loss\":0.1}\n\
    {\"stage\":2,\"step\":0,\"dropped\":\"long: the equilibrium is Stalled\"}\n{\"stage\":2,\"epoch\":1,\"mean_error_percent\":0.3}\n{\"sta";

/// One in a few of the ends of words and lines is another.
const ENDS: [&str; 9] = [" ", "  ", "\t", "\n", "\r\n", "\r", "\\\n", " # ", "\n\n"];

fn number(rng: &mut ChaCha8Rng) -> String {
    match rng.random_range(0..8_u32) {
        0..=4 => rng.random_range(-4..5_i32).to_string(),
        5 => rng.random_range(-10.0..10.0_f64).to_string(),
        6 => (*["nan", "inf", "", "0x1", "1_0", "1,5", "+1", "--1"]
            .choose(rng)
            .expect("words"))
        .into(),
        _ => (*NUMBERS.choose(rng).expect("there are numbers")).into(),
    }
}

/// Lines of shares, most of them some.
pub fn paint(rng: &mut ChaCha8Rng) -> Vec<u8> {
    let mut text = String::new();
    for _ in 0..1 << rng.random_range(0..7_u32) {
        match rng.random_range(0..4_u32) {
            0 => text.push_str(&number(rng)),
            _ => text.push_str(&rng.random_range(0.0..1.0_f64).to_string()),
        }
        text.push_str(match rng.random_range(0..8_u32) {
            0 => ENDS.choose(rng).expect("ends"),
            _ => "\n",
        });
    }
    text.into_bytes()
}

/// Lines of vertices, faces and whatever else, mostly meaningful.
pub fn obj(rng: &mut ChaCha8Rng) -> Vec<u8> {
    const KEYWORDS: [&str; 20] = [
        "v", "v", "v", "v", "v", "v", "f", "f", "f", "f", "fo", "vt", "vn", "g", "usemtl", "l",
        "curv2", "call", "x", "",
    ];
    let mut text = String::new();
    if rng.random() {
        text.push_str(OBJ);
    }
    for _ in 0..1 << rng.random_range(0..7_u32) {
        let keyword = KEYWORDS.choose(rng).expect("there are keywords");
        text.push_str(keyword);
        for _ in 0..3 + rng.random_range(0..4_u32) * rng.random_range(0..2_u32) {
            text.push_str(if rng.random_range(0..64_u32) > 0 {
                " "
            } else {
                ENDS.choose(rng).expect("ends")
            });
            text.push_str(&number(rng));
            if *keyword == "f" && rng.random_range(0..3_u32) == 0 {
                text.push('/');
                text.push_str(&number(rng));
            }
        }
        text.push_str(if rng.random_range(0..16_u32) > 0 {
            "\n"
        } else {
            ENDS.choose(rng).expect("ends")
        });
    }
    text.into_bytes()
}

/// A table with a header, mostly of one width.
pub fn curves(rng: &mut ChaCha8Rng) -> Vec<u8> {
    const NAMES: [&str; 12] = [
        "bent",
        "long",
        "\"a \"\"b\"\", c\"",
        "frame",
        "bent ",
        "\"long\"",
        "",
        "x",
        "\"",
        "\u{e9}",
        "\u{1b}[1m",
        "a;b",
    ];
    let width = if rng.random() {
        3
    } else {
        1 << rng.random_range(0..10_u32)
    };
    let names = if width == 3 { 3 } else { NAMES.len() };
    let mut text = String::new();
    let separator = *[",", ",", ",", ",", ", ", ";", "\t"]
        .choose(rng)
        .expect("separators");
    for row in 0..rng.random_range(1..8_u32) {
        let ragged = rng.random_range(0..16_u32) == 0;
        let cells = (0..width + usize::from(ragged)).map(|column| match row {
            0 if width == 3 => NAMES[column % names].to_string(),
            0 => format!(
                "{}{column}",
                NAMES.choose(rng).expect("names").trim_end_matches('"')
            ),
            _ if rng.random_range(0..4_u32) > 0 => rng.random_range(0.0..1.0_f64).to_string(),
            _ => number(rng),
        });
        text.push_str(&cells.collect::<Vec<_>>().join(separator));
        text.push_str(if rng.random_range(0..8_u32) > 0 {
            "\n"
        } else {
            "\r\n\r\n"
        });
    }
    text.into_bytes()
}

/// Lines of a vertex and a displacement.
pub fn target(rng: &mut ChaCha8Rng) -> Vec<u8> {
    let mut text = String::new();
    for _ in 0..1 << rng.random_range(0..7_u32) {
        text.push_str(&rng.random_range(0..120_u32).to_string());
        for _ in 0..if rng.random_range(0..16_u32) > 0 {
            3
        } else {
            rng.random_range(0..6)
        } {
            text.push_str(if rng.random_range(0..64_u32) > 0 {
                " "
            } else {
                ENDS.choose(rng).expect("ends")
            });
            text.push_str(&number(rng));
        }
        text.push('\n');
    }
    text.into_bytes()
}

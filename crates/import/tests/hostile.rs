//! Archives made to do harm: refused, without the memory or the places on disk that they are after.

use std::io::{Cursor, Write};
use std::path::Path;

use import::{ImportError, Origin, Source};
use zip::ZipWriter;
use zip::write::SimpleFileOptions;

const ORIGIN: Origin = Origin {
    marker: "data/base.obj",
    roots: &[""],
    obtain: "It is made by a test",
};

fn archive(entries: &[(&str, &[u8])]) -> Vec<u8> {
    let mut writer = ZipWriter::new(Cursor::new(Vec::new()));
    let deflated =
        SimpleFileOptions::default().compression_method(zip::CompressionMethod::Deflated);
    for (name, content) in entries {
        writer.start_file(*name, deflated).unwrap();
        writer.write_all(content).unwrap();
    }
    writer.finish().unwrap().into_inner()
}

fn open(bytes: Vec<u8>) -> Source {
    Source::from_archive(bytes, Path::new("a.zip"), ORIGIN).unwrap()
}

/// A few kilobytes unpacked to gigabytes, all of them in memory.
#[test]
fn an_entry_that_unpacks_without_end_is_refused() {
    let zeros = vec![0; 64 << 20];
    let mut source = open(archive(&[
        ("data/base.obj", b"v 0 0 0\n"),
        ("data/bomb.json", &zeros),
    ]));
    source.read("data/base.obj").unwrap();
    let refused = source.read("data/bomb.json").unwrap_err();
    assert!(matches!(refused, ImportError::Bomb { .. }), "{refused}");
    let message = refused.to_string();
    assert!(
        message.contains("a.zip")
            && message.contains("bomb.json")
            && message.contains("get it anew")
    );
    // What says a little, over and over, is a text as there may be.
    let text = "0 0.1 0.2 0.3\n".repeat(50_000);
    let mut source = open(archive(&[("data/base.obj", text.as_bytes())]));
    assert_eq!(source.read("data/base.obj").unwrap(), text.as_bytes());
}

/// Nothing is ever unpacked into files under the names of an archive: entries are asked for by known names, or by those directly in a folder of
/// the source, which hold no slash.
#[test]
fn entries_that_climb_out_of_the_folder_are_not_seen() {
    let source = open(archive(&[
        ("top/data/base.obj", b"v 0 0 0\n"),
        ("top/data/own.target", b""),
        ("top/data/../../../outside.target", b""),
        ("../data/outside.target", b""),
        ("/etc/passwd", b""),
        ("top/data/deeper/outside.target", b""),
    ]));
    assert_eq!(source.list("data").unwrap(), ["base.obj", "own.target"]);
    assert!(source.require(["../../../outside.target"]).is_err());
    assert!(source.require(["etc/passwd"]).is_err());
}

//! The bytes of a glTF file's buffers: the GLB's binary chunk, `data:` URIs, and files beside it.

use std::borrow::Cow;
use std::fs::File;
use std::io::{self, Read};
use std::path::{Component, Path, PathBuf};

use gltf::json::{Buffer, Root};

use crate::GltfProblem;

/// Loads every buffer of a document; `folder` is where relative URIs start.
pub(super) fn load<'a>(
    root: &Root,
    binary_chunk: Option<&'a [u8]>,
    folder: &Path,
) -> Result<Vec<Cow<'a, [u8]>>, GltfProblem> {
    let mut chunk = binary_chunk;
    root.buffers
        .iter()
        .enumerate()
        .map(|(index, buffer)| {
            let bytes = match &buffer.uri {
                Some(uri) => Cow::Owned(load_uri(index, buffer, uri, folder)?),
                // Only the first buffer can be the binary chunk.
                None if index == 0 => chunk
                    .take()
                    .map(Cow::Borrowed)
                    .ok_or(GltfProblem::NoBinaryChunk { buffer: index })?,
                None => return Err(GltfProblem::NoBinaryChunk { buffer: index }),
            };
            cut(index, buffer, bytes)
        })
        .collect()
}

/// Cuts a buffer to its declared length: a binary chunk is padded.
fn cut<'a>(
    index: usize,
    buffer: &Buffer,
    bytes: Cow<'a, [u8]>,
) -> Result<Cow<'a, [u8]>, GltfProblem> {
    let declared = buffer.byte_length.0;
    if declared > bytes.len() as u64 {
        return Err(GltfProblem::BufferTruncated {
            buffer: index,
            declared,
            found: bytes.len() as u64,
        });
    }
    let length = declared as usize;
    Ok(match bytes {
        Cow::Borrowed(bytes) => Cow::Borrowed(&bytes[..length]),
        Cow::Owned(mut bytes) => {
            bytes.truncate(length);
            Cow::Owned(bytes)
        }
    })
}

fn load_uri(
    index: usize,
    buffer: &Buffer,
    uri: &str,
    folder: &Path,
) -> Result<Vec<u8>, GltfProblem> {
    let unsupported = || GltfProblem::BufferUri {
        buffer: index,
        uri: uri.chars().take(60).collect(),
    };
    if let Some(data) = uri.strip_prefix("data:") {
        let (kind, text) = data.split_once(',').ok_or_else(unsupported)?;
        if !kind.ends_with(";base64") {
            return Err(unsupported());
        }
        return decode_base64(text.as_bytes()).map_err(|offset| GltfProblem::Base64 {
            buffer: index,
            offset,
        });
    }
    let name = percent_decoded(uri)
        .filter(|name| is_below(name))
        .ok_or_else(unsupported)?;
    let path = folder.join(name);
    read_file(&path, buffer.byte_length.0).map_err(|cause| GltfProblem::BufferFile {
        buffer: index,
        path,
        cause,
    })
}

/// Whether a name stays in the folder that it starts from. A file that somebody else made must not reach what lies elsewhere on this
/// machine: its bytes would turn up as coordinates in everything that is written.
fn is_below(name: &str) -> bool {
    let plain = |part| matches!(part, Component::Normal(_) | Component::CurDir);
    !name.contains([':', '\\']) && Path::new(name).components().all(plain)
}

/// Reads at most `length` bytes of a regular file.
fn read_file(path: &PathBuf, length: u64) -> io::Result<Vec<u8>> {
    let file = File::open(path)?;
    if !file.metadata()?.is_file() {
        return Err(io::Error::other("not a regular file"));
    }
    let mut bytes = Vec::new();
    file.take(length).read_to_end(&mut bytes)?;
    Ok(bytes)
}

/// Undoes `%20` and the like; `None` when an escape is damaged or the result is not UTF-8.
fn percent_decoded(uri: &str) -> Option<String> {
    let mut bytes = Vec::with_capacity(uri.len());
    let mut rest = uri.as_bytes();
    while let Some((&byte, tail)) = rest.split_first() {
        rest = tail;
        if byte == b'%' {
            let (digits, tail) = rest.split_at_checked(2)?;
            let digits = std::str::from_utf8(digits).ok()?;
            bytes.push(u8::from_str_radix(digits, 16).ok()?);
            rest = tail;
        } else {
            bytes.push(byte);
        }
    }
    String::from_utf8(bytes).ok()
}

/// Decodes standard base64 with or without padding; the error is the offset of the first bad character.
fn decode_base64(text: &[u8]) -> Result<Vec<u8>, usize> {
    let end = text.len()
        - text
            .iter()
            .rev()
            .take(2)
            .take_while(|&&c| c == b'=')
            .count();
    let mut bytes = Vec::with_capacity(end / 4 * 3 + 2);
    for (group, characters) in text[..end].chunks(4).enumerate() {
        let mut bits = 0;
        for (i, &character) in characters.iter().enumerate() {
            bits = bits << 6 | sextet(character).ok_or(4 * group + i)?;
        }
        // A last group of 2 or 3 characters holds 1 or 2 bytes; a single character holds none.
        let length = characters.len() - 1;
        if length == 0 {
            return Err(4 * group);
        }
        bits <<= 6 * (4 - characters.len());
        bytes.extend_from_slice(&bits.to_be_bytes()[1..=length]);
    }
    Ok(bytes)
}

fn sextet(character: u8) -> Option<u32> {
    let value = match character {
        b'A'..=b'Z' => character - b'A',
        b'a'..=b'z' => character - b'a' + 26,
        b'0'..=b'9' => character - b'0' + 52,
        b'+' => 62,
        b'/' => 63,
        _ => return None,
    };
    Some(value.into())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn base64_decodes_the_vectors_of_rfc_4648() {
        let vectors = [
            ("", ""),
            ("Zg==", "f"),
            ("Zm8=", "fo"),
            ("Zm9v", "foo"),
            ("Zm9vYg==", "foob"),
            ("Zm9vYmE=", "fooba"),
            ("Zm9vYmFy", "foobar"),
            ("Zm9vYmE", "fooba"),
        ];
        for (text, bytes) in vectors {
            assert_eq!(decode_base64(text.as_bytes()), Ok(bytes.into()), "{text}");
        }
        assert_eq!(decode_base64(b"+/+/"), Ok(vec![0xfb, 0xff, 0xbf]));
        assert_eq!(decode_base64(b"Zm9v Zg="), Err(4));
        assert_eq!(decode_base64(b"Zm9vZ"), Err(4));
        assert_eq!(decode_base64(b"===="), Err(0));
    }

    #[test]
    fn percent_escapes_are_undone() {
        assert_eq!(
            percent_decoded("a%20b%C3%A9.bin").as_deref(),
            Some("a b\u{e9}.bin")
        );
        for damaged in ["a%2", "a%zz", "%ff"] {
            assert_eq!(percent_decoded(damaged), None);
        }
    }
}

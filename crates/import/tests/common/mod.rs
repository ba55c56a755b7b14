//! What the tests share: text of small meshes, folders of files, and the same as a zip archive.
#![allow(dead_code)]

use std::fmt::Write as _;
use std::fs::File;
use std::io::Write as _;
use std::path::{Path, PathBuf};

use import::ImportError;
use nalgebra::{Rotation3, Vector3};
use tempfile::TempDir;
use zip::ZipWriter;
use zip::write::SimpleFileOptions;

/// Files of a source by their names.
pub type Files = Vec<(String, Vec<u8>)>;

/// A mesh in the making.
#[derive(Clone, Default)]
pub struct Mesh {
    pub vertices: Vec<Vector3<f64>>,
    pub polygons: Vec<Vec<usize>>,
}

impl Mesh {
    /// Adds vertices and polygons that count from these vertices; tells the range.
    pub fn add(&mut self, vertices: &[[f64; 3]], polygons: &[&[usize]]) -> std::ops::Range<usize> {
        let start = self.vertices.len();
        self.vertices
            .extend(vertices.iter().map(|&v| Vector3::from(v)));
        let shifted = polygons
            .iter()
            .map(|p| p.iter().map(|c| c + start).collect());
        self.polygons.extend(shifted);
        start..self.vertices.len()
    }

    /// Adds a small tetrahedron at a place.
    pub fn add_tetrahedron(&mut self, at: [f64; 3]) -> std::ops::Range<usize> {
        let [x, y, z] = at;
        let corners = [[x, y, z], [x + 0.5, y, z], [x, y + 0.4, z], [x, y, z + 0.3]];
        self.add(&corners, &[&[0, 2, 1], &[0, 1, 3], &[0, 3, 2], &[1, 2, 3]])
    }

    /// As OBJ.
    pub fn obj(&self) -> Vec<u8> {
        let mut text = String::from("mtllib none.mtl\n");
        for v in &self.vertices {
            writeln!(text, "v {} {} {}", v.x, v.y, v.z).unwrap();
        }
        text.push_str("vt 0 0\ng all\n");
        for polygon in &self.polygons {
            let corners: Vec<String> = polygon.iter().map(|c| format!("{}/1", c + 1)).collect();
            writeln!(text, "f {}", corners.join(" ")).unwrap();
        }
        text.into_bytes()
    }
}

/// The motion that the tests give to the jaw.
pub fn opened(point: &Vector3<f64>) -> Vector3<f64> {
    let turn = Rotation3::from_axis_angle(&Vector3::x_axis(), 0.3);
    turn * point + Vector3::new(0.0, 0.25, -0.5)
}

/// A folder with these files, and room beside them.
pub fn folder(files: &Files) -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    for (name, bytes) in files {
        let path = folder.path().join("source").join(name);
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(path, bytes).unwrap();
    }
    folder
}

/// The same files in an archive, below a folder.
pub fn archive(files: &Files, below: &str) -> (TempDir, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("source.whl");
    let mut zip = ZipWriter::new(File::create(&path).unwrap());
    for (name, bytes) in files {
        zip.start_file(format!("{below}{name}"), SimpleFileOptions::default())
            .unwrap();
        zip.write_all(bytes).unwrap();
    }
    zip.finish().unwrap();
    (folder, path)
}

/// The files with one changed or taken away.
pub fn with(files: &Files, name: &str, bytes: Option<&[u8]>) -> Files {
    let mut changed = files.clone();
    let index = changed.iter().position(|(n, _)| n == name);
    let index = index.unwrap_or_else(|| panic!("no {name}"));
    match bytes {
        Some(bytes) => changed[index].1 = bytes.to_vec(),
        None => drop(changed.remove(index)),
    }
    changed
}

/// Names of what is directly in a folder, hidden ones too.
pub fn names(folder: &Path) -> Vec<String> {
    let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
    let mut names: Vec<String> = entries
        .map(|e| e.file_name().into_string().unwrap())
        .collect();
    names.sort();
    names
}

/// The error's text holds all of `parts`.
#[track_caller]
pub fn tells(error: &ImportError, parts: &[&str]) {
    let message = error.to_string();
    for part in parts {
        assert!(message.contains(part), "no `{part}` in: {message}");
    }
}

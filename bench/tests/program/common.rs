//! Running the program as `cargo xtask bench` does, in a folder that nobody else uses.

use serde_json::Value;
use std::path::{Path, PathBuf};
use std::process::Command;
use surface_mesh::primitives::icosphere;
use surface_mesh::write_obj;
use tempfile::TempDir;

/// How a run of the program ended.
#[derive(Debug)]
pub struct Ran {
    /// The exit code; none when a signal ended it.
    pub code: Option<i32>,
    /// The tables.
    pub stdout: String,
    /// Everything else.
    pub stderr: String,
}

/// A folder for files.
pub struct Place(TempDir);

impl Place {
    /// An empty one.
    pub fn new() -> Self {
        Self(tempfile::tempdir().unwrap())
    }

    /// A path in it.
    pub fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    /// A ball of radius one, in a file there.
    pub fn ball(&self) -> PathBuf {
        let path = self.path("ball.obj");
        write_obj(&path, &icosphere(2, 1.0)).unwrap();
        path
    }

    /// Names of all files in it.
    pub fn files(&self) -> Vec<String> {
        let entries = std::fs::read_dir(self.0.path()).unwrap();
        let name = |entry: std::fs::DirEntry| entry.file_name().into_string().unwrap();
        let mut names: Vec<_> = entries.map(|entry| name(entry.unwrap())).collect();
        names.sort();
        names
    }

    /// Runs a command line (split at spaces) that has to succeed; its JSON.
    #[track_caller]
    pub fn measure(&self, line: &str) -> Value {
        let json = self.path("out.json");
        let ran = run(&format!("{line} --json {}", json.display()));
        assert_eq!(ran.code, Some(0), "{line}: {ran:?}");
        assert!(!ran.stdout.is_empty());
        self.read(&json)
    }

    /// The JSON of a file, which is removed.
    #[track_caller]
    pub fn read(&self, path: &Path) -> Value {
        let text = std::fs::read_to_string(path).unwrap();
        assert!(text.ends_with("}\n"));
        std::fs::remove_file(path).unwrap();
        serde_json::from_str(&text).unwrap()
    }
}

/// Runs the program with a command line, split at spaces.
pub fn run(line: &str) -> Ran {
    let output = Command::new(env!("CARGO_BIN_EXE_myofield-bench"))
        .args(line.split_whitespace())
        .output()
        .expect("the program starts");
    Ran {
        code: output.status.code(),
        stdout: String::from_utf8(output.stdout).unwrap(),
        stderr: String::from_utf8(output.stderr).unwrap(),
    }
}

impl Ran {
    /// It refused with one line of error that holds all of `parts`.
    #[track_caller]
    pub fn refuses(&self, parts: &[&str]) {
        assert!(matches!(self.code, Some(1 | 2)), "{self:?}");
        assert!(!self.stderr.contains("panicked"), "{self:?}");
        let errors = self.stderr.lines().filter(|l| l.starts_with("error:"));
        let errors: Vec<_> = errors.collect();
        assert_eq!(errors.len(), 1, "{self:?}");
        for part in parts {
            assert!(errors[0].contains(part), "`{part}` is not in: {self:?}");
        }
    }
}

/// A number that has to be there.
#[track_caller]
pub fn number(value: &Value, key: &str) -> f64 {
    let found = value[key].as_f64();
    found.unwrap_or_else(|| panic!("{key} is {}", value[key]))
}

/// A list of numbers that has to be there.
#[track_caller]
pub fn numbers(value: &Value, key: &str) -> Vec<f64> {
    let list = value[key].as_array().unwrap_or_else(|| panic!("{key}"));
    list.iter().map(|x| x.as_f64().unwrap()).collect()
}

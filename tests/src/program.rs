//! Running the program as a user does.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::OnceLock;

/// How a run of the program ended.
#[derive(Debug)]
pub struct Ran {
    /// The exit code; none when a signal ended it.
    pub code: Option<i32>,
    /// Everything it printed.
    pub stdout: String,
    /// Everything it said on the side.
    pub stderr: String,
}

/// The program, built once per test binary with the profile of the tests: a test must not run yesterday's program.
///
/// # Panics
/// When it does not build.
pub fn program() -> &'static Path {
    static PROGRAM: OnceLock<PathBuf> = OnceLock::new();
    PROGRAM.get_or_init(|| {
        let test = std::env::current_exe().expect("a test knows its file");
        let folder = test
            .ancestors()
            .nth(2)
            .expect("TARGET/PROFILE/deps/TEST")
            .to_path_buf();
        let target = folder.parent().expect("TARGET/PROFILE");
        let profile = folder.file_name().expect("a profile").to_string_lossy();
        let profile = if profile == "debug" { "dev" } else { &profile };
        let built = Command::new(env!("CARGO"))
            .args(["build", "--quiet", "-p", "trainer", "--bin", "myofield"])
            .args(["--profile", profile, "--target-dir"])
            .arg(target)
            .current_dir(env!("CARGO_MANIFEST_DIR"))
            .status()
            .expect("cargo runs");
        assert!(built.success(), "the program does not build");
        folder.join(format!("myofield{}", std::env::consts::EXE_SUFFIX))
    })
}

/// Runs the program with the arguments of a command line split at spaces (so no path may hold one).
///
/// # Panics
/// When it does not start.
pub fn check(line: impl AsRef<str>) -> Ran {
    let output = Command::new(program())
        .args(line.as_ref().split_whitespace())
        .output()
        .expect("the program starts");
    Ran {
        code: output.status.code(),
        stdout: String::from_utf8_lossy(&output.stdout).into_owned(),
        stderr: String::from_utf8_lossy(&output.stderr).into_owned(),
    }
}

impl Ran {
    /// The same, when it ended well.
    ///
    /// # Panics
    /// When it did not.
    #[track_caller]
    pub fn succeeds(self) -> Self {
        assert_eq!(self.code, Some(0), "{}\n{}", self.stdout, self.stderr);
        self
    }

    /// The same, when it refused with one line of error that holds all of `parts`.
    ///
    /// # Panics
    /// When it did not, or panicked.
    #[track_caller]
    pub fn refuses(self, parts: &[&str]) -> Self {
        let all = format!("{}\n{}", self.stdout, self.stderr);
        assert!(matches!(self.code, Some(1 | 2)), "{:?}: {all}", self.code);
        assert!(!all.contains("panicked"), "{all}");
        let errors = self.stderr.lines().filter(|l| l.starts_with("error:"));
        let errors: Vec<&str> = errors.collect();
        assert_eq!(errors.len(), 1, "{all}");
        for part in parts {
            assert!(errors[0].contains(part), "`{part}` is not in:\n{all}");
        }
        if self.code == Some(1) {
            assert_eq!(self.stderr.lines().last(), Some(errors[0]), "{all}");
        }
        self
    }
}

/// All files below a folder with their contents; empty where there is no folder, and with an entry for every folder below it.
///
/// # Panics
/// When something there cannot be read.
pub fn tree(folder: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let mut all = BTreeMap::new();
    let mut left = vec![folder.to_path_buf()];
    while let Some(folder) = left.pop().filter(|f| f.exists()) {
        for entry in std::fs::read_dir(&folder).expect("a readable folder") {
            let path = entry.expect("a readable entry").path();
            if path.is_dir() {
                all.insert(path.clone(), Vec::new());
                left.push(path);
            } else {
                let bytes = std::fs::read(&path).expect("a readable file");
                all.insert(path, bytes);
            }
        }
    }
    all
}

/// Runs the program, which has to refuse with `parts` in its error and leave `out` as it was, absent or to the byte.
///
/// # Panics
/// When it does not.
#[track_caller]
pub fn refused_and_unchanged(line: impl AsRef<str>, out: &Path, parts: &[&str]) {
    let (there, before) = (out.exists(), tree(out));
    check(line).refuses(parts);
    assert_eq!(out.exists(), there, "{}", out.display());
    let after = tree(out);
    let names = |tree: &BTreeMap<PathBuf, Vec<u8>>| tree.keys().cloned().collect::<Vec<_>>();
    assert_eq!(names(&after), names(&before));
    assert!(after == before, "a file below {} changed", out.display());
}

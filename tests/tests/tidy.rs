//! Rules of the house that no compiler checks: every crate is described, shown and measured, the architecture page knows every
//! member, files stay short, and nothing is left open or bound to one machine.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

/// Lines that a Rust file may have: beyond that it has more than one purpose.
const LONGEST_FILE: usize = 600;
/// Where the files of a machine lie. A path that starts here is of no use on another.
const MACHINE_FOLDERS: [&str; 5] = ["work", "root", "home", "Users", "tmp"];
/// Macros that stand for code that is not written.
const OPEN_ENDS: [&str; 2] = ["todo", "unimplemented"];

fn workspace() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..")
}

/// Fails with all complaints at once.
fn none(complaints: Vec<String>) {
    assert!(complaints.is_empty(), "\n{}\n", complaints.join("\n"));
}

/// Names and manifest folders of all members of the workspace.
fn members() -> Vec<(String, PathBuf)> {
    let output = Command::new(env!("CARGO"))
        .args(["metadata", "--no-deps", "--offline", "--format-version=1"])
        .current_dir(workspace())
        .output()
        .expect("cargo starts");
    let metadata: serde_json::Value = serde_json::from_slice(&output.stdout).expect("JSON");
    let packages = metadata["packages"].as_array().expect("a list of packages");
    let text = |value: &serde_json::Value| value.as_str().expect("text").to_string();
    let member = |package: &serde_json::Value| {
        let manifest = PathBuf::from(text(&package["manifest_path"]));
        let folder = manifest.parent().expect("a folder").to_path_buf();
        (text(&package["name"]), folder)
    };
    packages.iter().map(member).collect()
}

fn has_rust_files(folder: &Path) -> bool {
    let files = fs::read_dir(folder).into_iter().flatten().flatten();
    files
        .map(|file| file.path())
        .any(|path| path.extension().is_some_and(|e| e == "rs"))
}

/// All committed files that are text, with their paths from the root; `None` outside a repository.
fn committed_texts() -> Option<Vec<(String, String)>> {
    let output = Command::new("git")
        .args(["ls-files", "-z"])
        .current_dir(workspace())
        .output()
        .ok()?;
    if !output.status.success() {
        return None;
    }
    let names = String::from_utf8(output.stdout).expect("paths in Unicode");
    let text = |name: &str| {
        let text = fs::read_to_string(workspace().join(name)).ok()?;
        Some((name.to_string(), text))
    };
    Some(names.split_terminator('\0').filter_map(text).collect())
}

/// Asks `complain(name, line)` about all lines of all committed texts.
fn over_lines(complain: impl Fn(&str, &str) -> Option<String>) {
    let Some(texts) = committed_texts() else {
        eprintln!("skipped: not a git repository, so what is committed is not known");
        return;
    };
    assert!(texts.iter().any(|(name, _)| name == "Cargo.toml"));
    let mut complaints = Vec::new();
    for (name, text) in &texts {
        for (i, line) in text.lines().enumerate() {
            let complaint = complain(name, line);
            complaints.extend(complaint.map(|c| format!("{name}:{}: {c}", i + 1)));
        }
    }
    none(complaints);
}

/// The machine folder that some absolute path in a line starts with.
fn machine_folder(line: &str) -> Option<&'static str> {
    MACHINE_FOLDERS.into_iter().find(|folder| {
        let start = format!("/{folder}/");
        line.match_indices(&start).any(|(at, _)| {
            let before = line[..at].chars().next_back();
            before.is_none_or(|c| !c.is_alphanumeric() && !"./_-}".contains(c))
        })
    })
}

#[test]
fn every_crate_is_described_shown_and_measured() {
    let mut complaints = Vec::new();
    for (name, folder) in members() {
        if folder
            .parent()
            .and_then(Path::file_name)
            .is_none_or(|parent| parent != "crates")
        {
            continue;
        }
        let page = fs::read_to_string(folder.join("README.md")).unwrap_or_default();
        if !page.starts_with(&format!("# {name}")) || page.lines().count() < 10 {
            complaints.push(format!(
                "crates/{name}/README.md: describe the crate under its name"
            ));
        }
        for (part, mend) in [("examples", "show its use"), ("benches", "measure it")] {
            if !has_rust_files(&folder.join(part)) {
                complaints.push(format!("crates/{name}/{part}: {mend} in a Rust file"));
            }
        }
    }
    none(complaints);
}

#[test]
fn the_architecture_page_names_every_member() {
    let page = fs::read_to_string(workspace().join("docs/architecture.md"));
    let page = page.expect("docs/architecture.md");
    let missing = members()
        .into_iter()
        .map(|(name, _)| name)
        .filter(|name| !page.contains(&format!("`{name}`")));
    none(
        missing
            .map(|name| {
                format!("docs/architecture.md: say what `{name}` holds and what is absent from it")
            })
            .collect(),
    );
}

#[test]
fn no_path_of_one_machine_is_committed() {
    over_lines(|_, line| {
        machine_folder(line).map(|folder| format!("a path below the machine's `{folder}` folder"))
    });
}

#[test]
fn machine_paths_are_told_from_others() {
    let path = |before: &str, folder: &str| format!("{before}/{folder}/file");
    for folder in MACHINE_FOLDERS {
        for before in ["", "in ", "\"", "dir="] {
            assert_eq!(
                machine_folder(&path(before, folder)),
                Some(folder),
                "{before}"
            );
        }
        for before in ["target", "..", "https://example.org", "{root}", "$OUT_"] {
            assert_eq!(machine_folder(&path(before, folder)), None, "{before}");
        }
    }
}

#[test]
fn nothing_committed_is_left_open() {
    over_lines(|name, line| {
        let found = OPEN_ENDS
            .into_iter()
            .find(|open| line.contains(&format!("{open}!(")));
        found
            .filter(|_| name.ends_with(".rs"))
            .map(|open| format!("`{open}` stands where code should"))
    });
}

#[test]
fn rust_files_are_short() {
    let Some(texts) = committed_texts() else {
        eprintln!("skipped: not a git repository, so what is committed is not known");
        return;
    };
    let lengths = texts
        .iter()
        .filter(|(name, _)| name.ends_with(".rs"))
        .map(|(name, text)| (name, text.lines().count()));
    let long = lengths.filter(|&(_, length)| length > LONGEST_FILE);
    none(
        long.map(|(name, length)| {
            format!(
                "{name}: {length} lines, more than {LONGEST_FILE}: give each purpose its own file"
            )
        })
        .collect(),
    );
}

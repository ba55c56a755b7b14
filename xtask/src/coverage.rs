//! `cargo xtask coverage`: which share of each crate's lines the tests run.

use crate::{cargo, line, root, tools};
use std::collections::BTreeMap;
use std::process::ExitCode;

/// Where the report of every line is left, from the root of the workspace.
const REPORT: &str = "target/coverage.lcov";

/// Runs all tests with counters (arguments go to `cargo llvm-cov`) and prints the lines of every crate.
pub fn coverage(arguments: &[String]) -> ExitCode {
    if let Err(what) = prepare() {
        eprintln!("error: {what}");
        return ExitCode::FAILURE;
    }
    // Tests that kill a program leave counters that were not written to their end: those are left out, where all would be refused.
    let mut words = line("llvm-cov --release --workspace --failure-mode all --lcov --output-path");
    // cargo llvm-cov takes paths from the folder that one stands in, and makes none.
    let report = root().join(REPORT);
    if let Some(folder) = report.parent() {
        let _ = std::fs::create_dir_all(folder);
    }
    words.push(report.display().to_string());
    words.extend_from_slice(arguments);
    match cargo(&words).status() {
        Ok(status) if status.success() => {}
        Ok(_) => return ExitCode::FAILURE,
        Err(error) => {
            eprintln!("error: cargo llvm-cov could not be started: {error}");
            return ExitCode::FAILURE;
        }
    }
    match std::fs::read_to_string(&report) {
        Ok(report) => {
            print!(
                "{}\nline by line: {REPORT}\n",
                table(&lines_by_crate(&report))
            );
            ExitCode::SUCCESS
        }
        Err(error) => {
            eprintln!("error: {REPORT} could not be read: {error}");
            ExitCode::FAILURE
        }
    }
}

/// Installs what is missing; an error says what to do by hand.
fn prepare() -> Result<(), String> {
    let tools = "the component llvm-tools is missing and could not be added: `rustup component add llvm-tools`, or set LLVM_COV and \
                 LLVM_PROFDATA to the tools of the LLVM that rustc was built with";
    let given = ["LLVM_COV", "LLVM_PROFDATA"].map(|name| std::env::var_os(name).is_some());
    if given != [true, true] && !tools::succeeds("rustup", &["component", "add", "llvm-tools"]) {
        return Err(tools.to_string());
    }
    tools::prepare("llvm-cov")
}

/// Lines with code and lines that were run, by the folder of the crate.
fn lines_by_crate(report: &str) -> BTreeMap<String, [usize; 2]> {
    let mut crates = BTreeMap::new();
    let mut owner = String::new();
    for record in report.lines() {
        let Some((kind, value)) = record.split_once(':') else {
            continue;
        };
        let place = match kind {
            "SF" => {
                owner = crate_of(value);
                continue;
            }
            "LF" => 0,
            "LH" => 1,
            _ => continue,
        };
        let counts: &mut [usize; 2] = crates.entry(owner.clone()).or_default();
        counts[place] += value.trim().parse::<usize>().unwrap_or(0);
    }
    crates
}

/// The folder of the crate that a source file belongs to: what comes before `src`, `tests` and the like, from the workspace on.
fn crate_of(file: &str) -> String {
    let file = file.replace('\\', "/");
    let base = root()
        .canonicalize()
        .unwrap_or_else(|_| root().to_path_buf());
    let base = format!("{}/", base.display()).replace('\\', "/");
    let inside = file.strip_prefix(&base).unwrap_or(&file);
    let end = ["/src/", "/tests/", "/benches/", "/examples/", "/build.rs"]
        .iter()
        .filter_map(|part| inside.find(part))
        .min();
    end.map_or(inside, |end| &inside[..end]).to_string()
}

/// One row per crate, and the sum.
fn table(crates: &BTreeMap<String, [usize; 2]>) -> String {
    let mut text = format!("{:<24} {:>8} {:>8} {:>7}\n", "crate", "lines", "run", "%");
    let mut sum = [0; 2];
    let row = |name: &str, [all, run]: [usize; 2]| {
        let share = 100.0 * run as f64 / all.max(1) as f64;
        format!("{name:<24} {all:>8} {run:>8} {share:>7.1}\n")
    };
    for (name, counts) in crates {
        text.push_str(&row(name, *counts));
        sum = [sum[0] + counts[0], sum[1] + counts[1]];
    }
    text.push_str(&row("all", sum));
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_are_summed_over_the_files_of_a_crate() {
        let root = root().canonicalize().unwrap();
        let report = [
            "crates/a/src/lib.rs",
            "crates/a/src/tests/x.rs",
            "xtask/src/main.rs",
        ]
        .iter()
        .zip([(10, 5), (4, 4), (6, 0)])
        .map(|(file, (all, run))| {
            let file = root.join(file);
            format!(
                "TN:\nSF:{}\nDA:1,3\nLF:{all}\nLH:{run}\nend_of_record\n",
                file.display()
            )
        })
        .collect::<String>();
        let crates = lines_by_crate(&report);
        let expected = [("crates/a", [14, 9]), ("xtask", [6, 0])];
        assert_eq!(
            crates,
            expected.map(|(name, n)| (name.to_string(), n)).into()
        );
        let table = table(&crates);
        assert!(
            table
                .lines()
                .any(|l| l.split_whitespace().eq(["crates/a", "14", "9", "64.3"])),
            "{table}"
        );
        assert!(
            table
                .lines()
                .any(|l| l.split_whitespace().eq(["all", "20", "9", "45.0"])),
            "{table}"
        );
    }

    #[test]
    fn a_crate_inside_a_folder_of_tests_keeps_its_name() {
        let root = root().canonicalize().unwrap();
        for (file, owner) in [
            ("tests/src/lib.rs", "tests"),
            ("tests/hard-cases/src/main.rs", "tests/hard-cases"),
            ("tests/tests/resume.rs", "tests"),
            ("crates/a/benches/b.rs", "crates/a"),
        ] {
            let file = root.join(file).display().to_string();
            assert_eq!(crate_of(&file), owner);
        }
    }
}

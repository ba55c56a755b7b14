//! Thin dispatcher: builds in release mode and starts the program, the tests, the benches and the checks. Links none of the crates.

use std::path::Path;
use std::process::{Command, ExitCode};

const HELP: &str = "\
cargo xtask COMMAND

  train [SCENE] [--resume] [--out DIR] [--data DIR]
                 train a scene (the starfish unless given) into a run folder
  eval RUN [--shapes FILE.glb] [--weights \"a=0.5,b=0.5\"] [--element-size H] [--out DIR]
                 simulate and measure the shapes of a trained run, and others
  solve (--cells NX,NY,NZ --size H | --surface FILE --element-size H) --fix \"x=0\" [...]
                 find one equilibrium and the gradient of a loss, on arrays in .npy files
  test [ARGS]    run all tests (arguments go to cargo test)
  bench [ARGS]   run all benches (arguments go to cargo bench)
  ci             everything that .ci/run checks

`cargo xtask train --help` and the like tell more.
";

fn main() -> ExitCode {
    let mut arguments = std::env::args().skip(1);
    let command = arguments.next().unwrap_or_default();
    let rest: Vec<String> = arguments.collect();
    match command.as_str() {
        "train" | "eval" | "solve" => program(&command, &rest),
        "test" => all_of(&[tests(&rest)]),
        "bench" => all_of(&[benches(&rest)]),
        "ci" => all_of(&checks()),
        "" | "help" | "-h" | "--help" => {
            print!("{HELP}");
            ExitCode::SUCCESS
        }
        other => {
            eprintln!("error: `{other}` is no command\n\n{HELP}");
            ExitCode::from(2)
        }
    }
}

/// A cargo command line.
type Line = Vec<String>;

fn line(words: &str) -> Line {
    words.split_whitespace().map(str::to_string).collect()
}

fn tests(more: &[String]) -> Line {
    let mut words = line("test --release --workspace");
    words.extend_from_slice(more);
    words
}

fn benches(more: &[String]) -> Line {
    let mut words = line("bench --workspace --benches");
    words.extend_from_slice(more);
    words
}

fn checks() -> Vec<Line> {
    vec![
        line("fmt --all --check"),
        line("clippy --release --workspace --all-targets -- -D warnings"),
        line("doc --release --workspace --no-deps"),
        tests(&[]),
        line("package -p polar-grad --allow-dirty"),
    ]
}

fn program(command: &str, rest: &[String]) -> ExitCode {
    let mut words = line("run --quiet --release --package trainer --bin myofield --");
    words.push(command.to_string());
    words.extend_from_slice(rest);
    become_or_run(cargo(&words))
}

/// Hands this process over, so that Ctrl-C and kill reach the program itself.
#[cfg(unix)]
fn become_or_run(mut command: Command) -> ExitCode {
    use std::os::unix::process::CommandExt;
    not_started(command.exec())
}

#[cfg(not(unix))]
fn become_or_run(command: Command) -> ExitCode {
    wait_for(command)
}

/// Runs the lines in order and stops at the first that fails.
fn all_of(lines: &[Line]) -> ExitCode {
    for words in lines {
        eprintln!("cargo {}", words.join(" "));
        let code = run(words);
        if code != ExitCode::SUCCESS {
            return code;
        }
    }
    ExitCode::SUCCESS
}

fn run(words: &[String]) -> ExitCode {
    wait_for(cargo(words))
}

/// A cargo command in the folder that the user stands in, so that paths on the command line mean what they say; the manifest is
/// named, so that this works from anywhere.
fn cargo(words: &[String]) -> Command {
    let manifest = Path::new(env!("CARGO_MANIFEST_DIR"))
        .parent()
        .expect("xtask lies in the workspace")
        .join("Cargo.toml");
    let mut command = Command::new(std::env::var("CARGO").unwrap_or_else(|_| "cargo".into()));
    let (verb, rest) = words.split_first().expect("a command");
    command
        .arg(verb)
        .arg("--manifest-path")
        .arg(manifest)
        .args(rest);
    if verb == "doc" {
        command.env("RUSTDOCFLAGS", "-D warnings");
    }
    command
}

fn wait_for(mut command: Command) -> ExitCode {
    match command.status() {
        Ok(status) if status.success() => ExitCode::SUCCESS,
        Ok(status) => ExitCode::from(
            status
                .code()
                .and_then(|c| u8::try_from(c).ok())
                .unwrap_or(1),
        ),
        Err(error) => not_started(error),
    }
}

fn not_started(error: std::io::Error) -> ExitCode {
    eprintln!("error: cannot start cargo: {error}");
    ExitCode::FAILURE
}

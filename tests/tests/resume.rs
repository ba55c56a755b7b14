//! Whatever ends a training, it goes on exactly where it was: the same weights to the last bit, every step once.

use myofield_tests::{TinyScene, check, program};
use serde_json::Value;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::time::{Duration, Instant};

const EPOCHS: [usize; 2] = [15, 4];

fn training(tiny: &TinyScene, out: &str, more: &[&str]) -> Command {
    let mut command = Command::new(program());
    command.arg("train").arg(tiny.scene()).arg("--out");
    command.arg(tiny.path(out)).args(more);
    command.stdin(Stdio::null());
    command.stdout(Stdio::piped()).stderr(Stdio::piped());
    command
}

fn undisturbed(tiny: &TinyScene, out: &str) -> PathBuf {
    let line = format!(
        "train {} --out {}",
        tiny.scene().display(),
        tiny.path(out).display()
    );
    check(line).succeeds();
    tiny.path(out)
}

#[track_caller]
fn succeeds(output: &Output) {
    let said = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(0), "{said}");
}

fn read(path: impl AsRef<Path>) -> Vec<u8> {
    let path = path.as_ref();
    std::fs::read(path).unwrap_or_else(|e| panic!("{}: {e}", path.display()))
}

/// The metrics of training without what a clock said.
fn metrics(run: &Path) -> Vec<Value> {
    let text = String::from_utf8(read(run.join("metrics.jsonl"))).unwrap();
    let line = |line: &str| {
        let mut value: Value = serde_json::from_str(line).unwrap();
        let entries = value.as_object_mut().unwrap();
        entries.retain(|key, _| !key.ends_with("_seconds"));
        value
    };
    text.lines().map(line).collect()
}

/// The results of the final evaluation without what a clock said.
fn results(run: &Path) -> Value {
    let mut all: Value =
        serde_json::from_slice(&read(run.join("evaluation/metrics.json"))).unwrap();
    for shape in all["shapes"].as_array_mut().unwrap() {
        shape.as_object_mut().unwrap().remove("seconds");
    }
    all
}

/// The same weights and results to the last bit, and the same steps.
#[track_caller]
fn assert_same(run: &Path, expected: &Path) {
    assert_eq!(metrics(run), metrics(expected));
    let weights = |run: &Path| read(run.join("model.safetensors"));
    assert!(weights(run) == weights(expected), "other weights");
    assert_eq!(results(run), results(expected));
    let meshes = |run: &Path| read(run.join("evaluation/shapes.glb"));
    assert!(meshes(run) == meshes(expected), "other shapes");
}

fn names(folder: &Path) -> Vec<String> {
    let entries = std::fs::read_dir(folder).unwrap();
    let names = entries.map(|e| e.unwrap().file_name().into_string().unwrap());
    let mut names: Vec<String> = names.collect();
    names.sort();
    names
}

/// Kills a training and waits for it; false when it had ended well before.
fn kill(mut child: Child) -> bool {
    let ended = child.try_wait().unwrap().is_some();
    child.kill().unwrap();
    let output = child.wait_with_output().unwrap();
    if ended {
        succeeds(&output);
    }
    !ended
}

/// Waits until a file is there or the process ended.
fn wait_for(path: &Path, child: &mut Child) {
    let limit = Instant::now() + Duration::from_secs(60);
    while !path.exists() && child.try_wait().unwrap().is_none() {
        assert!(Instant::now() < limit, "{} does not appear", path.display());
        std::thread::sleep(Duration::from_millis(2));
    }
}

#[test]
fn training_does_not_depend_on_time_or_threads() {
    let tiny = TinyScene::new(EPOCHS[0], EPOCHS[1]);
    let first = undisturbed(&tiny, "first");
    let second = undisturbed(&tiny, "second");
    assert_same(&second, &first);
    for threads in ["1", "2", "3"] {
        let mut alone = training(&tiny, threads, &[]);
        succeeds(&alone.env("RAYON_NUM_THREADS", threads).output().unwrap());
        assert_same(&tiny.path(threads), &first);
    }
    // Nor on how often the state is saved, nor on the folder.
    tiny.edit("checkpoint_seconds = 0", "checkpoint_seconds = 1000");
    let rare = undisturbed(&tiny, "rare");
    assert_same(&rare, &first);
    tiny.edit("checkpoint_seconds = 1000", "seed = 1");
    let other = undisturbed(&tiny, "other");
    assert_ne!(metrics(&other), metrics(&first));
}

#[test]
fn every_step_is_in_the_metrics_once() {
    let tiny = TinyScene::new(EPOCHS[0], EPOCHS[1]);
    let lines = metrics(&undisturbed(&tiny, "run"));
    let of = |stage: u64, key: &str| -> Vec<u64> {
        let lines = lines.iter().filter(|l| l["stage"] == stage);
        lines.map(|l| l[key].as_u64().unwrap()).collect()
    };
    assert!(of(1, "epoch").into_iter().eq(1..=EPOCHS[0] as u64));
    assert!(of(2, "step").into_iter().eq(0..3 * EPOCHS[1] as u64));
}

/// Kills at many moments: at start, while targets are pulled, in both stages (in the middle of an epoch too), in the evaluation.
#[test]
fn a_killed_training_goes_on_bit_for_bit() {
    let tiny = TinyScene::new(EPOCHS[0], EPOCHS[1]);
    let clock = Instant::now();
    let expected = undisturbed(&tiny, "undisturbed");
    let whole = clock.elapsed();
    // Once at every twelfth of the time an undisturbed run takes.
    let mut interrupted = 0;
    for part in 1..12 {
        let name = format!("once-{part}");
        let run = tiny.path(&name);
        let child = training(&tiny, &name, &[]).spawn().unwrap();
        std::thread::sleep(whole * part / 12);
        interrupted += u32::from(kill(child));
        // Before the scene is in the folder there is no run to go on with, and the same command starts one.
        let resume: &[&str] = match run.join("scene.toml").exists() {
            true => &["--resume"],
            false => &[],
        };
        succeeds(&training(&tiny, &name, resume).output().unwrap());
        assert_same(&run, &expected);
        assert_eq!(names(&run), names(&expected), "files are left over");
    }
    assert!(interrupted >= 3, "only {interrupted} runs were caught");

    // And one run again and again, with ever more time, from its first file on.
    let run = tiny.path("often");
    let mut child = training(&tiny, "often", &[]).spawn().unwrap();
    wait_for(&run.join("scene.toml"), &mut child);
    let mut kills = u32::from(kill(child));
    while !run.join("evaluation/metrics.json").exists() {
        let child = training(&tiny, "often", &["--resume"]).spawn().unwrap();
        std::thread::sleep(whole * (kills + 1) / 10);
        kills += u32::from(kill(child));
        assert!(kills < 100, "no progress");
    }
    succeeds(&training(&tiny, "often", &["--resume"]).output().unwrap());
    assert!(kills >= 2, "only {kills}");
    assert_same(&run, &expected);
    assert_eq!(names(&run), names(&expected), "files are left over");
}

/// What a finished run is resumed to: itself.
#[test]
fn a_finished_run_stays_as_it_is() {
    let tiny = TinyScene::new(2, 1);
    let run = undisturbed(&tiny, "run");
    let before = [
        read(run.join("model.safetensors")),
        read(run.join("metrics.jsonl")),
    ];
    let old = results(&run);
    // The run holds its inputs itself.
    for name in ["ball.obj", "shapes.glb"] {
        std::fs::remove_file(tiny.path(name)).unwrap();
    }
    succeeds(&training(&tiny, "run", &["--resume"]).output().unwrap());
    let after = [
        read(run.join("model.safetensors")),
        read(run.join("metrics.jsonl")),
    ];
    assert!(before == after);
    assert_eq!(results(&run), old);
}

#[cfg(unix)]
#[test]
fn an_interrupt_saves_and_says_how_to_go_on() {
    let tiny = TinyScene::new(EPOCHS[0], EPOCHS[1]);
    let expected = undisturbed(&tiny, "undisturbed");
    // Rare checkpoints: what is resumed was saved by the interrupt.
    tiny.edit("checkpoint_seconds = 0", "checkpoint_seconds = 1000");
    for signal in ["-INT", "-TERM"] {
        let name = &signal[1..];
        let run = tiny.path(name);
        let mut child = training(&tiny, name, &[]).spawn().unwrap();
        wait_for(&run.join("metrics.jsonl"), &mut child);
        let sent = Command::new("kill")
            .args([signal, &child.id().to_string()])
            .status();
        assert!(sent.unwrap().success());
        let output = child.wait_with_output().unwrap();
        let said = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(130), "{said}");
        assert!(said.contains("--resume --out"), "{said}");
        assert!(said.contains(&run.display().to_string()), "{said}");
        assert!(!run.join("model.safetensors").exists());
        succeeds(&training(&tiny, name, &["--resume"]).output().unwrap());
        assert_same(&run, &expected);
    }
}

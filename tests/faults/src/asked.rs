//! kill -9 of what is asked of a trained run: evaluation, performance, fit and comparison.

use crate::same::{is_between, recorded, same};
use crate::setting::{Setting, Start, at, wait};
use crate::state::has_unfinished;
use crate::{Result, Verdict};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::ffi::OsStr;
use std::path::{Path, PathBuf};
use std::process::Child;
use std::time::{Duration, Instant};

/// Numbers of threads that have to give the same bytes.
const THREADS: [u32; 3] = [1, 2, 3];

/// Something that is asked of a run.
struct Question {
    name: &'static str,
    /// The command, before the run's folder.
    command: &'static str,
    /// What stands behind it.
    options: &'static [&'static str],
}

const QUESTIONS: [Question; 4] = [
    Question {
        name: "evaluation",
        command: "eval",
        options: &["--shapes", "other.glb", "--weights", "bend=0.5,turn=0.5"],
    },
    Question {
        name: "performance",
        command: "eval",
        options: &["--blend", "neutral:bend:6"],
    },
    Question {
        name: "fit",
        command: "eval",
        options: &["--shapes", "other.glb", "--fit", "--fit-steps", "4"],
    },
    Question {
        name: "comparison",
        command: "compare",
        options: &["--width", "16"],
    },
];

impl Question {
    fn ask(&self, setting: &Setting, run: &Path, threads: u32) -> Result<Child> {
        let mut arguments: Vec<&OsStr> = vec![self.command.as_ref(), run.as_os_str()];
        arguments.extend(self.options.iter().map(OsStr::new));
        let start = Start {
            threads: Some(threads),
            ..Start::default()
        };
        setting.spawn(&arguments, &start)
    }

    /// Asks a copy of the undisturbed run and waits for the end. Returns the copy, and how long it took.
    fn answered(&self, setting: &Setting, threads: u32) -> Result<(PathBuf, Duration)> {
        let run = setting.path(&format!("{}-{threads}", self.name));
        copy(setting.undisturbed(), &run)?;
        let clock = Instant::now();
        wait(self.ask(setting, &run, threads)?)?.succeeds()?;
        Ok((run, clock.elapsed()))
    }
}

/// What the kills met.
#[derive(Default)]
struct Met {
    count: u32,
    runs: u32,
    in_a_file: u32,
    between: u32,
}

/// Asks a copy of the undisturbed run each of four things on one, two and three threads, which has to change nothing but what it
/// is to write, and give the same bytes; then kills it `kills` times, each after a time that is uniform over the whole of it, with as many
/// threads as chance gives. After a kill every file has to be as it was, or as it will be; it is asked again until it comes to its end,
/// with the same bytes.
///
/// # Errors
/// When one of them fails, or a file is anything else.
pub fn kill_questions(setting: &Setting, kills: u32, seed: u64) -> Result<Verdict> {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let mut met = Met::default();
    for question in &QUESTIONS {
        let mut disturb = || kill_question(setting, question, kills, &mut random, &mut met);
        disturb().map_err(|e| format!("{}, seed {seed}: {e}", question.name))?;
    }
    let names = QUESTIONS.map(|question| question.name).join(", ");
    Ok(Verdict::Held(format!(
        "{} kills over {} runs of {names}; {} in the middle of a file, {} between two; on {THREADS:?} threads the same bytes",
        met.count, met.runs, met.in_a_file, met.between
    )))
}

fn kill_question(
    setting: &Setting,
    question: &Question,
    kills: u32,
    random: &mut ChaCha8Rng,
    met: &mut Met,
) -> Result<()> {
    let before = setting.undisturbed();
    let (after, whole) = question.answered(setting, THREADS[0])?;
    only_answers(before, &after)?;
    for threads in &THREADS[1..] {
        let (run, _) = question.answered(setting, *threads)?;
        same(&run, &after).map_err(|e| format!("{threads} threads: {e}"))?;
        std::fs::remove_dir_all(&run).map_err(at(&run))?;
    }
    let mut own = 0;
    while own < kills {
        let run = setting.path(question.name);
        copy(before, &run)?;
        loop {
            let mut child = question.ask(setting, &run, random.random_range(1..=3))?;
            if own < kills {
                std::thread::sleep(whole.mul_f64(random.random()));
                // Does nothing to a process that has ended.
                child.kill().map_err(|e| e.to_string())?;
            }
            if !wait(child)?.was_killed()? {
                break;
            }
            own += 1;
            let (new, all) = is_between(&run, before, &after)?;
            met.in_a_file += u32::from(has_unfinished(&run));
            met.between += u32::from(new > 0 && new < all);
        }
        same(&run, &after).map_err(|e| format!("after {own} kills: {e}"))?;
        std::fs::remove_dir_all(&run).map_err(at(&run))?;
        met.runs += 1;
    }
    met.count += own;
    Ok(())
}

/// Fails where an answer changed what is not its own: all but the folders of evaluations and comparisons.
fn only_answers(before: &Path, after: &Path) -> Result<()> {
    let [before, after] = [before, after].map(|run| {
        let mut all = recorded(run);
        all.retain(|path, _| !path.starts_with("evaluation") && !path.starts_with("comparison"));
        all
    });
    match before == after {
        true => Ok(()),
        false => Err("the run itself is another afterwards".into()),
    }
}

/// Copies a folder and all that is in it.
fn copy(from: &Path, to: &Path) -> Result<()> {
    std::fs::create_dir(to).map_err(at(to))?;
    for entry in std::fs::read_dir(from).map_err(at(from))? {
        let path = entry.map_err(at(from))?.path();
        let place = to.join(path.file_name().unwrap_or_default());
        match path.is_dir() {
            true => copy(&path, &place)?,
            false => std::fs::copy(&path, &place).map(drop).map_err(at(&path))?,
        }
    }
    Ok(())
}

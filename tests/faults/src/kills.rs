//! kill -9 at random moments, until there were enough.

use crate::setting::{Setting, Start, wait};
use crate::state::{PARTS, left};
use crate::{Result, Verdict};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::time::Duration;

/// One kill in so many comes right after a start.
const SOON: u32 = 5;
/// What "right after" means at most.
const AT_ONCE: Duration = Duration::from_millis(60);

/// What the kills met.
#[derive(Debug, Default, Clone, PartialEq, Eq)]
pub struct Kills {
    /// Kills that found a living process.
    pub count: u32,
    /// Runs that were brought to their end, all with the same bytes.
    pub runs: u32,
    /// Kills in each of [`PARTS`].
    pub parts: [u32; PARTS.len()],
    /// Kills that left a file unfinished.
    pub in_a_file: u32,
    /// Kills after lines of metrics that no checkpoint knew of.
    pub ahead: u32,
    /// The most kills that one run took.
    pub most: u32,
}

impl Kills {
    /// The same for people.
    pub fn verdict(&self) -> Verdict {
        let parts = PARTS.iter().zip(self.parts);
        let parts: Vec<String> = parts.map(|(name, n)| format!("{name} {n}")).collect();
        Verdict::Held(format!(
            "{} kills over {} runs, at most {} in one; {}; {} in the middle of a file, {} between metrics and checkpoint",
            self.count,
            self.runs,
            self.most,
            parts.join(", "),
            self.in_a_file,
            self.ahead
        ))
    }
}

/// Kills trainings until it was done `wanted` times, each after a time that is uniform over a whole run or, where a run is resumed, over
/// half of one and a little more with every kill; goes on with each until it ends, on one to three threads, and compares it. The seed settles the times; `told` hears of every run that ended.
///
/// # Errors
/// When a training fails, a checkpoint is damaged, or a run ends with other bytes.
pub fn kill_trainings(
    setting: &Setting,
    wanted: u32,
    seed: u64,
    mut told: impl FnMut(&Kills),
) -> Result<Kills> {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let mut kills = Kills::default();
    while kills.count < wanted {
        let run = setting.path(&format!("run-{}", kills.runs));
        let mut own = 0;
        loop {
            let start = Start {
                threads: Some(random.random_range(1..=3)),
                ..Start::default()
            };
            if kills.count == wanted {
                setting.finish(&run, &start)?;
                break;
            }
            let whole = setting.whole();
            let longest = match (random.random_ratio(1, SOON), own) {
                (true, _) => AT_ONCE.min(whole),
                (_, 0) => whole,
                // Longer and longer, for a machine that has more to do than when the undisturbed run was timed.
                _ => whole.mul_f64(0.5 + 0.1 * f64::from(own)),
            };
            let after = longest.mul_f64(random.random());
            let mut child = setting.start(&run, &start)?;
            std::thread::sleep(after);
            // Does nothing to a process that has ended.
            child.kill().map_err(|e| e.to_string())?;
            let ended = wait(child)?;
            if !ended.was_killed()? {
                break;
            }
            own += 1;
            kills.count += 1;
            let left = left(&run)?;
            kills.parts[left.part] += 1;
            kills.in_a_file += u32::from(left.is_in_a_file);
            kills.ahead += u32::from(left.is_ahead);
        }
        setting
            .compare(&run)
            .map_err(|e| format!("after {own} kills, seed {seed}, run {}: {e}", kills.runs))?;
        std::fs::remove_dir_all(&run).map_err(|e| e.to_string())?;
        kills.runs += 1;
        kills.most = kills.most.max(own);
        told(&kills);
    }
    Ok(kills)
}

//! A run folder that becomes read-only while a training works in it.

use crate::disk::tells;
use crate::setting::{Setting, Start, at, wait};
use crate::state::left;
use crate::{Result, Verdict};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::os::unix::fs::{MetadataExt, PermissionsExt, chown};
use std::path::Path;

/// A user without any rights: leave to write does not bind the superuser.
const NOBODY: u32 = 65_534;

/// Takes the leave to write at `times` random moments of as many trainings, and looks at the error and at what is left; gives it back, goes on
/// and compares. The superuser has another user train.
///
/// # Errors
/// When an error does not say what to do, something was lost, or a run ends with other bytes.
pub fn take_leave(setting: &Setting, times: u32, seed: u64) -> Result<Verdict> {
    let runs = setting.path("runs");
    std::fs::create_dir(&runs).map_err(at(&runs))?;
    let is_superuser = std::fs::metadata(&runs).map_err(at(&runs))?.uid() == 0;
    let mut start = Start::default();
    if is_superuser {
        if let Err(error) = chown(&runs, Some(NOBODY), Some(NOBODY)) {
            return Ok(Verdict::Skipped(format!("no other user: {error}")));
        }
        start.user = Some(NOBODY);
    }
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let mut errors = 0;
    for i in 0..times {
        let run = runs.join(format!("run-{i}"));
        let after = setting.whole().mul_f64(random.random_range(0.1..0.8));
        let child = match setting.start(&run, &start) {
            Err(reason) if is_superuser => return Ok(Verdict::Skipped(reason)),
            child => child?,
        };
        std::thread::sleep(after);
        allow(&run, false)?;
        let ended = wait(child)?;
        // A training may have written its last before.
        if !ended.status.success() {
            let error = ended.error()?;
            let place = run.display().to_string();
            tells(
                error,
                [
                    place.as_str(),
                    "Permission denied",
                    "leave to read and write",
                ],
            )?;
            if run.join("scene.toml").exists() {
                tells(error, ["--resume --out"])?;
            }
            left(&run)?;
            errors += 1;
            // As long as it is so, going on is refused, and changes nothing.
            let again = wait(setting.start_as(&run, &start, true)?)?;
            tells(again.error()?, [place.as_str()])?;
        }
        allow(&run, true)?;
        setting.conclude(&run, &start)?;
    }
    Ok(Verdict::Held(format!(
        "{times} trainings, {errors} ended by a folder that became read-only, with an error that says so, and resumed{}",
        if is_superuser {
            "; as another user"
        } else {
            ""
        }
    )))
}

/// Gives or takes the leave to write into a folder and those below it.
fn allow(folder: &Path, is_allowed: bool) -> Result<()> {
    let mode = if is_allowed { 0o755 } else { 0o555 };
    let set = |path: &Path| {
        let mode = std::fs::Permissions::from_mode(mode);
        std::fs::set_permissions(path, mode).map_err(at(path))
    };
    if !folder.exists() {
        return Ok(());
    }
    set(folder)?;
    let entries = std::fs::read_dir(folder).map_err(at(folder))?;
    for path in entries.flatten().map(|entry| entry.path()) {
        if path.is_dir() {
            allow(&path, is_allowed)?;
        }
    }
    Ok(())
}

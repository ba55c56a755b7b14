//! A disk that becomes full while a training writes to it: a small tmpfs, where the user may mount one.

use crate::setting::{Setting, Start, at, wait};
use crate::state::left;
use crate::{Result, Verdict};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::io::{ErrorKind, Write};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

/// A mounted tmpfs; unmounted when it is dropped.
struct Disk(PathBuf);

impl Disk {
    /// Mounts so many bytes on a new folder.
    ///
    /// # Errors
    /// Says why this user cannot.
    fn new(folder: PathBuf, bytes: usize) -> Result<Self> {
        std::fs::create_dir(&folder).map_err(at(&folder))?;
        let options = format!("size={bytes},mode=755");
        let done = Command::new("mount")
            .args(["-t", "tmpfs", "-o", &options, "tmpfs"])
            .arg(&folder)
            .stdin(Stdio::null())
            .output();
        match done {
            Ok(output) if output.status.success() => Ok(Self(folder)),
            Ok(output) => Err(String::from_utf8_lossy(&output.stderr).trim().to_string()),
            Err(error) => Err(format!("mount: {error}")),
        }
    }

    fn filler(&self) -> PathBuf {
        self.0.join("filler")
    }

    /// Takes all space that is left.
    fn fill(&self) -> Result<()> {
        let path = self.filler();
        let mut file = std::fs::File::create(&path).map_err(at(&path))?;
        // By whole pages, and then again: the training frees and takes pages meanwhile.
        let page = [0_u8; 4096];
        let mut refused = 0;
        while refused < 50 {
            match file.write_all(&page) {
                Ok(()) => {}
                Err(error) if error.kind() == ErrorKind::StorageFull => {
                    refused += 1;
                    std::thread::sleep(std::time::Duration::from_millis(1));
                }
                Err(error) => return Err(at(&path)(error)),
            }
        }
        Ok(())
    }

    fn free(&self) -> Result<()> {
        let path = self.filler();
        std::fs::remove_file(&path).map_err(at(&path))
    }
}

impl Drop for Disk {
    fn drop(&mut self) {
        let unmounted = Command::new("umount").arg(&self.0).status();
        if !unmounted.is_ok_and(|status| status.success()) {
            eprintln!("note: {} is still mounted", self.0.display());
        }
    }
}

/// Fills the disk at `times` random moments of as many trainings, and looks at the error and at what is left; makes room, goes on and
/// compares. Before these, a disk that is too small for the first file.
///
/// # Errors
/// When an error does not say what to do, something was lost, or a run ends with other bytes.
pub fn fill_disks(setting: &Setting, times: u32, seed: u64) -> Result<Verdict> {
    let small = match Disk::new(setting.path("small-disk"), 8 << 10) {
        Ok(disk) => disk,
        Err(reason) => return Ok(Verdict::Skipped(format!("no tmpfs: {reason}"))),
    };
    let run = small.0.join("run");
    let ended = wait(setting.start(&run, &Start::default())?)?;
    says_what_to_do(ended.error()?, &run, false)?;
    if run.join("scene.toml").exists() {
        return Err("half a run was made on a disk that is too small for one".into());
    }
    drop(small);

    let room = 4 * setting.size().1;
    let disk = Disk::new(setting.path("disk"), room)?;
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let (mut errors, mut resumed) = (1, 0);
    for i in 0..times {
        let run = disk.0.join(format!("run-{i}"));
        let after = setting.whole().mul_f64(random.random_range(0.05..0.9));
        let child = setting.start(&run, &Start::default())?;
        std::thread::sleep(after);
        disk.fill()?;
        let ended = wait(child)?;
        // A training may have written its last before.
        if !ended.status.success() {
            let is_run = run.join("scene.toml").exists();
            says_what_to_do(ended.error()?, &run, is_run)?;
            left(&run)?;
            errors += 1;
            resumed += u32::from(is_run);
        }
        disk.free()?;
        setting.conclude(&run, &Start::default())?;
    }
    Ok(Verdict::Held(format!(
        "{} trainings, {errors} ended by a full disk with an error that says so, {resumed} of them resumed",
        times + 1
    )))
}

fn says_what_to_do(error: &str, run: &Path, is_run: bool) -> Result<()> {
    let place = run.display().to_string();
    let parts = [place.as_str(), "No space left", "free some space"];
    let how = is_run.then_some("--resume --out");
    tells(error, parts.into_iter().chain(how))
}

/// Fails unless an error has all these parts.
pub(crate) fn tells<'a>(error: &str, parts: impl IntoIterator<Item = &'a str>) -> Result<()> {
    match parts.into_iter().find(|part| !error.contains(part)) {
        None => Ok(()),
        Some(part) => Err(format!("an error does not say `{part}`: {error}")),
    }
}

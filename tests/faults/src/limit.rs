//! A limit on the size of files, as a full disk for everybody: `ulimit -f` needs no leave.

use crate::disk::tells;
use crate::setting::{Setting, Start, wait};
use crate::state::left;
use crate::{Result, Verdict};
use std::os::unix::process::ExitStatusExt;

/// What a shell counts file sizes in.
const BLOCK: usize = 512;
const SIGXFSZ: i32 = 25;

/// Trains below `count` limits, spread over the sizes of the files of a run; once with the signal ignored, so that the program sees an error,
/// and once as the system does it, which is one more way to be killed. Goes on without the limit and compares.
///
/// # Errors
/// When an error does not say what to do, something was lost, or a run ends with other bytes.
pub fn limit_files(setting: &Setting, count: usize) -> Result<Verdict> {
    let (mut errors, mut killed) = (0, 0);
    for i in 0..count {
        let blocks = setting.largest() * (2 * i + 1) / (2 * count) / BLOCK;
        for is_ignored in [true, false] {
            let run = setting.path(&format!("limit-{i}-{is_ignored}"));
            let trap = if is_ignored { "trap '' XFSZ; " } else { "" };
            let start = Start {
                shell: Some(format!("{trap}ulimit -c 0; ulimit -f {blocks}")),
                ..Start::default()
            };
            let ended = wait(setting.start(&run, &start)?)?;
            if is_ignored {
                let error = ended.error()?;
                tells(error, ["File too large", "ulimit -f", "cannot write"])?;
                if run.join("scene.toml").exists() {
                    tells(error, ["--resume --out"])?;
                }
                errors += 1;
            } else if ended.status.signal() == Some(SIGXFSZ) {
                killed += 1;
            } else {
                return Err(format!("no signal ended it: {}", ended.status));
            }
            left(&run)?;
            setting.conclude(&run, &Start::default())?;
        }
    }
    Ok(Verdict::Held(format!(
        "{count} limits: {errors} trainings ended by an error that says so, {killed} by the signal, all resumed"
    )))
}

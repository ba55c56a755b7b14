//! A second training in a folder where one is at work.

use crate::disk::tells;
use crate::setting::{Setting, Start, wait};
use crate::{Result, Verdict};
use std::time::Duration;

/// Starts second trainings, to resume and anew, into a folder that a first one works in; both are refused, and the first one is not disturbed.
/// Then kills one and goes on: the lock that it left holds nobody back.
///
/// # Errors
/// When one is not refused, or the first run ends with other bytes.
pub fn train_twice(setting: &Setting) -> Result<Verdict> {
    let run = setting.path("shared");
    let mut first = setting.start(&run, &Start::default())?;
    while !run.join("scene.toml").exists() {
        if first.try_wait().map_err(|e| e.to_string())?.is_some() {
            return Err(format!("the first ended: {}", wait(first)?.said));
        }
        std::thread::sleep(Duration::from_millis(1));
    }
    for is_resumed in [true, false] {
        let second = wait(setting.start_as(&run, &Start::default(), is_resumed)?)?;
        let place = run.display().to_string();
        tells(
            second.error()?,
            [
                place.as_str(),
                "another process works on this run",
                "wait for it",
            ],
        )?;
    }
    if first.try_wait().map_err(|e| e.to_string())?.is_some() {
        return Err("the first ended before the second was refused: it has to be longer".into());
    }
    first.kill().map_err(|e| e.to_string())?;
    wait(first)?;
    if !run.join(".lock").exists() {
        return Err("a killed training leaves a lock".into());
    }
    setting.conclude(&run, &Start::default())?;
    Ok(Verdict::Held(
        "2 second trainings refused; a lock left by kill -9 holds nobody back".into(),
    ))
}

//! What the operating system tells: peak memory and load. Absent where it does not (anything but Linux).

use std::fs;

/// Sets the peak of this process's memory back to what it holds now. Without the right to do so the peak stays that of the whole
/// life of the process, which is no smaller.
pub fn reset_peak() {
    // The result is of no use: there is nothing to fall back on.
    fs::write("/proc/self/clear_refs", "5").ok();
}

/// Peak resident memory of this process in MB (2^20 bytes) since the last reset.
pub fn peak_megabytes() -> Option<f64> {
    let status = fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find(|line| line.starts_with("VmHWM:"))?;
    let kilobytes: f64 = line.split_whitespace().nth(1)?.parse().ok()?;
    Some(kilobytes / 1024.0)
}

/// Processes that wanted a core, averaged over the last minute.
pub fn load() -> Option<f64> {
    let text = fs::read_to_string("/proc/loadavg").ok()?;
    text.split_whitespace().next()?.parse().ok()
}

/// The name of the processor.
pub fn processor() -> Option<String> {
    let text = fs::read_to_string("/proc/cpuinfo").ok()?;
    let line = text.lines().find(|line| line.starts_with("model name"))?;
    Some(line.split_once(':')?.1.trim().to_string())
}

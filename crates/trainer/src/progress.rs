//! Progress for people: bars on a terminal, a line now and then elsewhere; and the request to stop.

use indicatif::{ProgressBar, ProgressStyle};
use std::io::IsTerminal;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};
use surface_mesh::printable;

/// Between lines where there is no terminal.
const QUIET: Duration = Duration::from_secs(10);

/// One phase of work with a known number of steps.
pub struct Phase {
    bar: ProgressBar,
    plain: bool,
    last_line: Instant,
    name: String,
    started: Instant,
}

impl Phase {
    /// Starts a phase; `done` steps were done before.
    pub fn new(name: &str, steps: u64, done: u64) -> Self {
        let bar = ProgressBar::new(steps);
        let style = "{prefix:>12} {bar:32} {pos}/{len}  {msg}  {eta} left";
        bar.set_style(ProgressStyle::with_template(style).expect("a valid template"));
        bar.set_prefix(name.to_string());
        bar.set_position(done);
        bar.reset_eta();
        Self {
            bar,
            plain: !std::io::stderr().is_terminal(),
            last_line: Instant::now(),
            name: name.to_string(),
            started: Instant::now(),
        }
    }

    /// One more step is done; `message` tells how it went.
    pub fn step(&mut self, message: impl FnOnce() -> String) {
        self.bar.inc(1);
        if self.plain {
            if self.last_line.elapsed() >= QUIET {
                self.last_line = Instant::now();
                let (at, of) = (self.bar.position(), self.bar.length().unwrap_or(0));
                let left = self.bar.eta().as_secs();
                let message = message();
                let message = printable(&message);
                eprintln!("{:>12} {at}/{of}  {message}  {left} s left", self.name);
            }
        } else {
            self.bar.set_message(printable(&message()).into_owned());
        }
    }

    /// Ends the phase with a last word.
    pub fn finish(self, message: &str) {
        let message = format!(
            "{} ({:.1} s)",
            printable(message),
            self.started.elapsed().as_secs_f64()
        );
        if self.plain {
            eprintln!("{:>12} {message}", self.name);
        } else {
            let done =
                ProgressStyle::with_template("{prefix:>12} {msg}").expect("a valid template");
            self.bar.set_style(done);
            self.bar.finish_with_message(message);
        }
    }
}

/// Says something that the user may want to know and need not act on.
pub fn note(message: &str) {
    eprintln!("{:>12} {}", "note", printable(message));
}

static STOP: AtomicBool = AtomicBool::new(false);

/// Lets Ctrl-C and SIGTERM ask the work to stop at the next step; a second one stops at once.
pub fn stop_on_signal() {
    // Fails only if a handler is set already, which then does the same.
    let _ = ctrlc::set_handler(|| {
        if STOP.swap(true, Ordering::SeqCst) {
            std::process::exit(130);
        }
        eprintln!("\nstopping after this step; once more to stop at once");
    });
}

/// Whether the user asked to stop.
pub fn stop_requested() -> bool {
    STOP.load(Ordering::SeqCst)
}

//! One execution of a reader, with an eye on panics, time and memory.

use std::alloc::System;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::{Mutex, MutexGuard, Once, PoisonError};
use std::time::{Duration, Instant};

use cap::Cap;
use peakmem_alloc::{PeakMemAlloc, PeakMemAllocTrait};

use crate::{Outcome, Target};

/// Memory that this process never goes beyond: a reader that asks for more ends it, before the machine suffers.
const MOST_MEMORY: usize = 2 << 30;

/// How long a reader may take for an input.
pub const LONGEST: Duration = Duration::from_secs(1);

#[global_allocator]
static MEMORY: PeakMemAlloc<Cap<System>> = PeakMemAlloc::new(Cap::new(System, MOST_MEMORY));

/// What a reader did that no input may make it do.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Harm {
    /// It panicked: the message and its place.
    Panic(String),
    /// It took longer than [`LONGEST`].
    Slow(Duration),
    /// It held more memory at once than the target allows.
    Memory {
        /// The most bytes that it held at once.
        peak: usize,
        /// How many it may.
        allowed: usize,
    },
}

impl Harm {
    /// What harms of one cause have in common: the place of a panic, else the kind.
    pub fn cause(&self) -> String {
        match self {
            Self::Panic(message) => message.lines().next().unwrap_or_default().to_string(),
            Self::Slow(_) => "slow".into(),
            Self::Memory { .. } => "memory".into(),
        }
    }
}

impl std::fmt::Display for Harm {
    fn fmt(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
        match self {
            Self::Panic(message) => write!(f, "panicked at {message}"),
            Self::Slow(time) => write!(f, "took {:.2} s", time.as_secs_f64()),
            Self::Memory { peak, allowed } => {
                write!(f, "held {peak} bytes at once, {allowed} are allowed")
            }
        }
    }
}

/// How an execution went.
#[derive(Debug)]
pub struct Executed {
    /// What the reader said, or the harm it did.
    pub result: Result<Outcome, Harm>,
    /// How long it took.
    pub time: Duration,
    /// The most bytes that it held at once.
    pub peak: usize,
}

/// Memory is counted for the process: executions take turns.
fn turn() -> MutexGuard<'static, ()> {
    static TURN: Mutex<()> = Mutex::new(());
    TURN.lock().unwrap_or_else(PoisonError::into_inner)
}

/// What the last panic said, with its place first.
static PANIC: Mutex<String> = Mutex::new(String::new());

thread_local! {
    /// Whether this thread is inside a reader.
    static WATCHED: std::cell::Cell<bool> = const { std::cell::Cell::new(false) };
}

/// Keeps what panics of readers say instead of printing it.
fn keep_panics() {
    static ONCE: Once = Once::new();
    ONCE.call_once(|| {
        let usual = std::panic::take_hook();
        std::panic::set_hook(Box::new(move |info| {
            if !WATCHED.get() {
                return usual(info);
            }
            let place = info.location().map(ToString::to_string).unwrap_or_default();
            let message = info.payload_as_str().unwrap_or("(no message)");
            *PANIC.lock().unwrap_or_else(PoisonError::into_inner) = format!("{place}\n{message}");
        }));
    });
}

/// Runs a target's reader on an input. A slow one gets a second chance, as other work on the machine may have been in its way.
///
/// An abort, as after a stack overflow or where more than 2 GiB are asked for, ends the process.
pub fn execute(target: &Target, input: &[u8]) -> Executed {
    let first = execute_once(target, input);
    match first.result {
        Err(Harm::Slow(_)) => execute_once(target, input),
        _ => first,
    }
}

fn execute_once(target: &Target, input: &[u8]) -> Executed {
    keep_panics();
    let _turn = turn();
    MEMORY.reset_peak_memory();
    let start = Instant::now();
    WATCHED.set(true);
    let ended = catch_unwind(AssertUnwindSafe(|| (target.read)(input)));
    WATCHED.set(false);
    let time = start.elapsed();
    let peak = MEMORY.get_peak_memory();
    let allowed = (target.allowance)(input);
    let result = match ended {
        Err(_) => {
            let said = PANIC.lock().unwrap_or_else(PoisonError::into_inner);
            Err(Harm::Panic(said.clone()))
        }
        Ok(_) if time > LONGEST => Err(Harm::Slow(time)),
        Ok(_) if peak > allowed => Err(Harm::Memory { peak, allowed }),
        Ok(outcome) => Ok(outcome),
    };
    Executed { result, time, peak }
}

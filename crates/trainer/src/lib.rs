//! Trains, evaluates and simulates neural muscle fields.
//!
//! A [`scene::Scene`] says what a body is made of and which shapes it is to learn; [`train::train`] turns it into a run folder;
//! [`evaluate::evaluate`] simulates and measures what was learned; [`performance::perform`] turns curves of weights into an animation;
//! [`fit::fit`] fits codes to shapes that none describes; [`compare::compare`] sets the field beside linear blendshapes and an explicit decoder; [`solve::solve`] makes the solver usable by itself. The program
//! `myofield` is a command line over these.

/// Compiles the examples of the README.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;

pub mod actuator;
pub mod balance;
pub mod body;
pub mod checkpoint;
pub mod compare;
mod curves;
pub mod dial;
mod draw;
pub mod dynamics;
pub mod error;
pub mod evaluate;
mod failures;
pub mod files;
pub mod fit;
#[cfg(test)]
mod fixture;
pub mod focus;
pub mod frames;
mod generated;
mod geometry;
pub mod grid;
pub mod hanging;
mod inversion;
pub mod loss;
mod matching;
pub mod motion;
pub mod npy;
pub mod performance;
mod progress;
pub mod props;
pub mod rig;
pub mod run;
pub mod scene;
pub mod shapes;
pub mod sheets;
pub mod simulate;
pub mod simulator;
pub mod solve;
pub mod stage1;
pub mod stage2;
pub mod table;
pub mod train;
pub mod trained;
pub mod units;
pub mod weights;

pub use error::{Result, TrainerError};
pub use progress::{stop_on_signal, stop_requested};

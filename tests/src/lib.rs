//! What the tests of the program `myofield` share: how to run it, and a scene so small that it trains in a moment.

mod place;
mod program;
mod tiny;

pub use place::Place;
pub use program::{Ran, check, program, refused_and_unchanged, tree};
pub use tiny::{TinyScene, bent, targets};

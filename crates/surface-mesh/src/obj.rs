//! The OBJ format.

mod problem;
mod read;
mod write;

pub use problem::ObjProblem;
pub use read::{parse_obj, read_obj};
pub use write::write_obj;

//! The OBJ format.

mod problem;
mod read;
mod write;

pub use problem::ObjProblem;
pub use read::read_obj;
pub use write::write_obj;

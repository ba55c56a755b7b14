//! The OBJ format.

mod read;
mod write;

pub use read::read_obj;
pub use write::write_obj;

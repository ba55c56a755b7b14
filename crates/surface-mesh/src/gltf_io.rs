//! The glTF 2.0 format, as `.gltf` and `.glb`.

mod accessor;
mod animation;
mod buffers;
mod placement;
mod problem;
mod read;
mod write;

pub use animation::{AnimationProblem, FrameAnimation, write_animated_glb};
pub use problem::GltfProblem;
pub use read::{parse_gltf, read_gltf};
pub use write::write_glb;

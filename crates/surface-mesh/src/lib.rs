#![doc = include_str!("../README.md")]

mod closest;
mod error;
mod gltf_io;
mod morph;
mod normals;
mod obj;
mod ply;
pub mod primitives;
mod printable;
mod read;
mod report;
mod self_intersections;
mod separate;
mod surface;
mod whole_file;

pub use closest::{ClosestPoint, ClosestPoints};
pub use error::SurfaceError;
pub use gltf_io::{
    AnimationProblem, FrameAnimation, GltfProblem, parse_gltf, read_gltf, write_animated_glb,
    write_glb,
};
pub use morph::{MorphTarget, MorphedSurface};
pub use normals::{vertex_normals, vertex_normals_vjp};
pub use obj::{ObjProblem, parse_obj, read_obj, write_obj};
pub use ply::{PlyAttributes, write_ply};
pub use printable::printable;
pub use read::read_surface;
pub use report::{Component, Edge, SurfaceReport, report};
pub use self_intersections::self_intersections;
pub use separate::{Separation, separate};
pub use surface::Surface;

//! Draws a mesh file (OBJ, glTF or GLB) from the front.
//!
//! ```text
//! cargo run --release -p report --example picture -- MESH PICTURE.png
//! ```

use nalgebra::Vector3;
use report::{CLAY, Camera, Colours, Mesh, render};
use std::error::Error;

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<_> = std::env::args_os().skip(1).collect();
    let [mesh_path, picture_path] = arguments.as_slice() else {
        return Err("usage: picture MESH PICTURE.png".into());
    };
    let surface = surface_mesh::read_surface(mesh_path)?.surface;
    let direction = Vector3::new(-0.35, -0.12, -1.0);
    let camera = Camera::framing_perspective(surface.vertices(), direction, Vector3::y(), 0.35)?;
    let mesh = Mesh {
        vertices: surface.vertices(),
        triangles: surface.triangles(),
        colours: Colours::Uniform(CLAY),
    };
    render(&mesh, &camera, 800, 800)?.write_png(picture_path)?;
    Ok(())
}

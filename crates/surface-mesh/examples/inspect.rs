//! Prints what is wrong with a surface file, and its morph targets: `cargo run --release --example inspect -- face.glb`.
//! Without a file it inspects a sphere that misses a triangle.

use std::process::ExitCode;

use surface_mesh::{
    MorphTarget, MorphedSurface, Surface, SurfaceError, primitives, read_surface, report,
};

fn main() -> ExitCode {
    let file = std::env::args_os().nth(1);
    let (name, surface) = match &file {
        Some(file) => (file.to_string_lossy(), read_surface(file)),
        None => ("a sphere with a hole".into(), sphere_with_a_hole()),
    };
    match surface {
        Ok(morphed) => {
            println!("{name}: {}", report(&morphed.surface));
            for target in &morphed.targets {
                println!("  {}", summary(target));
            }
            ExitCode::SUCCESS
        }
        Err(error) => {
            eprintln!("{error}");
            ExitCode::FAILURE
        }
    }
}

fn summary(target: &MorphTarget) -> String {
    let lengths = || target.deltas.iter().map(|delta| delta.norm());
    let moved = lengths().filter(|&length| length > 0.0).count();
    let most = lengths().fold(0.0, f64::max);
    format!(
        "target {}: moves {moved} vertices, by {most:.3} at most",
        target.name
    )
}

fn sphere_with_a_hole() -> Result<MorphedSurface, SurfaceError> {
    let sphere = primitives::icosphere(2, 1.0);
    let deltas = sphere.vertices().iter().map(|v| v * v.y.max(0.0)).collect();
    let surface =
        Surface::from_triangles(sphere.vertices().to_vec(), sphere.triangles()[1..].to_vec())?;
    let name = "upper half swells".into();
    MorphedSurface::new(surface, vec![MorphTarget { name, deltas }])
}

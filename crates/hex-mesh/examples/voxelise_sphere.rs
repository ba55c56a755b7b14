//! Voxelises a sphere at falling element sizes and prints what was found: `cargo run --release --example voxelise_sphere`.

use hex_mesh::{HexMeshError, VoxelOptions, voxelise};
use surface_mesh::primitives::icosphere;

fn main() -> Result<(), HexMeshError> {
    let surface = icosphere(5, 1.0);
    for element_size in [0.2, 0.1, 0.05, 0.025] {
        let body = voxelise(&surface, &VoxelOptions::new(element_size))?;
        let skin = body.embed_surface(&surface)?;
        println!("{}", body.report);
        println!(
            "skin: {} points, at most {:.3} outside\n",
            skin.len(),
            skin.max_outside_distance()
        );
    }
    Ok(())
}

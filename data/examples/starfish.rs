//! Writes the default starfish and some poses of it as OBJ files: `starfish FOLDER`.

use std::error::Error;
use std::path::PathBuf;

use scene_shapes::{ArmPose, StarfishPose, StarfishShape, pose, starfish};
use surface_mesh::write_obj;

fn main() -> Result<(), Box<dyn Error>> {
    let folder: PathBuf = std::env::args_os()
        .nth(1)
        .ok_or("say where to write: starfish FOLDER")?
        .into();
    std::fs::create_dir_all(&folder)?;
    let shape = StarfishShape::default();
    let surface = starfish(&shape)?;
    write_obj(folder.join("starfish.obj"), &surface)?;
    println!(
        "starfish.obj: {} vertices, {} triangles, volume {:.4}",
        surface.vertex_count(),
        surface.triangles().len(),
        surface.signed_volume()
    );
    for (name, arms) in poses() {
        let vertices = pose(&shape, &StarfishPose { arms }, surface.vertices());
        let posed = surface.with_vertices(vertices)?;
        println!("{name}.obj: volume {:.4}", posed.signed_volume());
        write_obj(folder.join(format!("{name}.obj")), &posed)?;
    }
    Ok(())
}

fn poses() -> Vec<(&'static str, Vec<ArmPose>)> {
    let straight = ArmPose::default();
    let curl = |curl| ArmPose { curl, ..straight };
    let lift = |lift| ArmPose { lift, ..straight };
    let twist = |twist| ArmPose { twist, ..straight };
    let sway = |sway| ArmPose { sway, ..straight };
    vec![
        ("curled", vec![curl(90.0); 5]),
        ("lifted", vec![lift(50.0), straight, lift(30.0)]),
        ("twisted", vec![twist(120.0), straight, twist(-90.0)]),
        ("swayed", vec![sway(40.0); 5]),
        (
            "walking",
            vec![
                ArmPose {
                    lift: 40.0,
                    curl: -60.0,
                    sway: 15.0,
                    twist: 0.0,
                },
                curl(-25.0),
                sway(-25.0),
                curl(100.0),
                sway(25.0),
            ],
        ),
        (
            "extreme",
            vec![
                ArmPose {
                    curl: 120.0,
                    sway: 40.0,
                    twist: 120.0,
                    lift: 60.0
                };
                5
            ],
        ),
    ]
}

//! An open box is closed, and the motion of four teeth is found again.

use import::{close_holes, fit_rigid};
use nalgebra::{Rotation3, Vector3};
use surface_mesh::Surface;
use surface_mesh::primitives::icosphere;

fn main() -> import::Result<()> {
    let ball = icosphere(2, 1.0);
    let upper = ball
        .polygons()
        .filter(|polygon| {
            polygon
                .iter()
                .all(|&c| ball.vertices()[c as usize].y > -0.5)
        })
        .map(<[u32]>::to_vec)
        .collect();
    let open = Surface::from_polygons(ball.vertices().to_vec(), upper)?;
    let closed = close_holes(&open, "the cut ball")?;
    println!(
        "a hole of {} corners closed: volume {:.3}, that of the whole ball is {:.3}",
        closed.holes[0].len(),
        closed.surface.signed_volume(),
        ball.signed_volume()
    );

    let teeth = [
        [-2.0, -3.0, 8.0],
        [2.0, -3.0, 8.0],
        [0.0, -3.0, 9.0],
        [0.0, -2.0, 8.5],
    ]
    .map(Vector3::from);
    let turn = Rotation3::from_axis_angle(&Vector3::x_axis(), 0.4);
    let opened = teeth.map(|tooth| turn * tooth + Vector3::new(0.0, 0.7, 0.4));
    let fit = fit_rigid(&teeth, &opened)?;
    println!(
        "the teeth turned by {:.3} rad, residual {:.1e}",
        Rotation3::from_matrix_unchecked(fit.rotation).angle(),
        fit.residual_max
    );
    Ok(())
}

//! What an import does to every mesh: closing its holes, and fitting the motion of the teeth.

use criterion::{Criterion, criterion_group, criterion_main};
use import::{close_holes, fit_rigid};
use nalgebra::{Rotation3, Vector3};
use surface_mesh::Surface;
use surface_mesh::primitives::icosphere;

fn benches(criterion: &mut Criterion) {
    let ball = icosphere(5, 1.0);
    let upper = ball
        .polygons()
        .filter(|polygon| {
            polygon
                .iter()
                .all(|&c| ball.vertices()[c as usize].y > -0.5)
        })
        .map(<[u32]>::to_vec)
        .collect();
    let open = Surface::from_polygons(ball.vertices().to_vec(), upper).expect("a cut ball");
    criterion.bench_function("close a ball of 20,480 triangles", |b| {
        b.iter(|| close_holes(&open, "the cut ball").expect("one hole"));
    });
    let turn = Rotation3::from_axis_angle(&Vector3::x_axis(), 0.4);
    let turned: Vec<Vector3<f64>> = ball.vertices().iter().map(|v| turn * v).collect();
    criterion.bench_function("rigid motion of 10,242 points", |b| {
        b.iter(|| fit_rigid(ball.vertices(), &turned).expect("as many points"));
    });
}

criterion_group!(all, benches);
criterion_main!(all);

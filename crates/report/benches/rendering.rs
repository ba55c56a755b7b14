//! Time of one 800 x 800 picture of a mesh as fine as a scanned face.

use criterion::{Criterion, criterion_group, criterion_main};
use nalgebra::Vector3;
use report::{CLAY, Camera, Colours, Mesh, render};
use std::hint::black_box;

/// A wavy grid of 2 x 119 x 118 = 28,084 triangles.
fn face_sized() -> (Vec<Vector3<f64>>, Vec<[u32; 3]>) {
    const COLUMNS: u32 = 119;
    const ROWS: u32 = 118;
    let mut vertices = Vec::new();
    for row in 0..=ROWS {
        for column in 0..=COLUMNS {
            let (x, y) = (
                f64::from(column) / f64::from(COLUMNS),
                f64::from(row) / f64::from(ROWS),
            );
            vertices.push(Vector3::new(x, y, 0.1 * (9.0 * x).sin() * (7.0 * y).cos()));
        }
    }
    let mut triangles = Vec::new();
    for row in 0..ROWS {
        for column in 0..COLUMNS {
            let corner = row * (COLUMNS + 1) + column;
            let above = corner + COLUMNS + 1;
            triangles.push([corner, corner + 1, above + 1]);
            triangles.push([corner, above + 1, above]);
        }
    }
    (vertices, triangles)
}

fn picture(criterion: &mut Criterion) {
    let (vertices, triangles) = face_sized();
    let camera = Camera::framing(&vertices, Vector3::new(-0.3, -0.2, -1.0), Vector3::y())
        .expect("the view is proper");
    let mesh = Mesh {
        vertices: &vertices,
        triangles: &triangles,
        colours: Colours::Uniform(CLAY),
    };
    criterion.bench_function("28k triangles at 800 x 800", |bencher| {
        bencher.iter(|| render(black_box(&mesh), &camera, 800, 800));
    });
}

criterion_group!(benches, picture);
criterion_main!(benches);

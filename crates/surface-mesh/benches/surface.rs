//! Reading, normals and the report, on a sphere of 10,242 vertices and 20,480 triangles with 40 morph targets that move a
//! fifth of the vertices each: about the size of a face.

use std::hint::black_box;

use criterion::{Criterion, criterion_group, criterion_main};
use nalgebra::Vector3;
use surface_mesh::{
    MorphTarget, MorphedSurface, primitives, read_gltf, read_obj, report, vertex_normals,
    vertex_normals_vjp, write_glb, write_obj,
};

fn face_sized() -> MorphedSurface {
    let surface = primitives::icosphere(5, 10.0);
    let target = |i: usize| MorphTarget {
        name: format!("target {i}"),
        deltas: (surface.vertices().iter().enumerate())
            .map(|(v, position)| {
                if (v + i).is_multiple_of(5) {
                    position * 0.01
                } else {
                    Vector3::zeros()
                }
            })
            .collect(),
    };
    MorphedSurface {
        targets: (0..40).map(target).collect(),
        surface,
        unit: None,
    }
}

fn files(criterion: &mut Criterion) {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let (obj, glb) = (
        folder.path().join("face.obj"),
        folder.path().join("face.glb"),
    );
    let morphed = face_sized();
    write_obj(&obj, &morphed.surface).expect("the folder is writable");
    write_glb(&glb, &morphed).expect("the folder is writable");
    criterion.bench_function("read_obj", |b| b.iter(|| read_obj(&obj)));
    criterion.bench_function("read_gltf, 40 targets", |b| b.iter(|| read_gltf(&glb)));
    criterion.bench_function("write_glb, 40 targets", |b| {
        b.iter(|| write_glb(&glb, &morphed))
    });
}

fn geometry(criterion: &mut Criterion) {
    let surface = primitives::icosphere(5, 10.0);
    let (vertices, triangles) = (surface.vertices(), surface.triangles());
    criterion.bench_function("vertex_normals", |b| {
        b.iter(|| vertex_normals(black_box(vertices), black_box(triangles)))
    });
    criterion.bench_function("vertex_normals_vjp", |b| {
        b.iter(|| {
            vertex_normals_vjp(
                black_box(vertices),
                black_box(triangles),
                black_box(vertices),
            )
        })
    });
    criterion.bench_function("report", |b| b.iter(|| report(black_box(&surface))));
}

criterion_group!(benches, files, geometry);
criterion_main!(benches);

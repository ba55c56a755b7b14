//! A file of a megabyte, whole or not at all, beside one that may be left half: what the way to the disk costs.

use criterion::{Criterion, criterion_group, criterion_main};

fn writing(c: &mut Criterion) {
    let folder = tempfile::tempdir().expect("a folder");
    let bytes = vec![7_u8; 1 << 20];
    let path = folder.path().join("a");
    c.bench_function("whole", |b| {
        b.iter(|| whole_file::write(&path, |file| file.write_all(&bytes)).expect("it is written"))
    });
    c.bench_function("std::fs::write", |b| {
        b.iter(|| std::fs::write(&path, &bytes).expect("it is written"))
    });
}

criterion_group!(benches, writing);
criterion_main!(benches);

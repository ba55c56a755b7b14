//! Times of the effect alone, printed on request.

use super::*;

/// Milliseconds of each operation on 48 x 25 x 25 elements: `cargo test --release -p pd-solver timing -- --ignored --nocapture`.
#[test]
#[ignore = "prints times, checks nothing"]
fn timing() {
    const CELLS: [usize; 3] = [48, 25, 25];
    let mesh = HexMesh::solid_box(CELLS, 0.01, hex_mesh::Quadrature::Eight).unwrap();
    let samples = mesh.quadrature().len();
    let tau = std::f64::consts::TAU;
    let mut parameters = Parameters {
        actuation: vec![[0.0; 6]; samples * mesh.elements().len()],
        prescribed: Vec::new(),
        spring_targets: Vec::new(),
        acceleration: Vec::new(),
    };
    for (cell, b) in (mesh.cells().iter()).zip(parameters.actuation.chunks_mut(samples)) {
        let c: [f64; 3] = std::array::from_fn(|i| (f64::from(cell[i]) + 0.5) / CELLS[i] as f64);
        let s = 0.3 * (2.0 * c[2] - 1.0);
        b.fill([
            s,
            0.05 * (tau * c[0]).sin(),
            0.0,
            -0.15 * s,
            0.05 * (tau * c[1]).cos(),
            -0.5 * s,
        ]);
    }
    let bend = |p: &Vector3<f64>| {
        let turn = nalgebra::Rotation3::from_axis_angle(&Vector3::y_axis(), 4.0 * p.x);
        turn * Vector3::new(0.9 * p.x, 1.1 * p.y, p.z + 0.05 * p.x * p.y)
    };
    let u: Vec<_> = mesh.nodes().iter().map(bend).collect();
    let z: Vec<_> = mesh
        .nodes()
        .iter()
        .map(|p| p.map(|x| (300.0 * x).sin()))
        .collect();
    let mut runs = vec![(1, "default", Arch::new()), (2, "default", Arch::new())];
    #[cfg(target_arch = "x86_64")]
    runs.extend(pulp::x86::V3::try_new().map(|v3| (1, "AVX2", Arch::V3(v3))));
    for (threads, set, arch) in runs {
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .unwrap();
        pool.install(|| {
            let mut e = Elasticity::from_mesh(&mesh, 1.0);
            e.arch = arch;
            let mut out = vec![Vector3::zeros(); u.len()];
            let mut vjp = parameters.zeros_like();
            let print = |name: &str, e: &mut Elasticity, run: &mut dyn FnMut(&mut Elasticity)| {
                let mut times: Vec<f64> = (0..31)
                    .map(|_| {
                        let start = std::time::Instant::now();
                        run(e);
                        start.elapsed().as_secs_f64() * 1e3
                    })
                    .collect();
                times.sort_by(f64::total_cmp);
                println!(
                    "{threads} threads {set:8} {name:16} median {:7.3} ms, least {:7.3} ms",
                    times[15], times[0]
                );
            };
            print("set_parameters", &mut e, &mut |e| {
                e.set_parameters(&parameters)
            });
            print("energy_gradient", &mut e, &mut |e| {
                std::hint::black_box(e.energy_gradient(&u, &mut out));
            });
            print("linearise", &mut e, &mut |e| e.linearise(&u));
            print("hessian_product", &mut e, &mut |e| {
                e.hessian_product(&z, &mut out)
            });
            print("parameter_vjp", &mut e, &mut |e| {
                e.parameter_vjp(&u, &z, &mut vjp)
            });
        });
    }
}

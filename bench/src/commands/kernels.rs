//! `kernels`: nanoseconds per matrix and per sample of the innermost loops.

use crate::case::Case;
use crate::error::Result;
use crate::files::{check_writable, write_json};
use crate::lanes::{
    ACTUATION, BLOCK, Block, InstructionSet, LaneKernel, blocks, matrices, run as run_lanes,
    symmetric_blocks,
};
use crate::options::{RepeatArgs, parse_cells, parse_count, use_threads};
use crate::system;
use crate::table::{optional, print, row, say};
use crate::timing::{median, timed};
use clap::Args;
use nalgebra::{Matrix3, Rotation3, Vector3};
use polar_grad::lanes::batch;
use polar_grad::{
    Filter, HessianCore, RotationGradient, actuation_from_b, polar_rotation, signed_svd,
};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{RngCore, SeedableRng};
use serde::Serialize;
use std::hint::black_box;

/// Options of `kernels`.
#[derive(Args, Debug)]
pub struct KernelsArgs {
    /// 3x3 matrices of each class; the default stays within the first cache.
    #[arg(long, value_name = "N", default_value_t = 256, allow_hyphen_values = true, value_parser = parse_count)]
    count: usize,
    /// Elements along x, y and z of the reference box, for the solver's loops.
    #[arg(long, value_name = "NX,NY,NZ", default_value = "32,16,16", allow_hyphen_values = true, value_parser = parse_cells)]
    cells: [usize; 3],
    /// Milliseconds that one repetition takes at least.
    #[arg(long, value_name = "MS", default_value_t = 20, allow_hyphen_values = true, value_parser = parse_count)]
    milliseconds: usize,
    #[command(flatten)]
    repeat: RepeatArgs,
}

#[derive(Serialize)]
struct Report {
    processor: Option<String>,
    load: Option<f64>,
    count: usize,
    cells: [usize; 3],
    threads: usize,
    /// One thread, per 3x3 matrix.
    per_matrix: Vec<Kernel>,
    /// All threads, per sample.
    per_sample: Vec<Kernel>,
}

#[derive(Serialize)]
struct Kernel {
    kernel: String,
    instruction_set: &'static str,
    /// What the matrices are like.
    class: &'static str,
    /// Median.
    nanoseconds: f64,
    /// Largest |R^T R - I| over all matrices (Frobenius norm), of kernels that give a rotation.
    orthogonality: Option<f64>,
}

/// Measures, prints and writes.
///
/// # Errors
/// When the box is too large, or the file cannot be written.
pub fn run(args: &KernelsArgs) -> Result<bool> {
    let json = args.repeat.json.as_deref();
    check_writable(json)?;
    use_threads(args.repeat.threads)?;
    let load = system::load();
    let mut per_matrix = Vec::new();
    for (class, inverted) in [("deformed", false), ("inverted", true)] {
        let list = deformations(args.count.next_multiple_of(BLOCK), inverted);
        scalar_kernels(args, class, &list, &mut per_matrix);
        lane_kernels(args, class, &list, &mut per_matrix);
        batch_kernels(args, class, &list, &mut per_matrix);
    }
    let report = Report {
        processor: system::processor(),
        load,
        count: args.count.next_multiple_of(BLOCK),
        cells: args.cells,
        threads: rayon::current_num_threads(),
        per_matrix,
        per_sample: solver_loops(args)?,
    };
    write_json(json, &report)?;
    print_report(&report);
    Ok(true)
}

/// Turned matrices near the identity; with `inverted` every second one is mirrored and flattened.
fn deformations(count: usize, inverted: bool) -> Vec<Matrix3<f64>> {
    let mut random = ChaCha8Rng::seed_from_u64(1);
    let mut entry = || (random.next_u64() >> 11) as f64 / (1_u64 << 52) as f64 - 1.0;
    let list = (0..count).map(|i| {
        let turn = Rotation3::new(Vector3::from_fn(|_, _| 2.0 * entry()));
        let stretch = Matrix3::identity() + Matrix3::from_fn(|_, _| 0.2 * entry());
        let last = if inverted && i % 2 == 1 { -0.3 } else { 1.0 };
        turn * stretch * Matrix3::from_diagonal(&Vector3::new(1.0, 1.0, last))
    });
    list.collect()
}

/// Median nanoseconds per item of a pass over `items` of them.
fn nanoseconds(args: &KernelsArgs, items: usize, mut pass: impl FnMut()) -> f64 {
    let least = 1e-3 * args.milliseconds as f64;
    // The first pass warms the caches up; the second says how many fit the time.
    pass();
    let (once, ()) = timed(&mut pass);
    let passes = (least / once.max(1e-9)).ceil().clamp(1.0, 1e9) as usize;
    let repetition = |_| timed(|| (0..passes).for_each(|_| pass())).0;
    let seconds: Vec<f64> = (0..args.repeat.runs).map(repetition).collect();
    1e9 * median(&seconds) / (passes * items) as f64
}

fn scalar_kernels(
    args: &KernelsArgs,
    class: &'static str,
    list: &[Matrix3<f64>],
    out: &mut Vec<Kernel>,
) {
    let a = actuation_from_b(&[0.2, 0.05, 0.0, -0.1, 0.05, -0.15]);
    let mut add = |kernel: &str, rotation: Option<Rotate>, pass: &mut dyn FnMut()| {
        out.push(Kernel {
            kernel: kernel.into(),
            instruction_set: "scalar",
            class,
            nanoseconds: nanoseconds(args, list.len(), pass),
            orthogonality: rotation.map(|rotate| defect(list.iter().map(rotate))),
        });
    };
    add("nalgebra SVD", Some(nalgebra_rotation), &mut || {
        over(list, |m| m.svd(true, true))
    });
    add(
        "signed_svd",
        Some(|m| signed_svd(m).rotation()),
        &mut || over(list, signed_svd),
    );
    add("polar_rotation", Some(polar_rotation), &mut || {
        over(list, polar_rotation)
    });
    add("RotationGradient::at", None, &mut || {
        over(list, RotationGradient::at)
    });
    add("HessianCore::new", None, &mut || {
        over(list, |m| HessianCore::new(m, &a))
    });
    add("HessianCore, projected", None, &mut || {
        over(list, |m| {
            HessianCore::new(m, &a).filtered(Filter::Projected)
        })
    });
}

type Rotate = fn(&Matrix3<f64>) -> Matrix3<f64>;

fn over<T>(list: &[Matrix3<f64>], kernel: impl Fn(&Matrix3<f64>) -> T) {
    for m in list {
        black_box(kernel(black_box(m)));
    }
}

/// U V^T, a reflection where the matrix is mirrored: orthogonal all the same.
fn nalgebra_rotation(m: &Matrix3<f64>) -> Matrix3<f64> {
    let svd = m.svd(true, true);
    svd.u.unwrap_or_default() * svd.v_t.unwrap_or_default()
}

/// Largest |R^T R - I|.
fn defect(rotations: impl Iterator<Item = Matrix3<f64>>) -> f64 {
    let off = |r: Matrix3<f64>| (r.transpose() * r - Matrix3::identity()).norm();
    rotations.map(off).fold(0.0, f64::max)
}

fn lane_kernels(
    args: &KernelsArgs,
    class: &'static str,
    list: &[Matrix3<f64>],
    out: &mut Vec<Kernel>,
) {
    let matrices_in_blocks = blocks(list);
    let pair_sums = symmetric_blocks(&Batch::of(list).pair_sums);
    let mut output: Vec<Block> = vec![[[0.0; BLOCK]; 9]; matrices_in_blocks.len()];
    for (name, kernel, input) in [
        (
            "polar_rotation_lanes",
            LaneKernel::Rotation,
            &matrices_in_blocks,
        ),
        (
            "rotation_factor_lanes",
            LaneKernel::Factor,
            &matrices_in_blocks,
        ),
        ("projected_factor_lanes", LaneKernel::Projection, &pair_sums),
        (
            "rotation_tangent_lanes",
            LaneKernel::Tangent,
            &matrices_in_blocks,
        ),
    ] {
        for set in InstructionSet::all() {
            let nanoseconds = nanoseconds(args, list.len(), || {
                run_lanes(set, kernel, black_box(input), &mut output);
                black_box(&mut output);
            });
            let rotations = matrices(&output).into_iter();
            out.push(Kernel {
                kernel: name.into(),
                instruction_set: set.name(),
                class,
                nanoseconds,
                orthogonality: (kernel == LaneKernel::Rotation).then(|| defect(rotations)),
            });
        }
    }
}

/// Plain slices for the batch functions.
struct Batch {
    rotations: Vec<Matrix3<f64>>,
    pair_sums: Vec<[f64; 6]>,
    factors: Vec<[f64; 6]>,
}

impl Batch {
    fn of(list: &[Matrix3<f64>]) -> Self {
        let n = list.len();
        let mut all = Self {
            rotations: vec![Matrix3::zeros(); n],
            pair_sums: vec![[0.0; 6]; n],
            factors: vec![[0.0; 6]; n],
        };
        let Self {
            rotations,
            pair_sums,
            factors,
        } = &mut all;
        batch::factors(list, rotations, pair_sums, factors);
        all
    }
}

fn batch_kernels(
    args: &KernelsArgs,
    class: &'static str,
    list: &[Matrix3<f64>],
    out: &mut Vec<Kernel>,
) {
    let Batch {
        mut rotations,
        mut pair_sums,
        mut factors,
    } = Batch::of(list);
    let off = defect(rotations.iter().copied());
    let mut add = |kernel: &str, orthogonality, pass: &mut dyn FnMut()| {
        out.push(Kernel {
            kernel: kernel.into(),
            instruction_set: InstructionSet::best().name(),
            class,
            nanoseconds: nanoseconds(args, list.len(), pass),
            orthogonality,
        });
    };
    add("batch::polar_rotations", Some(off), &mut || {
        batch::polar_rotations(black_box(list), &mut rotations);
        black_box(&mut rotations);
    });
    add("batch::factors", Some(off), &mut || {
        batch::factors(
            black_box(list),
            &mut rotations,
            &mut pair_sums,
            &mut factors,
        );
        black_box(&mut factors);
    });
    let actuations = vec![ACTUATION; list.len()];
    let mut projected = factors.clone();
    add("batch::projected_factors", None, &mut || {
        batch::projected_factors(black_box(&pair_sums), &actuations, &mut projected);
        black_box(&mut projected);
    });
    let mut products = rotations.clone();
    add("batch::hessian_products", None, &mut || {
        batch::hessian_products(&rotations, &factors, black_box(list), &mut products);
        black_box(&mut products);
    });
}

/// What the solver's public functions cost per sample, with the copying and checking of their arguments.
fn solver_loops(args: &KernelsArgs) -> Result<Vec<Kernel>> {
    let case = Case::solid_box(args.cells, 1.0)?;
    let (mut solver, parameters) = case.solver()?;
    let samples = parameters.actuation.len();
    let rest = solver.rest().to_vec();
    // A state in which nothing is at rest any more.
    let bent: Vec<_> = rest
        .iter()
        .map(|x| x + Vector3::new(0.05 * x.z, 0.1 * x.x * x.y, -0.2 * x.x * x.x))
        .collect();
    solver.energy_gradient(&parameters, &bent)?;
    let set = InstructionSet::best().name();
    let kernel = |kernel: &str, nanoseconds| Kernel {
        kernel: kernel.into(),
        instruction_set: set,
        class: "bent box",
        nanoseconds,
        orthogonality: None,
    };
    let energy = nanoseconds(args, samples, || {
        black_box(
            solver
                .energy_gradient(&parameters, black_box(&bent))
                .is_ok(),
        );
    });
    let product = nanoseconds(args, samples, || {
        black_box(
            solver
                .hessian_product(&parameters, &bent, black_box(&rest))
                .is_ok(),
        );
    });
    Ok(vec![
        kernel("energy and gradient", energy),
        kernel("linearisation and Hessian product", product),
    ])
}

fn print_report(report: &Report) {
    for (title, kernels) in [
        ("per matrix, one thread", &report.per_matrix),
        ("per sample, all threads", &report.per_sample),
    ] {
        let mut rows = vec![row([title, "runs on", "class", "ns", "|R^T R - I|"])];
        rows.extend(kernels.iter().map(|k| {
            row([
                &k.kernel,
                k.instruction_set,
                k.class,
                &format!("{:.1}", k.nanoseconds),
                &optional(k.orthogonality, |x| format!("{x:.1e}")),
            ])
        }));
        print(&rows);
        say("\n");
    }
}

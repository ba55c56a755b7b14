//! Every kernel of the crate on lists of matrices: what the example `kernels` times and the benchmark of that name measures.

use nalgebra::{Matrix3, Rotation3, Vector3};
use polar_grad::lanes::{
    LaneMatrix, SymmetricLanes, polar_rotation_lanes, projected_factor_lanes,
    rotation_factor_lanes, rotation_tangent_lanes,
};
use polar_grad::{
    Filter, HessianCore, RotationGradient, actuation_from_b, batch, polar_rotation, signed_svd,
};
use pulp::{Scalar, Simd, WithSimd};
use std::hint::black_box;

/// Matrices in a list: few enough for the second-level cache.
pub const COUNT: usize = 2048;
/// Matrices that are stored side by side, for registers of up to that many lanes.
const GROUP: usize = 8;

/// A kernel applied to [`COUNT`] matrices.
pub struct Kernel {
    /// What is computed, by what, and on which class of matrices: `polar/avx512/ordinary`.
    pub name: String,
    /// One pass over all matrices.
    pub run: Box<dyn FnMut()>,
}

/// Entries in `[-1, 1)` from a linear congruential generator.
struct Entries(u64);

impl Entries {
    fn next(&mut self) -> f64 {
        self.0 = self
            .0
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 11) as f64 / (1_u64 << 52) as f64 - 1.0
    }

    fn rotation(&mut self) -> Matrix3<f64> {
        Rotation3::new(Vector3::from_fn(|_, _| 2.0 * self.next())).into_inner()
    }

    /// Turned matrices near the identity, of which the last axis is scaled by `last`.
    fn deformation(&mut self, last: f64) -> Matrix3<f64> {
        let stretch = Matrix3::identity() + Matrix3::from_fn(|_, _| 0.2 * self.next());
        self.rotation() * stretch * Matrix3::from_diagonal(&Vector3::new(1.0, 1.0, last))
    }

    /// Signed singular values 1.2, 0.5, -0.5 + g with g log-uniform in `[1e-8, 1e-2)`.
    fn nearly_reflected(&mut self) -> Matrix3<f64> {
        let gap = 10.0_f64.powf(-5.0 + 3.0 * self.next());
        let sigma = Matrix3::from_diagonal(&Vector3::new(1.2, 0.5, -0.5 + gap));
        self.rotation() * sigma * self.rotation()
    }
}

/// The classes of matrices, by name.
fn classes() -> [(&'static str, Vec<Matrix3<f64>>); 4] {
    let list = |draw: fn(&mut Entries, usize) -> Matrix3<f64>| {
        let mut entries = Entries(1);
        (0..COUNT).map(|k| draw(&mut entries, k)).collect()
    };
    [
        ("ordinary", list(|entries, _| entries.deformation(1.0))),
        (
            "half_inverted",
            list(|entries, k| entries.deformation(if k % 2 == 0 { 1.0 } else { -0.3 })),
        ),
        ("inverted", list(|entries, _| entries.deformation(-0.3))),
        (
            "nearly_reflected",
            list(|entries, _| entries.nearly_reflected()),
        ),
    ]
}

/// What the kernels need of a list of matrices, matrices side by side in groups.
struct Lanes {
    matrices: Vec<[[f64; GROUP]; 9]>,
    rotations: Vec<[[f64; GROUP]; 9]>,
    pair_sums: Vec<[[f64; GROUP]; 6]>,
    factors: Vec<[[f64; GROUP]; 6]>,
    actuations: Vec<[[f64; GROUP]; 6]>,
    out: Vec<[[f64; GROUP]; 9]>,
}

const PLACES: [(usize, usize); 6] = [(0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)];

fn groups<const N: usize>(
    matrices: &[Matrix3<f64>],
    places: [(usize, usize); N],
) -> Vec<[[f64; GROUP]; N]> {
    let group = |m: &[Matrix3<f64>]| places.map(|place| std::array::from_fn(|i| m[i][place]));
    matrices.chunks_exact(GROUP).map(group).collect()
}

impl Lanes {
    fn new(matrices: &[Matrix3<f64>], actuations: &[Matrix3<f64>]) -> Self {
        let all = std::array::from_fn(|k| (k / 3, k % 3));
        let gradients: Vec<_> = matrices.iter().map(RotationGradient::at).collect();
        let part = |f: fn(&RotationGradient) -> Matrix3<f64>| -> Vec<Matrix3<f64>> {
            gradients.iter().map(f).collect()
        };
        Self {
            matrices: groups(matrices, all),
            rotations: groups(&part(|g| g.rotation), all),
            pair_sums: groups(&part(|g| g.pair_sums), PLACES),
            factors: groups(&part(|g| g.factor), PLACES),
            actuations: groups(actuations, PLACES),
            out: groups(matrices, all),
        }
    }
}

/// The kernels that work in lanes.
#[derive(Clone, Copy)]
enum Task {
    Polar,
    Factor,
    Projected,
    Product,
}

const TASKS: [(&str, Task); 4] = [
    ("polar", Task::Polar),
    ("factor", Task::Factor),
    ("projected_factor", Task::Projected),
    ("product", Task::Product),
];

struct Pass<'a>(Task, &'a mut Lanes);

impl WithSimd for Pass<'_> {
    type Output = ();

    // No closures around the kernels: what the compiler does not inline here loses the instruction set.
    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self(task, lanes) = self;
        for group in 0..COUNT / GROUP {
            for part in 0..GROUP / S::F64_LANES {
                let m = load::<S, 9>(&lanes.matrices[group], part);
                let rotation = load::<S, 9>(&lanes.rotations[group], part);
                let out = match task {
                    Task::Polar => polar_rotation_lanes(simd, &m),
                    Task::Factor => padded::<S>(&rotation_factor_lanes(simd, &rotation, &m).factor),
                    Task::Projected => {
                        let t = load::<S, 6>(&lanes.pair_sums[group], part);
                        let a = load::<S, 6>(&lanes.actuations[group], part);
                        padded::<S>(&projected_factor_lanes(simd, &t, &a))
                    }
                    Task::Product => {
                        let factor = load::<S, 6>(&lanes.factors[group], part);
                        rotation_tangent_lanes(simd, &rotation, &factor, &m)
                    }
                };
                for (row, value) in lanes.out[group].iter_mut().zip(&out) {
                    S::as_mut_simd_f64s(row).0[part] = *value;
                }
            }
        }
    }
}

#[inline(always)]
fn load<S: Simd, const N: usize>(group: &[[f64; GROUP]; N], part: usize) -> [S::f64s; N] {
    let mut out = [S::as_simd_f64s(&group[0]).0[part]; N];
    for (value, row) in out.iter_mut().zip(group) {
        *value = S::as_simd_f64s(row).0[part];
    }
    out
}

/// Six values in the place of nine.
#[inline(always)]
fn padded<S: Simd>(s: &SymmetricLanes<S>) -> LaneMatrix<S> {
    [s[0], s[1], s[2], s[3], s[4], s[5], s[3], s[4], s[5]]
}

/// Runs a pass on one instruction set.
type Runner = fn(Pass<'_>);

/// The instruction sets of this machine, and portable code.
fn instruction_sets() -> Vec<(&'static str, Runner)> {
    let mut sets: Vec<(&'static str, Runner)> = vec![("portable", |pass| pass.with_simd(Scalar))];
    #[cfg(target_arch = "x86_64")]
    {
        use pulp::x86::{V3, V4};
        if V3::try_new().is_some() {
            sets.push(("avx2", |pass| {
                Simd::vectorize(V3::try_new().expect("checked above"), pass)
            }));
        }
        if V4::try_new().is_some() {
            sets.push(("avx512", |pass| {
                Simd::vectorize(V4::try_new().expect("checked above"), pass)
            }));
        }
    }
    sets
}

/// All kernels: every task in lanes on every instruction set, batches, scalar functions, nalgebra.
pub fn kernels() -> Vec<Kernel> {
    let mut kernels = Vec::new();
    for (class, m) in classes() {
        let mut entries = Entries(2);
        let a: Vec<_> = (0..COUNT)
            .map(|_| actuation_from_b(&std::array::from_fn(|_| 0.2 * entries.next())))
            .collect();
        for (set, runner) in instruction_sets() {
            for (name, task) in TASKS {
                let mut lanes = Lanes::new(&m, &a);
                kernels.push(Kernel {
                    name: format!("{name}/{set}/{class}"),
                    run: Box::new(move || runner(Pass(task, black_box(&mut lanes)))),
                });
            }
        }
        let list = m.clone();
        let mut rotations = m.clone();
        kernels.push(Kernel {
            name: format!("polar/batch/{class}"),
            run: Box::new(move || {
                batch::polar_rotations(black_box(&list), black_box(&mut rotations))
            }),
        });
        let cores: Vec<_> = (0..COUNT)
            .map(|i| HessianCore {
                gradient: RotationGradient::at(&m[i]),
                actuation: a[i],
                filter: Filter::Exact,
            })
            .collect();
        let pairs: Vec<_> = cores
            .iter()
            .zip(&m)
            .map(|(c, m)| (c.gradient, *m))
            .collect();
        kernels.extend([
            scalar("polar/scalar", class, &m, polar_rotation),
            scalar("polar/signed_svd", class, &m, |m| signed_svd(m).rotation()),
            scalar("polar/nalgebra_svd", class, &m, |m| {
                let svd = m.svd(true, true);
                svd.u.zip(svd.v_t).map(|(u, v_t)| u * v_t)
            }),
            scalar("polar/nalgebra_polar", class, &m, |m| m.polar().1),
            scalar("polar_and_factor/scalar", class, &m, RotationGradient::at),
            scalar("projected_factor/scalar", class, &cores, |core| {
                core.filtered(Filter::Projected)
            }),
            scalar("product/scalar", class, &pairs, |(gradient, d_m)| {
                gradient.apply(d_m)
            }),
        ]);
    }
    kernels
}

/// One call per item.
fn scalar<T: Clone + 'static, R: 'static>(
    name: &str,
    class: &str,
    items: &[T],
    kernel: fn(&T) -> R,
) -> Kernel {
    let items = items.to_vec();
    Kernel {
        name: format!("{name}/{class}"),
        run: Box::new(move || {
            for item in &items {
                black_box(kernel(black_box(item)));
            }
        }),
    }
}

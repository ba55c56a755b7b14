//! The lane functions against the scalar ones, on every instruction set of this machine and in portable code.

use super::*;
use crate::hessian::{Filter, HessianCore};
use crate::linear::symmetrize;
use crate::symmetric::SINGULAR;
use crate::testing::{HARD_CLASSES, Random, SCALES, planted};
use crate::{RotationGradient, actuation_from_b, signed_svd};
use nalgebra::{SMatrix, SymmetricEigen, Vector3};
use pulp::{Arch, WithSimd};

/// What the lane functions answer for one matrix and actuation.
#[derive(Clone, Copy)]
struct Answer {
    rotation: Matrix3<f64>,
    pair_sums: Matrix3<f64>,
    factor: Matrix3<f64>,
    projected: Matrix3<f64>,
    tangent: Matrix3<f64>,
}

/// A matrix M, an actuation A and a tangent dM.
#[derive(Clone, Copy)]
struct Case {
    m: Matrix3<f64>,
    a: Matrix3<f64>,
    d_m: Matrix3<f64>,
}

/// Runs the lane functions over a list of cases on one instruction set.
struct Run<'a>(&'a [Case]);

impl WithSimd for Run<'_> {
    type Output = Vec<Answer>;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> Self::Output {
        let mut out = Vec::new();
        for chunk in self.0.chunks(S::F64_LANES) {
            let m = load::<S>(simd, chunk, |case| case.m);
            let d_m = load::<S>(simd, chunk, |case| case.d_m);
            let a = load::<S>(simd, chunk, |case| case.a);
            let a = [a[0], a[1], a[2], a[4], a[5], a[8]];
            let rotation = polar_rotation_lanes(simd, &m);
            let RotationFactor { pair_sums, factor } = rotation_factor_lanes(simd, &rotation, &m);
            let projected = projected_factor_lanes(simd, &pair_sums, &a);
            let tangent = rotation_tangent_lanes(simd, &rotation, &factor, &d_m);
            out.extend((0..chunk.len()).map(|i| Answer {
                rotation: matrix_of_lane::<S>(&rotation, i),
                pair_sums: symmetric_of_lane::<S>(&pair_sums, i),
                factor: symmetric_of_lane::<S>(&factor, i),
                projected: symmetric_of_lane::<S>(&projected, i),
                tangent: matrix_of_lane::<S>(&tangent, i),
            }));
        }
        out
    }
}

fn load<S: Simd>(simd: S, chunk: &[Case], matrix: impl Fn(&Case) -> Matrix3<f64>) -> LaneMatrix<S> {
    let mut m = [simd.splat_f64s(0.0); 9];
    for (k, v) in m.iter_mut().enumerate() {
        for i in 0..S::F64_LANES {
            set_lane::<S>(v, i, matrix(&chunk[i % chunk.len()])[(k / 3, k % 3)]);
        }
    }
    m
}

/// Every instruction set this machine has, and the portable one.
fn on_all_sets(cases: &[Case], mut check: impl FnMut(&Case, &Answer)) {
    let mut answers = vec![
        Arch::new().dispatch(Run(cases)),
        Run(cases).with_simd(pulp::Scalar),
    ];
    #[cfg(target_arch = "x86_64")]
    {
        answers.extend(pulp::x86::V3::try_new().map(|v3| Simd::vectorize(v3, Run(cases))));
        answers.extend(pulp::x86::V4::try_new().map(|v4| Simd::vectorize(v4, Run(cases))));
    }
    for answers in answers {
        assert_eq!(answers.len(), cases.len());
        for (case, answer) in cases.iter().zip(&answers) {
            check(case, answer);
        }
    }
}

/// Actuations that are ordinary, indefinite, singular, huge, tiny, of rank one, and zero.
fn actuation(random: &mut Random, kind: usize) -> Matrix3<f64> {
    let ordinary = actuation_from_b(&random.actuation_entries(0.4));
    let n = random.rotation().column(0).into_owned();
    match kind % 10 {
        0 | 1 => ordinary,
        2 => ordinary - Matrix3::from_diagonal(&Vector3::new(0.0, 0.0, 1.6)),
        3 => Matrix3::new(1.2, 0.3, 0.0, 0.3, 0.8, 0.0, 0.0, 0.0, 0.0),
        4 => ordinary * 1e3,
        5 => ordinary * 1e100,
        6 => ordinary * 1e-100,
        7 => n * n.transpose(),
        8 => symmetrize(&random.matrix()),
        _ => Matrix3::zeros(),
    }
}

/// Planted hard cases at all scales, mixed with ordinary ones.
fn cases() -> Vec<Case> {
    let mut random = Random::new(5);
    let mut cases = Vec::new();
    for kind in 0..10 {
        for (_, sigma) in HARD_CLASSES {
            for scale in SCALES {
                let (u, v) = (random.rotation(), random.rotation());
                let diagonal = Matrix3::from_diagonal(&Vector3::from(*sigma));
                let hard = u * diagonal * v.transpose() * *scale;
                for m in [hard, random.matrix()] {
                    cases.push(Case {
                        m,
                        a: actuation(&mut random, kind),
                        d_m: random.matrix(),
                    });
                }
            }
        }
    }
    cases
}

/// The lengths around every lane count, and everything.
fn parts(cases: &[Case]) -> impl Iterator<Item = &[Case]> {
    (1..=17)
        .map(|length| &cases[3 * length..4 * length])
        .chain([cases])
}

/// `(s_y + s_z) / |M|`.
fn gap(m: &Matrix3<f64>) -> f64 {
    RotationGradient::at(m).smallest_pair_sum / m.norm().max(f64::MIN_POSITIVE)
}

/// The largest entry of the difference, relative to the largest of the second.
fn relative(x: &Matrix3<f64>, expected: &Matrix3<f64>) -> f64 {
    let size = expected.amax().max(f64::MIN_POSITIVE);
    (x / size - expected / size).amax()
}

#[test]
fn rotations_agree_with_the_signed_svd() {
    for part in parts(&cases()) {
        on_all_sets(part, |Case { m, .. }, Answer { rotation: r, .. }| {
            let defect = (r.transpose() * r - Matrix3::identity()).norm();
            assert!(
                defect < 4e-15 && (r.determinant() - 1.0).abs() < 1e-14,
                "{m} {r} {defect:e}"
            );
            let gap = gap(m);
            if gap > 1e-6 {
                let off = (r - signed_svd(m).rotation()).norm();
                assert!(off < 1e-14 / gap, "{m} {off:e} {gap:e}");
            }
        });
    }
}

#[test]
fn factors_agree_with_the_scalar_gradient() {
    for part in parts(&cases()) {
        on_all_sets(part, |Case { m, d_m, .. }, answer| {
            let gradient = RotationGradient::at(m);
            let gap = gap(m);
            let tolerance = 1e-14 + 4e-15 / gap.max(crate::PAIR_SUM_FLOOR);
            let error = relative(&answer.pair_sums, &gradient.pair_sums);
            assert!(error < tolerance.min(1e-10), "{m} {error:e}");
            let error = relative(&answer.factor, &gradient.factor);
            assert!(error < tolerance, "{m} {error:e} {gap:e}");
            if gap > 1e-6 {
                let error = (answer.tangent - gradient.apply(d_m)).amax();
                assert!(
                    error < tolerance * 10.0 * gradient.factor.amax(),
                    "{m} {error:e}"
                );
            }
        });
    }
}

/// `I - Z B' Z^T` as a 9x9 matrix.
fn core(rotation: &Matrix3<f64>, factor: &Matrix3<f64>, a: &Matrix3<f64>) -> SMatrix<f64, 9, 9> {
    let z = crate::gradient::cross_basis(rotation, a);
    SMatrix::identity() - z * factor * z.transpose()
}

/// The exact core at a polar rotation of `m`.
fn exact_core(m: &Matrix3<f64>, a: &Matrix3<f64>) -> HessianCore {
    HessianCore {
        gradient: RotationGradient::at(m),
        actuation: *a,
        filter: Filter::Exact,
    }
}

/// How well the answer is determined: the determinant of `(K + T) / tr(K + T)`.
fn regularity(core: &HessianCore) -> f64 {
    let sum = crate::hessian::reach(&core.actuation) + core.gradient.pair_sums;
    (sum / sum.trace()).determinant()
}

/// Largest error of a core's entries and eigenvalues where `K + T` is as regular as this.
fn core_tolerance(regularity: f64) -> f64 {
    2e-14 + 5e-17 / regularity
}

#[test]
fn projections_agree_with_the_scalar_filter() {
    for part in parts(&cases()) {
        on_all_sets(part, |Case { m, a, .. }, answer| {
            let exact = exact_core(m, a);
            let regularity = regularity(&exact);
            if regularity > SINGULAR {
                let dense = core(&exact.gradient.rotation, &answer.projected, a);
                let expected = exact.filtered(Filter::Projected).to_matrix();
                let error = (dense - expected).amax();
                // The lane's own T counts, whose rotation differs by rounding over the gap.
                let tolerance = core_tolerance(regularity) * (1.0 + 1e-3 / gap(m).max(1e-9));
                assert!(error < tolerance, "{m} {a} {error:e} {regularity:e}");
            }
        });
    }
}

/// The meaning of B': the eigenvalues of the projected core are those of the exact one, the negative ones replaced by zero.
#[test]
fn projections_clamp_the_eigenvalues() {
    let (mut worst, mut checked): (f64, usize) = (0.0, 0);
    for case in cases() {
        let exact = exact_core(&case.m, &case.a);
        let regularity = regularity(&exact);
        let mut expected = [exact.spectrum().nontrivial.as_slice(), &[1.0; 6]].concat();
        expected.iter_mut().for_each(|x| *x = x.max(0.0));
        expected.sort_by(f64::total_cmp);
        let mut answers = Vec::new();
        on_all_sets(&[case], |_, answer| answers.push(*answer));
        // Cases are counted, not answers: a machine without AVX-512 gives one answer less for each.
        checked += usize::from(regularity > SINGULAR);
        for answer in answers {
            let dense = core(&answer.rotation, &answer.projected, &case.a);
            assert!(dense.iter().all(|x| x.is_finite()), "{} {}", case.m, case.a);
            let mut values: [f64; 9] = SymmetricEigen::new(dense).eigenvalues.into();
            values.sort_by(f64::total_cmp);
            // As documented for actuations of rank one, nearly.
            let slack = if regularity > 1e-4 { 1e-12 } else { 1e-6 };
            assert!(
                values[0] > -slack && values[8] < 1.0 + slack,
                "{} {} {values:?}",
                case.m,
                case.a
            );
            if regularity > SINGULAR {
                let differences = values.iter().zip(&expected).map(|(x, y)| (x - y).abs());
                let error = differences.fold(0.0, f64::max);
                assert!(
                    error < core_tolerance(regularity),
                    "{} {} {values:?} {expected:?} {regularity:e}",
                    case.m,
                    case.a
                );
                worst = worst.max(if regularity > 1e-3 { error } else { 0.0 });
            }
        }
    }
    println!("largest error of an eigenvalue, K + T regular: {worst:e} of {checked}");
    assert!(checked > 3_000);
}

/// Every pattern of eigenvalues of X = (K - T) / (K + T): distinct, double, triple, near zero and of both signs.
#[test]
fn projections_at_coinciding_eigenvalues() {
    let mut random = Random::new(8);
    let mut cases = Vec::new();
    for exponent in [-17, -16, -15, -14, -12, -10, -8, -6, -4, -2] {
        for _ in 0..40 {
            let small = 10.0_f64.powi(exponent);
            let stretch = |random: &mut Random| 1.0 + small * random.signed();
            let sigma = match cases.len() % 4 {
                0 => [1.0; 3].map(|_| stretch(&mut random)),
                1 => [stretch(&mut random), stretch(&mut random), 0.4],
                2 => [1.5, stretch(&mut random) * 0.5, stretch(&mut random) * 0.5],
                _ => [1.0, 1.0 + random.signed(), 0.3 + 0.2 * random.signed()],
            };
            let (u, v) = (random.rotation(), random.rotation());
            let diagonal = Matrix3::from_diagonal(&Vector3::from(sigma));
            cases.push(Case {
                m: u * diagonal * v.transpose(),
                a: Matrix3::identity(),
                d_m: random.matrix(),
            });
        }
    }
    on_all_sets(&cases, |Case { m, a, .. }, answer| {
        let exact = exact_core(m, a);
        let dense = core(&answer.rotation, &answer.projected, a);
        let error = (dense - exact.filtered(Filter::Projected).to_matrix()).amax();
        assert!(error < 1e-14, "{m} {error:e}");
    });
}

#[test]
fn non_finite_lanes_give_nan_and_spoil_no_other() {
    let mut random = Random::new(2);
    let mut cases: Vec<Case> = (0..64)
        .map(|_| Case {
            m: Matrix3::identity() + random.matrix() * 0.3,
            a: actuation(&mut random, 0),
            d_m: random.matrix(),
        })
        .collect();
    let clean = cases.clone();
    for (k, case) in cases.iter_mut().enumerate().filter(|(k, _)| k % 5 == 0) {
        case.m[k % 9] = if k % 2 == 0 { f64::NAN } else { f64::INFINITY };
    }
    let collect = |cases: &[Case]| {
        let mut all = Vec::new();
        on_all_sets(cases, |case, answer| {
            all.push((case.m.iter().all(|x| x.is_finite()), *answer))
        });
        all
    };
    for ((finite, spoilt), (_, clean)) in collect(&cases).iter().zip(&collect(&clean)) {
        let pairs = [
            (spoilt.rotation, clean.rotation),
            (spoilt.factor, clean.factor),
            (spoilt.projected, clean.projected),
        ];
        for (x, y) in pairs {
            assert!(if *finite {
                x == y
            } else {
                x.iter().all(|x| x.is_nan())
            });
        }
    }
}

/// What defines the rotation, for gaps from 1 down to rounding: no lane certifies a wrong one, on the first attempt or the second.
#[test]
fn rotations_are_the_nearest_at_every_gap() {
    let cases: Vec<Case> = (0..20_000)
        .map(|seed| {
            let mut random = Random::new(seed);
            let gap = 10.0_f64.powf(-8.0 * (1.0 + random.signed()));
            let y = 0.5 * (1.0 + random.signed());
            Case {
                m: planted([1.0, y, -y + gap.min(2.0 * y)], seed).matrix,
                a: Matrix3::identity(),
                d_m: random.matrix(),
            }
        })
        .collect();
    let mut worst = [0.0_f64; 3];
    on_all_sets(&cases, |Case { m, .. }, Answer { rotation: r, .. }| {
        let defect = (r.transpose() * r - Matrix3::identity()).norm();
        let b = r.transpose() * m;
        let asymmetry = (b - b.transpose()).amax();
        let stretch = symmetrize(&b);
        let sums = Matrix3::identity() * stretch.trace() - stretch;
        let smallest = sums.symmetric_eigenvalues().min();
        assert!(
            r.determinant() > 0.0 && defect < 4e-15,
            "{m} {r} {defect:e}"
        );
        assert!(asymmetry < 8e-15, "{m} {r} {asymmetry:e}");
        assert!(smallest > -8e-15, "{m} {r} {smallest:e}");
        worst = [
            worst[0].max(defect),
            worst[1].max(asymmetry),
            worst[2].min(smallest),
        ];
    });
    let [defect, asymmetry, smallest] = worst;
    println!(
        "largest |R^T R - I| {defect:e}, asymmetry of R^T M {asymmetry:e}, smallest pair sum {smallest:e}"
    );
}

/// A condition holds in all lanes exactly when it fails in none.
struct AllLanes;

impl WithSimd for AllLanes {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let holds = |v| simd.less_than_f64s(v, simd.splat_f64s(0.5));
        assert!(all(simd, holds(simd.splat_f64s(0.0))));
        for i in 0..S::F64_LANES {
            let mut one = simd.splat_f64s(0.0);
            set_lane::<S>(&mut one, i, 1.0);
            assert!(!all(simd, holds(one)), "{i}");
            let mut failed = Vec::new();
            for_each_failed(simd, holds(one), |lane| failed.push(lane));
            assert_eq!(failed, [i]);
        }
    }
}

#[test]
fn all_means_that_no_lane_failed() {
    AllLanes.with_simd(pulp::Scalar);
    Arch::new().dispatch(AllLanes);
}

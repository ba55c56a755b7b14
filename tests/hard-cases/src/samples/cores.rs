//! The Hessian core: its spectrum, its filters and its products.

use super::decompositions::beyond;
use super::derivatives::vec;
use super::draws::Draw;
use super::finite;
use super::tally::Tally;
use nalgebra::{Matrix3, SMatrix, SymmetricEigen};
use polar_grad::{Filter, HessianCore};

/// Whether the entries of `A^2` and `F A` are finite, which the core asks for.
fn is_asked(draw: &Draw) -> bool {
    finite(&(draw.f * draw.a)) && finite(&(draw.a * draw.a))
}

/// How well the joint axes of `K` and `T` are determined: the determinant of `(K + T) / tr(K + T)`.
pub fn regularity(core: &HessianCore) -> f64 {
    let a = core.actuation;
    let square = a * a;
    let k = Matrix3::from_diagonal_element(square.trace()) - square;
    let largest = k.amax().max(core.gradient.pair_sums.amax());
    let sum = k / largest + core.gradient.pair_sums / largest;
    (sum / sum.trace()).determinant()
}

/// Eigenvalues, ascending.
fn eigenvalues(c: &SMatrix<f64, 9, 9>) -> [f64; 9] {
    let mut values: [f64; 9] = SymmetricEigen::new(*c).eigenvalues.into();
    values.sort_by(f64::total_cmp);
    values
}

pub fn check(tally: &mut Tally, number: u64, draw: &Draw, dear: bool) {
    if !is_asked(draw) {
        return;
    }
    let exact = HessianCore::new(&draw.f, &draw.a);
    let projected = exact.filtered(Filter::Projected);
    let absolute = exact.filtered(Filter::Absolute);
    let [x, y] = &draw.tangents;
    let spectra = [exact, projected, absolute].map(|core| core.spectrum().nontrivial);
    let products = [exact, projected, absolute].map(|core| core.apply(x));
    tally.require(
        number,
        "spectra finite and ascending",
        spectra
            .iter()
            .all(|s| s.iter().all(|x| x.is_finite()) && s[0] <= s[1] && s[1] <= s[2]),
    );
    tally.require(
        number,
        "products with the core finite",
        products.iter().all(finite),
    );
    let lowest = spectra[0][0];
    tally.see_curvature(lowest);
    // What rounding is relative to: the largest terms, and how badly they are known.
    let a2 = draw.a.norm_squared();
    let size = 1.0 + exact.gradient.factor.amax() * a2;
    let m = draw.f * draw.a;
    let pair_sum = exact.gradient.smallest_pair_sum;
    let gap = (pair_sum / m.amax().max(f64::MIN_POSITIVE)).max(1e-12);
    let regularity = regularity(&exact);
    let over = (spectra[0][2].max(spectra[1][2]) - 1.0).max(0.0);
    tally.check(number, "C <= I, C+ <= I", over, 0.0);
    let error = (products[0].dot(y) - exact.apply(y).dot(x)).abs() / size;
    tally.check(number, "C symmetric", error, 2e-14);

    // The trace does not know of axes: 3 - tr(K B).
    let k = Matrix3::from_diagonal_element(a2) - draw.a * draw.a;
    let trace = 3.0 - (k * exact.gradient.factor).trace();
    let sum: f64 = spectra[0].iter().sum();
    let error = (sum - trace).abs() / size / (1.0 + 1.0 / gap);
    tally.check(number, "sum of the spectrum", error, 4e-14);
    let mut expected = spectra[0].map(|x| x.max(0.0));
    let close = |a: &[f64; 3], b: &[f64; 3]| {
        let pairs = a.iter().zip(b);
        pairs.map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
    };
    // The axes are known to rounding over the regularity.
    let slack = 1e-12 + 1e-16 / regularity.max(1e-11);
    let error = beyond(close(&spectra[1], &expected), slack);
    tally.check(number, "spectrum of the projected core", error, 0.0);
    expected = spectra[0].map(f64::abs);
    expected.sort_by(f64::total_cmp);
    let error = beyond(close(&spectra[2], &expected) / size, slack);
    tally.check(number, "spectrum of the absolute core", error, 0.0);

    // Documented: one part in a million where A has rank one.
    let rounding = if regularity > 1e-4 { 1e-12 } else { 1e-6 };
    let quadratic = [0, 1, 2].map(|i| products[i].dot(x));
    let low = (-quadratic[1])
        .max(quadratic[1] - x.norm_squared())
        .max(0.0);
    tally.check(number, "0 <= C+ <= I", beyond(low, rounding), 0.0);
    let low = (quadratic[0].abs() - quadratic[2]).max(0.0) / size;
    tally.check(number, "|C| bounds C", beyond(low, rounding), 0.0);
    let identity = (products[2] - (products[1] * 2.0 - products[0])).amax() / size;
    tally.check(number, "|C| = 2 C+ - C", identity, 2e-14);
    tally.require(
        number,
        "filtered again unchanged",
        projected.filtered(Filter::Projected) == projected
            && absolute.filtered(Filter::Projected) == absolute
            && exact.filtered(Filter::Exact) == exact,
    );
    if lowest > 1e-9 && pair_sum > 1e-6 * m.amax() && regularity > 1e-3 {
        tally.require(
            number,
            "a definite core is kept",
            projected.gradient == exact.gradient && absolute.gradient == exact.gradient,
        );
    }
    if dear {
        dense(
            tally,
            number,
            draw,
            &[exact, projected, absolute],
            size,
            gap,
        );
    }
}

/// The same by 9x9 matrices and their eigenvalues.
fn dense(
    tally: &mut Tally,
    number: u64,
    draw: &Draw,
    cores: &[HessianCore; 3],
    size: f64,
    gap: f64,
) {
    let regularity = regularity(&cores[0]);
    let rounding = if regularity > 1e-4 { 1e-12 } else { 1e-6 };
    for core in cores {
        let matrix = core.to_matrix();
        let scale = 1.0 + core.gradient.factor.amax() * draw.a.norm_squared();
        let error = (matrix * vec(&draw.tangents[0]) - vec(&core.apply(&draw.tangents[0]))).amax();
        tally.check(number, "C dense and applied", error / scale, 2e-14);
        let mut expected = [core.spectrum().nontrivial.as_slice(), &[1.0; 6]].concat();
        expected.sort_by(f64::total_cmp);
        let values = eigenvalues(&matrix);
        let pairs = values.iter().zip(&expected);
        let error = pairs.map(|(x, y)| (x - y).abs()).fold(0.0, f64::max);
        let error = beyond(error / scale / (1.0 + 1.0 / gap), rounding);
        tally.check(number, "eigenvalues of dense C", error, 0.0);
        if core.filter != Filter::Exact {
            let low = beyond((-values[0]).max(0.0) / scale, rounding);
            tally.check(number, "filtered C dense: definite", low, 0.0);
        }
        if core.filter == Filter::Projected {
            let high = beyond((values[8] - 1.0).max(0.0), rounding);
            tally.check(number, "C+ dense: at most I", high, 0.0);
        }
    }
    if size < 10.0 && regularity > 1e-3 && gap > 1e-3 {
        let eigen = SymmetricEigen::new(cores[0].to_matrix());
        let q = eigen.eigenvectors;
        for (core, map) in [
            (&cores[1], (|x: f64| x.max(0.0)) as fn(f64) -> f64),
            (&cores[2], f64::abs),
        ] {
            let mapped = q * SMatrix::from_diagonal(&eigen.eigenvalues.map(map)) * q.transpose();
            let error = (core.to_matrix() - mapped).amax() / (1.0 + 1.0 / gap);
            tally.check(number, "filter of the dense C", error, 1e-12);
        }
    }
}

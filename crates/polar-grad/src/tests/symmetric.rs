//! What is built from symmetric matrices: minors, eigenvectors, factors.

use crate::linear::symmetrize;
use crate::symmetric::{Minors, SINGULAR, eigen, inverse_cholesky_factor};
use crate::testing::Random;
use nalgebra::{Matrix3, Vector3};

/// Each minor has its own bound, `margin * scale^k`, which it has to exceed. (All numbers are exact.)
#[test]
fn every_leading_minor_is_held_against_its_own_power_of_the_scale() {
    let (margin, scale) = (0.25, 4.0);
    // Minors of a diagonal matrix are products of its entries; the bounds are 1, 4 and 16.
    let are_above = |minors: [f64; 3]| {
        let entries = Vector3::new(minors[0], minors[1] / minors[0], minors[2] / minors[1]);
        Minors::of(&Matrix3::from_diagonal(&entries)).are_above(margin, scale)
    };
    assert!(are_above([2.0, 8.0, 32.0]));
    for k in 0..3 {
        let bound = margin * scale.powi(k as i32 + 1);
        let with = |value: f64| {
            let mut minors = [2.0, 8.0, 32.0];
            minors[k] = value;
            are_above(minors)
        };
        assert!(with(bound * 1.25), "{k}");
        assert!(!with(bound), "{k}");
        assert!(!with(bound * 0.75), "{k}");
        assert!(!with(-bound * 2.0), "{k}");
        assert!(!with(f64::NAN), "{k}");
    }
}

/// An entry whose square is no number larger than zero, beside equal diagonal entries and a large one.
#[test]
fn eigenvectors_bear_entries_that_vanish_when_squared() {
    for tiny in [1e-200, 1e-310, 0.0] {
        for large in [[0, 1], [0, 2], [1, 2]] {
            let mut s = Matrix3::repeat(tiny);
            s.fill_diagonal(1.0);
            s[(large[0], large[1])] = 0.5;
            s[(large[1], large[0])] = 0.5;
            let (values, q) = eigen(&s);
            let composed = q * Matrix3::from_diagonal(&values) * q.transpose();
            assert!((composed - s).amax() < 1e-15, "{s} {values}");
            let mut sorted: [f64; 3] = values.into();
            sorted.sort_by(f64::total_cmp);
            for (x, expected) in sorted.iter().zip([0.5, 1.0, 1.5]) {
                assert!((x - expected).abs() < 1e-15, "{s} {values}");
            }
        }
    }
}

/// `L L^T` is the matrix itself where that is regular, and where it is not, it raised by [`SINGULAR`] times its trace, in any unit.
#[test]
fn the_cholesky_factor_is_that_of_a_matrix_raised_where_it_is_singular() {
    let mut random = Random::new(41);
    for _ in 0..200 {
        let n = random.rotation().column(0).into_owned();
        let regular = Matrix3::identity() + symmetrize(&random.matrix()) * 0.3;
        let rank_one = n * n.transpose();
        let rank_two = Matrix3::identity() - rank_one;
        for size in [1e-6, 1.0, 1e6] {
            for (g, shift) in [(regular, 0.0), (rank_one, SINGULAR), (rank_two, SINGULAR)] {
                let g = g * size;
                let raised = g + Matrix3::from_diagonal_element(shift * g.trace());
                let inverse = inverse_cholesky_factor(&g);
                let unit = inverse * raised * inverse.transpose();
                let error = (unit - Matrix3::identity()).amax();
                // Rounding of G over what it is raised by.
                let tolerance = if shift == 0.0 { 1e-14 } else { 1e-7 };
                assert!(error < tolerance, "{g} {error:e}");
                let diagonal = Matrix3::from_diagonal(&inverse.diagonal());
                assert_eq!(inverse.upper_triangle(), diagonal);
            }
        }
    }
}

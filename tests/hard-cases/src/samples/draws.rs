//! One sample, drawn at random around what is known of it.

use nalgebra::{Matrix3, Vector3};
use polar_grad::actuation_from_b;
use polar_grad::testing::Random;

/// A signed singular value decomposition that is known before it is asked for.
#[derive(Debug, Clone, Copy)]
pub struct Planted {
    pub u: Matrix3<f64>,
    /// `x >= y >= |z|`.
    pub sigma: Vector3<f64>,
    pub v: Matrix3<f64>,
}

impl Planted {
    /// `U diag(sigma) V^T` for values of any order and signs, by the same product's signed decomposition.
    pub fn new(u: Matrix3<f64>, sigma: Vector3<f64>, v: Matrix3<f64>) -> Self {
        let (mut u, mut sigma, mut v) = (u, sigma, v);
        for (p, q) in [(0, 1), (0, 2), (1, 2)] {
            if sigma[q].abs() > sigma[p].abs() {
                // A quarter turn on both sides: the determinants stay.
                sigma.swap_rows(p, q);
                for m in [&mut u, &mut v] {
                    m.swap_columns(p, q);
                    m.column_mut(p).neg_mut();
                }
            }
        }
        // Half turns bring all signs into the last value.
        for k in [0, 1] {
            if sigma[k] < 0.0 {
                sigma[k] = -sigma[k];
                sigma[2] = -sigma[2];
                u.column_mut(k).neg_mut();
                u.column_mut(2).neg_mut();
            }
        }
        Self { u, sigma, v }
    }

    pub fn rotation(&self) -> Matrix3<f64> {
        self.u * self.v.transpose()
    }

    pub fn matrix(&self) -> Matrix3<f64> {
        self.u * Matrix3::from_diagonal(&self.sigma) * self.v.transpose()
    }
}

/// A deformation gradient and an actuation, with what is known of their product.
#[derive(Debug, Clone, Copy)]
pub struct Draw {
    pub f: Matrix3<f64>,
    pub a: Matrix3<f64>,
    /// What is decomposed: `F A`, or what `F` was made from.
    pub m: Matrix3<f64>,
    /// Its decomposition, where it is known.
    pub planted: Option<Planted>,
    /// Two tangents of norm one.
    pub tangents: [Matrix3<f64>; 2],
}

impl Draw {
    /// A sample whose `F A` is this, `A` being the identity in every other draw.
    pub fn of_product(random: &mut Random, m: Matrix3<f64>, planted: Option<Planted>) -> Self {
        let plain = random.bits().is_multiple_of(2);
        let a = if plain {
            Matrix3::identity()
        } else {
            ordinary_actuation(random)
        };
        let f = if plain {
            m
        } else {
            m * a.try_inverse().expect("a regular actuation")
        };
        Self {
            f,
            a,
            m,
            planted,
            tangents: tangents(random),
        }
    }

    /// A sample whose `F A` has these singular values, of any order and signs, between random rotations.
    pub fn of_values(random: &mut Random, sigma: [f64; 3]) -> Self {
        let (u, v) = (random.rotation(), random.rotation());
        let planted = Planted::new(u, Vector3::from(sigma), v);
        Self::of_product(random, planted.matrix(), Some(planted))
    }

    /// A sample of a given actuation.
    pub fn of_actuation(random: &mut Random, f: Matrix3<f64>, a: Matrix3<f64>) -> Self {
        Self {
            f,
            a,
            m: f * a,
            planted: None,
            tangents: tangents(random),
        }
    }
}

/// An actuation whose eigenvalues lie in `[0.25, 1.75]`.
pub fn ordinary_actuation(random: &mut Random) -> Matrix3<f64> {
    actuation_from_b(&random.actuation_entries(0.25))
}

/// A deformation gradient of any sign of the determinant.
pub fn ordinary_deformation(random: &mut Random) -> Matrix3<f64> {
    random.rotation() * (Matrix3::identity() + random.matrix() * 0.7)
}

/// Uniform in `[low, high)`.
pub fn between(random: &mut Random, low: f64, high: f64) -> f64 {
    low + (high - low) * 0.5 * (1.0 + random.signed())
}

/// A power of ten with an exponent uniform in `[low, high)`.
pub fn decades(random: &mut Random, low: f64, high: f64) -> f64 {
    10.0_f64.powf(between(random, low, high))
}

fn tangents(random: &mut Random) -> [Matrix3<f64>; 2] {
    [(); 2].map(|()| {
        let m = random.matrix();
        m / m.norm().max(1e-3)
    })
}

/// Three factors of `2^e`, also where that is no number; only the last product may round.
fn power_in_parts(e: i32) -> [f64; 3] {
    let part = e / 3;
    let power = |e: i32| f64::from_bits(((e + 1023) as u64) << 52);
    [power(part), power(part), power(e - 2 * part)]
}

/// `2^e M`.
pub fn scaled(m: &Matrix3<f64>, e: i32) -> Matrix3<f64> {
    let [a, b, c] = power_in_parts(e);
    m.map(|x| x * a * b * c)
}

/// `2^e x`.
pub fn times_power(x: f64, e: i32) -> f64 {
    let [a, b, c] = power_in_parts(e);
    x * a * b * c
}

/// The exponent of the power of two that is as large as the largest entry; zero for the zero matrix.
pub fn exponent(m: &Matrix3<f64>) -> i32 {
    let largest = m.amax();
    if largest == 0.0 {
        return 0;
    }
    let e = largest.log2().floor();
    e as i32
}

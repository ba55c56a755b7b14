//! Planted cases for tests: matrices built from known singular values, and the classes that break
//! naive code.
//!
//! Only with the feature `testing`. Everything is deterministic in its seed.

use nalgebra::{Matrix3, Quaternion, UnitQuaternion, Vector3};

/// Signed singular values that are hard for some algorithm, with a name.
pub const HARD_CLASSES: &[(&str, [f64; 3])] = &[
    ("rest", [1.0, 1.0, 1.0]),
    ("generic", [1.4, 0.9, 0.6]),
    ("two equal, large", [1.3, 1.3, 0.7]),
    ("two equal, small", [1.3, 0.7, 0.7]),
    ("almost equal", [1.0 + 1e-9, 1.0, 1.0 - 1e-9]),
    ("inverted", [1.3, 0.8, -0.3]),
    ("inverted, two equal", [1.2, 1.2, -0.4]),
    ("nearly a reflection", [1.2, 0.5, -0.499]),
    ("within 1e-8 of a reflection", [1.2, 0.5, -0.5 + 1e-8]),
    ("within 1e-14 of a reflection", [1.2, 0.5, -0.5 + 1e-14]),
    ("tie s_y = -s_z", [1.2, 0.5, -0.5]),
    ("reflection", [1.0, 1.0, -1.0]),
    ("rank two", [1.1, 0.6, 0.0]),
    ("rank two, equal", [1.0, 1.0, 0.0]),
    ("almost rank two", [1.1, 0.6, 1e-15]),
    ("rank one", [0.9, 0.0, 0.0]),
    ("almost rank one", [0.9, 1e-12, 1e-13]),
    ("graded", [1.0, 1e-6, 1e-12]),
    ("graded, inverted", [1.0, 1e-6, -1e-9]),
    ("zero", [0.0, 0.0, 0.0]),
];

/// Factors by which the hard classes are multiplied.
pub const SCALES: &[f64] = &[1e-150, 1e-100, 1e-20, 1e-3, 1.0, 1e4, 1e20, 1e100, 1e150];

/// A matrix made from a known signed SVD.
#[derive(Clone, Copy, Debug)]
pub struct Planted {
    /// `U diag(sigma) V^T`, rounded.
    pub matrix: Matrix3<f64>,
    /// The rotation `U`.
    pub u: Matrix3<f64>,
    /// The signed singular values.
    pub sigma: Vector3<f64>,
    /// The rotation `V`.
    pub v: Matrix3<f64>,
}

/// A small deterministic generator (SplitMix64).
#[derive(Clone, Debug)]
pub struct Random(u64);

impl Random {
    /// A generator for a seed; equal seeds give equal sequences.
    pub fn new(seed: u64) -> Self {
        Self(
            seed.wrapping_mul(0x9e37_79b9_7f4a_7c15)
                .wrapping_add(0x1234_5678_9abc_def1),
        )
    }

    /// The next 64 bits.
    pub fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let z = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    /// Uniform in `[-1, 1)`.
    pub fn signed(&mut self) -> f64 {
        (self.bits() >> 11) as f64 / (1_u64 << 52) as f64 - 1.0
    }

    /// A matrix with entries uniform in `[-1, 1)`.
    pub fn matrix(&mut self) -> Matrix3<f64> {
        Matrix3::from_fn(|_, _| self.signed())
    }

    /// Six entries uniform in `[-size, size)`, for [`crate::actuation_from_b`].
    pub fn actuation_entries(&mut self, size: f64) -> [f64; 6] {
        std::array::from_fn(|_| size * self.signed())
    }

    /// A rotation, uniformly distributed.
    pub fn rotation(&mut self) -> Matrix3<f64> {
        loop {
            let q = Quaternion::new(self.signed(), self.signed(), self.signed(), self.signed());
            if (0.01..1.0).contains(&q.norm_squared()) {
                return UnitQuaternion::from_quaternion(q)
                    .to_rotation_matrix()
                    .into_inner();
            }
        }
    }
}

/// A uniformly distributed rotation from a seed.
pub fn rotation(seed: u64) -> Matrix3<f64> {
    Random::new(seed).rotation()
}

/// A matrix with given signed singular values and random singular vectors.
pub fn planted(sigma: [f64; 3], seed: u64) -> Planted {
    let mut random = Random::new(seed);
    let (u, v, sigma) = (random.rotation(), random.rotation(), Vector3::from(sigma));
    Planted {
        matrix: u * Matrix3::from_diagonal(&sigma) * v.transpose(),
        u,
        sigma,
        v,
    }
}

/// A deformation gradient `F` for which `F A` has given signed singular values.
///
/// # Panics
/// When `a` is singular.
pub fn deformation_with(sigma: [f64; 3], a: &Matrix3<f64>, seed: u64) -> Matrix3<f64> {
    planted(sigma, seed).matrix * a.try_inverse().expect("the actuation must be regular")
}

/// Every hard class at every scale, `count` times with different singular vectors: class name and
/// planted matrix.
pub fn hard_cases(count: u64) -> impl Iterator<Item = (&'static str, Planted)> {
    HARD_CLASSES.iter().flat_map(move |(name, sigma)| {
        SCALES.iter().flat_map(move |scale| {
            (0..count).map(move |seed| (*name, planted(sigma.map(|s| s * scale), seed)))
        })
    })
}

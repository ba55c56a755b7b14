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

#[cfg(test)]
mod tests {
    use super::*;

    /// Published outputs of SplitMix64 from the state 1234567.
    #[test]
    fn bits_are_those_of_splitmix64() {
        let mut random = Random(1_234_567);
        let expected = [
            6_457_827_717_110_365_317,
            3_203_168_211_198_807_973,
            9_817_491_932_198_370_423,
            4_593_380_528_125_082_431,
            16_408_922_859_458_223_821,
        ];
        assert_eq!(expected.map(|_| random.bits()), expected);
    }

    /// Mean 0 and variance 1/3, from -1 to 1; entries of an actuation the same, times their size.
    #[test]
    fn numbers_are_uniform() {
        let mut random = Random::new(1);
        let of_actuations = |random: &mut Random| random.actuation_entries(0.25).map(|x| 4.0 * x);
        let numbers: [Vec<f64>; 2] = [
            (0..60_000).map(|_| random.signed()).collect(),
            (0..10_000)
                .flat_map(|_| of_actuations(&mut random))
                .collect(),
        ];
        for x in numbers {
            let n = x.len() as f64;
            let mean = x.iter().sum::<f64>() / n;
            let variance = x.iter().map(|x| x * x).sum::<f64>() / n;
            assert!(mean.abs() < 0.02, "{mean}");
            assert!((variance - 1.0 / 3.0).abs() < 0.01, "{variance}");
            assert!(x.iter().all(|x| (-1.0..1.0).contains(x)));
        }
    }

    #[test]
    fn deformations_have_their_singular_values_after_the_actuation() {
        let a = crate::actuation_from_b(&[0.1, -0.2, 0.3, 0.2, -0.1, 0.4]);
        for seed in 0..20 {
            let sigma = Vector3::new(1.3, 0.8, -0.3);
            let f = deformation_with(sigma.into(), &a, seed);
            let error = (crate::signed_svd(&(f * a)).sigma - sigma).amax();
            assert!(error < 1e-14, "{error:e}");
        }
    }

    /// `s_x >= s_y >= |s_z|`, with the sign and the distance from a reflection that the name says.
    #[test]
    fn hard_classes_are_what_they_are_called() {
        for &(name, [x, y, z]) in HARD_CLASSES {
            assert!(x >= y && y >= z.abs(), "{name}");
            let words = ["inverted", "reflection", "tie"];
            assert_eq!(z < 0.0, words.iter().any(|w| name.contains(w)), "{name}");
            let gap = match name {
                "nearly a reflection" => 1e-3,
                "within 1e-8 of a reflection" => 1e-8,
                "within 1e-14 of a reflection" => 1e-14,
                "reflection" | "tie s_y = -s_z" => 0.0,
                _ => continue,
            };
            assert!((y + z - gap).abs() < 1e-16, "{name}: {:e}", y + z);
        }
    }

    #[test]
    fn hard_cases_are_every_class_at_every_scale() {
        let mut cases = hard_cases(2);
        for (name, sigma) in HARD_CLASSES {
            for scale in SCALES {
                for _ in 0..2 {
                    let (found, case) = cases.next().expect("one more");
                    assert_eq!((found, case.sigma), (*name, Vector3::from(*sigma) * *scale));
                }
            }
        }
        assert!(cases.next().is_none());
    }
}

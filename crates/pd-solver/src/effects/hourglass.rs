//! What holds an element with a single sample together.

use super::elasticity::{Corners, stiffness_block};
use hex_mesh::{Quadrature, QuadratureRule, corner_offset};
use nalgebra::Vector3;

/// The four modes of a cube (products of two or three coordinates) whose gradient vanishes at the centre, each with the
/// stiffness that full integration of `|F|^2` gives it (Flanagan and Belytschko 1981).
///
/// The energy is zero on affine deformations, invariant under rotation, and makes the constant matrix that of eight samples,
/// so that it stays an upper bound of the Hessian.
pub(super) struct Hourglass {
    modes: [[f64; 8]; 4],
    stiffness: [f64; 4],
}

impl Hourglass {
    /// `scale` is stiffness times volume of an element.
    pub(super) fn new(size: f64, scale: f64) -> Self {
        let sign = |corner: usize, axis: usize| 2.0 * corner_offset(corner)[axis] as f64 - 1.0;
        let product = |axes: &[usize]| -> [f64; 8] {
            std::array::from_fn(|c| axes.iter().map(|&a| sign(c, a)).product())
        };
        let modes = [
            product(&[1, 2]),
            product(&[0, 2]),
            product(&[0, 1]),
            product(&[0, 1, 2]),
        ];
        let rule = QuadratureRule::new(Quadrature::Eight);
        let weights: Vec<f64> = rule.weights.iter().map(|w| w * scale).collect();
        let block = stiffness_block(&rule.gradients(size), &weights);
        // The modes are eigenvectors: each has its own parity under the reflections of the cube.
        let stiffness = modes.map(|m| {
            let quadratic: f64 = (0..64)
                .map(|i| m[i / 8] * block[i / 8][i % 8] * m[i % 8])
                .sum();
            quadratic / 64.0
        });
        Self { modes, stiffness }
    }

    /// Adds the forces of the modes in `x` and returns their energy.
    pub(super) fn add(&self, x: &Corners, force: &mut Corners) -> f64 {
        let mut energy = 0.0;
        for (mode, k) in self.modes.iter().zip(&self.stiffness) {
            let amplitude: Vector3<f64> = mode.iter().zip(x).map(|(m, x)| x * *m).sum();
            energy += 0.5 * k * amplitude.norm_squared();
            for (m, force) in mode.iter().zip(force.iter_mut()) {
                *force += amplitude * (k * m);
            }
        }
        energy
    }

    /// Adds the modes to an element's block of the constant matrix.
    pub(super) fn add_block(&self, block: &mut [[f64; 8]; 8]) {
        for (mode, k) in self.modes.iter().zip(&self.stiffness) {
            for (a, row) in block.iter_mut().enumerate() {
                row.iter_mut()
                    .enumerate()
                    .for_each(|(b, entry)| *entry += k * mode[a] * mode[b]);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// One sample plus the modes is full integration, entry by entry.
    #[test]
    fn completes_the_constant_block() {
        let block = |quadrature| {
            let rule = QuadratureRule::new(quadrature);
            stiffness_block(&rule.gradients(0.5), &rule.weights)
        };
        let mut completed = block(Quadrature::One);
        Hourglass::new(0.5, 1.0).add_block(&mut completed);
        for (a, b) in completed
            .iter()
            .flatten()
            .zip(block(Quadrature::Eight).iter().flatten())
        {
            assert!((a - b).abs() < 1e-14);
        }
    }
}

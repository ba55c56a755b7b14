//! What holds an element with a single sample together.
//!
//! A box has four modes (products of two or three coordinates) whose gradient vanishes at the centre. Each gets the stiffness that
//! full integration of `|F|^2` gives it (Flanagan and Belytschko 1981). The energy is zero on affine deformations, invariant under
//! rotation, and makes the constant matrix that of eight samples, so that it stays an upper bound of the Hessian.

use super::block::{Block, CornerLanes};
use hex_mesh::corner_offset;
use pulp::Simd;

/// Signs of the modes at the corners: yz, xz, xy, xyz in coordinates from -1 to 1.
const MODES: [[f64; 8]; 4] = [
    products([false, true, true]),
    products([true, false, true]),
    products([true, true, false]),
    products([true, true, true]),
];

/// Product of some of the coordinates at every corner.
const fn products(axes: [bool; 3]) -> [f64; 8] {
    let mut out = [1.0; 8];
    let mut corner = 0;
    while corner < 8 {
        let mut axis = 0;
        while axis < 3 {
            if axes[axis] && corner_offset(corner)[axis] == 0 {
                out[corner] = -out[corner];
            }
            axis += 1;
        }
        corner += 1;
    }
    out
}

/// Factor on the stiffness of a product of two coordinates: slope^2 times one mean square, over the 8 x 8 of the signs.
const TWO: f64 = 4.0 / 3.0 / 64.0;
/// The same of all three.
const THREE: f64 = 4.0 / 9.0 / 64.0;

/// `int |grad m|^2 / volume / 64` of each mode m in a box, from the squares of the inverse edge lengths.
///
/// Along an axis that m is a product of, m changes with slope `2 / h` times the product of the others, whose squares have the mean
/// 1/3 each.
fn stiffness([x, y, z]: [f64; 3]) -> [f64; 4] {
    [
        TWO * (y + z),
        TWO * (x + z),
        TWO * (x + y),
        THREE * (x + y + z),
    ]
}

/// Adds the forces of the modes in `x` to the lanes of one register, and gives their energy.
#[inline(always)]
pub(super) fn add_forces<S: Simd>(
    simd: S,
    block: &Block,
    x: &CornerLanes,
    part: usize,
    force: &mut CornerLanes,
) -> f64 {
    let weight = block.weight.part::<S>(part);
    let mut squares = [weight; 3];
    for (out, inverse) in squares.iter_mut().zip(&block.inverse_size) {
        let inverse = inverse.part::<S>(part);
        *out = simd.mul_f64s(inverse, inverse);
    }
    let [xx, yy, zz] = squares;
    let two = simd.mul_f64s(weight, simd.splat_f64s(TWO));
    let three = simd.mul_f64s(weight, simd.splat_f64s(THREE));
    let (xy, yz, xz) = (
        simd.add_f64s(xx, yy),
        simd.add_f64s(yy, zz),
        simd.add_f64s(xx, zz),
    );
    let stiffness = [
        simd.mul_f64s(two, yz),
        simd.mul_f64s(two, xz),
        simd.mul_f64s(two, xy),
        simd.mul_f64s(three, simd.add_f64s(xy, zz)),
    ];
    let mut energy = simd.splat_f64s(0.0);
    for (mode, k) in MODES.iter().zip(stiffness) {
        for (x, force) in x.iter().zip(force.iter_mut()) {
            let mut amplitude = simd.splat_f64s(0.0);
            for (sign, x) in mode.iter().zip(x) {
                let sign = simd.splat_f64s(*sign);
                amplitude = simd.mul_add_e_f64s(sign, x.part::<S>(part), amplitude);
            }
            let pull = simd.mul_f64s(k, amplitude);
            energy = simd.mul_add_e_f64s(pull, amplitude, energy);
            for (sign, force) in mode.iter().zip(force.iter_mut()) {
                let force = force.part_mut::<S>(part);
                *force = simd.mul_add_e_f64s(simd.splat_f64s(*sign), pull, *force);
            }
        }
    }
    0.5 * simd.reduce_sum_f64s(energy)
}

/// Adds the modes to the block of the constant matrix of an element of unit weight, given the squares of its inverse edge lengths.
pub(super) fn add_to_constant(inverse_size2: [f64; 3], block: &mut [[f64; 8]; 8]) {
    for (mode, k) in MODES.iter().zip(stiffness(inverse_size2)) {
        for (a, row) in block.iter_mut().enumerate() {
            for (b, entry) in row.iter_mut().enumerate() {
                *entry += k * mode[a] * mode[b];
            }
        }
    }
}

//! Eight consecutive elements side by side: their nodes, sizes and weights, and the way between nodes and lanes.

use nalgebra::Vector3;
use pulp::Simd;

/// Elements in a block.
pub(super) const LANES: usize = 8;

/// One number per element of a block, on one line of the cache.
#[derive(Clone, Copy, Debug, PartialEq)]
#[repr(C, align(64))]
pub(super) struct Lanes(pub(super) [f64; LANES]);

impl Lanes {
    pub(super) const ZERO: Self = Self([0.0; LANES]);

    /// The lanes that fit one register, part number `part`.
    #[inline(always)]
    pub(super) fn part<S: Simd>(&self, part: usize) -> S::f64s {
        S::as_simd_f64s(&self.0).0[part]
    }

    /// The same, to write.
    #[inline(always)]
    pub(super) fn part_mut<S: Simd>(&mut self, part: usize) -> &mut S::f64s {
        &mut S::as_mut_simd_f64s(&mut self.0).0[part]
    }
}

/// Registers per block.
#[inline(always)]
pub(super) const fn parts<S: Simd>() -> usize {
    LANES / S::F64_LANES
}

/// A vector per corner and element: `[axis][corner]`.
pub(super) type CornerLanes = [[Lanes; 8]; 3];

/// Eight consecutive elements. A block that is not full is filled with copies of its first element whose weight is zero, so that
/// every lane holds ordinary numbers and no loop has a remainder.
#[derive(Clone, Copy)]
pub(super) struct Block {
    /// `[element][corner]`.
    nodes: [[u32; 8]; LANES],
    /// 1 / edge length, per axis.
    pub(super) inverse_size: [Lanes; 3],
    /// Stiffness times volume of an element.
    pub(super) weight: Lanes,
}

impl Block {
    /// The block of up to eight elements.
    pub(super) fn new(elements: &[[u32; 8]], sizes: &[Vector3<f64>], weights: &[f64]) -> Self {
        let filled = |lane: usize| if lane < elements.len() { lane } else { 0 };
        let inverse =
            |axis: usize| Lanes(std::array::from_fn(|lane| 1.0 / sizes[filled(lane)][axis]));
        Self {
            nodes: std::array::from_fn(|lane| elements[filled(lane)]),
            inverse_size: std::array::from_fn(inverse),
            weight: Lanes(std::array::from_fn(|lane| {
                weights.get(lane).copied().unwrap_or(0.0)
            })),
        }
    }

    /// The vectors at the corners of all elements.
    #[inline(always)]
    pub(super) fn gather(&self, x: &[Vector3<f64>]) -> CornerLanes {
        let mut out = [[Lanes::ZERO; 8]; 3];
        for (lane, nodes) in self.nodes.iter().enumerate() {
            for (corner, &node) in nodes.iter().enumerate() {
                let x = &x[node as usize];
                for axis in 0..3 {
                    out[axis][corner].0[lane] = x[axis];
                }
            }
        }
        out
    }

    /// Adds the vectors at the corners to those of the nodes, of which `out` holds those from number `first` on.
    #[inline(always)]
    pub(super) fn scatter(&self, force: &CornerLanes, first: usize, out: &mut [Vector3<f64>]) {
        for (lane, nodes) in self.nodes.iter().enumerate() {
            for (corner, &node) in nodes.iter().enumerate() {
                let out = &mut out[node as usize - first];
                for axis in 0..3 {
                    out[axis] += force[axis][corner].0[lane];
                }
            }
        }
    }
}

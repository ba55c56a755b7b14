//! Kernels over many 3x3 matrices in SIMD lanes, on every instruction set of the machine.

use nalgebra::Matrix3;
use polar_grad::lanes::{
    LaneMatrix, polar_rotation_lanes, projected_factor_lanes, rotation_factor_lanes,
    rotation_tangent_lanes,
};
use pulp::{Simd, WithSimd};
use std::hint::black_box;

/// Matrices in a block: a multiple of the lanes of every instruction set.
pub const BLOCK: usize = 8;

/// Eight matrices, entry by entry: `block[3 i + j]` holds M_ij of each.
pub type Block = [[f64; BLOCK]; 9];

/// What is done to every matrix.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LaneKernel {
    /// The polar rotation.
    Rotation,
    /// The polar rotation, and the six entries of the factor of its derivative.
    Factor,
    /// The factor of the projected Hessian core, of blocks whose first six rows are the pair sums.
    Projection,
    /// The tangent of a rotation, as every Hessian product needs it. Each block stands for rotations, the next two for the
    /// directions and the factors: any numbers do, as there is no branch in it.
    Tangent,
}

/// The entries of A in the measurements of projections.
pub const ACTUATION: [f64; 6] = [1.2, 0.05, 0.0, 0.9, 0.05, 0.85];

/// Blocks of matrices; the list is a multiple of [`BLOCK`] long.
pub fn blocks(matrices: &[Matrix3<f64>]) -> Vec<Block> {
    packed(matrices, |m| std::array::from_fn(|k| m[(k / 3, k % 3)]))
}

/// Blocks of symmetric matrices, given by their six entries; the last three rows are zero.
pub fn symmetric_blocks(matrices: &[[f64; 6]]) -> Vec<Block> {
    packed(matrices, |s| {
        std::array::from_fn(|k| s.get(k).copied().unwrap_or(0.0))
    })
}

fn packed<T>(items: &[T], entries: impl Fn(&T) -> [f64; 9]) -> Vec<Block> {
    let block = |items: &[T]| {
        let mut block = [[0.0; BLOCK]; 9];
        for (i, item) in items.iter().enumerate() {
            for (row, entry) in block.iter_mut().zip(entries(item)) {
                row[i] = entry;
            }
        }
        block
    };
    items.chunks_exact(BLOCK).map(block).collect()
}

/// The matrices of blocks, one after another.
pub fn matrices(blocks: &[Block]) -> Vec<Matrix3<f64>> {
    let all = blocks.iter().flat_map(|block| {
        (0..BLOCK).map(|i| Matrix3::from_fn(|row, column| block[3 * row + column][i]))
    });
    all.collect()
}

/// Runs a kernel over all blocks on an instruction set.
pub fn run(set: InstructionSet, kernel: LaneKernel, input: &[Block], out: &mut [Block]) {
    set.run(Pass { kernel, input, out });
}

/// An instruction set that this machine has.
#[derive(Debug, Clone, Copy)]
pub enum InstructionSet {
    /// No vectors at all.
    Portable,
    /// What pulp finds best on processors of other kinds.
    #[cfg(not(target_arch = "x86_64"))]
    Best,
    /// AVX2 with FMA.
    #[cfg(target_arch = "x86_64")]
    Avx2(pulp::x86::V3),
    /// AVX-512.
    #[cfg(target_arch = "x86_64")]
    Avx512(pulp::x86::V4),
}

impl InstructionSet {
    /// All that this machine has, the best one last.
    pub fn all() -> Vec<Self> {
        let mut all = vec![Self::Portable];
        #[cfg(not(target_arch = "x86_64"))]
        all.push(Self::Best);
        #[cfg(target_arch = "x86_64")]
        {
            all.extend(pulp::x86::V3::try_new().map(Self::Avx2));
            all.extend(pulp::x86::V4::try_new().map(Self::Avx512));
        }
        all
    }

    /// The best one.
    pub fn best() -> Self {
        *Self::all().last().expect("the portable one at least")
    }

    /// Its name.
    pub fn name(self) -> &'static str {
        match self {
            Self::Portable => "portable",
            #[cfg(not(target_arch = "x86_64"))]
            Self::Best => "best",
            #[cfg(target_arch = "x86_64")]
            Self::Avx2(_) => "AVX2",
            #[cfg(target_arch = "x86_64")]
            Self::Avx512(_) => "AVX-512",
        }
    }

    /// Runs an operation on it.
    pub fn run<Op: WithSimd>(self, operation: Op) -> Op::Output {
        match self {
            Self::Portable => pulp::Scalar::new().vectorize(operation),
            #[cfg(not(target_arch = "x86_64"))]
            Self::Best => pulp::Arch::new().dispatch(operation),
            #[cfg(target_arch = "x86_64")]
            Self::Avx2(simd) => Simd::vectorize(simd, operation),
            #[cfg(target_arch = "x86_64")]
            Self::Avx512(simd) => Simd::vectorize(simd, operation),
        }
    }
}

struct Pass<'a> {
    kernel: LaneKernel,
    input: &'a [Block],
    out: &'a mut [Block],
}

impl WithSimd for Pass<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let zero = simd.splat_f64s(0.0);
        let actuation = black_box(ACTUATION).map(|a| simd.splat_f64s(a));
        for (i, out) in self.out.iter_mut().enumerate() {
            let block = |ahead: usize| &self.input[(i + ahead) % self.input.len()];
            for part in 0..BLOCK / S::F64_LANES {
                let load = |block: &Block| {
                    let mut m: LaneMatrix<S> = [zero; 9];
                    for (m, entries) in m.iter_mut().zip(block) {
                        *m = S::as_simd_f64s(entries).0[part];
                    }
                    m
                };
                let m = load(block(0));
                let result = match self.kernel {
                    LaneKernel::Rotation => polar_rotation_lanes(simd, &m),
                    LaneKernel::Factor => {
                        let rotation = polar_rotation_lanes(simd, &m);
                        let [f0, f1, f2, f3, f4, f5] =
                            rotation_factor_lanes(simd, &rotation, &m).factor;
                        let [.., r6, r7, r8] = rotation;
                        [f0, f1, f2, f3, f4, f5, r6, r7, r8]
                    }
                    LaneKernel::Projection => {
                        let [t0, t1, t2, t3, t4, t5, ..] = m;
                        let sums = [t0, t1, t2, t3, t4, t5];
                        let [f0, f1, f2, f3, f4, f5] =
                            projected_factor_lanes(simd, &sums, &actuation);
                        [f0, f1, f2, f3, f4, f5, zero, zero, zero]
                    }
                    LaneKernel::Tangent => {
                        let [f0, f1, f2, f3, f4, f5, ..] = load(block(2));
                        let factor = [f0, f1, f2, f3, f4, f5];
                        rotation_tangent_lanes(simd, &m, &factor, &load(block(1)))
                    }
                };
                for (entries, result) in out.iter_mut().zip(result) {
                    S::as_mut_simd_f64s(entries).0[part] = result;
                }
            }
        }
    }
}

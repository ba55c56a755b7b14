//! The constant matrix of local/global iteration: assembled once, factored once, as one scalar matrix for three axes.
//!
//! Every effect with a local projection contributes `sum w G^T G`, which acts on x, y and z alike (maths.md, "The spectrum of
//! C"): a single factor of a third of the size then serves all three right-hand sides.

use crate::error::SolverError;
use crate::ordering::nested_dissection;
use crate::panel::{PanelFactor, Row};
use crate::vector::NodalVector;
use faer::dyn_stack::{MemBuffer, MemStack};
use faer::perm::PermRef;
use faer::sparse::linalg::SupernodalThreshold;
use faer::sparse::linalg::cholesky::{
    CholeskySymbolicParams, SymmetricOrdering, factorize_symbolic_cholesky,
};
use faer::sparse::{SparseColMatRef, SymbolicSparseColMatRef};
use faer::{Par, Side};
use nalgebra::Vector3;
use sprs::{CsMat, TriMat};

/// Collects the entries of the constant matrix over the free nodes; each symmetric pair is given once, as lower triangle.
pub(crate) struct ConstantMatrix<'a> {
    free_index: &'a [Option<u32>],
    triplets: TriMat<f64>,
}

impl<'a> ConstantMatrix<'a> {
    /// An empty matrix; `free_index[node]` is the row of a free node.
    pub(crate) fn new(free_index: &'a [Option<u32>], free: usize) -> Self {
        Self {
            free_index,
            triplets: TriMat::new((free, free)),
        }
    }

    /// Adds the symmetric block `stiffness * weights weights^T` of one linear form over some nodes.
    pub(crate) fn add_outer(&mut self, nodes: &[u32], weights: &[f64], stiffness: f64) {
        self.add_block(nodes, |a, b| stiffness * weights[a] * weights[b]);
    }

    /// Adds a symmetric block over some nodes; `entry(a, b)` is asked for local indices.
    pub(crate) fn add_block(&mut self, nodes: &[u32], entry: impl Fn(usize, usize) -> f64) {
        for (a, &node_a) in nodes.iter().enumerate() {
            let Some(row) = self.free_index[node_a as usize] else {
                continue;
            };
            for (b, &node_b) in nodes.iter().enumerate() {
                if let Some(column) = self.free_index[node_b as usize]
                    && row >= column
                {
                    let value = entry(a, b);
                    self.triplets
                        .add_triplet(row as usize, column as usize, value);
                }
            }
        }
    }

    /// The lower triangle, compressed by columns.
    fn compress(self) -> CsMat<f64> {
        self.triplets.to_csc()
    }
}

/// The factored constant matrix and the map between nodes and its rows.
pub(crate) struct ConstantSystem {
    free: Vec<u32>,
    /// The free nodes in the order of the factor.
    elimination: Vec<u32>,
    factor: PanelFactor,
    stiffest: f64,
    nonzeros: usize,
    rows: Vec<Row>,
}

impl ConstantSystem {
    /// Orders, analyses and factors the matrix. `free[row]` is the node of a row, `positions` the rest positions of all nodes.
    pub(crate) fn factor(
        matrix: ConstantMatrix,
        free: Vec<u32>,
        positions: &[Vector3<f64>],
        spacing: f64,
    ) -> Result<Self, SolverError> {
        let n = free.len();
        let lower = matrix.compress();
        let points: Vec<_> = free.iter().map(|&i| positions[i as usize]).collect();
        let forward = nested_dissection(&points, spacing);
        let mut inverse = vec![0; n];
        for (new, &old) in forward.iter().enumerate() {
            inverse[old] = new;
        }
        let failed = |reason: String| SolverError::Factorisation { size: n, reason };
        let index_pointer = lower.indptr();
        let pattern = SymbolicSparseColMatRef::new_checked(
            n,
            n,
            index_pointer.raw_storage(),
            None,
            lower.indices(),
        );
        let symbolic = factorize_symbolic_cholesky(
            pattern,
            Side::Lower,
            SymmetricOrdering::Custom(PermRef::new_checked(&forward, &inverse, n)),
            CholeskySymbolicParams {
                supernodal_flop_ratio_threshold: SupernodalThreshold::FORCE_SUPERNODAL,
                ..Default::default()
            },
        )
        .map_err(|e| failed(e.to_string()))?;
        let mut values = vec![0.0; symbolic.len_val()];
        // One thread everywhere: results must not depend on how many there are, and faer's triangular solve is slower on two.
        let mut scratch = MemBuffer::new(
            symbolic.factorize_numeric_llt_scratch::<f64>(Par::Seq, Default::default()),
        );
        symbolic
            .factorize_numeric_llt(
                &mut values,
                SparseColMatRef::new(pattern, lower.data()),
                Side::Lower,
                Default::default(),
                Par::Seq,
                MemStack::new(&mut scratch),
                Default::default(),
            )
            .map_err(|e| failed(e.to_string()))?;
        let factor = PanelFactor::new(&symbolic, &values)
            .ok_or_else(|| failed("the factor is not supernodal".into()))?;
        let permutation = symbolic.perm().expect("an order was given");
        let order = permutation.arrays().0;
        let diagonal = (0..n).filter_map(|i| lower.get(i, i).copied());
        Ok(Self {
            elimination: order.iter().map(|&i| free[i]).collect(),
            stiffest: diagonal.fold(0.0, f64::max),
            nonzeros: lower.nnz(),
            rows: vec![[0.0; 4]; n],
            free,
            factor,
        })
    }

    /// `out = K^-1 r` on the free nodes, zero on the prescribed ones.
    pub(crate) fn solve(&mut self, r: &[Vector3<f64>], out: &mut NodalVector) {
        for (row, &node) in self.rows.iter_mut().zip(&self.elimination) {
            let r = &r[node as usize];
            *row = [r.x, r.y, r.z, 0.0];
        }
        self.factor.solve(&mut self.rows);
        out.fill(Vector3::zeros());
        for (row, &node) in self.rows.iter().zip(&self.elimination) {
            out[node as usize] = Vector3::new(row[0], row[1], row[2]);
        }
    }

    /// Nodes that are free, in the order of the rows.
    pub(crate) fn free(&self) -> &[u32] {
        &self.free
    }

    /// Stored entries of the lower triangle of the matrix.
    pub(crate) fn nonzeros(&self) -> usize {
        self.nonzeros
    }

    /// Stored entries of the factor.
    pub(crate) fn factor_entries(&self) -> usize {
        self.factor.entries()
    }

    /// Largest diagonal entry: force per length of the stiffest node.
    pub(crate) fn stiffness_scale(&self) -> f64 {
        self.stiffest
    }
}

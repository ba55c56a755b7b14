//! The constant matrix of local/global iteration: one scalar matrix for three axes, factored once, when it is first needed.
//!
//! Every effect with a local projection contributes `sum w G^T G`, which acts on x, y and z alike (maths.md, "The spectrum of
//! C"): a single factor of a third of the size then serves all three right-hand sides.

pub(crate) use crate::assembly::ConstantMatrix;
use crate::error::SolverError;
use crate::forest::Forest;
use crate::ordering::nested_dissection;
use crate::symbolic::Symbolic;
use crate::vector::NodalVector;
use nalgebra::Vector3;
use serde::Serialize;
use std::time::Instant;

/// Seconds that the parts of building the factor of the constant matrix took.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize)]
pub struct FactorSeconds {
    /// Finding an order of elimination.
    pub ordering: f64,
    /// Adding up the entries of the matrix.
    pub assembly: f64,
    /// Finding the pattern of the factor.
    pub symbolic: f64,
    /// Computing its values, and packing them for the solve.
    pub numeric: f64,
}

/// The factored constant matrix over the free nodes.
pub(crate) struct ConstantSystem {
    /// The free nodes in the order of the factor.
    elimination: Vec<u32>,
    forest: Forest,
    nonzeros: usize,
    solves: u64,
    seconds: FactorSeconds,
}

impl ConstantSystem {
    /// Orders, assembles and factors the matrix over the `free` nodes. `positions` are the rest positions of all nodes, `spacing`
    /// the edge length of their grid; `add` adds the entries.
    ///
    /// # Errors
    /// When the matrix is not positive definite, or too large to be factored.
    pub(crate) fn factor(
        free: &[u32],
        positions: &[Vector3<f64>],
        spacing: f64,
        add: impl Fn(&mut ConstantMatrix),
    ) -> Result<Self, SolverError> {
        let mut clock = Instant::now();
        let mut lap = || {
            std::mem::replace(&mut clock, Instant::now())
                .elapsed()
                .as_secs_f64()
        };
        let points: Vec<_> = (free.iter()).map(|&i| positions[i as usize]).collect();
        let dissection = nested_dissection(&points, spacing);
        let elimination: Vec<u32> = (dissection.order.iter()).map(|&i| free[i]).collect();
        let ordering = lap();
        let mut matrix = ConstantMatrix::new(rows_of_nodes(positions.len(), &elimination));
        add(&mut matrix);
        let lower = matrix.compress();
        let assembly = lap();
        let failed = |row: usize| SolverError::Factorisation {
            size: free.len(),
            reason: format!("no positive pivot at node {}", elimination[row]),
        };
        let symbolic = Symbolic::new(&lower, &dissection.ends);
        let symbolic_seconds = lap();
        let forest = Forest::factor(&lower, &symbolic).map_err(failed)?;
        Ok(Self {
            elimination,
            forest,
            nonzeros: lower.rows.len(),
            solves: 0,
            seconds: FactorSeconds {
                ordering,
                assembly,
                symbolic: symbolic_seconds,
                numeric: lap(),
            },
        })
    }

    /// `out = K^-1 r` on the free nodes, zero on the prescribed ones.
    pub(crate) fn solve(&mut self, r: &[Vector3<f64>], out: &mut NodalVector) {
        self.solves += 1;
        out.fill(Vector3::zeros());
        let elimination = &self.elimination;
        self.forest
            .solve(&|row| r[elimination[row] as usize].into(), |row, value| {
                out[elimination[row] as usize] = value.into()
            });
    }

    /// Solves done so far.
    pub(crate) fn solves(&self) -> u64 {
        self.solves
    }

    /// Stored entries of the lower triangle of the matrix.
    pub(crate) fn nonzeros(&self) -> usize {
        self.nonzeros
    }

    /// Stored entries of the factor.
    pub(crate) fn factor_entries(&self) -> usize {
        self.forest.entries()
    }

    /// What building the factor took.
    pub(crate) fn seconds(&self) -> FactorSeconds {
        self.seconds
    }
}

/// The row of each node when `nodes_of_rows` are the rows.
fn rows_of_nodes(nodes: usize, nodes_of_rows: &[u32]) -> Vec<Option<u32>> {
    let mut rows = vec![None; nodes];
    for (row, &node) in nodes_of_rows.iter().enumerate() {
        rows[node as usize] = Some(row as u32);
    }
    rows
}

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

/// The constant matrix over the free nodes and, once it was asked for, its factor.
pub(crate) struct ConstantSystem {
    free: Vec<u32>,
    stiffest: f64,
    factored: Option<Factored>,
}

struct Factored {
    /// The free nodes in the order of the factor.
    elimination: Vec<u32>,
    forest: Forest,
    nonzeros: usize,
    seconds: FactorSeconds,
}

impl ConstantSystem {
    /// The system without its factor. `add` is asked for the entries of the matrix, of which only the diagonal is kept.
    pub(crate) fn new(nodes: usize, prescribed: &[u32], add: impl Fn(&mut ConstantMatrix)) -> Self {
        let mut is_free = vec![true; nodes];
        for &node in prescribed {
            is_free[node as usize] = false;
        }
        let free: Vec<u32> = (0..nodes as u32).filter(|&i| is_free[i as usize]).collect();
        let mut diagonal = ConstantMatrix::diagonal_only(rows_of_nodes(nodes, &free));
        add(&mut diagonal);
        Self {
            free,
            stiffest: diagonal.largest_diagonal(),
            factored: None,
        }
    }

    /// Orders, assembles and factors the matrix, unless that was done. `positions` are the rest positions of all nodes,
    /// `spacing` the edge length of their grid; `add` adds the same entries as at [`Self::new`].
    ///
    /// # Errors
    /// When the matrix is not positive definite, or too large to be factored.
    pub(crate) fn factor(
        &mut self,
        positions: &[Vector3<f64>],
        spacing: f64,
        add: impl Fn(&mut ConstantMatrix),
    ) -> Result<(), SolverError> {
        if self.factored.is_some() {
            return Ok(());
        }
        let mut clock = Instant::now();
        let mut lap = || {
            std::mem::replace(&mut clock, Instant::now())
                .elapsed()
                .as_secs_f64()
        };
        let points: Vec<_> = (self.free.iter()).map(|&i| positions[i as usize]).collect();
        let dissection = nested_dissection(&points, spacing);
        let elimination: Vec<u32> = (dissection.order.iter()).map(|&i| self.free[i]).collect();
        let ordering = lap();
        let mut matrix = ConstantMatrix::new(rows_of_nodes(positions.len(), &elimination));
        add(&mut matrix);
        let lower = matrix.compress();
        let assembly = lap();
        let failed = |row: usize| SolverError::Factorisation {
            size: self.free.len(),
            reason: format!("no positive pivot at node {}", elimination[row]),
        };
        let symbolic = Symbolic::new(&lower, &dissection.ends);
        let symbolic_seconds = lap();
        let forest = Forest::factor(&lower, &symbolic).map_err(failed)?;
        self.factored = Some(Factored {
            elimination,
            forest,
            nonzeros: lower.rows.len(),
            seconds: FactorSeconds {
                ordering,
                assembly,
                symbolic: symbolic_seconds,
                numeric: lap(),
            },
        });
        Ok(())
    }

    /// `out = K^-1 r` on the free nodes, zero on the prescribed ones.
    ///
    /// # Panics
    /// Where the matrix was not factored before.
    pub(crate) fn solve(&mut self, r: &[Vector3<f64>], out: &mut NodalVector) {
        let Factored {
            elimination,
            forest,
            ..
        } = self.factored.as_mut().expect("factored before");
        out.fill(Vector3::zeros());
        forest.solve(&|row| r[elimination[row] as usize].into(), |row, value| {
            out[elimination[row] as usize] = value.into()
        });
    }

    /// Nodes that are free, by rising index.
    pub(crate) fn free(&self) -> &[u32] {
        &self.free
    }

    /// Largest diagonal entry: force per length of the stiffest node.
    pub(crate) fn stiffness_scale(&self) -> f64 {
        self.stiffest
    }

    /// Stored entries of the lower triangle of the matrix; zero before it is factored.
    pub(crate) fn nonzeros(&self) -> usize {
        self.factored.as_ref().map_or(0, |f| f.nonzeros)
    }

    /// Stored entries of the factor; zero before there is one.
    pub(crate) fn factor_entries(&self) -> usize {
        self.factored.as_ref().map_or(0, |f| f.forest.entries())
    }

    /// What building the factor took; `None` before there is one.
    pub(crate) fn factor_seconds(&self) -> Option<FactorSeconds> {
        self.factored.as_ref().map(|f| f.seconds)
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

//! The numeric part of a supernodal Cholesky factorisation, one supernode at a time (Liu 1992, "The multifrontal method for
//! sparse matrix solution").
//!
//! A supernode's front holds its columns and what eliminating them, and everything below them in the elimination forest, adds to
//! its rows below. All is dense, so the work is faer's; one thread per front keeps the sums in one order.

use crate::assembly::LowerTriangle;
use crate::symbolic::SymbolicNode;
use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::cholesky::llt::factor::{cholesky_in_place, cholesky_in_place_scratch};
use faer::linalg::matmul::triangular::{BlockStructure, matmul};
use faer::linalg::triangular_solve::solve_lower_triangular_in_place;
use faer::{Accum, Mat, Par};

/// What a subtree adds to the rows below its root: the lower triangle, and the root's rows below.
pub(crate) struct Update<'a> {
    pub(crate) rows: &'a [u32],
    pub(crate) matrix: Mat<f64>,
}

/// A supernode's part of the factor, `[columns + below, columns]`, and what is left for its parent.
pub(crate) struct Eliminated<'a> {
    pub(crate) panel: Mat<f64>,
    pub(crate) update: Update<'a>,
}

/// Eliminates the columns of one supernode, given its children's updates.
///
/// # Errors
/// The column of the matrix whose pivot is not positive.
pub(crate) fn eliminate<'a>(
    matrix: &LowerTriangle,
    node: &'a SymbolicNode,
    children: impl Iterator<Item = Update<'a>>,
) -> Result<Eliminated<'a>, usize> {
    let (own, below) = (node.columns.len(), node.below.len());
    let mut panel = Mat::<f64>::zeros(own + below, own);
    let mut update = Mat::<f64>::zeros(below, below);
    for (j, column) in node.columns.clone().enumerate() {
        for (row, value) in matrix.column(column) {
            let place = match row.checked_sub(node.columns.end) {
                None => row - node.columns.start,
                Some(_) => own + (node.below.binary_search(&(row as u32))).expect("in the pattern"),
            };
            panel[(place, j)] += value;
        }
    }
    for child in children {
        let places = node.places(child.rows);
        for (j, &column) in places.iter().enumerate() {
            let share = &child.matrix.col_as_slice(j)[j..];
            let column = column as usize;
            let (target, shift) = if column < own {
                (panel.col_as_slice_mut(column), 0)
            } else {
                (update.col_as_slice_mut(column - own), own)
            };
            for (value, &place) in share.iter().zip(&places[j..]) {
                target[place as usize - shift] += value;
            }
        }
    }
    let (mut diagonal, mut rest) = panel.as_mut().split_at_row_mut(own);
    let scratch = cholesky_in_place_scratch::<f64>(own, Par::Seq, Default::default());
    cholesky_in_place(
        diagonal.as_mut(),
        Default::default(),
        Par::Seq,
        MemStack::new(&mut MemBuffer::new(scratch)),
        Default::default(),
    )
    .map_err(|error| {
        let faer::linalg::cholesky::llt::factor::LltError::NonPositivePivot { index } = error;
        node.columns.start + index
    })?;
    let transposed = rest.as_mut().transpose_mut();
    solve_lower_triangular_in_place(diagonal.as_ref(), transposed, Par::Seq);
    matmul(
        update.as_mut(),
        BlockStructure::TriangularLower,
        Accum::Add,
        rest.as_ref(),
        BlockStructure::Rectangular,
        rest.as_ref().transpose(),
        BlockStructure::Rectangular,
        -1.0,
        Par::Seq,
    );
    Ok(Eliminated {
        panel,
        update: Update {
            rows: &node.below,
            matrix: update,
        },
    })
}

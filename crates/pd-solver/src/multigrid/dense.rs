//! The coarsest level, solved by a dense Cholesky factor.

use super::grid::Grid;
use super::layout::Layout;
use super::stencil::Stencil;
use super::touch::Bridge;
use nalgebra::{Cholesky, DMatrix, DVector, Dyn};

/// What is added to the diagonal, relative to its largest entry: the entries are in single precision, and directions whose
/// stiffness is below that are not known.
const SHIFT: f64 = 1e-7;

pub(super) struct Dense {
    /// Slots of the free unknowns.
    slots: Vec<u32>,
    /// Row of each node's x component, three rows per free node.
    rows: Vec<Option<u32>>,
    factor: Option<Cholesky<f64, Dyn>>,
    values: DVector<f64>,
}

impl Dense {
    pub(super) fn new(layout: &Layout, held: &[bool]) -> Self {
        let mut slots = Vec::new();
        let mut rows = Vec::with_capacity(held.len());
        for (node, &held) in held.iter().enumerate() {
            rows.push((!held).then_some(slots.len() as u32));
            if !held {
                slots.extend(layout.components(node).map(|at| at as u32));
            }
        }
        Self {
            values: DVector::zeros(slots.len()),
            slots,
            rows,
            factor: None,
        }
    }

    /// Factors the operator's present entries; false where they are not positive definite.
    pub(super) fn factor(&mut self, stencil: &Stencil, bridges: &[Bridge], grid: &Grid) -> bool {
        let n = self.slots.len();
        // The last factor's memory is used again.
        let mut matrix = match self.factor.take() {
            Some(factor) => factor.unpack_dirty(),
            None => DMatrix::zeros(n, n),
        };
        matrix.fill(0.0);
        stencil.for_each_entry(grid, |row, column, i, j, value| {
            if let (Some(row), Some(column)) = (self.rows[row as usize], self.rows[column as usize])
            {
                // Elements that share a pair of corners show the same entry.
                matrix[(row as usize + i, column as usize + j)] = value as f64;
            }
        });
        for bridge in bridges {
            bridge.for_each_entry(|row, column, i, j, value| {
                let rows = (self.rows[row as usize], self.rows[column as usize]);
                if let (Some(row), Some(column)) = rows {
                    matrix[(row as usize + i, column as usize + j)] += f64::from(value);
                }
            });
        }
        let largest = matrix.diagonal().max();
        for i in 0..n {
            matrix[(i, i)] += SHIFT * largest;
        }
        self.factor = Cholesky::new(matrix);
        self.factor.is_some()
    }

    /// `x = A^-1 b`; zero where the operator is not positive definite.
    pub(super) fn solve(&mut self, b: &[f32], x: &mut [f32]) {
        for (value, &slot) in self.values.iter_mut().zip(&self.slots) {
            *value = b[slot as usize] as f64;
        }
        match &self.factor {
            Some(factor) => factor.solve_mut(&mut self.values),
            None => self.values.fill(0.0),
        }
        for (value, &slot) in self.values.iter().zip(&self.slots) {
            x[slot as usize] = *value as f32;
        }
    }
}

//! Interpolation of nodal values from a coarse grid to a fine one, and its transpose.

use crate::vector::NodalVector;
use nalgebra::Vector3;
use rayon::prelude::*;
use sprs::CsMatI;

/// A sparse matrix whose rows are lists of nodes and weights.
pub(crate) struct Rows(CsMatI<f32, u32>);

impl Rows {
    /// The entries of a row.
    #[inline(always)]
    pub(crate) fn row(&self, row: usize) -> impl Iterator<Item = (u32, f32)> + '_ {
        let range = self.0.indptr().outer_inds_sz(row);
        let weights = self.0.data()[range.clone()].iter().copied();
        self.0.indices()[range].iter().copied().zip(weights)
    }

    fn len(&self) -> usize {
        self.0.outer_dims()
    }
}

/// Trilinear interpolation of nodal values. Weights are held in single precision: shares like 1/2, 1/4, 1/8 are exact in it, and
/// what comes of thirds at odd ends is a start, or a correction, that is improved afterwards.
pub(crate) struct Transfer {
    /// A row per fine node.
    pub(crate) interpolation: Rows,
    /// A row per coarse node.
    pub(crate) restriction: Rows,
}

impl Transfer {
    pub(crate) fn new(
        rows: impl Iterator<Item = impl Iterator<Item = (u32, f64)>>,
        coarse: usize,
    ) -> Self {
        let (mut offsets, mut columns, mut weights) = (vec![0], Vec::new(), Vec::new());
        for row in rows {
            for (column, weight) in row {
                columns.push(column);
                weights.push(weight as f32);
            }
            offsets.push(columns.len() as u32);
        }
        let shape = (offsets.len() - 1, coarse);
        let by_rows = CsMatI::new_from_unsorted(shape, offsets, columns, weights)
            .map_err(|(.., error)| error)
            .expect("offsets rise and columns are coarse nodes");
        Self {
            // Stored by columns, each of which is a row of the transpose.
            restriction: Rows(by_rows.to_csc()),
            interpolation: Rows(by_rows),
        }
    }

    /// The coarse node that a fine node coincides with, if there is one.
    pub(crate) fn coincident(&self, fine: usize) -> Option<u32> {
        let mut row = self.interpolation.row(fine);
        match (row.next(), row.next()) {
            (Some((node, _)), None) => Some(node),
            _ => None,
        }
    }

    /// `fine = fine_rest + P (coarse - coarse_rest)`.
    pub(crate) fn interpolate_displacement(
        &self,
        coarse: (&[Vector3<f64>], &[Vector3<f64>]),
        fine_rest: &[Vector3<f64>],
        fine: &mut NodalVector,
    ) {
        let (u, rest) = coarse;
        let one = |(node, out): (usize, &mut Vector3<f64>)| {
            let moved: Vector3<f64> = self
                .interpolation
                .row(node)
                .map(|(c, w)| (u[c as usize] - rest[c as usize]) * w as f64)
                .sum();
            *out = fine_rest[node] + moved;
        };
        fine.par_iter_mut()
            .with_min_len(2048)
            .enumerate()
            .for_each(one);
    }

    /// Composes a linear form over fine nodes with the interpolation: the same form over coarse nodes.
    pub(crate) fn restrict_form(&self, nodes: &[u32], weights: &[f64]) -> (Vec<u32>, Vec<f64>) {
        let (mut out_nodes, mut out_weights): (Vec<u32>, Vec<f64>) = Default::default();
        for (&node, weight) in nodes.iter().zip(weights) {
            for (coarse, share) in self.interpolation.row(node as usize) {
                match out_nodes.iter().position(|&n| n == coarse) {
                    Some(at) => out_weights[at] += weight * share as f64,
                    None => {
                        out_nodes.push(coarse);
                        out_weights.push(weight * share as f64);
                    }
                }
            }
        }
        (out_nodes, out_weights)
    }

    /// `P^T x` for one value per node.
    pub(crate) fn restrict_scalars(&self, fine: &[f64]) -> Vec<f64> {
        (0..self.restriction.len())
            .map(|node| {
                let row = self.restriction.row(node);
                row.map(|(f, w)| fine[f as usize] * w as f64).sum()
            })
            .collect()
    }
}

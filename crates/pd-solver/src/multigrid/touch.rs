//! What the cycle knows of contact: forms over the corners of single elements, anew at every building.
//!
//! What touches is stiff along one direction. On the finest level its forms are applied one by one, and the first coarse matrices get them by the
//! Galerkin product; from there they go down with the rest. Two sides of the body that touch each other are held each by itself there.

use super::coarse::Coarse;
use super::element_matrix::{BLOCKS, parent_weights};
use super::fine::{FineOperator, Slab};
use super::grid::Grid;
use super::hierarchy::Hierarchy;
use super::layout::Layout;
use crate::element_finder::Touch;

/// The coefficients of a form at a node: slot of its x component relative to the slab's part, distance to the next components.
struct AtNode {
    slot: u32,
    step: u32,
    vector: [f32; 3],
}

/// A form on the finest level.
pub(super) struct FineTouch(Vec<AtNode>);

impl FineTouch {
    /// Adds the forces of half its square.
    pub(super) fn apply(&self, x: &[f32], y: &mut [f32]) {
        let places = |n: &AtNode| [0, 1, 2].map(|c| (n.slot + c * n.step) as usize);
        let products = |n: &AtNode| -> f32 {
            let at = places(n);
            (0..3).map(|c| n.vector[c] * x[at[c]]).sum()
        };
        let value: f32 = self.0.iter().map(products).sum();
        for n in &self.0 {
            for (at, v) in places(n).into_iter().zip(n.vector) {
                y[at] += v * value;
            }
        }
    }

    /// Adds to the diagonal what bounds its square: the smoother knows of no eigenvalue that is larger for it. `first` is the length of the
    /// slab's first plane.
    pub(super) fn add_diagonal(&self, first: usize, out: &mut [f32]) {
        let size = |n: &AtNode| n.vector.iter().map(|v| v * v).sum::<f32>().sqrt();
        let total: f32 = self.0.iter().map(size).sum();
        for n in &self.0 {
            let scale = total / size(n);
            // From a place among three components to one among six.
            let slot = n.slot as usize;
            let slot = if slot >= first { slot + first } else { slot };
            for (c, (i, j)) in BLOCKS.into_iter().enumerate() {
                out[slot + c * n.step as usize] += scale * n.vector[i] * n.vector[j];
            }
        }
    }
}

impl FineOperator {
    /// Takes over what touches, in units of the operator by the factor `scale`.
    pub(super) fn set_touches(
        &mut self,
        grid: &Grid,
        layout: &Layout,
        touches: &[Touch],
        scale: f64,
    ) {
        let clear = |slab: &mut Slab| slab.touches.clear();
        self.slabs.iter_mut().for_each(clear);
        for touch in touches {
            let element = touch.element as usize;
            let plane = grid.cells[element][0] as usize;
            let at_node = |(corner, &node): (usize, &u32)| {
                let [x, y, _] = layout.components(node as usize);
                let vector = touch.vector.map(|row| (row[corner] * scale) as f32);
                (vector != [0.0; 3]).then_some(AtNode {
                    slot: (x - layout.starts[plane]) as u32,
                    step: (y - x) as u32,
                    vector,
                })
            };
            let nodes = grid.elements[element].iter().enumerate();
            let nodes = nodes.filter_map(at_node).collect();
            self.slabs[plane].touches.push(FineTouch(nodes));
        }
    }
}

/// A form on the corners of an element of the first coarse level.
pub(super) type CoarseTouch = (u32, [[f32; 8]; 3]);

impl Coarse {
    /// Takes over what touches on the finest level, whose next coarser one this is.
    pub(super) fn set_touches(&mut self, hierarchy: &Hierarchy, touches: &[Touch], scale: f64) {
        let to_parent = |touch: &Touch| -> CoarseTouch {
            let element = touch.element as usize;
            let (interval, held) = hierarchy.place_in_parent(0, element);
            let row = |row: [f64; 8]| {
                parent_weights(&row, &interval, held).map(|w| (w * scale) as f32)
            };
            (hierarchy.parents[0][element], touch.vector.map(row))
        };
        self.touches.clear();
        self.touches.extend(touches.iter().map(to_parent));
    }

    /// Adds the squares of the forms to the matrices.
    pub(super) fn add_touches(&mut self) {
        for (element, vector) in &self.touches {
            let matrix = &mut self.matrices[*element as usize];
            for (block, (i, j)) in matrix.iter_mut().zip(BLOCKS) {
                for (row, left) in block.iter_mut().zip(&vector[i]) {
                    for (entry, right) in row.iter_mut().zip(&vector[j]) {
                        *entry += left * right;
                    }
                }
            }
        }
    }
}

//! What the cycle knows of contact: forms over nodes whose squares are added to the operators, anew at every building.
//!
//! A form joins what touches, and that need not share an element. On the finest level forms are applied one by one. Coarser operators have their
//! Galerkin products: where one element has all nodes of a form it goes into the stencil, and is applied one by one elsewhere, as between lips
//! that lie in different coarse elements.

use super::element_matrix::BLOCKS;
use super::grid::Grid;
use super::hierarchy::Hierarchy;
use super::layout::Layout;
use super::level::{Level, Operator};
use crate::element_finder::ElementFinder;
use nalgebra::Vector3;

/// A form over nodes by its coefficients, each node once.
pub(crate) type Form = Vec<(u32, Vector3<f64>)>;

/// What touches on the finest level, and what it takes to find its place on coarser ones.
pub(super) struct Touches {
    forms: Vec<Form>,
    /// Per level but the finest.
    finders: Vec<ElementFinder>,
}

impl Touches {
    pub(super) fn new(hierarchy: &Hierarchy) -> Self {
        let finder = |grid: &Grid| ElementFinder::new(&grid.elements, grid.node_count());
        Self {
            forms: Vec::new(),
            finders: hierarchy.grids[1..].iter().map(finder).collect(),
        }
    }

    /// Takes over what touches, in units of the operators by the factor `scale`.
    pub(super) fn set(&mut self, forms: Vec<Form>, scale: f64) {
        self.forms = forms;
        let terms = self.forms.iter_mut().flatten();
        terms.for_each(|(_, v)| *v *= scale);
    }

    /// Adds the forms to all operators; those of coarser levels were assembled without.
    pub(super) fn add(&self, hierarchy: &Hierarchy, levels: &mut [Level]) {
        let mut forms = self.forms.clone();
        for (l, (level, grid)) in levels.iter_mut().zip(&hierarchy.grids).enumerate() {
            level.bridges.clear();
            if l > 0 {
                forms
                    .iter_mut()
                    .for_each(|form| restrict(form, hierarchy, l - 1));
                forms.retain(|form| !form.is_empty());
            }
            for form in &forms {
                let place = match &mut level.operator {
                    Operator::Fine(_) => None,
                    Operator::Stencil(stencil) => {
                        let nodes = form.iter().map(|(node, _)| *node);
                        let element = self.finders[l - 1].with_all(&grid.elements, nodes);
                        element.map(|element| (stencil, element as usize))
                    }
                };
                let Some((stencil, element)) = place else {
                    level.bridges.push(Bridge::new(form, &level.layout));
                    continue;
                };
                let corners = &grid.elements[element];
                let mut vector = [[0.0; 8]; 3];
                for (node, v) in form {
                    let corner = corners.iter().position(|n| n == node);
                    let corner = corner.expect("a corner of the element");
                    (0..3).for_each(|axis| vector[axis][corner] = v[axis] as f32);
                }
                stencil.add_square(element, &vector);
            }
        }
    }
}

/// Turns a form over the nodes of a level into the same over those of the next coarser one; held nodes take no part.
fn restrict(form: &mut Form, hierarchy: &Hierarchy, level: usize) {
    let rows = &hierarchy.transfers[level].interpolation;
    let (held, coarse_held) = (&hierarchy.held[level], &hierarchy.held[level + 1]);
    let mut out: Form = Vec::new();
    for (node, v) in form.iter().filter(|(node, _)| !held[*node as usize]) {
        for (coarse, weight) in rows.row(*node as usize) {
            if coarse_held[coarse as usize] {
                continue;
            }
            let v = v * f64::from(weight);
            match out.iter_mut().find(|(node, _)| *node == coarse) {
                Some((_, sum)) => *sum += v,
                None => out.push((coarse, v)),
            }
        }
    }
    *form = out;
}

/// The coefficients of a form at a node.
struct AtNode {
    node: u32,
    /// Slots of the three components.
    slots: [u32; 3],
    vector: [f32; 3],
}

/// A form on a level that is applied by itself.
pub(super) struct Bridge(Vec<AtNode>);

impl Bridge {
    fn new(form: &Form, layout: &Layout) -> Self {
        let at_node = |(node, v): &(u32, Vector3<f64>)| AtNode {
            node: *node,
            slots: layout.components(*node as usize).map(|at| at as u32),
            vector: std::array::from_fn(|axis| v[axis] as f32),
        };
        Self(form.iter().map(at_node).collect())
    }

    /// Adds the forces of half the square.
    pub(super) fn apply(&self, x: &[f32], y: &mut [f32]) {
        let mut value = 0.0;
        for n in &self.0 {
            for (at, v) in n.slots.iter().zip(&n.vector) {
                value += v * x[*at as usize];
            }
        }
        for n in &self.0 {
            for (at, v) in n.slots.iter().zip(&n.vector) {
                y[*at as usize] += v * value;
            }
        }
    }

    /// Calls `f(node, block)` with blocks of a diagonal that bounds the square: it gives the smoother no larger eigenvalue.
    pub(super) fn for_each_block(&self, mut f: impl FnMut(u32, [f32; 6])) {
        let size = |n: &AtNode| n.vector.iter().map(|v| v * v).sum::<f32>().sqrt();
        let total: f32 = self.0.iter().map(size).sum();
        for n in self.0.iter().filter(|n| size(n) > 0.0) {
            let scale = total / size(n);
            f(
                n.node,
                BLOCKS.map(|(i, j)| scale * n.vector[i] * n.vector[j]),
            );
        }
    }

    /// Calls `f(row node, column node, row component, column component, value)` for all entries of the square.
    pub(super) fn for_each_entry(&self, mut f: impl FnMut(u32, u32, usize, usize, f32)) {
        for row in &self.0 {
            for column in &self.0 {
                for entry in 0..9 {
                    let (i, j) = (entry / 3, entry % 3);
                    f(
                        row.node,
                        column.node,
                        i,
                        j,
                        row.vector[i] * column.vector[j],
                    );
                }
            }
        }
    }
}

//! Flaps: parts of the body that are one or two elements thick, such as ears and rims.
//!
//! Elements of a coarse grid are many times stiffer in bending than a flap that fills a part of them, so the coarse correction moves flaps too
//! little, whatever the smoother does on the whole grid. They are smoothed by a polynomial of higher degree on top, as a body of
//! their own whose surroundings are held.

use super::cores::{Curvature, Symmetric, set_cores};
use super::fine::{CORE, ElementForm, FineOperator};
use super::grid::Grid;
use super::kept_volume::Normal;
use super::layout::Layout;
use super::level::{Level, Operator, Smoother};
use nalgebra::Vector3;

/// Elements across a flap.
const THICKNESS: u32 = 2;
/// Shares of all elements between which a body is one with flaps. Fewer are not worth the work, and above it is better spent on everything.
const SHARE: std::ops::RangeInclusive<f64> = 0.01..=0.1;

/// The elements around the nodes of all flaps.
pub(super) struct Flaps {
    level: Level,
    /// Their numbers in the body, their corners there, and reciprocals of their edge lengths.
    elements: Vec<u32>,
    corners: Vec<[u32; 8]>,
    inverse_sizes: Vec<Vector3<f64>>,
    actuation: Vec<Symmetric>,
    /// Where the x component of each node lies here and in the body, and the distances to the next components. First the nodes of flaps that
    /// may move, then those around them.
    places: Vec<[u32; 4]>,
    free: usize,
    cores: Vec<[f32; CORE]>,
    normals: Vec<Normal>,
}

impl Flaps {
    /// None where there are no flaps to speak of, or hardly anything else. `layout` and `held` are those of the body's finest level, as are `forms`, in units of `unit`.
    pub(super) fn new(
        grid: &Grid,
        (layout, held): (&Layout, &[bool]),
        forms: &[ElementForm],
        unit: f64,
        samples: usize,
    ) -> Option<Self> {
        let thin = grid.thin_elements(THICKNESS);
        let count = thin.iter().filter(|thin| **thin).count();
        if !SHARE.contains(&(count as f64 / thin.len() as f64)) {
            return None;
        }
        let mut moves = vec![false; grid.node_count()];
        for (nodes, _) in grid.elements.iter().zip(&thin).filter(|(_, thin)| **thin) {
            for &node in nodes {
                moves[node as usize] = !held[node as usize];
            }
        }
        let around = |nodes: &[u32; 8]| nodes.iter().any(|&n| moves[n as usize]);
        let elements: Vec<u32> = (0..grid.elements.len() as u32)
            .filter(|&e| around(&grid.elements[e as usize]))
            .collect();
        if elements.is_empty() {
            // All of them are held.
            return None;
        }
        let (part, nodes) = grid.part(&elements);
        let own_layout = Layout::new(&part);
        let own_forms: Vec<ElementForm> = forms
            .iter()
            .filter_map(|&(element, weights, stiffness)| {
                let own = elements.binary_search(&element).ok()?;
                Some((own as u32, weights, stiffness))
            })
            .collect();
        let operator = FineOperator::new(&part, &own_layout, &own_forms, unit, samples);
        let place = |own: usize| {
            let ([x, y, _], [body_x, body_y, _]) = (
                own_layout.components(own),
                layout.components(nodes[own] as usize),
            );
            [x, y - x, body_x, body_y - body_x].map(|at| at as u32)
        };
        let is_free = |own: &usize| moves[nodes[*own] as usize];
        let (free, around): (Vec<usize>, Vec<usize>) = (0..nodes.len()).partition(is_free);
        Some(Self {
            places: free.iter().chain(&around).map(|&own| place(own)).collect(),
            free: free.len(),
            cores: vec![[0.0; CORE]; elements.len()],
            corners: elements
                .iter()
                .map(|&e| grid.elements[e as usize])
                .collect(),
            inverse_sizes: (0..elements.len())
                .map(|e| part.size(e).map(f64::recip))
                .collect(),
            actuation: Vec::new(),
            normals: Vec::new(),
            elements,
            level: Level::new(
                own_layout,
                Operator::Fine(operator),
                nodes.iter().map(|&n| !moves[n as usize]).collect(),
                Smoother::OF_FLAPS,
            ),
        })
    }

    /// Projects the cores of these elements, at the positions `u` of the body's nodes: bent and pressed, flaps are soft or about to buckle where
    /// they are not at rest yet, and steps that follow that go too far.
    pub(super) fn project(
        &mut self,
        u: &[Vector3<f64>],
        actuation: &[Symmetric],
        cores: &mut [[f32; CORE]],
    ) {
        let own = self.elements.iter().map(|&e| actuation[e as usize]);
        self.actuation.clear();
        self.actuation.extend(own);
        let given = (&self.inverse_sizes[..], &self.actuation[..]);
        set_cores(
            Curvature::Projected,
            &self.corners,
            u,
            given,
            &mut self.cores,
        );
        for (own, &element) in self.cores.iter().zip(&self.elements) {
            cores[element as usize] = *own;
        }
    }

    /// Takes over the projected cores, and what elements do against changes of their volume where they do.
    pub(super) fn set(&mut self, normals: Option<&[Normal]>) {
        let Operator::Fine(operator) = &mut self.level.operator else {
            unreachable!("made as one");
        };
        operator.set_cores(&self.cores);
        if let Some(normals) = normals {
            self.normals.clear();
            let own = self.elements.iter().map(|&e| normals[e as usize]);
            self.normals.extend(own);
            operator.set_normals(&self.normals);
        }
        self.level.refresh();
    }

    /// Smooths `A x = b` of the body at the nodes of flaps.
    pub(super) fn smooth(&mut self, body: &mut Level) {
        let own = &mut self.level;
        for &[at, step, body_at, body_step] in &self.places {
            for c in 0..3 {
                let (at, body_at) = ((at + c * step) as usize, (body_at + c * body_step) as usize);
                own.x[at] = body.x[body_at];
                own.b[at] = body.b[body_at];
            }
        }
        own.smooth(false);
        for &[at, step, body_at, body_step] in &self.places[..self.free] {
            for c in 0..3 {
                body.x[(body_at + c * body_step) as usize] = own.x[(at + c * step) as usize];
            }
        }
    }

    /// Makes the smoother more careful.
    pub(super) fn strengthen(&mut self, factor: f32) {
        self.level.strengthen(factor);
    }
}

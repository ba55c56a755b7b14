//! Geometric multigrid on the Hessian of a voxel body: the preconditioner of the fast methods.
//!
//! The finest level is applied element by element from one core each ([`fine`]), the coarser ones are Galerkin products of it
//! ([`element_matrix`], [`stencil`]), smoothed by Chebyshev polynomials of the block Jacobi iteration ([`level`]) in single
//! precision. The cores are those of the true Hessian or of the exactly projected one ([`Curvature`]): with the projected one a cycle is a
//! symmetric positive definite operator everywhere, with the true one it is at a minimum, and nearer to the inverse there. Squares of forms are added
//! for flesh that keeps its volume ([`kept_volume`]) and for what touches ([`touch`]).

mod coarse;
mod cores;
mod correction;
mod dense;
mod element_matrix;
mod fine;
mod flaps;
mod grid;
mod hierarchy;
mod kept_volume;
mod layout;
mod level;
mod modes;
mod stencil;
#[cfg(test)]
mod tests;
mod touch;
mod transfer;

use crate::vector::{NodalVector, max_norm};
use coarse::{Coarse, set_up};
use cores::{Curvature, Symmetric, set_cores};
use correction::Correction;
use dense::Dense;
use element_matrix::CoreTables;
pub(crate) use fine::ElementForm;
use fine::{CORE, FineOperator};
use flaps::Flaps;
pub(crate) use grid::{DisjointSets, Grid};
pub(crate) use hierarchy::Hierarchy;
use kept_volume::KeptVolume;
use layout::Layout;
use level::{Level, Operator, Smoother};
use modes::{LINEAR, stiffness};
use nalgebra::Vector3;
use rayon::prelude::*;
use stencil::Stencil;
pub(crate) use touch::Form;
use touch::Touches;
pub(crate) use transfer::Transfer;

/// Elements per task.
const CHUNK: usize = 64;
/// What a largest eigenvalue is raised by where the smoother built on its estimate was not positive definite.
const CAREFUL: f32 = 1.4;
/// The preconditioner: built at a state on any level, applied from that level down.
pub(crate) struct Multigrid {
    hierarchy: Hierarchy,
    levels: Vec<Level>,
    corrections: Vec<Correction>,
    /// Where the body has any.
    flaps: Option<Flaps>,
    /// Per level but the finest.
    coarse: Vec<Coarse>,
    tables: CoreTables,
    dense: Dense,
    /// Reciprocals of the edge lengths of all elements, per level.
    inverse_sizes: Vec<Vec<Vector3<f64>>>,
    /// Mean A of every element, per level.
    actuation: Vec<Vec<Symmetric>>,
    cores: Vec<[f32; CORE]>,
    /// Where something keeps volumes.
    kept: Option<KeptVolume>,
    /// Where something touches.
    touches: Option<Touches>,
    /// Which Hessian the cycle from each level down is built on.
    curvature: Vec<Curvature>,
    /// Stiffness of a linear mode of an element on the finest level: the unit of all operators.
    unit: f64,
    /// Times that operators were built, and cycles, on any level.
    pub(crate) builds: u64,
    pub(crate) cycles: u64,
}

impl Multigrid {
    /// The preconditioner of a body of stiffness `elastic`, and `keeping` against changes of volume, and `samples` per element, with linear
    /// forms (springs) on each level.
    pub(crate) fn new(
        hierarchy: Hierarchy,
        (elastic, keeping): (f64, f64),
        samples: usize,
        forms: Vec<Vec<ElementForm>>,
    ) -> Self {
        let grids = &hierarchy.grids;
        let size = grids[0].size(0);
        let unit = elastic * size.product() * stiffness(&size)[LINEAR[0]];
        let mut tables = CoreTables::default();
        let smoother = match keeping > 0.0 {
            true => Smoother::OF_KEPT_VOLUME,
            false => Smoother::PLAIN,
        };
        let mut levels = Vec::new();
        for (l, (grid, held)) in grids.iter().zip(&hierarchy.held).enumerate() {
            let layout = Layout::new(grid);
            let operator = if l == 0 {
                Operator::Fine(FineOperator::new(grid, &layout, &forms[0], unit, samples))
            } else {
                Operator::Stencil(Stencil::new(grid, &layout))
            };
            levels.push(Level::new(layout, operator, held.clone(), smoother));
        }
        let corrections = hierarchy
            .transfers
            .iter()
            .zip(levels.windows(2))
            .map(|(transfer, pair)| {
                let side = |level: usize| (&pair[level].layout, &pair[level].held[..]);
                Correction::new(transfer, side(0), side(1))
            })
            .collect();
        let scale = |volume: f64| elastic * volume / unit;
        let mut coarse = Vec::new();
        for (l, own) in forms.iter().enumerate().skip(1) {
            let inherited = if l == 1 { &forms[0][..] } else { &[] };
            coarse.push(set_up(
                &hierarchy,
                l,
                own,
                inherited,
                unit,
                &mut tables,
                scale,
            ));
        }
        let inverse_sizes: Vec<Vec<Vector3<f64>>> = grids
            .iter()
            .map(|g| {
                (0..g.elements.len())
                    .map(|e| g.size(e).map(f64::recip))
                    .collect()
            })
            .collect();
        let identity = [1.0, 0.0, 0.0, 1.0, 0.0, 1.0];
        let last = levels.len() - 1;
        let rest: NodalVector = (0..grids[0].node_count())
            .map(|n| grids[0].position(n))
            .collect();
        let finest = (&levels[0].layout, &levels[0].held[..]);
        let flaps = Flaps::new(&grids[0], finest, &forms[0], unit, samples);
        let mut multigrid = Self {
            flaps,
            curvature: vec![Curvature::True; levels.len()],
            dense: Dense::new(&levels[last].layout, &levels[last].held),
            cores: vec![[0.0; CORE]; grids[0].elements.len()],
            touches: None,
            kept: KeptVolume::new(keeping, elastic, grids[0].elements.len()),
            actuation: inverse_sizes
                .iter()
                .map(|v| vec![identity; v.len()])
                .collect(),
            inverse_sizes,
            hierarchy,
            levels,
            corrections,
            coarse,
            tables,
            unit,
            builds: 0,
            cycles: 0,
        };
        // At rest, once, so that every level has a first estimate of its spectrum that all later ones start from.
        multigrid.build(0, &rest, Curvature::True);
        multigrid.builds = 0;
        multigrid
    }

    pub(crate) fn hierarchy(&self) -> &Hierarchy {
        &self.hierarchy
    }

    /// Takes over the mean A of every element, which `write` writes for the finest level.
    pub(crate) fn set_actuation(&mut self, write: impl FnOnce(&mut [Symmetric])) {
        write(&mut self.actuation[0]);
        for l in 1..self.levels.len() {
            let (fine, coarse) = self.actuation.split_at_mut(l);
            let (fine, coarse) = (&fine[l - 1], &mut coarse[0]);
            let level = &self.coarse[l - 1];
            let mean = |(element, out): (usize, &mut Symmetric)| {
                *out = [0.0; 6];
                for child in level.children(element) {
                    let a = &fine[child.element as usize];
                    out.iter_mut()
                        .zip(a)
                        .for_each(|(out, a)| *out += child.share * a);
                }
            };
            coarse
                .par_iter_mut()
                .with_min_len(CHUNK)
                .enumerate()
                .for_each(mean);
        }
    }

    /// Takes over what touches on the finest level, from the next building there on.
    pub(crate) fn set_touches(&mut self, forms: Vec<Form>) {
        let touches = self
            .touches
            .get_or_insert_with(|| Touches::new(&self.hierarchy));
        touches.set(forms, self.unit.sqrt().recip());
    }

    /// Mean A of the elements on a level.
    pub(crate) fn actuation(&self, level: usize) -> &[Symmetric] {
        &self.actuation[level]
    }

    /// Builds the operators of a level and all coarser ones at the positions `u` of the level's nodes. False where the coarsest of them
    /// is not positive definite: then the cycle is not either.
    fn build(&mut self, level: usize, u: &[Vector3<f64>], curvature: Curvature) -> bool {
        self.builds += 1;
        let elements = &self.hierarchy.grids[level].elements;
        let (inverse, actuation) = (&self.inverse_sizes[level], &self.actuation[level]);
        let cores = &mut self.cores[..elements.len()];
        set_cores(curvature, elements, u, (inverse, actuation), cores);
        if let Some(flaps) = self.flaps.as_mut().filter(|_| level == 0) {
            flaps.project(u, actuation, cores);
        }
        if let Some(kept) = &mut self.kept {
            kept.set(elements, inverse, u);
        }
        if let Operator::Fine(operator) = &mut self.levels[0].operator
            && level == 0
        {
            operator.set_cores(&self.cores);
            if let Some(kept) = &self.kept {
                operator.set_normals(&kept.normals);
            }
            if let Some(flaps) = &mut self.flaps {
                let normals = self.kept.as_ref().map(|kept| &kept.normals[..]);
                flaps.set(normals);
            }
        }
        let last = self.levels.len() - 1;
        for l in level.max(1)..=last {
            let (before, after) = self.coarse.split_at_mut(l - 1);
            let coarse = &mut after[0];
            let (grid, tables) = (&self.hierarchy.grids[l], &self.tables);
            if l == level {
                coarse.set_own(grid, &self.cores, tables);
                if let Some(kept) = &self.kept {
                    coarse.add_own_normals(grid, &kept.normals, tables);
                }
            } else if l == 1 {
                coarse.set_from_cores(&self.cores, tables);
                if let Some(kept) = &self.kept {
                    coarse.add_normals(&kept.normals, tables);
                }
            } else {
                coarse.set_from_matrices(&before[l - 2].matrices);
            }
        }
        self.finish(level, true)
    }

    /// Assembles all operators from what the elements do, which is new or as before, and from what touches. False where the coarsest of them is
    /// not positive definite.
    fn finish(&mut self, level: usize, new: bool) -> bool {
        let last = self.levels.len() - 1;
        for (level, coarse) in self.levels[1..]
            .iter_mut()
            .zip(&self.coarse)
            .skip(level.max(1) - 1)
        {
            if let Operator::Stencil(stencil) = &mut level.operator {
                stencil.assemble(&coarse.matrices);
            }
        }
        // Coarse bodies touch nothing.
        if let Some(touches) = self.touches.as_ref().filter(|_| level == 0) {
            touches.add(&self.hierarchy, &mut self.levels);
        }
        for (l, level) in self.levels[..last].iter_mut().enumerate().skip(level) {
            // On the finest level what touches is bounded by its part of the diagonal.
            match l == 0 && !new {
                true => level.refresh_diagonal(),
                false => level.refresh(),
            }
        }
        let coarsest = &self.levels[last];
        let Operator::Stencil(stencil) = &coarsest.operator else {
            unreachable!("there are two levels at least");
        };
        let grid = &self.hierarchy.grids[last];
        self.dense.factor(stencil, &coarsest.bridges, grid)
    }

    /// Builds the cycle for what touches now and the elements as they were when it was last built on the finest level; `u` is where that is.
    pub(crate) fn touch(&mut self, forms: Vec<Form>, u: &[Vector3<f64>]) {
        self.set_touches(forms);
        if !self.finish(0, false) {
            self.project(0, u);
        }
    }

    /// Builds the cycle from `level` down at `u`: on the true Hessian, if that is definite and was not given up.
    pub(crate) fn rebuild(&mut self, level: usize, u: &[Vector3<f64>]) {
        if !self.build(level, u, self.curvature[level]) {
            self.project(level, u);
        }
    }

    /// Gives the true Hessian up on this level and builds on the projected one; false where that was done before.
    pub(crate) fn project(&mut self, level: usize, u: &[Vector3<f64>]) -> bool {
        let was_true = self.curvature[level] == Curvature::True;
        if was_true {
            self.curvature[level] = Curvature::Projected;
            self.build(level, u, Curvature::Projected);
        }
        was_true
    }

    /// Tries the true Hessian again on this level from the next building on.
    pub(crate) fn trust(&mut self, level: usize) {
        self.curvature[level] = Curvature::True;
    }

    /// Makes a cycle safer that turned out not to be positive definite at `u`: projects it, or else makes the smoothers more careful on
    /// `level` and all coarser ones, whose spectrum reaches farther than estimated.
    pub(crate) fn strengthen(&mut self, level: usize, u: &[Vector3<f64>]) {
        if !self.project(level, u) {
            self.levels[level..]
                .iter_mut()
                .for_each(|l| l.strengthen(CAREFUL));
            if let Some(flaps) = &mut self.flaps {
                flaps.strengthen(CAREFUL);
            }
        }
    }

    /// `z = M^-1 r` by one V-cycle from `level`; zero at held nodes.
    pub(crate) fn apply(&mut self, level: usize, r: &[Vector3<f64>], z: &mut NodalVector) {
        let largest = max_norm(r);
        if largest == 0.0 || !largest.is_finite() {
            z.fill(Vector3::zeros());
            return;
        }
        self.cycles += 1;
        let top = &mut self.levels[level];
        top.layout.pack(r, 1.0 / largest, &mut top.b);
        self.cycle(level);
        let top = &self.levels[level];
        top.layout.unpack(&top.x, largest / self.unit, z);
    }

    fn cycle(&mut self, l: usize) {
        if l + 1 == self.levels.len() {
            let level = &mut self.levels[l];
            self.dense.solve(&level.b, &mut level.x);
            return;
        }
        self.levels[l].smooth(true);
        self.smooth_flaps(l);
        // Coarse levels, which cost next to nothing, are corrected twice: on slender bodies a third of the iterations is saved.
        let again = l > 0 && l + 2 < self.levels.len();
        for visit in 0..=usize::from(again) {
            if visit > 0 {
                self.levels[l].smooth(false);
            }
            self.levels[l].residual();
            let (fine, coarse) = self.levels.split_at_mut(l + 1);
            let (fine, coarse) = (&mut fine[l], &mut coarse[0]);
            self.corrections[l].restrict(&fine.y, &coarse.layout, &mut coarse.b);
            self.cycle(l + 1);
            let (fine, coarse) = self.levels.split_at_mut(l + 1);
            let (fine, coarse) = (&mut fine[l], &coarse[0]);
            self.corrections[l].interpolate(&coarse.x, &fine.layout, &mut fine.x);
        }
        self.smooth_flaps(l);
        self.levels[l].smooth(false);
    }

    /// Smooths flaps on the finest level. What touches is not known to them, and a cycle is symmetric only if all of it smooths the same operator.
    fn smooth_flaps(&mut self, l: usize) {
        let level = &mut self.levels[l];
        if let Some(flaps) = self.flaps.as_mut().filter(|_| l == 0)
            && level.bridges.is_empty()
        {
            flaps.smooth(level);
        }
    }
}

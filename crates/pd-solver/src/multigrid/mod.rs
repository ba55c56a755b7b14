//! Geometric multigrid on the Hessian of a voxel body: the preconditioner of the fast methods.
//!
//! The finest level is applied element by element from one core each ([`fine`]), the coarser ones are Galerkin products of it
//! ([`element_matrix`], [`stencil`]), smoothed by Chebyshev polynomials of the block Jacobi iteration ([`level`]) in single
//! precision. The cores are those of the true Hessian or of the exactly projected one ([`Curvature`]): with the projected one a cycle is a
//! symmetric positive definite operator everywhere, with the true one it is at a minimum, and nearer to the inverse there.

mod cores;
mod correction;
mod dense;
mod element_matrix;
mod fine;
mod grid;
mod hierarchy;
mod layout;
mod level;
mod modes;
mod stencil;
#[cfg(test)]
mod tests;
mod transfer;

use crate::vector::{NodalVector, max_norm};
pub(crate) use cores::Curvature;
use cores::{Cores, GROUP, Symmetric};
use correction::Correction;
use dense::Dense;
use element_matrix::{
    CoreSum, CoreTables, ElementMatrix, ZERO, add_form, add_galerkin, parent_weights,
};
pub(crate) use fine::ElementForm;
use fine::{CORE, FineOperator};
pub(crate) use grid::{DisjointSets, Grid};
pub(crate) use hierarchy::Hierarchy;
use layout::Layout;
use level::{Level, Operator};
use modes::{LINEAR, stiffness};
use nalgebra::Vector3;
use rayon::prelude::*;
use stencil::Stencil;
pub(crate) use transfer::Transfer;

/// Elements per task.
const CHUNK: usize = 64;
/// What a largest eigenvalue is raised by where the smoother built on its estimate was not positive definite.
const CAREFUL: f32 = 1.4;
/// Matrices per task.
const TASK: usize = 16;

/// How an element of a finer grid enters its parent's matrix.
#[derive(Clone, Copy)]
struct Child {
    element: u32,
    /// For elements of the finest grid: the table that turns their core into a matrix.
    table: u32,
    interval: [[f32; 2]; 3],
    held: u8,
    /// Share of the parent's volume.
    share: f64,
}

/// What is needed to set the matrices of a coarse level's elements.
struct Coarse {
    /// First child of each element, and the end.
    offsets: Vec<u32>,
    children: Vec<Child>,
    /// Forms of the finest level as this one sees them; only on the level next to it, coarser ones get them from there.
    inherited: Vec<ElementForm>,
    /// Forms of this level's own problem.
    own: Vec<ElementForm>,
    /// Table of each element for this level's own problem, and its weight.
    tables: Vec<u32>,
    matrices: Vec<ElementMatrix>,
}

/// The preconditioner: built at a state on any level, applied from that level down.
pub(crate) struct Multigrid {
    hierarchy: Hierarchy,
    levels: Vec<Level>,
    corrections: Vec<Correction>,
    /// Per level but the finest.
    coarse: Vec<Coarse>,
    tables: CoreTables,
    dense: Dense,
    /// Reciprocals of the edge lengths of all elements, per level.
    inverse_sizes: Vec<Vec<Vector3<f64>>>,
    /// Mean A of every element, per level.
    actuation: Vec<Vec<Symmetric>>,
    cores: Vec<[f32; CORE]>,
    /// Stiffness of a linear mode of an element on the finest level: the unit of all operators.
    unit: f64,
    /// Times that operators were built, and cycles, on any level.
    pub(crate) builds: u64,
    pub(crate) cycles: u64,
}

impl Multigrid {
    /// The preconditioner of a body of elastic stiffness `elastic` and `samples` per element, with linear forms (springs) on each level.
    pub(crate) fn new(
        hierarchy: Hierarchy,
        elastic: f64,
        samples: usize,
        forms: Vec<Vec<ElementForm>>,
    ) -> Self {
        let grids = &hierarchy.grids;
        let size = grids[0].size(0);
        let unit = elastic * size.product() * stiffness(&size)[LINEAR[0]];
        let mut tables = CoreTables::default();
        let mut levels = Vec::new();
        for (l, (grid, held)) in grids.iter().zip(&hierarchy.held).enumerate() {
            let layout = Layout::new(grid);
            let operator = if l == 0 {
                Operator::Fine(FineOperator::new(grid, &layout, &forms[0], unit, samples))
            } else {
                Operator::Stencil(Stencil::new(grid, &layout))
            };
            levels.push(Level::new(layout, operator, held.clone()));
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
        let mut multigrid = Self {
            dense: Dense::new(&levels[last].layout, &levels[last].held),
            cores: vec![[0.0; CORE]; grids[0].elements.len()],
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

    /// Takes over the actuation b of all samples, `samples` per element.
    pub(crate) fn set_actuation(&mut self, b: &[[f64; 6]], samples: usize) {
        let share = 1.0 / samples as f64;
        self.actuation[0]
            .par_iter_mut()
            .zip(b.par_chunks(samples))
            .with_min_len(CHUNK)
            .for_each(|(a, b)| {
                *a = [1.0, 0.0, 0.0, 1.0, 0.0, 1.0];
                for b in b {
                    a.iter_mut().zip(b).for_each(|(a, b)| *a += share * b);
                }
            });
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

    /// Mean A of the elements on a level.
    pub(crate) fn actuation(&self, level: usize) -> &[Symmetric] {
        &self.actuation[level]
    }

    /// Builds the operators of a level and all coarser ones at the positions `u` of the level's nodes. False where the coarsest of them
    /// is not positive definite: then the cycle is not either.
    pub(crate) fn build(&mut self, level: usize, u: &[Vector3<f64>], curvature: Curvature) -> bool {
        self.builds += 1;
        let mut definite = true;
        let elements = &self.hierarchy.grids[level].elements;
        let (inverse, actuation) = (&self.inverse_sizes[level], &self.actuation[level]);
        let arch = pulp::Arch::new();
        self.cores[..elements.len()]
            .par_chunks_mut(GROUP)
            .zip(elements.par_chunks(GROUP))
            .zip(inverse.par_chunks(GROUP).zip(actuation.par_chunks(GROUP)))
            .with_min_len(8)
            .for_each(|((out, elements), (inverse_sizes, actuation))| {
                arch.dispatch(Cores {
                    curvature,
                    elements,
                    u,
                    inverse_sizes,
                    actuation,
                    out,
                });
            });
        if let Operator::Fine(operator) = &mut self.levels[0].operator
            && level == 0
        {
            operator.set_cores(&self.cores);
            self.levels[0].refresh();
        }
        let last = self.levels.len() - 1;
        for l in level.max(1)..=last {
            let (before, after) = self.coarse.split_at_mut(l - 1);
            let coarse = &mut after[0];
            if l == level {
                coarse.set_own(&self.hierarchy.grids[l], &self.cores, &self.tables);
            } else if l == 1 {
                coarse.set_from_cores(&self.cores, &self.tables);
            } else {
                coarse.set_from_matrices(&before[l - 2].matrices);
            }
            if let Operator::Stencil(stencil) = &mut self.levels[l].operator {
                stencil.assemble(&coarse.matrices);
                if l == last {
                    definite = self.dense.factor(stencil, &self.hierarchy.grids[l]);
                }
            }
            if l < last {
                self.levels[l].refresh();
            }
        }
        definite
    }

    /// Makes the smoothers more careful on `level` and all coarser ones: for operators whose spectrum turned out to reach farther
    /// than estimated.
    pub(crate) fn strengthen(&mut self, level: usize) {
        self.levels[level..]
            .iter_mut()
            .for_each(|l| l.strengthen(CAREFUL));
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
        self.levels[l].smooth(false);
    }
}

/// Collects what level `l` needs to know of its elements, their children, and the forms on them.
fn set_up(
    hierarchy: &Hierarchy,
    l: usize,
    own: &[ElementForm],
    inherited: &[ElementForm],
    unit: f64,
    tables: &mut CoreTables,
    scale: impl Fn(f64) -> f64,
) -> Coarse {
    let (fine, grid) = (&hierarchy.grids[l - 1], &hierarchy.grids[l]);
    let parents = &hierarchy.parents[l - 1];
    let mut order: Vec<u32> = (0..parents.len() as u32).collect();
    order.sort_by_key(|&e| parents[e as usize]);
    let mut offsets = vec![0; grid.elements.len() + 1];
    parents.iter().for_each(|&p| offsets[p as usize + 1] += 1);
    for i in 0..grid.elements.len() {
        offsets[i + 1] += offsets[i];
    }
    let children = order.iter().map(|&element| {
        let (interval, held) = hierarchy.place_in_parent(l - 1, element as usize);
        let table = if l == 1 {
            let size = fine.size(element as usize);
            tables.number(&size, &interval, held, scale(size.product()))
        } else {
            0
        };
        Child {
            element,
            table,
            interval: interval.map(|ends| ends.map(|x| x as f32)),
            held,
            share: fine.volume(element as usize) / grid.volume(parents[element as usize] as usize),
        }
    });
    let children = children.collect();
    let whole = [[0.0, 1.0]; 3];
    let of_element = |e: usize| {
        let size = grid.size(e);
        tables.number(&size, &whole, 0, scale(size.product()))
    };
    let to_parent = |(element, weights, stiffness): &ElementForm| {
        let (interval, held) = hierarchy.place_in_parent(l - 1, *element as usize);
        let parent = parents[*element as usize];
        (
            parent,
            parent_weights(weights, &interval, held),
            stiffness / unit,
        )
    };
    Coarse {
        tables: (0..grid.elements.len()).map(of_element).collect(),
        matrices: vec![ZERO; grid.elements.len()],
        inherited: inherited.iter().map(to_parent).collect(),
        own: own.iter().map(|&(e, w, k)| (e, w, k / unit)).collect(),
        offsets,
        children,
    }
}

impl Coarse {
    fn children(&self, element: usize) -> &[Child] {
        &self.children[self.offsets[element] as usize..self.offsets[element + 1] as usize]
    }

    /// Sets every element's matrix.
    fn fill(&mut self, fill: impl Fill) {
        let mut matrices = std::mem::take(&mut self.matrices);
        let (this, arch) = (&*self, pulp::Arch::new());
        matrices
            .par_chunks_mut(TASK)
            .enumerate()
            .for_each(|(task, part)| {
                arch.dispatch(FillTask {
                    fill: &fill,
                    coarse: this,
                    first: task * TASK,
                    part,
                });
            });
        self.matrices = matrices;
    }

    /// From the cores of the finest level.
    fn set_from_cores(&mut self, cores: &[[f32; CORE]], tables: &CoreTables) {
        self.fill(FromCores { cores, tables });
        for (element, weights, stiffness) in &self.inherited {
            add_form(weights, *stiffness, &mut self.matrices[*element as usize]);
        }
    }

    /// From the matrices of the next finer level.
    fn set_from_matrices(&mut self, fine: &[ElementMatrix]) {
        self.fill(FromMatrices(fine));
    }

    /// From the cores of this level itself.
    fn set_own(&mut self, grid: &Grid, cores: &[[f32; CORE]], tables: &CoreTables) {
        self.fill(FromOwnCores {
            cores,
            tables,
            grid,
        });
        for (element, weights, stiffness) in &self.own {
            add_form(weights, *stiffness, &mut self.matrices[*element as usize]);
        }
    }
}

/// Where the matrix of a coarse element comes from.
trait Fill: Sync {
    /// Sets the matrix of an element; `sum` is memory to work in.
    fn set(&self, coarse: &Coarse, element: usize, sum: &mut CoreSum, out: &mut ElementMatrix);
}

struct FromCores<'a> {
    cores: &'a [[f32; CORE]],
    tables: &'a CoreTables,
}

impl Fill for FromCores<'_> {
    #[inline(always)]
    fn set(&self, coarse: &Coarse, element: usize, sum: &mut CoreSum, out: &mut ElementMatrix) {
        sum.clear();
        for child in coarse.children(element) {
            let table = &self.tables.tables[child.table as usize];
            sum.add(table, &self.cores[child.element as usize], 1.0);
        }
        sum.write(out);
    }
}

struct FromMatrices<'a>(&'a [ElementMatrix]);

impl Fill for FromMatrices<'_> {
    #[inline(always)]
    fn set(&self, coarse: &Coarse, element: usize, _: &mut CoreSum, out: &mut ElementMatrix) {
        *out = ZERO;
        for child in coarse.children(element) {
            let matrix = &self.0[child.element as usize];
            add_galerkin(matrix, &child.interval, child.held, out);
        }
    }
}

struct FromOwnCores<'a> {
    cores: &'a [[f32; CORE]],
    tables: &'a CoreTables,
    grid: &'a Grid,
}

impl Fill for FromOwnCores<'_> {
    #[inline(always)]
    fn set(&self, coarse: &Coarse, element: usize, sum: &mut CoreSum, out: &mut ElementMatrix) {
        sum.clear();
        let table = &self.tables.tables[coarse.tables[element] as usize];
        sum.add(table, &self.cores[element], self.grid.fill[element] as f32);
        sum.write(out);
    }
}

/// The matrices of one task.
struct FillTask<'a, F> {
    fill: &'a F,
    coarse: &'a Coarse,
    first: usize,
    part: &'a mut [ElementMatrix],
}

impl<F: Fill> pulp::WithSimd for FillTask<'_, F> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, _simd: S) {
        let mut sum = CoreSum::new();
        for (i, matrix) in self.part.iter_mut().enumerate() {
            self.fill.set(self.coarse, self.first + i, &mut sum, matrix);
        }
    }
}

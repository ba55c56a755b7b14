//! What is needed to set the matrices of a coarse level's elements: their children, tables, and the forms on them.

use super::element_matrix::{
    CoreSum, CoreTables, ElementMatrix, ZERO, add_form, add_galerkin, parent_weights, subtract,
};
use super::fine::{CORE, ElementForm};
use super::grid::Grid;
use super::hierarchy::Hierarchy;
use super::kept_volume::Normal;
use rayon::prelude::*;

/// Matrices per task.
const TASK: usize = 16;

/// How an element of a finer grid enters its parent's matrix.
#[derive(Clone, Copy)]
pub(super) struct Child {
    pub(super) element: u32,
    /// For elements of the finest grid: the table that turns their core into a matrix.
    pub(super) table: u32,
    pub(super) interval: [[f64; 2]; 3],
    pub(super) held: u8,
    /// Factor on the stiffness, for elements of the finest grid.
    stiffness: f32,
    /// Share of the parent's volume.
    pub(super) share: f64,
}

/// What is needed to set the matrices of a coarse level's elements.
pub(super) struct Coarse {
    /// First child of each element, and the end.
    offsets: Vec<u32>,
    children: Vec<Child>,
    /// Forms of the finest level as this one sees them; only on the level next to it, coarser ones get them from there.
    inherited: Vec<ElementForm>,
    /// Forms of this level's own problem.
    own: Vec<ElementForm>,
    /// Table of each element for this level's own problem, and its weight.
    tables: Vec<u32>,
    pub(super) matrices: Vec<ElementMatrix>,
}

/// Collects what level `l` needs to know of its elements, their children, and the forms on them.
pub(super) fn set_up(
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
            interval,
            held,
            stiffness: fine.stiffness[element as usize] as f32,
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
    pub(super) fn children(&self, element: usize) -> &[Child] {
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
    pub(super) fn set_from_cores(&mut self, cores: &[[f32; CORE]], tables: &CoreTables) {
        self.fill(FromCores { cores, tables });
        for (element, weights, stiffness) in &self.inherited {
            add_form(weights, *stiffness, &mut self.matrices[*element as usize]);
        }
    }

    /// Adds what the elements of the finest level do against changes of their volume.
    pub(super) fn add_normals(&mut self, normals: &[Normal], tables: &CoreTables) {
        self.fill(AddNormals { normals, tables });
    }

    /// Adds what this level's own elements do against changes of their volume.
    pub(super) fn add_own_normals(&mut self, grid: &Grid, normals: &[Normal], tables: &CoreTables) {
        self.fill(AddOwnNormals {
            normals,
            tables,
            grid,
        });
    }

    /// From the matrices of the next finer level.
    pub(super) fn set_from_matrices(&mut self, fine: &[ElementMatrix]) {
        self.fill(FromMatrices(fine));
    }

    /// From the cores of this level itself.
    pub(super) fn set_own(&mut self, grid: &Grid, cores: &[[f32; CORE]], tables: &CoreTables) {
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
            sum.add(table, &self.cores[child.element as usize], child.stiffness);
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
        let weight = self.grid.fill[element] * self.grid.stiffness[element];
        sum.add(table, &self.cores[element], weight as f32);
        sum.write(out);
    }
}

struct AddNormals<'a> {
    normals: &'a [Normal],
    tables: &'a CoreTables,
}

impl Fill for AddNormals<'_> {
    #[inline(always)]
    fn set(&self, coarse: &Coarse, element: usize, sum: &mut CoreSum, out: &mut ElementMatrix) {
        sum.clear();
        for child in coarse.children(element) {
            let table = &self.tables.tables[child.table as usize];
            sum.take(table, &self.normals[child.element as usize], 1.0);
        }
        let mut taken = ZERO;
        sum.write(&mut taken);
        subtract(&taken, out);
    }
}

struct AddOwnNormals<'a> {
    normals: &'a [Normal],
    tables: &'a CoreTables,
    grid: &'a Grid,
}

impl Fill for AddOwnNormals<'_> {
    #[inline(always)]
    fn set(&self, coarse: &Coarse, element: usize, sum: &mut CoreSum, out: &mut ElementMatrix) {
        sum.clear();
        let table = &self.tables.tables[coarse.tables[element] as usize];
        let root = (self.grid.fill[element] as f32).sqrt();
        sum.take(table, &self.normals[element], root);
        let mut taken = ZERO;
        sum.write(&mut taken);
        subtract(&taken, out);
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

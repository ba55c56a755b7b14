//! Which element carries each vertex of the surface: one of the vertex's own part of the body.

use nalgebra::Vector3;
use rayon::prelude::*;
use surface_mesh::{Surface, vertex_normals};

use super::candidates::NONE;
use super::cut::{CutCells, flat};
use super::grid::CellGrid;
use super::links::gapless;
use super::pieces::grid_position;
use super::segments::{Triangles, Way};
use crate::cell_tree::{Candidate, cell_distance, nearer};
use crate::{CellIndex, EmbeddedPoint, HexMesh, NodeElements};

/// The parts of the cut cells of a voxelised body, and their elements.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Parts {
    pub grid: CellGrid,
    pub cut: CutCells,
    /// The element of each part of the cut cells, or `NONE`.
    pub elements: Vec<u32>,
}

/// How far a walk through material leads, in cells along each axis.
const REACH: usize = 4;

/// How far from a vertex its first sample may lie, in samples along each axis.
const NEAR: i32 = 3;

impl Parts {
    /// The element that carries each vertex, `None` where no element of the vertex's own part is near. `nearest` are the elements with
    /// the nearest cubes.
    ///
    /// From the vertex, the way leads to a sample on the inner side without entering another part of the body, and from there from
    /// sample to linked sample. The elements that are reached first are candidates; the nearest cube of them is taken. Where no gap is
    /// around, that is simply the nearest cube.
    ///
    /// A vertex without such a sample or element, on a sharp edge say, starts from the elements of the nearest vertices along the
    /// surface that have one, and goes from element to element that share a node for as long as cubes come nearer.
    pub fn carriers(
        &self,
        mesh: &HexMesh,
        surface: &Surface,
        nearest: &[EmbeddedPoint],
    ) -> Vec<Option<u32>> {
        let orientation = surface.signed_volume().signum();
        let local = |vertex: &Vector3<f64>| {
            let first = Vector3::from(self.grid.first_cell.map(f64::from));
            (vertex - self.grid.origin) / self.grid.size - first
        };
        let vertices = surface.vertices().iter().map(local).collect();
        let counts = self.grid.counts;
        let triangles = Triangles::new(counts, vertices, surface.triangles(), orientation);
        let normals = vertex_normals(surface.vertices(), surface.triangles());
        let search = Search::new(self, mesh);
        let mut carriers: Vec<Option<u32>> = (0..surface.vertex_count())
            .into_par_iter()
            .map_init(
                || Walk::new(self.cut.samples),
                |walk, vertex| {
                    let outwards = normals[vertex] * orientation;
                    let point = triangles.vertices[vertex];
                    let seed = search.first_sample(&triangles, &point, &outwards)?;
                    let by_cube = nearest[vertex].element;
                    if search.is_gapless_around(&point, mesh.cells()[by_cube as usize]) {
                        return Some(by_cube);
                    }
                    let found = search.nearest_along(walk, seed, &point)?;
                    Some(found.1 as u32)
                },
            )
            .collect();
        spread(&mut carriers, mesh, surface);
        carriers
    }
}

/// What the search for the carriers of all vertices has in common.
struct Search<'a> {
    parts: &'a Parts,
    index: CellIndex,
    /// Steps to the samples around a point, the nearest first.
    offsets: Vec<[i32; 3]>,
    gapless: Vec<bool>,
    /// Per axis and place of a sample along it: its share of the flat index of the cell, and of that of the sample in the cell.
    /// Divisions would take most of the time.
    places: [Vec<(usize, usize)>; 3],
}

impl<'a> Search<'a> {
    fn new(parts: &'a Parts, mesh: &HexMesh) -> Self {
        let (n, counts) = (parts.cut.samples, parts.grid.counts);
        let places = |axis: usize| {
            let mut unit = [0; 3];
            unit[axis] = 1;
            let strides = [flat(unit, counts), flat(unit, [n; 3])];
            let along = 0..counts[axis] * n;
            along
                .map(|i| (i / n * strides[0], i % n * strides[1]))
                .collect()
        };
        Self {
            parts,
            index: mesh.cell_index(),
            offsets: near_offsets(),
            gapless: gapless(&parts.cut),
            places: [0, 1, 2].map(places),
        }
    }

    /// The nearest inside sample on the inner side of a vertex to which the way is free; else one to which it leaves other parts; else
    /// one on the outer side to which it is free: the walls of a cavity may face the wrong way.
    fn first_sample(
        &self,
        triangles: &Triangles,
        vertex: &Vector3<f64>,
        outwards: &Vector3<f64>,
    ) -> Option<[usize; 3]> {
        let n = self.parts.cut.samples as f64;
        let home = vertex.map(|x| (x * n - 0.5).round() as i32);
        let (mut leaving, mut outer) = (None, None);
        for offset in &self.offsets {
            let sample: [i32; 3] = std::array::from_fn(|axis| home[axis] + offset[axis]);
            let point = Vector3::from(sample.map(|i| (f64::from(i) + 0.5) / n));
            let is_inner = (point - vertex).dot(outwards) < 0.0;
            // What is below 0 wraps around to beyond the grid.
            let sample = sample.map(|i| i as usize);
            if !is_inner && outer.is_some() || self.part_at(sample).is_none() {
                continue;
            }
            match (triangles.way(vertex, &point), is_inner) {
                (Way::Free, true) => return Some(sample),
                (Way::Free, false) => outer = Some(sample),
                (Way::Leaving, true) => leaving = leaving.or(Some(sample)),
                _ => {}
            }
        }
        leaving.or(outer)
    }

    /// Whether there is no gap in the cells around a point, of which `cell` is one.
    fn is_gapless_around(&self, point: &Vector3<f64>, cell: [i32; 3]) -> bool {
        let CellGrid {
            first_cell, counts, ..
        } = self.parts.grid;
        let home: [i32; 3] = point.map(|x| x.floor() as i32).into();
        let is_near = |axis: usize| (cell[axis] - first_cell[axis]).abs_diff(home[axis]) <= 1;
        let mut block = (0..27).map(|i| [i / 9 - 1, i / 3 % 3 - 1, i % 3 - 1]);
        (0..3).all(is_near)
            && block.all(|steps| {
                // What is below 0 wraps around to beyond the grid.
                let position: [usize; 3] =
                    std::array::from_fn(|axis| (home[axis] + steps[axis]) as usize);
                let is_within = (0..3).all(|axis| position[axis] < counts[axis]);
                let slot = is_within.then(|| self.parts.cut.slot(flat(position, counts)));
                slot.flatten().is_none_or(|slot| self.gapless[slot])
            })
    }

    /// The cell of a sample and its part, if it is inside.
    fn part_at(&self, sample: [usize; 3]) -> Option<(usize, u8)> {
        let (cell, within) = self.place(sample)?;
        Some((cell, self.parts.cut.part_at(cell, within)?))
    }

    /// The cell of a sample of the lattice, and the sample in that cell.
    fn place(&self, sample: [usize; 3]) -> Option<(usize, usize)> {
        let [x, y, z] = [0, 1, 2].map(|axis| self.places[axis].get(sample[axis]));
        let (x, y, z) = (x?, y?, z?);
        Some((x.0 + y.0 + z.0, x.1 + y.1 + z.1))
    }

    /// The nearest cube among the elements that a walk from a sample meets first.
    fn nearest_along(
        &self,
        walk: &mut Walk,
        seed: [usize; 3],
        vertex: &Vector3<f64>,
    ) -> Option<Candidate> {
        let n = self.parts.cut.samples;
        walk.start(seed);
        let mut best: Option<Candidate> = None;
        let mut last_step = usize::MAX;
        while let Some((sample, step)) = walk.next() {
            if step > last_step {
                break;
            }
            let Some((cell, part)) = self.part_at(sample) else {
                continue;
            };
            if let Some(element) = self.element(cell, part) {
                let position = sample.map(|i| (i / n) as i32);
                let candidate = (cell_distance(vertex, position, position), element as usize);
                // Within a cell's length, another element may be nearer, but none that is farther from the start than that; around
                // an edge of this cell, it may be as near.
                let off_boundary = (0..3).all(|axis| vertex[axis] != vertex[axis].floor());
                let further = match candidate.0 == 0.0 {
                    true if off_boundary => 0,
                    true => 3,
                    false => n,
                };
                let farthest = (3.0 * candidate.0).sqrt() * n as f64;
                last_step = last_step
                    .min(step + further)
                    .min(farthest.ceil() as usize + 4);
                best = Some(best.map_or(candidate, |best| nearer(best, candidate)));
            }
            for axis in 0..3 {
                let mut above = sample;
                above[axis] += 1;
                for (neighbour, upper) in [(above, above), (before(sample, axis), sample)] {
                    let Some((cell, within)) = self.place(upper) else {
                        continue;
                    };
                    if self.part_at(neighbour).is_some()
                        && !self.parts.cut.has_barrier(cell, within, axis)
                    {
                        walk.visit(neighbour, step + 1);
                    }
                }
            }
        }
        best
    }

    fn element(&self, cell: usize, part: u8) -> Option<u32> {
        let Parts {
            grid,
            cut,
            elements,
        } = self.parts;
        match cut.slot(cell) {
            Some(slot) => {
                let element = elements[cut.first_part(slot) + usize::from(part)];
                (element != NONE).then_some(element)
            }
            None => {
                let position = grid_position(cell, grid.counts);
                self.index.elements(grid.cell(position)).next()
            }
        }
    }
}

/// The sample before another along an axis; before the first one comes a place beyond the grid.
fn before(mut sample: [usize; 3], axis: usize) -> [usize; 3] {
    sample[axis] = sample[axis].wrapping_sub(1);
    sample
}

/// Steps to the samples around a point, the nearest first.
fn near_offsets() -> Vec<[i32; 3]> {
    let side = 2 * NEAR + 1;
    let offset = |i: i32| [i / side / side, i / side % side, i % side].map(|i| i - NEAR);
    let mut offsets: Vec<_> = (0..side.pow(3)).map(offset).collect();
    offsets.sort_by_key(|offset| (offset.iter().map(|i| i * i).sum::<i32>(), *offset));
    offsets
}

/// A walk from sample to sample, the nearest first, within a window around its start.
struct Walk {
    /// Samples along each axis of the window.
    side: usize,
    start: [usize; 3],
    seen: Vec<bool>,
    queue: Vec<([usize; 3], usize)>,
    next: usize,
}

impl Walk {
    fn new(samples: usize) -> Self {
        let side = 2 * REACH * samples + 1;
        Self {
            side,
            start: [0; 3],
            seen: vec![false; side.pow(3)],
            queue: Vec::new(),
            next: 0,
        }
    }

    fn start(&mut self, sample: [usize; 3]) {
        for at in 0..self.queue.len() {
            let place = self.place(self.queue[at].0);
            self.seen[place.expect("only places in the window are queued")] = false;
        }
        self.queue.clear();
        self.next = 0;
        self.start = sample;
        self.visit(sample, 0);
    }

    fn place(&self, sample: [usize; 3]) -> Option<usize> {
        let centre = self.side / 2;
        let within: [usize; 3] = std::array::from_fn(|axis| {
            sample[axis]
                .wrapping_sub(self.start[axis])
                .wrapping_add(centre)
        });
        { within }
            .iter()
            .all(|&i| i < self.side)
            .then(|| flat(within, [self.side; 3]))
    }

    fn visit(&mut self, sample: [usize; 3], step: usize) {
        if let Some(place) = self.place(sample)
            && !std::mem::replace(&mut self.seen[place], true)
        {
            self.queue.push((sample, step));
        }
    }

    fn next(&mut self) -> Option<([usize; 3], usize)> {
        let next = self.queue.get(self.next).copied();
        self.next += 1;
        next
    }
}

/// Gives vertices without a carrier one that is reached from those of their neighbours along the surface.
fn spread(carriers: &mut [Option<u32>], mesh: &HexMesh, surface: &Surface) {
    let mut open: Vec<[u32; 3]> = surface.triangles().to_vec();
    let mut around = None;
    loop {
        let lacks = |vertex: &u32| carriers[*vertex as usize].is_none();
        open.retain(|triangle| triangle.iter().any(lacks));
        let mut starts: Vec<(u32, u32)> = Vec::new();
        for triangle in &open {
            for &vertex in triangle.iter().filter(|vertex| lacks(vertex)) {
                let known = triangle
                    .iter()
                    .filter_map(|&other| carriers[other as usize]);
                starts.extend(known.map(|carrier| (vertex, carrier)));
            }
        }
        if starts.is_empty() {
            return;
        }
        starts.sort_unstable();
        starts.dedup();
        let around = around.get_or_insert_with(|| mesh.node_elements());
        for starts in starts.chunk_by(|a, b| a.0 == b.0) {
            let vertex = starts[0].0 as usize;
            let local = (surface.vertices()[vertex] - mesh.origin()) / mesh.element_size();
            let ends = starts
                .iter()
                .map(|start| descend(start.1, &local, mesh, around));
            carriers[vertex] = ends.reduce(nearer).map(|nearest| nearest.1 as u32);
        }
    }
}

/// Goes from an element to the nearest one around it that shares a node, as long as cubes come nearer to a point.
fn descend(start: u32, local: &Vector3<f64>, mesh: &HexMesh, around: &NodeElements) -> Candidate {
    let candidate = |element: u32| {
        let cell = mesh.cells()[element as usize];
        (cell_distance(local, cell, cell), element as usize)
    };
    let mut best = candidate(start);
    loop {
        let nodes = mesh.elements()[best.1].iter();
        let corners = nodes.flat_map(|&node| around.at(node as usize));
        let next = corners
            .map(|corner| candidate(corner.element))
            .reduce(nearer);
        match next {
            Some(next) if next.0 < best.0 => best = next,
            _ => return best,
        }
    }
}

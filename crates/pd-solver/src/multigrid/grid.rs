//! The body on one level of the hierarchy, and its coarsening by blocks of elements.

use super::transfer::Transfer;
use hex_mesh::{HexMesh, corner_offset};
use nalgebra::Vector3;

/// A voxel body whose elements are boxes between lattice planes. On the finest level all are equal cubes.
///
/// Nodes are sorted by lattice place and elements by cell, x slowest, so that both come plane by plane. Several nodes or
/// elements may share a place: pieces that touch there without being connected.
pub(crate) struct Grid {
    /// Corners of every element.
    pub(crate) elements: Vec<[u32; 8]>,
    /// Cell of every element, counted from the lowest plane.
    pub(crate) cells: Vec<[u32; 3]>,
    /// Lattice place of every node.
    pub(crate) places: Vec<[u32; 3]>,
    /// Coordinates of the lattice planes along each axis.
    pub(crate) planes: [Vec<f64>; 3],
    /// Share of every element's box that is body.
    pub(crate) fill: Vec<f64>,
    /// Stiffness of what fills it, as a factor on that of the body.
    pub(crate) stiffness: Vec<f64>,
}

/// A coarser grid and how it hangs together with the finer one.
pub(crate) struct Coarsening {
    pub(crate) grid: Grid,
    /// The coarse element of every fine one.
    pub(crate) parent: Vec<u32>,
    /// Trilinear interpolation of nodal values from the coarse grid to the fine one.
    pub(crate) transfer: Transfer,
}

impl Grid {
    /// The grid of a mesh, with a factor on the stiffness of each element where they differ.
    pub(crate) fn from_mesh(mesh: &HexMesh, factors: Option<&[f64]>) -> Self {
        let low = mesh.cells().iter().fold([i32::MAX; 3], |low, cell| {
            std::array::from_fn(|a| low[a].min(cell[a]))
        });
        let cell_of = |cell: &[i32; 3]| std::array::from_fn(|a| cell[a].abs_diff(low[a]));
        let cells: Vec<[u32; 3]> = mesh.cells().iter().map(cell_of).collect();
        let mut places = vec![[0; 3]; mesh.nodes().len()];
        for (nodes, cell) in mesh.elements().iter().zip(&cells) {
            for (corner, &node) in nodes.iter().enumerate() {
                let offset = corner_offset(corner);
                places[node as usize] = std::array::from_fn(|a| cell[a] + offset[a] as u32);
            }
        }
        let origin = mesh.origin();
        let planes = std::array::from_fn(|a| {
            let last = cells.iter().map(|c| c[a]).max().unwrap_or(0) + 1;
            let coordinate = |i: u32| origin[a] + (i as f64 + low[a] as f64) * mesh.element_size();
            (0..=last).map(coordinate).collect()
        });
        Self {
            elements: mesh.elements().to_vec(),
            fill: vec![1.0; cells.len()],
            stiffness: factors.map_or_else(|| vec![1.0; cells.len()], <[f64]>::to_vec),
            cells,
            places,
            planes,
        }
    }

    /// Number of nodes.
    pub(crate) fn node_count(&self) -> usize {
        self.places.len()
    }

    /// Position of a node at rest.
    pub(crate) fn position(&self, node: usize) -> Vector3<f64> {
        let place = self.places[node];
        Vector3::from_fn(|a, _| self.planes[a][place[a] as usize])
    }

    /// Edge lengths of an element.
    pub(crate) fn size(&self, element: usize) -> Vector3<f64> {
        let cell = self.cells[element];
        Vector3::from_fn(|a, _| {
            let i = cell[a] as usize;
            self.planes[a][i + 1] - self.planes[a][i]
        })
    }

    /// Volume of body in an element.
    pub(crate) fn volume(&self, element: usize) -> f64 {
        self.size(element).product() * self.fill[element]
    }

    /// Which elements lie in a run of at most `most` along some axis.
    pub(crate) fn thin_elements(&self, most: u32) -> Vec<bool> {
        let mut thin = vec![false; self.cells.len()];
        for axis in 0..3 {
            let others = [(axis + 1) % 3, (axis + 2) % 3];
            let line = |cell: &[u32; 3]| others.map(|other| cell[other]);
            let mut order: Vec<([u32; 2], u32, u32)> = (self.cells.iter().zip(0..))
                .map(|(cell, element)| (line(cell), cell[axis], element))
                .collect();
            order.sort_unstable();
            // Several elements may share a cell.
            for run in order.chunk_by(|a, b| a.0 == b.0 && b.1 - a.1 <= 1) {
                if run[run.len() - 1].1 - run[0].1 < most {
                    run.iter().for_each(|r| thin[r.2 as usize] = true);
                }
            }
        }
        thin
    }

    /// Share of the elements that have no neighbour on either side along some axis.
    pub(crate) fn thin_share(&self) -> f64 {
        let thin = self.thin_elements(1);
        thin.iter().filter(|thin| **thin).count() as f64 / thin.len() as f64
    }

    /// Some elements, by rising numbers, as a grid of their own on the same planes, and the number of each of its nodes in this one.
    pub(crate) fn part(&self, elements: &[u32]) -> (Self, Vec<u32>) {
        let of = |e: &u32| self.elements[*e as usize];
        let mut nodes: Vec<u32> = elements.iter().flat_map(of).collect();
        nodes.sort_unstable();
        nodes.dedup();
        let own = |node: u32| nodes.partition_point(|&n| n < node) as u32;
        let pick = |values: &[f64]| elements.iter().map(|&e| values[e as usize]).collect();
        let part = Self {
            elements: elements.iter().map(|e| of(e).map(own)).collect(),
            cells: elements.iter().map(|&e| self.cells[e as usize]).collect(),
            places: nodes.iter().map(|&n| self.places[n as usize]).collect(),
            planes: self.planes.clone(),
            fill: pick(&self.fill),
            stiffness: pick(&self.stiffness),
        };
        (part, nodes)
    }

    /// Where an element lies in its parent's box, along each axis as shares of the parent's edge.
    pub(crate) fn interval(&self, element: usize, coarse: &Grid, parent: usize) -> [[f64; 2]; 3] {
        let (cell, block) = (self.cells[element], coarse.cells[parent]);
        std::array::from_fn(|a| {
            let share = |i: u32| coarse.share(a, block[a], self.planes[a][i as usize]);
            [share(cell[a]), share(cell[a] + 1)]
        })
    }

    /// A coordinate as share of the edge of a cell, exact at its ends.
    fn share(&self, axis: usize, cell: u32, coordinate: f64) -> f64 {
        let (low, high) = (
            self.planes[axis][cell as usize],
            self.planes[axis][cell as usize + 1],
        );
        if coordinate == high {
            1.0
        } else {
            (coordinate - low) / (high - low)
        }
    }

    /// The next coarser grid: blocks of two cells along each axis, three at the end of an odd extent.
    ///
    /// Half blocks at odd ends would be slivers that lead a coarse-to-fine start into spurious minima. Within a block, each
    /// connected piece becomes an element of its own; two coarse elements share a coarse node exactly where a fine node that both
    /// hold is interpolated from it, which is what makes the interpolation single-valued. `None` when nothing gets coarser.
    pub(crate) fn coarsen(&self) -> Option<Coarsening> {
        let starts: [Vec<usize>; 3] =
            std::array::from_fn(|a| block_starts(self.planes[a].len() - 1));
        let planes: [Vec<f64>; 3] =
            std::array::from_fn(|a| starts[a].iter().map(|&i| self.planes[a][i]).collect());
        if (0..3).all(|a| planes[a].len() == self.planes[a].len()) {
            return None;
        }
        let block = |cell: [u32; 3]| -> [u32; 3] {
            std::array::from_fn(|a| (cell[a] / 2).min(planes[a].len() as u32 - 2))
        };
        let blocks: Vec<[u32; 3]> = self.cells.iter().map(|&c| block(c)).collect();
        let (parent, cells) = self.pieces(&blocks);
        let mut grid = Grid {
            elements: vec![[0; 8]; cells.len()],
            fill: vec![0.0; cells.len()],
            stiffness: vec![0.0; cells.len()],
            cells,
            places: Vec::new(),
            planes,
        };
        for (element, &coarse) in parent.iter().enumerate() {
            let box_volume = grid.size(coarse as usize).product();
            grid.fill[coarse as usize] += self.volume(element) / box_volume;
        }
        let mut volumes = vec![0.0; grid.fill.len()];
        for (element, &coarse) in parent.iter().enumerate() {
            let volume = self.volume(element);
            volumes[coarse as usize] += volume;
            grid.stiffness[coarse as usize] += volume * self.stiffness[element];
        }
        let means = grid.stiffness.iter_mut().zip(volumes);
        means.for_each(|(stiffness, volume)| *stiffness /= volume);
        let transfer = self.connect(&mut grid, &parent);
        Some(Coarsening {
            grid,
            parent,
            transfer,
        })
    }

    /// Numbers the connected pieces of all blocks: the piece of every element, and the block of every piece.
    fn pieces(&self, blocks: &[[u32; 3]]) -> (Vec<u32>, Vec<[u32; 3]>) {
        let mut order: Vec<u32> = (0..blocks.len() as u32).collect();
        order.sort_by_key(|&e| (blocks[e as usize], e));
        let mut parent = vec![0; blocks.len()];
        let mut cells = Vec::new();
        for members in order.chunk_by(|&a, &b| blocks[a as usize] == blocks[b as usize]) {
            let mut sets = DisjointSets::new(members.len());
            for (i, &a) in members.iter().enumerate() {
                for (j, &b) in members[..i].iter().enumerate() {
                    let (a, b) = (&self.elements[a as usize], &self.elements[b as usize]);
                    if a.iter().any(|node| b.contains(node)) {
                        sets.join(i as u32, j as u32);
                    }
                }
            }
            let mut number = vec![u32::MAX; members.len()];
            for (i, &element) in members.iter().enumerate() {
                let root = sets.root(i as u32) as usize;
                if number[root] == u32::MAX {
                    number[root] = cells.len() as u32;
                    cells.push(blocks[element as usize]);
                }
                parent[element as usize] = number[root];
            }
        }
        (parent, cells)
    }

    /// Finds the nodes of the coarse grid, sets them in its elements, and returns the interpolation from them.
    fn connect(&self, coarse: &mut Grid, parent: &[u32]) -> Transfer {
        // The corners that each fine node takes its value from, as seen from each coarse element around it.
        let mut corners = DisjointSets::new(coarse.cells.len() * 8);
        let mut seen: Vec<(u32, u32)> = Vec::with_capacity(self.elements.len() * 8);
        for (element, nodes) in self.elements.iter().enumerate() {
            seen.extend(nodes.iter().map(|&node| (node, parent[element])));
        }
        seen.sort_unstable();
        seen.dedup();
        for around in seen.chunk_by(|a, b| a.0 == b.0) {
            let place = self.places[around[0].0 as usize];
            let (first, others) = around.split_first().expect("chunks are not empty");
            for (corner, at, _) in self.weights(coarse, place, first.1) {
                for other in others {
                    let same = self.weights(coarse, place, other.1);
                    for (candidate, place, _) in same {
                        if place == at {
                            corners.join(first.1 * 8 + corner, other.1 * 8 + candidate);
                        }
                    }
                }
            }
        }
        let mut roots: Vec<([u32; 3], u32)> = (0..coarse.cells.len() as u32 * 8)
            .filter(|&slot| corners.root(slot) == slot)
            .map(|slot| (coarse.corner_place(slot), slot))
            .collect();
        roots.sort_unstable();
        let mut number = vec![0; coarse.cells.len() * 8];
        for (node, &(_, slot)) in roots.iter().enumerate() {
            number[slot as usize] = node as u32;
        }
        let node_of = |corners: &mut DisjointSets, slot: u32| number[corners.root(slot) as usize];
        for (element, nodes) in coarse.elements.iter_mut().enumerate() {
            for (corner, node) in nodes.iter_mut().enumerate() {
                *node = node_of(&mut corners, (element * 8 + corner) as u32);
            }
        }
        coarse.places = roots.iter().map(|&(place, _)| place).collect();
        let mut rows = Vec::with_capacity(self.node_count());
        for around in seen.chunk_by(|a, b| a.0 == b.0) {
            let (node, element) = around[0];
            let row = self.weights(coarse, self.places[node as usize], element);
            let corners = &coarse.elements[element as usize];
            rows.push(row.map(move |(corner, _, weight)| (corners[corner as usize], weight)));
        }
        Transfer::new(rows.into_iter(), coarse.node_count())
    }

    /// The corners of a coarse element, with their places, that a fine lattice place takes its value from, and the weights.
    fn weights(
        &self,
        coarse: &Grid,
        place: [u32; 3],
        element: u32,
    ) -> impl Iterator<Item = (u32, [u32; 3], f64)> + use<> {
        let block = coarse.cells[element as usize];
        let share: [f64; 3] =
            std::array::from_fn(|a| coarse.share(a, block[a], self.planes[a][place[a] as usize]));
        (0..8u32).filter_map(move |corner| {
            let offset = corner_offset(corner as usize);
            let weight: f64 = (0..3)
                .map(|a| {
                    if offset[a] == 1 {
                        share[a]
                    } else {
                        1.0 - share[a]
                    }
                })
                .product();
            let at = std::array::from_fn(|a| block[a] + offset[a] as u32);
            (weight != 0.0).then_some((corner, at, weight))
        })
    }

    fn corner_place(&self, slot: u32) -> [u32; 3] {
        let (cell, offset) = (
            self.cells[slot as usize / 8],
            corner_offset(slot as usize % 8),
        );
        std::array::from_fn(|a| cell[a] + offset[a] as u32)
    }
}

/// First cell of every block along an axis of `n` cells, and the end.
fn block_starts(n: usize) -> Vec<usize> {
    let blocks = (n / 2).max(1);
    let mut starts: Vec<usize> = (0..=blocks).map(|b| 2 * b).collect();
    starts[blocks] = n;
    starts
}

/// Union-find with path halving; the root of a set is its smallest member.
pub(crate) struct DisjointSets(Vec<u32>);

impl DisjointSets {
    pub(crate) fn new(n: usize) -> Self {
        Self((0..n as u32).collect())
    }

    pub(crate) fn root(&mut self, mut i: u32) -> u32 {
        while self.0[i as usize] != i {
            let above = self.0[i as usize];
            self.0[i as usize] = self.0[above as usize];
            i = above;
        }
        i
    }

    pub(crate) fn join(&mut self, a: u32, b: u32) {
        let (a, b) = (self.root(a), self.root(b));
        self.0[a.max(b) as usize] = a.min(b);
    }
}

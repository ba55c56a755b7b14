//! Which points of a regular grid lie inside a closed surface: ray parity along the three axes.
//!
//! Every row of grid points along an axis is one ray. A triangle is scan-converted onto the two other axes; where it covers a ray
//! it toggles the parity of all grid points above the crossing. Three rays through each point vote.
//!
//! Rays through vertices and edges need no special case. A grid point is taken to lie an infinitesimal step up along every axis (all
//! comparisons are half-open the same way), and what a ray does at an edge depends on that edge alone, so the two triangles beside
//! it always agree: every ray meets a closed surface an even number of times, whatever the rounding.

use nalgebra::Vector3;
use rayon::prelude::*;

/// A grid of points `first + spacing * (i, j, k)`.
#[derive(Debug, Clone, Copy)]
pub(crate) struct PointGrid {
    pub first: Vector3<f64>,
    pub spacing: f64,
    pub counts: [usize; 3],
}

/// Bit `axis` of a vote is set when the ray along that axis finds the point inside.
type Vote = u8;

/// The votes of all points of a grid, x slowest and z fastest.
pub(crate) struct InsideVotes(Vec<Vote>);

impl InsideVotes {
    /// Casts the rays. The surface must be closed and finite, and its triangles' indices in range.
    pub fn new(grid: &PointGrid, vertices: &[Vector3<f64>], triangles: &[[u32; 3]]) -> Self {
        let strides = [grid.counts[1] * grid.counts[2], grid.counts[2], 1];
        let crossings = scan(grid, vertices, triangles, |position, axis| Crossing {
            point: (0..3).map(|a| position[a] * strides[a]).sum::<usize>() as u32,
            axis_bit: 1 << axis,
        });

        let mut votes = vec![0; grid.counts.iter().product()];
        for crossing in crossings.iter().flatten() {
            votes[crossing.point as usize] ^= crossing.axis_bit;
        }
        accumulate_parity(&mut votes, grid.counts);
        Self(votes)
    }

    /// Whether most rays found the point inside.
    pub fn is_inside(&self, point: usize) -> bool {
        self.0[point].count_ones() >= 2
    }

    /// How many points had one ray in disagreement with the other two.
    pub fn minority_count(&self) -> usize {
        let split = |vote: &&Vote| matches!(vote.count_ones(), 1 | 2);
        self.0.iter().filter(split).count()
    }
}

/// The first grid point beyond a crossing of a ray with a triangle.
struct Crossing {
    point: u32,
    axis_bit: Vote,
}

/// All crossings of a surface with the rays of a grid, in chunks of triangles: what `entry(position, axis)` makes of the first grid
/// point beyond each crossing. Crossings beyond the last point of their ray are left out.
pub(crate) fn scan<T: Send>(
    grid: &PointGrid,
    vertices: &[Vector3<f64>],
    triangles: &[[u32; 3]],
    entry: impl Fn([usize; 3], usize) -> T + Sync,
) -> Vec<Vec<T>> {
    let local: Vec<_> = vertices
        .iter()
        .map(|vertex| (vertex - grid.first) / grid.spacing)
        .collect();
    let of_chunk = |chunk: &[[u32; 3]]| {
        let mut crossings = Vec::new();
        for triangle in chunk {
            let corners = triangle.map(|vertex| local[vertex as usize]);
            for axis in 0..3 {
                scan_triangle(&corners, axis, grid.counts, |position| {
                    crossings.push(entry(position, axis));
                });
            }
        }
        crossings
    };
    triangles.par_chunks(512).map(of_chunk).collect()
}

/// Tells of the crossings of a triangle (in grid coordinates) with the rays along `axis`.
fn scan_triangle(
    corners: &[Vector3<f64>; 3],
    axis: usize,
    counts: [usize; 3],
    mut found: impl FnMut([usize; 3]),
) {
    let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
    let rows = corners.map(|corner| corner[v]);
    let low = rows.iter().copied().fold(f64::INFINITY, f64::min);
    let high = rows.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    for row in grid_range(low, high, counts[v]) {
        let [start, end] = span(corners, row as f64, [u, v, axis]);
        for column in grid_range(start.u, end.u, counts[u]) {
            let t = (column as f64 - start.u) / (end.u - start.u);
            let depth = start.w + t * (end.w - start.w);
            let above = first_at_or_above(depth, counts[axis]);
            if above < counts[axis] {
                let mut position = [above; 3];
                position[u] = column;
                position[v] = row;
                found(position);
            }
        }
    }
}

/// Where an edge meets a row: position along the row, and along the ray.
#[derive(Clone, Copy)]
struct EdgeCrossing {
    u: f64,
    w: f64,
}

/// The stretch of row `v = row` that a triangle covers. Exactly two edges cross any row in the half-open range of its `v`.
fn span(corners: &[Vector3<f64>; 3], row: f64, axes: [usize; 3]) -> [EdgeCrossing; 2] {
    let [a, b, c] = corners;
    let v = axes[1];
    let side = [a, b, c].map(|corner| corner[v] > row);
    let (alone, others) = if side[0] == side[1] {
        (c, [a, b])
    } else if side[0] == side[2] {
        (b, [a, c])
    } else {
        (a, [b, c])
    };
    let [p, q] = others.map(|other| cross_edge(alone, other, row, axes));
    if p.u <= q.u { [p, q] } else { [q, p] }
}

/// Always from the lower end to the upper, so that both triangles of an edge get the same bits.
fn cross_edge(a: &Vector3<f64>, b: &Vector3<f64>, row: f64, [u, v, w]: [usize; 3]) -> EdgeCrossing {
    let (low, high) = if a[v] < b[v] { (a, b) } else { (b, a) };
    let t = (row - low[v]) / (high[v] - low[v]);
    EdgeCrossing {
        u: low[u] + t * (high[u] - low[u]),
        w: low[w] + t * (high[w] - low[w]),
    }
}

/// The integers `i` in `0..count` with `low <= i < high`.
fn grid_range(low: f64, high: f64, count: usize) -> std::ops::Range<usize> {
    first_at_or_above(low, count)..first_at_or_above(high, count)
}

/// The least `i` in `0..=count` that is not below `x`, or `count`.
fn first_at_or_above(x: f64, count: usize) -> usize {
    // The cast saturates at 0.
    (x.ceil() as usize).min(count)
}

/// Turns toggles into parities: along each axis, every point takes the exclusive or of all points up to it.
fn accumulate_parity(votes: &mut [Vote], [_, ny, nz]: [usize; 3]) {
    let plane = ny * nz;
    votes.par_chunks_mut(plane).for_each(|votes| {
        for row in votes.chunks_mut(nz) {
            let mut parity = 0;
            for vote in row {
                parity ^= *vote & 4;
                *vote = *vote & !4 | parity;
            }
        }
        carry_forward(votes, nz, 2);
    });
    carry_forward(votes, plane, 1);
}

/// Toggles bit `mask` of each entry by the same bit `stride` entries before.
fn carry_forward(votes: &mut [Vote], stride: usize, mask: Vote) {
    let mut rest = votes;
    while rest.len() > stride {
        let (previous, following) = rest.split_at_mut(stride);
        for (next, previous) in following.iter_mut().zip(&*previous) {
            *next ^= previous & mask;
        }
        rest = following;
    }
}

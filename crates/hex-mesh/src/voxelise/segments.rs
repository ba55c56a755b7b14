//! What a segment from a vertex of the surface crosses.

use nalgebra::Vector3;

use super::cut::flat;

/// The triangles of a surface, sorted into the cells of a grid.
pub(crate) struct Triangles<'a> {
    counts: [usize; 3],
    /// Vertices in grid coordinates: cell `[i, j, k]` is the box from `(i, j, k)` to `(i + 1, j + 1, k + 1)`.
    pub vertices: Vec<Vector3<f64>>,
    triangles: &'a [[u32; 3]],
    /// 1 when triangles face outwards, -1 when they face inwards.
    orientation: f64,
    /// Triangles before those of each cell: `[cells + 1]`.
    offsets: Vec<u32>,
    of_cells: Vec<u32>,
}

/// What a segment crosses, from least to most.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Way {
    /// No triangle.
    Free,
    /// Triangles, all from the inner side to the outer.
    Leaving,
    /// A triangle from the outer side to the inner.
    Entering,
}

impl<'a> Triangles<'a> {
    /// Sorts triangles by the cells that their bounding boxes touch.
    pub fn new(
        counts: [usize; 3],
        vertices: Vec<Vector3<f64>>,
        triangles: &'a [[u32; 3]],
        orientation: f64,
    ) -> Self {
        let mut sorted = Self {
            counts,
            vertices,
            triangles,
            orientation,
            offsets: vec![0; counts.iter().product::<usize>() + 1],
            of_cells: Vec::new(),
        };
        let boxes = triangles.iter().map(|&[a, b, c]| {
            let [a, b, c] = [a, b, c].map(|vertex| sorted.vertices[vertex as usize]);
            sorted.cells_between(&a.inf(&b).inf(&c), &a.sup(&b).sup(&c))
        });
        let boxes: Vec<_> = boxes.collect();
        for cell in boxes.iter().flat_map(|range| cells_of(range, counts)) {
            sorted.offsets[cell + 1] += 1;
        }
        for cell in 1..sorted.offsets.len() {
            sorted.offsets[cell] += sorted.offsets[cell - 1];
        }
        let mut next = sorted.offsets.clone();
        sorted.of_cells = vec![0; sorted.offsets[sorted.offsets.len() - 1] as usize];
        for (triangle, range) in (0..).zip(&boxes) {
            for cell in cells_of(range, counts) {
                sorted.of_cells[next[cell] as usize] = triangle;
                next[cell] += 1;
            }
        }
        sorted
    }

    /// What the segment from a vertex to a point crosses, both in grid coordinates. Triangles at the vertex itself do not count.
    pub fn way(&self, vertex: &Vector3<f64>, point: &Vector3<f64>) -> Way {
        let range = self.cells_between(&vertex.inf(point), &vertex.sup(point));
        let mut way = Way::Free;
        for cell in cells_of(&range, self.counts) {
            let of_cell = self.offsets[cell] as usize..self.offsets[cell + 1] as usize;
            for &triangle in &self.of_cells[of_cell] {
                let corners = self.triangles[triangle as usize];
                let corners = corners.map(|corner| self.vertices[corner as usize]);
                if corners.contains(vertex) {
                    continue;
                }
                let crossed = match crossing(&corners, vertex, point) {
                    Some(along) if along * self.orientation > 0.0 => Way::Leaving,
                    Some(_) => Way::Entering,
                    None => Way::Free,
                };
                way = way.max(crossed);
                if way == Way::Entering {
                    return way;
                }
            }
        }
        way
    }

    /// The first and last cell, along each axis, that a box touches.
    fn cells_between(&self, min: &Vector3<f64>, max: &Vector3<f64>) -> [[usize; 2]; 3] {
        std::array::from_fn(|axis| {
            // Casts saturate at 0. What lies on a face belongs to both cells.
            let last = self.counts[axis] - 1;
            let first = (min[axis] - ROUNDING).floor() as usize;
            let end = (max[axis] + ROUNDING).floor() as usize;
            [first.min(last), end.min(last)]
        })
    }
}

/// Part of a cell by which cells and triangles are taken to be larger: rounding must open no way through an edge.
const ROUNDING: f64 = 1e-9;

fn cells_of(
    &[[x0, x1], y, z]: &[[usize; 2]; 3],
    counts: [usize; 3],
) -> impl Iterator<Item = usize> + use<> {
    (x0..=x1).flat_map(move |x| {
        (y[0]..=y[1]).flat_map(move |y| (z[0]..=z[1]).map(move |z| flat([x, y, z], counts)))
    })
}

/// Whether a segment crosses a triangle; positive along the triangle's normal.
fn crossing([a, b, c]: &[Vector3<f64>; 3], p: &Vector3<f64>, q: &Vector3<f64>) -> Option<f64> {
    let normal = (b - a).cross(&(c - a));
    let [before, behind] = [p, q].map(|point| normal.dot(&(point - a)));
    if before * behind > 0.0 || before == behind {
        return None;
    }
    let at = p + (q - p) * (before / (before - behind));
    let least = -ROUNDING * normal.norm();
    let inside = |from: &Vector3<f64>, to: &Vector3<f64>| {
        (to - from).cross(&(at - from)).dot(&normal) >= least * normal.norm()
    };
    (inside(a, b) && inside(b, c) && inside(c, a)).then_some(behind - before)
}

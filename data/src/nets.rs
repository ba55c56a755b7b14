//! Surface nets: one vertex in every grid cell that the surface crosses, one quad for every grid edge that it crosses.
//!
//! Gibson, "Constrained elastic surface nets", MICCAI 1998; vertices start at the mean of the cell's edge crossings.

use nalgebra::Vector3;

/// A regular grid of cubic cells.
pub(crate) struct Grid {
    /// The corner with the least coordinates.
    pub origin: Vector3<f64>,
    /// Edge length of a cell.
    pub step: f64,
    /// Number of corners along each axis.
    pub corners: [usize; 3],
}

impl Grid {
    /// A grid with the given step that covers a box with at least one cell to spare on all sides.
    pub fn covering(low: Vector3<f64>, high: Vector3<f64>, step: f64) -> Self {
        let corners =
            std::array::from_fn(|axis| ((high[axis] - low[axis]) / step).ceil() as usize + 3);
        let origin = Vector3::from_fn(|axis, _| {
            0.5 * (low[axis] + high[axis]) - 0.5 * step * (corners[axis] - 1) as f64
        });
        Self {
            origin,
            step,
            corners,
        }
    }

    fn strides(&self) -> [usize; 3] {
        [1, self.corners[0], self.corners[0] * self.corners[1]]
    }

    fn corner(&self, index: [usize; 3]) -> Vector3<f64> {
        self.origin + Vector3::from_fn(|axis, _| self.step * index[axis] as f64)
    }

    /// All corners but those on the last layers, in storage order: the lowest corners of the cells.
    fn cells(&self) -> impl Iterator<Item = [usize; 3]> {
        let [nx, ny, nz] = self.corners;
        (0..nz - 1)
            .flat_map(move |k| (0..ny - 1).flat_map(move |j| (0..nx - 1).map(move |i| [i, j, k])))
    }

    fn values(&self, function: impl Fn(&Vector3<f64>) -> f64) -> Vec<f64> {
        let [nx, ny, nz] = self.corners;
        let mut values = Vec::with_capacity(nx * ny * nz);
        for k in 0..nz {
            for j in 0..ny {
                values.extend((0..nx).map(|i| function(&self.corner([i, j, k]))));
            }
        }
        values
    }
}

/// Vertices and quads of the zero set of `function`, which must be positive on the border of the grid. Quads are turned
/// outwards: counter-clockwise seen from where the function is positive.
pub(crate) fn surface_nets(
    grid: &Grid,
    function: impl Fn(&Vector3<f64>) -> f64,
) -> (Vec<Vector3<f64>>, Vec<[u32; 4]>) {
    let values = grid.values(function);
    let strides = grid.strides();
    let place = |index: [usize; 3]| {
        (0..3)
            .map(|axis| index[axis] * strides[axis])
            .sum::<usize>()
    };
    let mut vertices = Vec::new();
    let mut vertex_of_cell = vec![u32::MAX; values.len()];
    for cell in grid.cells() {
        if let Some(offset) = mean_crossing(&values, place(cell), strides) {
            vertex_of_cell[place(cell)] = vertices.len() as u32;
            vertices.push(grid.corner(cell) + offset * grid.step);
        }
    }
    let mut quads = Vec::new();
    for cell in grid.cells() {
        let here = place(cell);
        for axis in 0..3 {
            let inside = values[here] < 0.0;
            if inside == (values[here + strides[axis]] < 0.0) {
                continue;
            }
            let [u, v] = [strides[(axis + 1) % 3], strides[(axis + 2) % 3]];
            let around = [here - u - v, here - v, here, here - u];
            let mut quad = around.map(|cell| vertex_of_cell[cell]);
            if !inside {
                quad.reverse();
            }
            quads.push(quad);
        }
    }
    (vertices, quads)
}

/// The mean of the crossings on a cell's twelve edges, in units of the cell from its lowest corner.
fn mean_crossing(values: &[f64], cell: usize, strides: [usize; 3]) -> Option<Vector3<f64>> {
    let mut sum = Vector3::zeros();
    let mut count = 0;
    for axis in 0..3 {
        let [u, v] = [(axis + 1) % 3, (axis + 2) % 3];
        for (at_u, at_v) in [(0, 0), (1, 0), (0, 1), (1, 1)] {
            let start = cell + at_u * strides[u] + at_v * strides[v];
            let [from, to] = [values[start], values[start + strides[axis]]];
            if (from < 0.0) != (to < 0.0) {
                sum[axis] += from / (from - to);
                sum[u] += at_u as f64;
                sum[v] += at_v as f64;
                count += 1;
            }
        }
    }
    (count > 0).then(|| sum / f64::from(count))
}

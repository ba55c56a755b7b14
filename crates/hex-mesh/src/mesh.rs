//! The mesh of cubes.

use nalgebra::{SMatrix, Vector3};

use crate::lattice::{NodeOrder, NumberedNodes, number_nodes};
use crate::{
    CellIndex, HexMeshError, MAX_GRID_CELLS, NodeElements, Quadrature, QuadratureRule,
    trilinear_gradients, trilinear_weights,
};

/// A mesh of equal cubes, aligned with the axes, on one integer grid.
///
/// Corner `c = 4 a + 2 b + c'` of an element has offsets `(a, b, c')` in `{0, 1}^3` along x, y, z (x slowest, z fastest); the
/// sample points of an element run in the same order. Element and node order is deterministic and stated by each constructor.
///
/// A cell may hold several elements, and several nodes may lie at one place: parts of the body that come close without being
/// connected, as [`voxelise`](crate::voxelise) finds them.
#[derive(Debug, Clone, PartialEq)]
pub struct HexMesh {
    origin: Vector3<f64>,
    element_size: f64,
    nodes: Vec<Vector3<f64>>,
    elements: Vec<[u32; 8]>,
    cells: Vec<[i32; 3]>,
    quadrature: QuadratureRule,
}

impl HexMesh {
    /// A full box of `cells[0] x cells[1] x cells[2]` cubes of edge length `size`, with its lowest corner at 0.
    ///
    /// Elements and nodes run in lexicographic order of their integer position: x slowest, z fastest.
    ///
    /// # Errors
    /// [`HexMeshError::EmptyBox`], [`HexMeshError::ElementSize`], and [`HexMeshError::GridTooLarge`] above [`MAX_GRID_CELLS`].
    pub fn solid_box(
        cells: [usize; 3],
        size: f64,
        quadrature: Quadrature,
    ) -> Result<Self, HexMeshError> {
        let total: f64 = cells.iter().map(|&n| n as f64).product();
        if total == 0.0 {
            return Err(HexMeshError::EmptyBox { cells });
        }
        if total > MAX_GRID_CELLS as f64 {
            return Err(HexMeshError::GridTooLarge {
                cells: total,
                limit: MAX_GRID_CELLS,
            });
        }
        let [nx, ny, nz] = cells.map(|n| n as i32);
        let mut list = Vec::with_capacity(total as usize);
        for x in 0..nx {
            for y in 0..ny {
                list.extend((0..nz).map(|z| [x, y, z]));
            }
        }
        let order = NodeOrder::Lexicographic;
        Self::build(list, Vector3::zeros(), size, quadrature, order)
    }

    /// The cubes of the given integer cells: cell `[i, j, k]` has its lowest corner at `origin + size * (i, j, k)`.
    ///
    /// Elements keep the order of `cells`; nodes are numbered as elements first use them, corner by corner. Cells that touch
    /// share the nodes in which they touch.
    ///
    /// # Errors
    /// [`HexMeshError::ElementSize`], [`HexMeshError::Origin`] when not finite, [`HexMeshError::NoCellsGiven`],
    /// [`HexMeshError::DuplicateCell`], and [`HexMeshError::GridTooLarge`] when the bounding box of the cells holds more than
    /// [`MAX_GRID_CELLS`].
    pub fn from_cells(
        cells: Vec<[i32; 3]>,
        origin: Vector3<f64>,
        size: f64,
        quadrature: Quadrature,
    ) -> Result<Self, HexMeshError> {
        Self::build(cells, origin, size, quadrature, NodeOrder::FirstUse)
    }

    fn build(
        cells: Vec<[i32; 3]>,
        origin: Vector3<f64>,
        size: f64,
        quadrature: Quadrature,
        order: NodeOrder,
    ) -> Result<Self, HexMeshError> {
        check_element_size(size)?;
        if !origin.iter().all(|x| x.is_finite()) {
            return Err(HexMeshError::Origin { origin });
        }
        let NumberedNodes { points, elements } = number_nodes(&cells, order)?;
        Ok(Self::from_numbered(
            cells, &points, elements, origin, size, quadrature,
        ))
    }

    /// Elements whose nodes are numbered already, with the lattice point of each node. Cells may repeat.
    pub(crate) fn from_numbered(
        cells: Vec<[i32; 3]>,
        points: &[[i32; 3]],
        elements: Vec<[u32; 8]>,
        origin: Vector3<f64>,
        size: f64,
        quadrature: Quadrature,
    ) -> Self {
        let position = |point: &[i32; 3]| origin + size * Vector3::from(point.map(f64::from));
        Self {
            origin,
            element_size: size,
            nodes: points.iter().map(position).collect(),
            elements,
            cells,
            quadrature: QuadratureRule::new(quadrature),
        }
    }

    /// The same mesh sampled by another quadrature rule.
    #[must_use]
    pub fn with_quadrature(mut self, quadrature: Quadrature) -> Self {
        self.quadrature = QuadratureRule::new(quadrature);
        self
    }

    /// Rest positions of the nodes.
    #[must_use]
    pub fn nodes(&self) -> &[Vector3<f64>] {
        &self.nodes
    }

    /// The eight nodes of each element, in corner order.
    #[must_use]
    pub fn elements(&self) -> &[[u32; 8]] {
        &self.elements
    }

    /// Edge length of the cubes.
    #[must_use]
    pub fn element_size(&self) -> f64 {
        self.element_size
    }

    /// Volume of one element: the cube of its edge length.
    #[must_use]
    pub fn element_volume(&self) -> f64 {
        self.element_size.powi(3)
    }

    /// Volume of all elements together.
    #[must_use]
    pub fn volume(&self) -> f64 {
        self.elements.len() as f64 * self.element_volume()
    }

    /// Integer cell of each element; `[i, j, k]` has its lowest corner at `origin + size * (i, j, k)`.
    #[must_use]
    pub fn cells(&self) -> &[[i32; 3]] {
        &self.cells
    }

    /// Lowest corner of cell `[0, 0, 0]`, whether or not that cell is in the mesh.
    #[must_use]
    pub fn origin(&self) -> Vector3<f64> {
        self.origin
    }

    /// Sample points and weights of every element.
    #[must_use]
    pub fn quadrature(&self) -> &QuadratureRule {
        &self.quadrature
    }

    /// Lowest corner of an element.
    ///
    /// # Panics
    /// When `element` is not an element of the mesh.
    #[must_use]
    pub fn element_corner(&self, element: usize) -> Vector3<f64> {
        self.nodes[self.elements[element][0] as usize]
    }

    /// Rest positions of all sample points, element by element: `[elements * samples]`.
    #[must_use]
    pub fn sample_positions(&self) -> Vec<Vector3<f64>> {
        let offsets = self.quadrature.points.iter();
        let offsets: Vec<_> = offsets.map(|point| self.element_size * point).collect();
        (0..self.elements.len())
            .map(|element| self.element_corner(element))
            .flat_map(|corner| offsets.iter().map(move |offset| corner + offset))
            .collect()
    }

    /// The 9 x 24 matrix `G` of a sample point, the same for every element: `vec(F) = G u_e` with row-wise
    /// `vec(F)[3 i + j] = F_ij`, `u_e[3 n + i]` = axis `i` of corner `n`, and `G[3 i + j, 3 n + i] = dN_n / dx_j`.
    ///
    /// For checks and small problems; a solver uses [`QuadratureRule::gradients`].
    ///
    /// # Panics
    /// When `sample` is not a sample of the quadrature rule.
    #[must_use]
    pub fn gradient_operator(&self, sample: usize) -> SMatrix<f64, 9, 24> {
        let gradients = trilinear_gradients(&self.quadrature.points[sample]);
        let mut operator = SMatrix::zeros();
        for (n, gradient) in gradients.iter().enumerate() {
            for i in 0..3 {
                for j in 0..3 {
                    operator[(3 * i + j, 3 * n + i)] = gradient[j] / self.element_size;
                }
            }
        }
        operator
    }

    /// Interpolation weights of the eight corners at each sample point, the same for every element.
    #[must_use]
    pub fn sample_weights(&self) -> Vec<[f64; 8]> {
        self.quadrature
            .points
            .iter()
            .map(trilinear_weights)
            .collect()
    }

    /// The element corners that meet at each node.
    #[must_use]
    pub fn node_elements(&self) -> NodeElements {
        NodeElements::new(self.nodes.len(), &self.elements)
    }

    /// A look-up from integer cells to elements. Takes 4 bytes per cell of the mesh's bounding box.
    #[must_use]
    pub fn cell_index(&self) -> CellIndex {
        CellIndex::new(&self.cells).expect("checked when the mesh was built")
    }
}

/// Refuses sizes that are no length.
pub(crate) fn check_element_size(size: f64) -> Result<(), HexMeshError> {
    if size.is_finite() && size > 0.0 {
        Ok(())
    } else {
        Err(HexMeshError::ElementSize { size })
    }
}

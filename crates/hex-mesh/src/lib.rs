//! Hexahedral voxel meshes of closed surfaces: nodes, elements, quadrature, embedding and regions.
//!
//! A [`HexMesh`] is made of cubes of one edge length, either a [`HexMesh::solid_box`], a list of cells ([`HexMesh::from_cells`]) or
//! the [`voxelise`]d inside of a closed surface. An [`Embedding`] ties points (a skin, a bone) to the cubes; a [`NodeRegion`]
//! picks nodes.
//!
//! Corner order everywhere: corner `c = 4 a + 2 b + c'` of a cube has offsets `(a, b, c')` in `{0, 1}^3` along x, y, z, so x is
//! slowest and z fastest. Sample points of an element run in the same order.

mod cell_index;
mod embedding;
mod error;
mod incidence;
mod lattice;
mod mesh;
mod nearest;
mod quadrature;
mod region;
mod trilinear;
mod voxelise;

pub use cell_index::CellIndex;
pub use embedding::{EmbeddedPoint, Embedding, embed};
pub use error::HexMeshError;
pub use incidence::{ElementCorner, NodeElements};
pub use mesh::HexMesh;
pub use quadrature::{Quadrature, QuadratureRule};
pub use region::{Axis, NodeRegion};
pub use trilinear::{corner_offset, trilinear_gradients, trilinear_weights};
pub use voxelise::{DroppedPiece, Keep, VoxelOptions, VoxelReport, Voxelised, voxelise};

/// The largest grid, in cells of its bounding box, that the crate will number: 50 million.
pub const MAX_GRID_CELLS: usize = 50_000_000;

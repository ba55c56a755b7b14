#![doc = include_str!("../README.md")]

mod cell_index;
mod cell_tree;
mod embedding;
mod error;
mod grid_box;
mod incidence;
mod lattice;
mod mesh;
mod nearest;
mod quadrature;
mod region;
mod trilinear;
mod voxelise;

pub use cell_index::CellIndex;
pub use embedding::{EmbeddedPoint, Embedding, embed, embed_in};
pub use error::HexMeshError;
pub use incidence::{ElementCorner, NodeElements};
pub use mesh::HexMesh;
pub use quadrature::{Quadrature, QuadratureRule};
pub use region::{Axis, NodeRegion, nodes_near};
pub use trilinear::{corner_offset, trilinear_gradients, trilinear_weights};
pub use voxelise::{
    DroppedPiece, Keep, Splitting, VoxelOptions, VoxelReport, Voxelised, voxelise,
    voxelise_with_bones,
};

/// The largest grid, in cells of its bounding box, that the crate will number: 50 million.
pub const MAX_GRID_CELLS: usize = 50_000_000;

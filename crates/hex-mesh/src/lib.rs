//! Hexahedral voxel meshes of closed surfaces: nodes, elements, quadrature, embedding and regions

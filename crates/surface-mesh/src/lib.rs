//! Polygon surfaces: OBJ and glTF in, OBJ, GLB and PLY out, morph targets, normals with derivatives, and a report on what is wrong with a mesh

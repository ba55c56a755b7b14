//! The one error type of the crate.

use nalgebra::Vector3;

/// Everything that bad input can do to this crate; each message says how to mend it.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum HexMeshError {
    /// The edge length of the cubes is zero, negative, infinite or NaN.
    #[error(
        "element size {size} is not a positive finite length; give the edge length of the cubes in scene units"
    )]
    ElementSize {
        /// The size that was asked for.
        size: f64,
    },
    /// A box of cubes has an axis without cells.
    #[error("a box of {cells:?} cells holds no element; every axis needs at least one cell")]
    EmptyBox {
        /// Cells along x, y and z.
        cells: [usize; 3],
    },
    /// A list of cells is empty.
    #[error("a mesh needs at least one cell, and the list of cells is empty")]
    NoCellsGiven,
    /// The same cell was listed twice.
    #[error(
        "cell {cell:?} (entry {entry} of the list) is already in the mesh; list each cell once"
    )]
    DuplicateCell {
        /// The integer cell.
        cell: [i32; 3],
        /// Index of its second mention in the list.
        entry: usize,
    },
    /// The cells span a grid too large to number.
    #[error(
        "the cells span a grid of {cells:.3e} cells, more than {limit}; cells must lie closer together"
    )]
    GridTooLarge {
        /// Cells of the bounding grid.
        cells: f64,
        /// The largest grid that is accepted.
        limit: usize,
    },
    /// No quadrature rule has this many points.
    #[error("no quadrature rule has {count} points per element; use 1, 8 or 27")]
    QuadratureCount {
        /// The count that was asked for.
        count: usize,
    },
    /// Cells cannot be sampled like this.
    #[error("cells cannot be split by {samples} samples along each axis; use 3, 5 or 7")]
    SplitSamples {
        /// The count that was asked for.
        samples: usize,
    },
    /// A part of a cell cannot be asked to fill this much of it.
    #[error(
        "least fraction {least_fraction} of a split cell is not above 0 and at most 0.5; 0.2 is the default"
    )]
    SplitFraction {
        /// The fraction that was asked for.
        least_fraction: f64,
    },
    /// A bone is no closed finite surface.
    #[error("bone {bone} cannot be told from flesh: {source}")]
    Bone {
        /// Index of the bone in the list.
        bone: usize,
        /// What is wrong with its surface.
        source: Box<HexMeshError>,
    },
    /// The bones take up the whole body.
    #[error(
        "all {cells} cells of the body lie inside bones; give bones that are smaller than the body, or smaller elements"
    )]
    NoFlesh {
        /// Cells with their centre inside the body.
        cells: usize,
    },
    /// A vertex has an infinite or NaN coordinate.
    #[error("vertex {vertex} of the surface is not finite; repair or remove it")]
    VertexNotFinite {
        /// Index of the vertex.
        vertex: usize,
    },
    /// The surface has a hole, so that inside and outside are not defined.
    #[error("the surface is not closed: {count} edges border an odd number of triangles, at vertices {}; fill the holes, or weld vertices that should coincide", list_edges(.edges, *.count))]
    OpenSurface {
        /// How many such edges there are.
        count: usize,
        /// The first of them as pairs of vertex indices, at most eight.
        edges: Vec<[u32; 2]>,
    },
    /// The surface encloses no volume.
    #[error("the surface encloses no volume (bounding box {} to {}); a solid body is needed", show(.min), show(.max))]
    FlatSurface {
        /// Lower corner of the bounding box.
        min: Vector3<f64>,
        /// Upper corner of the bounding box.
        max: Vector3<f64>,
    },
    /// One element is larger than the whole body.
    #[error("element size {element_size} is larger than the body (bounding box {} to {}); try an element size of {suggested_size}", show(.min), show(.max))]
    LargerThanBody {
        /// The size that was asked for.
        element_size: f64,
        /// Lower corner of the body's bounding box.
        min: Vector3<f64>,
        /// Upper corner of the body's bounding box.
        max: Vector3<f64>,
        /// A size of about a third of the body's mean thickness.
        suggested_size: f64,
    },
    /// The elements are too large for the body: no cell centre is inside.
    #[error("no cell of size {element_size} has its centre inside the body (bounding box {} to {}); try an element size of {suggested_size}", show(.min), show(.max))]
    NoCells {
        /// The size that was asked for.
        element_size: f64,
        /// Lower corner of the body's bounding box.
        min: Vector3<f64>,
        /// Upper corner of the body's bounding box.
        max: Vector3<f64>,
        /// A size of about a third of the body's mean thickness.
        suggested_size: f64,
    },
    /// The elements are too small: the grid would not fit in memory.
    #[error(
        "element size {element_size} makes a grid of {cells:.3e} cells, more than {limit}; the smallest size that fits is about {fitting_size}"
    )]
    TooManyCells {
        /// The size that was asked for.
        element_size: f64,
        /// Cells of the bounding grid.
        cells: f64,
        /// The largest grid that is accepted.
        limit: usize,
        /// A size whose grid is within the limit.
        fitting_size: f64,
    },
    /// The grid's origin is not finite, or too far away to count cells from.
    #[error("grid origin {} is not finite, or more than 2^30 cells away from the body; put it near the body", show(.origin))]
    Origin {
        /// The origin that was given.
        origin: Vector3<f64>,
    },
    /// A point to embed has an infinite or NaN coordinate.
    #[error("point {point} to embed is not finite; repair or remove it")]
    PointNotFinite {
        /// Index of the point.
        point: usize,
    },
    /// A region has an infinite or NaN number, a negative radius, or a minimum above its maximum.
    #[error("the region's {field} {value} is invalid: {rule}")]
    RegionInvalid {
        /// The offending field.
        field: &'static str,
        /// Its value.
        value: f64,
        /// What is required of it.
        rule: &'static str,
    },
    /// A region holds no node of the mesh.
    #[error("the region selects no node: the nearest is node {node} at {}, {distance} away; enlarge or move the region, or use smaller elements", show(.position))]
    RegionEmpty {
        /// The node nearest to the region.
        node: usize,
        /// Where that node is.
        position: Vector3<f64>,
        /// Its distance from the region.
        distance: f64,
    },
    /// A `Surface` region was asked for nodes without its surface.
    #[error("a surface region needs its closed surface: call `select_with_surface`")]
    RegionNeedsSurface,
}

fn show(point: &Vector3<f64>) -> String {
    format!("({}, {}, {})", point.x, point.y, point.z)
}

fn list_edges(edges: &[[u32; 2]], count: usize) -> String {
    let named: Vec<String> = edges.iter().map(|[a, b]| format!("{a}-{b}")).collect();
    let more = if count > edges.len() { ", ..." } else { "" };
    format!("{}{more}", named.join(", "))
}

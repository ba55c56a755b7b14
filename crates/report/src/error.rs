//! Everything that can be wrong with the data handed to this crate.

use std::path::PathBuf;
use thiserror::Error;

/// Why a picture or plot could not be made or written.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum ReportError {
    /// A file could not be written; nothing is left at its place but what was there before.
    #[error("cannot write {path}: {source}")]
    Write {
        /// The file asked for.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// A picture could not be encoded as PNG.
    #[error("cannot encode the picture as PNG: {source}")]
    Encode {
        /// What the encoder said.
        source: png::EncodingError,
    },
    /// A picture would have no pixels, or more than the renderer handles.
    #[error("a picture of {width} x {height} pixels: each side must be 1 to {limit}")]
    PictureSize {
        /// Width asked for, in pixels.
        width: usize,
        /// Height asked for, in pixels.
        height: usize,
        /// Largest side allowed.
        limit: usize,
    },
    /// A triangle names a vertex that does not exist.
    #[error("triangle {triangle} names vertex {vertex}, but there are {vertices} vertices")]
    VertexIndex {
        /// Index of the triangle.
        triangle: usize,
        /// The vertex it names.
        vertex: u32,
        /// Number of vertices.
        vertices: usize,
    },
    /// A vertex position is infinite or not a number.
    #[error("vertex {vertex} has the coordinate {value}, which is not finite")]
    NonFiniteVertex {
        /// Index of the vertex.
        vertex: usize,
        /// The offending coordinate.
        value: f64,
    },
    /// There is not one colour for each vertex.
    #[error("{colours} colours for {vertices} vertices: give one for each vertex")]
    ColourCount {
        /// Number of colours.
        colours: usize,
        /// Number of vertices.
        vertices: usize,
    },
    /// There is nothing to frame.
    #[error("a camera cannot frame no points: give the vertices of what it is to show")]
    NothingToFrame,
    /// A camera's direction or up vector is zero, not finite, or both are in line.
    #[error(
        "a camera cannot look along {direction:?} with {up:?} up: both must be finite, not zero and not in line"
    )]
    CameraAxes {
        /// The direction asked for.
        direction: [f64; 3],
        /// The up vector asked for.
        up: [f64; 3],
    },
    /// The field of view is not between 0 and pi.
    #[error("a field of view of {radians} radians: it must lie between 0 and pi, both excluded")]
    FieldOfView {
        /// The angle asked for.
        radians: f64,
    },
    /// The end of a colour scale is not a positive number.
    #[error("a colour scale cannot end at {maximum}: it must be positive and finite")]
    ScaleEnd {
        /// The end asked for.
        maximum: f64,
    },
    /// A comparison sheet has no rows.
    #[error("the sheet has no rows: add at least one shape")]
    EmptySheet,
    /// A row's target (unless it has triangles of its own), simulated surface and errors differ in length.
    #[error(
        "row {row} ({name}): {target} target vertices, {simulated} simulated ones and {errors} errors must be equally many"
    )]
    RowCount {
        /// Index of the row.
        row: usize,
        /// Its name.
        name: String,
        /// Number of target vertices.
        target: usize,
        /// Number of simulated vertices.
        simulated: usize,
        /// Number of errors.
        errors: usize,
    },
    /// An error of a row is negative or not finite.
    #[error(
        "row {row} ({name}), vertex {vertex}: the error {value} must be finite and not negative"
    )]
    RowError {
        /// Index of the row.
        row: usize,
        /// Its name.
        name: String,
        /// Index of the vertex.
        vertex: usize,
        /// The offending error.
        value: f64,
    },
    /// A row's surface cannot be drawn.
    #[error("row {row} ({name}): {source}")]
    Row {
        /// Index of the row.
        row: usize,
        /// Its name.
        name: String,
        /// What is wrong with it.
        source: Box<ReportError>,
    },
    /// A plot has no points.
    #[error("the plot {title:?} has no points: give at least one series with at least one point")]
    EmptyPlot {
        /// Title of the plot.
        title: String,
    },
    /// A plot point is not finite, or not positive on a logarithmic axis.
    #[error(
        "series {series:?}, point {point}: ({x}, {y}) cannot be shown; coordinates must be finite, and positive on a logarithmic axis"
    )]
    PlotPoint {
        /// Name of the series.
        series: String,
        /// Index of the point.
        point: usize,
        /// Its x coordinate.
        x: f64,
        /// Its y coordinate.
        y: f64,
    },
    /// The plot library could not draw the picture.
    #[error("cannot draw the plot {title:?}: {reason}")]
    PlotDrawing {
        /// Title of the plot.
        title: String,
        /// What the plot library said.
        reason: String,
    },
}

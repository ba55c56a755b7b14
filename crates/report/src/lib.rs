//! Headless pictures of surfaces, comparison sheets and plots.

mod camera;
mod colour_map;
mod error;
mod files;
mod image;
mod normals;
mod plot;
mod render;
mod shade;
mod sheet;
mod text;

pub use camera::Camera;
pub use colour_map::{ColourScale, error_colour};
pub use error::ReportError;
pub use image::{Image, Rgb, SIDE_LIMIT};
pub use plot::{LinePlot, Series};
pub use render::{BACKGROUND, CLAY, Colours, Mesh, render};
pub use sheet::{ComparisonSheet, Row};

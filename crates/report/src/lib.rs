//! Headless pictures of surfaces, comparison sheets and plots.
//!
//! [`render`] draws a [`Mesh`] as a [`Camera`] sees it, [`ComparisonSheet`] sets target, simulation and error side by side,
//! [`ContactSheet`] shows many frames of one object on a page, and [`LinePlot`] draws curves. Nothing needs a screen or a graphics card.

/// Compiles the example of the README.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;

mod camera;
mod colour_map;
mod contact;
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
pub use contact::{ContactSheet, Panel};
pub use error::ReportError;
pub use image::{Image, Rgb, SIDE_LIMIT};
pub use plot::{LinePlot, PlotLabel, Series, SeriesStyle};
pub use render::{BACKGROUND, CLAY, Colours, Mesh, render};
pub use sheet::{ComparisonSheet, Row};

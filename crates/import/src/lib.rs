#![doc = include_str!("../README.md")]

mod close;
mod error;
mod ict;
mod jaw;
mod makehuman;
mod part;
mod source;
mod staging;
mod summary;
mod units;

pub use close::{Closed, close_holes};
pub use error::{ImportError, Result};
pub use ict::{ICT_FACEKIT, IctLayout, import_ict_facekit};
pub use jaw::{JawMotions, RigidFit, fit_rigid, jaw_json, jaw_motion};
pub use makehuman::{Axis, Makehuman, Pose, PoseSet, Turn, import_makehuman, parse_target};
pub use part::part;
pub use source::{Origin, Source};
pub use staging::Staging;
pub use summary::{BodySummary, FaceSummary};
pub use units::unit_target;

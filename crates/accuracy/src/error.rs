//! What can go wrong.

use std::path::PathBuf;

/// Errors of a study.
#[derive(Debug, thiserror::Error)]
pub enum AccuracyError {
    /// A scene, a run or a file.
    #[error(transparent)]
    Trainer(#[from] trainer::TrainerError),
    /// The solver refused something.
    #[error(transparent)]
    Solver(#[from] pd_solver::SolverError),
    /// The network refused something.
    #[error(transparent)]
    Network(#[from] actuation_net::Error),
    /// A plot or a picture could not be made.
    #[error(transparent)]
    Report(#[from] report::ReportError),
    /// A mesh could not be made.
    #[error("the {what} cannot be meshed: {source}")]
    Mesh {
        /// What was to be meshed.
        what: &'static str,
        /// Why.
        source: hex_mesh::HexMeshError,
    },
    /// A solve that all others are measured by did not end.
    #[error("{what} did not converge ({status:?}): nothing can be measured by it")]
    Reference {
        /// Which.
        what: String,
        /// How it ended.
        status: pd_solver::Status,
    },
    /// A folder holds another study.
    #[error("{}: {problem}", .path.display())]
    Folder {
        /// The folder or file.
        path: PathBuf,
        /// What is wrong, and the mend.
        problem: String,
    },
    /// The user asked to stop.
    #[error("stopped; the same command goes on from here")]
    Stopped,
    /// Steps of a training failed again and again.
    #[error("training through the simulator fails again and again, last by {reason}")]
    Training {
        /// The last reason.
        reason: String,
    },
    /// The target cannot be met by any setting that was tried.
    #[error(
        "no setting that was tried comes within {target:.3e} of the reference; the nearest is {nearest:.3e} away: ask for less, or add smaller elements with --sizes"
    )]
    Target {
        /// Asked, in scene units.
        target: f64,
        /// The smallest error.
        nearest: f64,
    },
    /// The budget is too small for any setting that was tried.
    #[error(
        "no setting that was tried takes at most {budget:.3e} s for a shape; the fastest takes {fastest:.3e} s: allow more, or add larger elements with --sizes"
    )]
    Budget {
        /// Asked, in seconds.
        budget: f64,
        /// The fastest.
        fastest: f64,
    },
}

/// Result of this crate.
pub type Result<T> = std::result::Result<T, AccuracyError>;

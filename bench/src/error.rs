//! What stops a measurement, each in one line with its mend.

use std::path::PathBuf;

/// Everything that the program refuses or fails at.
#[derive(Debug, thiserror::Error)]
pub enum BenchError {
    /// An option whose value does not fit what it is applied to.
    #[error("{option} {value}: {reason}")]
    Option {
        /// The option as written on the command line.
        option: &'static str,
        /// Its value.
        value: String,
        /// What is wrong, and what would be right.
        reason: String,
    },
    /// A surface that cannot be read.
    #[error("--surface: {0}")]
    Surface(#[from] surface_mesh::SurfaceError),
    /// The solver refuses the problem.
    #[error("the solver refuses the problem: {0}")]
    Solver(#[from] pd_solver::SolverError),
    /// A file that cannot be written.
    #[error("--json {}: cannot write the file: {cause}", path.display())]
    Write {
        /// The file.
        path: PathBuf,
        /// What the system says.
        cause: std::io::Error,
    },
    /// A measurement in a process of its own that gave no numbers.
    #[error("a measurement in a process of its own failed: {reason}")]
    Child {
        /// What the process said, or why it did not run.
        reason: String,
    },
}

/// What the commands return.
pub type Result<T> = std::result::Result<T, BenchError>;

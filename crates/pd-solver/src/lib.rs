//! Quasi-static equilibria of actuated soft bodies, and their exact adjoint.
//!
//! A [`Solver`] is built once from a [`hex_mesh::HexMesh`] and a list of [`EffectSpec`]. It assembles one scalar matrix for all
//! three axes, factors it, and then finds, for any [`Parameters`] (actuation, prescribed positions, spring targets), the
//! positions that minimise the energy; [`Solver::adjoint`] gives the gradient of any loss by those parameters.
//!
//! ```
//! use hex_mesh::{HexMesh, Quadrature};
//! use pd_solver::{EffectSpec, NodeSet, SolveOptions, Solver, Stop};
//!
//! let mesh = HexMesh::solid_box([4, 2, 2], 0.1, Quadrature::Eight)?;
//! let held = (0..9).collect(); // the nodes with x = 0
//! let mut solver = Solver::new(&mesh, &[
//!     EffectSpec::Elasticity { stiffness: 1.0 },
//!     EffectSpec::Prescribed { nodes: NodeSet::Indices(held) },
//! ])?;
//! let mut parameters = solver.rest_parameters();
//! parameters.actuation.fill([0.2, 0.0, 0.0, -0.1, 0.0, -0.1]); // 20 % longer along x
//! let solution = solver.solve(&parameters, None, &SolveOptions::new(Stop::Accuracy(1e-5)))?;
//! let tip = solution.positions.last().unwrap();
//! assert!((tip.x - 0.48).abs() < 0.01);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod activation;
mod adjoint;
mod approach;
mod assembly;
#[doc(hidden)]
pub mod bench_support;
mod constant;
mod effects;
mod element_finder;
mod error;
mod floating;
mod forest;
mod krylov;
mod measure;
mod methods;
mod motion;
mod multifrontal;
mod multigrid;
mod ordering;
mod panel;
mod parameters;
mod preconditioners;
mod problem;
mod saddle;
mod solution;
mod solver;
mod spec;
mod surface;
mod symbolic;
mod vector;

pub use constant::FactorSeconds;
pub use effects::{ContactReport, deformation_gradients};
pub use error::SolverError;
pub use motion::{Momenta, Motion, StepGradient, TimeStep};
pub use parameters::Parameters;
pub use solution::{
    Adjoint, AdjointOptions, AdjointStats, AdjointStatus, Estimate, Method, Solution, SolveOptions,
    SolveStats, Status, Stop, Work,
};
pub use solver::Solver;
pub use spec::{EffectSpec, ElementSet, NodeSet, Obstacle, SpringPoints, TimeScheme};
pub use surface::EmbeddedSurface;
pub use vector::NodalVector;

#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct ReadmeExample;

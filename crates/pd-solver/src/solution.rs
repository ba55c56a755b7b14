//! What a solve and its adjoint return.

use crate::parameters::Parameters;
use crate::vector::NodalVector;
use serde::Serialize;

/// How a forward solve ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Status {
    /// The stopping rule is met.
    Converged,
    /// The limit of iterations came first. The positions are the best found; the energy is the lowest.
    IterationLimit,
    /// No step lowers the energy any more, and the stopping rule asks for more than floating point can tell.
    Stalled,
    /// The energy or its gradient is not finite at the start, or the energy falls without end, as under a pressure that no wall can bear: the
    /// positions are finite, and out of all proportion.
    NotFinite,
}

/// The method that an equilibrium is searched with.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, serde::Deserialize, Default)]
#[serde(rename_all = "kebab-case")]
pub enum Method {
    /// [`Method::Multigrid`] where the body is large enough and has a hierarchy of coarser ones, [`Method::Lbfgs`] otherwise.
    #[default]
    Automatic,
    /// Local/global iteration: monotone without a line search, slow at the end. The reference.
    LocalGlobal,
    /// Anderson acceleration of local/global: monotone without a line search, too, and much faster at the end.
    Anderson,
    /// L-BFGS whose initial Hessian is the factored constant matrix; Newton takes over where it stalls.
    Lbfgs,
    /// L-BFGS whose initial Hessian is a multigrid cycle on the projected Hessian, started from coarser bodies; Newton takes
    /// over where it stalls.
    Multigrid,
    /// Newton with conjugate gradients on the true Hessian and a line search.
    Newton,
}

/// Where the estimated error of a solve comes from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Default)]
#[serde(rename_all = "snake_case")]
pub enum Estimate {
    /// There is none: no step was needed, or too few were made.
    #[default]
    None,
    /// The length of the last quasi-Newton direction, which costs nothing.
    Direction,
    /// A Newton step on the true Hessian, taken where the direction cannot be trusted: inverted samples, directions that grow,
    /// negative curvature, or the constant matrix as preconditioner.
    NewtonStep,
    /// A Newton step at the result, not taken: see [`SolveOptions::measure_error`].
    Measured,
    /// Extrapolation of linear convergence: what all further steps would add up to.
    Extrapolation,
}

/// When a solve may stop.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Stop {
    /// When the estimated distance of any node from its final place is at most this length, in scene units.
    Accuracy(f64),
    /// When `|g| <= T |g at rest|` over the free nodes, with the prescribed nodes in place.
    RelativeGradient(f64),
}

/// How to solve.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SolveOptions {
    /// Stopping rule.
    pub stop: Stop,
    /// Method.
    pub method: Method,
    /// Limit of iterations over all methods that are tried.
    pub max_iterations: usize,
    /// With a start: use the preconditioner of the solver's last call, and what was learnt with it, as they are where that was built
    /// nearby. From the end of the last solve, and for another actuation alone, also the gradient that was left there. Saves building and
    /// steps; in exchange the result depends, within its accuracy, on the calls before.
    pub reuse: bool,
    /// Measure the error at the end by a Newton step that is not taken, and go on where it is larger than the accuracy asked. What a solve
    /// tells without is a bound by what its last step did, mostly several times too large; this is about the error itself, for a few
    /// products with the Hessian.
    pub measure_error: bool,
    /// Look at the end for a direction of negative curvature, and go on along it where there is one: the end is then a minimum, for the price
    /// of about one adjoint. Without, that is done only where samples are inverted or the solve took more than ten steps.
    pub leave_saddles: bool,
}

impl SolveOptions {
    /// The default method with a stopping rule.
    pub fn new(stop: Stop) -> Self {
        Self {
            stop,
            method: Method::default(),
            max_iterations: 2000,
            reuse: false,
            measure_error: false,
            leave_saddles: false,
        }
    }

    /// The same with the error measured at the end.
    #[must_use]
    pub fn measuring_error(self) -> Self {
        Self {
            measure_error: true,
            ..self
        }
    }

    /// The same with saddles left.
    #[must_use]
    pub fn leaving_saddles(self) -> Self {
        Self {
            leave_saddles: true,
            ..self
        }
    }

    /// The same with another method.
    #[must_use]
    pub fn with_method(self, method: Method) -> Self {
        Self { method, ..self }
    }
}

/// Counts of the work done, which do not depend on the machine.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize)]
pub struct Work {
    /// Factorisations of the constant matrix since the solver was built: one where a method needs it.
    pub factorisations: u64,
    /// Stored entries of the constant matrix (lower triangle).
    pub matrix_nonzeros: usize,
    /// Stored entries of its factor.
    pub factor_entries: usize,
    /// Bytes held by the effects.
    pub effect_bytes: usize,
    /// Evaluations of energy and gradient.
    pub evaluations: u64,
    /// Polar decompositions in those evaluations.
    pub local_projections: u64,
    /// Solves with the factored constant matrix, each for three right-hand sides.
    pub constant_solves: u64,
    /// Times the multigrid operators were built, on any level.
    pub multigrid_builds: u64,
    /// Multigrid cycles, on any level.
    pub multigrid_cycles: u64,
    /// Linearisations, each with one rotation gradient per sample.
    pub linearisations: u64,
    /// Products with the Hessian.
    pub hessian_products: u64,
    /// Searches of contact for what is near.
    pub contact_queries: u64,
    /// Smallest s_i + s_j over all samples at the last linearisation; zero means a rotation that is not unique.
    pub smallest_pair_sum: Option<f64>,
}

/// What a forward solve did.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct SolveStats {
    /// Accepted steps on the body itself.
    pub iterations: usize,
    /// Accepted steps on the coarser bodies that the start came from.
    pub coarse_iterations: usize,
    /// Energy at the result.
    pub energy: f64,
    /// Norm of the gradient over the free nodes at the result.
    pub gradient_norm: f64,
    /// The same at rest, where the stopping rule needed it.
    pub gradient_norm_rest: Option<f64>,
    /// Estimated largest distance of a node from its final place, in scene units; absent where no step was needed.
    pub estimated_error: Option<f64>,
    /// Where that estimate comes from.
    pub estimate: Estimate,
    /// The method that finished.
    pub method: Method,
    /// Whether another method had to take over.
    pub fell_back: bool,
    /// Whether the Hessian at the result has a direction of negative curvature, so that this is no minimum; absent where nobody looked or
    /// the look told nothing.
    pub negative_curvature: Option<bool>,
    /// Work since the solver was built.
    pub work: Work,
    /// Wall-clock seconds.
    pub seconds: f64,
    /// Those of them in evaluations of energy and gradient on the body itself: the local part. The rest is global: directions, multigrid,
    /// coarser bodies.
    pub local_seconds: f64,
}

impl SolveStats {
    /// `|g| / |g at rest|`; absent where the gradient at rest was not needed.
    pub fn relative_gradient(&self) -> Option<f64> {
        let rest = self.gradient_norm_rest?;
        Some(if rest > 0.0 {
            self.gradient_norm / rest
        } else {
            self.gradient_norm
        })
    }
}

/// An equilibrium, or as near as the solve came.
#[derive(Debug, Clone, PartialEq)]
pub struct Solution {
    /// Positions of all nodes.
    pub positions: NodalVector,
    /// How the solve ended.
    pub status: Status,
    /// What it did.
    pub stats: SolveStats,
}

/// How an adjoint solve ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum AdjointStatus {
    /// Conjugate gradients on the true Hessian met the tolerance: the state is a minimum along all directions seen.
    Converged,
    /// Conjugate gradients met the tolerance, but the gradient hangs on something next to singular: a direction along which the body hardly resists
    /// ([`AdjointStats::softest`]), as where it is about to buckle, or a sample whose rotation is not unique
    /// ([`AdjointStats::smallest_pair_sum`]). It may be far from what a small change of a parameter does.
    ConvergedIllConditioned,
    /// Negative curvature was met, so the state is a saddle or the Hessian nearly singular; MINRES met the tolerance.
    /// The gradient is that of the stationary point and may be ill-conditioned.
    ConvergedIndefinite,
    /// The tolerance was not met; the gradient is approximate.
    IterationLimit,
    /// The state given is not an equilibrium to the tolerance that was asked for; no gradient.
    ForwardNotConverged,
    /// The cotangent has an entry that is not finite, or the linear solve broke down; no gradient.
    NotFinite,
}

impl AdjointStatus {
    /// Whether the linear solve met its tolerance.
    pub fn is_converged(self) -> bool {
        matches!(
            self,
            Self::Converged | Self::ConvergedIllConditioned | Self::ConvergedIndefinite
        )
    }

    /// Whether the gradient is that of a minimum, and no small error of the state makes it another.
    pub fn is_reliable(self) -> bool {
        self == Self::Converged
    }
}

/// How to solve the adjoint.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AdjointOptions {
    /// Relative residual of the linear solve.
    pub tolerance: f64,
    /// Limit of iterations of each method.
    pub max_iterations: usize,
    /// Start from the multiplier that the [`Adjoint`] to be overwritten holds from an earlier, similar case.
    pub warm_start: bool,
    /// Go on although the forward solve did not converge; its status is then the caller's to judge.
    pub allow_unconverged: bool,
}

impl Default for AdjointOptions {
    fn default() -> Self {
        Self {
            tolerance: 1e-10,
            max_iterations: 2000,
            warm_start: false,
            allow_unconverged: false,
        }
    }
}

/// What an adjoint solve did.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct AdjointStats {
    /// Iterations of conjugate gradients and, where needed, of MINRES.
    pub iterations: usize,
    /// Whether a direction of negative curvature was met.
    pub negative_curvature: bool,
    /// `|H z - b| / |b|` at the end.
    pub relative_residual: f64,
    /// Smallest Ritz value of the Hessian against the preconditioner: how little the softest direction that was met resists. About 1 where the
    /// preconditioner is good; absent where no step was made.
    pub softest: Option<f64>,
    /// Smallest s_i + s_j over all samples at the state.
    pub smallest_pair_sum: Option<f64>,
    /// Wall-clock seconds.
    pub seconds: f64,
}

/// The gradient of a loss by all parameters of a solve.
#[derive(Debug, Clone, PartialEq)]
pub struct Adjoint {
    /// dL/d parameters, in the shape of [`Parameters`]; absent where the status says why.
    pub gradient: Option<Parameters>,
    /// The multiplier z of `H z = cotangent` `[nodes]`, zero at prescribed nodes: a start for the next similar case.
    pub multiplier: NodalVector,
    /// How the solve ended.
    pub status: AdjointStatus,
    /// What it did.
    pub stats: AdjointStats,
}

impl Default for Solution {
    /// An empty one, to be overwritten.
    fn default() -> Self {
        Self {
            positions: Vec::new(),
            status: Status::NotFinite,
            stats: SolveStats {
                iterations: 0,
                coarse_iterations: 0,
                energy: f64::NAN,
                gradient_norm: f64::NAN,
                gradient_norm_rest: None,
                estimated_error: None,
                estimate: Estimate::None,
                method: Method::Automatic,
                fell_back: false,
                negative_curvature: None,
                work: Work::default(),
                seconds: 0.0,
                local_seconds: 0.0,
            },
        }
    }
}

impl Default for Adjoint {
    /// An empty one, to be overwritten.
    fn default() -> Self {
        Self {
            gradient: None,
            multiplier: Vec::new(),
            status: AdjointStatus::NotFinite,
            stats: AdjointStats {
                iterations: 0,
                negative_curvature: false,
                relative_residual: f64::NAN,
                softest: None,
                smallest_pair_sum: None,
                seconds: 0.0,
            },
        }
    }
}

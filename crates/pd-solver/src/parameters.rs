//! What may change from solve to solve.

use crate::error::SolverError;
use nalgebra::Vector3;
use rayon::prelude::*;

/// Everything that may change from solve to solve. [`Solver::rest_parameters`](crate::Solver::rest_parameters) gives one that fits. A gradient has
/// the same shape.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Parameters {
    /// Actuation b per sample, `[elements * samples]`, element by element, entries (11, 12, 13, 22, 23, 33) with A = I + sym(b).
    pub actuation: Vec<[f64; 6]>,
    /// Positions of the prescribed nodes, in the order of [`Solver::prescribed`](crate::Solver::prescribed).
    pub prescribed: Vec<Vector3<f64>>,
    /// Targets of the springs, all spring effects one after another.
    pub spring_targets: Vec<Vector3<f64>>,
    /// Acceleration of each gravity effect.
    pub acceleration: Vec<Vector3<f64>>,
    /// Force of each force effect and pressure of each wind, in their order.
    pub forces: Vec<Vector3<f64>>,
    /// Pressure of each pressure effect.
    pub pressures: Vec<f64>,
    /// Where inertia alone would take each node in this step, `[nodes]`; empty where there is no inertia.
    pub inertia: Vec<Vector3<f64>>,
    /// Positions of all nodes before this step, `[nodes]`; empty where there is no damping.
    pub before: Vec<Vector3<f64>>,
    /// Vertices of the surfaces that the body may touch, all contact effects one after another.
    pub obstacles: Vec<Vector3<f64>>,
}

impl Parameters {
    fn vectors(&self) -> [(&'static str, &Vec<Vector3<f64>>); 7] {
        [
            ("prescribed", &self.prescribed),
            ("spring_targets", &self.spring_targets),
            ("acceleration", &self.acceleration),
            ("forces", &self.forces),
            ("inertia", &self.inertia),
            ("before", &self.before),
            ("obstacles", &self.obstacles),
        ]
    }

    fn vectors_mut(&mut self) -> [&mut Vec<Vector3<f64>>; 7] {
        [
            &mut self.prescribed,
            &mut self.spring_targets,
            &mut self.acceleration,
            &mut self.forces,
            &mut self.inertia,
            &mut self.before,
            &mut self.obstacles,
        ]
    }

    /// Makes this what a gradient in the shape of `like` starts from: all zeros, but for the actuation, which elasticity writes over. Its memory
    /// is used again.
    pub(crate) fn begin_gradient(&mut self, like: &Parameters) {
        self.actuation.resize(like.actuation.len(), [0.0; 6]);
        for (own, (_, like)) in self.vectors_mut().into_iter().zip(like.vectors()) {
            own.clear();
            own.resize(like.len(), Vector3::zeros());
        }
        self.pressures.clear();
        self.pressures.resize(like.pressures.len(), 0.0);
    }

    /// `self + t direction`, entry by entry.
    ///
    /// # Panics
    /// When the shapes differ.
    #[must_use]
    pub fn moved(&self, t: f64, direction: &Parameters) -> Self {
        let mut out = self.clone();
        assert_eq!(out.actuation.len(), direction.actuation.len(), "one shape");
        for (a, d) in out.actuation.iter_mut().zip(&direction.actuation) {
            a.iter_mut().zip(d).for_each(|(a, d)| *a += t * d);
        }
        for (own, (_, d)) in out.vectors_mut().into_iter().zip(direction.vectors()) {
            assert_eq!(own.len(), d.len(), "one shape");
            own.iter_mut().zip(d).for_each(|(x, d)| *x += d * t);
        }
        let pressures = out.pressures.iter_mut().zip(&direction.pressures);
        pressures.for_each(|(p, d)| *p += t * d);
        out
    }

    /// The part `t` of the way to another one, entry by entry.
    ///
    /// # Panics
    /// When the shapes differ.
    #[must_use]
    pub fn between(&self, to: &Parameters, t: f64) -> Self {
        if t == 1.0 {
            return to.clone();
        }
        self.moved(t, &to.moved(-1.0, self))
    }

    /// Whether all but the actuation is the same.
    pub(crate) fn is_same_apart_from_actuation(&self, other: &Parameters) -> bool {
        self.vectors() == other.vectors() && self.pressures == other.pressures
    }

    /// Takes over all but the actuation.
    pub(crate) fn copy_apart_from_actuation(&mut self, from: &Parameters) {
        for (own, (_, from)) in self.vectors_mut().into_iter().zip(from.vectors()) {
            own.clone_from(from);
        }
        self.pressures.clone_from(&from.pressures);
    }

    /// Sum over all entries of the products with those of another: the slope along a direction, for a gradient.
    ///
    /// # Panics
    /// When the shapes differ.
    #[must_use]
    pub fn dot(&self, other: &Parameters) -> f64 {
        assert_eq!(self.actuation.len(), other.actuation.len(), "one shape");
        let (own, others) = (
            self.actuation.as_flattened(),
            other.actuation.as_flattened(),
        );
        let mut sum: f64 = own.iter().zip(others).map(|(a, b)| a * b).sum();
        for ((_, a), (_, b)) in self.vectors().into_iter().zip(other.vectors()) {
            assert_eq!(a.len(), b.len(), "one shape");
            sum += a.iter().zip(b).map(|(a, b)| a.dot(b)).sum::<f64>();
        }
        let pressures = self.pressures.iter().zip(&other.pressures);
        sum + pressures.map(|(a, b)| a * b).sum::<f64>()
    }

    /// Checks all entries of the actuation for finiteness.
    pub(crate) fn check_actuation(&self) -> Result<(), SolverError> {
        let expected = self.actuation.len();
        check_array("actuation", &self.actuation, expected, |b| {
            b.iter().fold(true, |all, x| all & x.is_finite())
        })
    }

    /// Checks lengths against `like` and all entries for finiteness, but for those of the actuation: it is much to read, and effects tell when
    /// they take it over.
    pub(crate) fn check(&self, like: &Parameters) -> Result<(), SolverError> {
        check_array("actuation", &self.actuation, like.actuation.len(), |_| true)?;
        let finite = |v: &Vector3<f64>| v.iter().all(|x| x.is_finite());
        for ((what, own), (_, like)) in self.vectors().into_iter().zip(like.vectors()) {
            check_array(what, own, like.len(), finite)?;
        }
        let pressures = like.pressures.len();
        check_array("pressures", &self.pressures, pressures, |p| p.is_finite())
    }
}

/// Refuses an array of the wrong length or with an entry that is not finite.
pub(crate) fn check_array<T: Sync>(
    what: &'static str,
    values: &[T],
    expected: usize,
    finite: impl Fn(&T) -> bool + Sync + Send,
) -> Result<(), SolverError> {
    if values.len() != expected {
        let found = values.len();
        return Err(SolverError::WrongLength {
            what,
            found,
            expected,
        });
    }
    // Without a way out of the loop over a part, which goes eight values at a time.
    let all_finite = |part: &[T]| part.iter().fold(true, |all, v| all & finite(v));
    if values.par_chunks(4096).all(all_finite) {
        return Ok(());
    }
    match values.iter().position(|v| !finite(v)) {
        Some(index) => Err(SolverError::NotFinite { what, index }),
        None => Ok(()),
    }
}

//! Convex quadratic programs with simple bounds, by a primal active set.

use nalgebra::{Cholesky, DMatrix, DVector, Dyn};

/// Where a weight came to rest.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Activity {
    /// Strictly between its bounds: the error has no slope in this weight.
    Free,
    /// At its lower bound.
    Lower,
    /// At its upper bound.
    Upper,
}

/// min 1/2 w^T H w - g^T w over lower <= w <= upper, with H positive definite.
pub(crate) struct BoundedProgram<'a> {
    pub hessian: &'a DMatrix<f64>,
    pub linear: &'a DVector<f64>,
    pub lower: &'a [f64],
    pub upper: &'a [f64],
    /// Slopes up to this size count as zero, one for each weight.
    pub slope_tolerance: &'a [f64],
}

/// The minimiser and how it was reached.
pub(crate) struct BoundedSolution {
    pub weights: DVector<f64>,
    pub activity: Vec<Activity>,
    pub iterations: usize,
    pub converged: bool,
}

impl BoundedProgram<'_> {
    /// Starts from the free minimiser pushed into the box, then alternates: move to the minimiser over the free weights,
    /// binding every weight met on the way; there, release the bound weight whose slope pulls inwards hardest.
    /// Each release lowers the objective, so no active set returns and the method ends (Stark and Parker 1995).
    pub fn solve(&self) -> BoundedSolution {
        let count = self.linear.len();
        let mut state = State {
            weights: DVector::zeros(count),
            activity: vec![Activity::Free; count],
        };
        state.weights = self.minimise_free(&state);
        self.push_into_box(&mut state);

        let mut released = None;
        let mut settled = vec![false; count];
        // Far above the 2-3 changes for each weight that are seen in practice.
        let limit = 20 * count + 20;
        for iteration in 1..=limit {
            let goal = self.minimise_free(&state);
            if let Some(index) = released
                .take()
                .filter(|&index| self.points_outwards(&state, &goal, index))
            {
                // Rounding alone made this bound look worth releasing: it is not, until something else has moved.
                self.bind_nearest(&mut state, index);
                settled[index] = true;
            } else {
                settled.fill(false);
                if self.step_towards(&mut state, &goal) {
                    continue;
                }
            }
            match self.worst_bound(&state, &settled) {
                Some(index) => {
                    state.activity[index] = Activity::Free;
                    released = Some(index);
                }
                None => return state.finish(iteration, true),
            }
        }
        state.finish(limit, false)
    }

    /// The minimiser over the free weights, the others staying where they are.
    fn minimise_free(&self, state: &State) -> DVector<f64> {
        let free = state.free();
        let mut goal = state.weights.clone();
        if free.is_empty() {
            return goal;
        }
        let bound: Vec<usize> = (0..goal.len())
            .filter(|&index| state.activity[index] != Activity::Free && goal[index] != 0.0)
            .collect();
        let reduced = DMatrix::from_fn(free.len(), free.len(), |row, column| {
            self.hessian[(free[row], free[column])]
        });
        let mut right_side = DVector::from_fn(free.len(), |row, _| {
            let column = self.hessian.column(free[row]);
            let fixed: f64 = bound
                .iter()
                .map(|&index| column[index] * state.weights[index])
                .sum();
            self.linear[free[row]] - fixed
        });
        factor_definite(reduced).solve_mut(&mut right_side);
        for (row, &index) in free.iter().enumerate() {
            goal[index] = right_side[row];
        }
        goal
    }

    /// Clamps the starting point and binds what lies outside.
    fn push_into_box(&self, state: &mut State) {
        for index in 0..state.weights.len() {
            let weight = state.weights[index];
            if weight <= self.lower[index] || weight >= self.upper[index] {
                self.bind_nearest(state, index);
            }
        }
    }

    /// Puts a weight on the bound that is nearer.
    fn bind_nearest(&self, state: &mut State, index: usize) {
        let weight = state.weights[index];
        let to_lower = (weight - self.lower[index]).abs() <= (self.upper[index] - weight).abs();
        let below = weight <= self.lower[index];
        let above = weight >= self.upper[index];
        if below || (to_lower && !above) {
            state.weights[index] = self.lower[index];
            state.activity[index] = Activity::Lower;
        } else {
            state.weights[index] = self.upper[index];
            state.activity[index] = Activity::Upper;
        }
    }

    fn points_outwards(&self, state: &State, goal: &DVector<f64>, index: usize) -> bool {
        let weight = state.weights[index];
        (weight <= self.lower[index] && goal[index] <= weight)
            || (weight >= self.upper[index] && goal[index] >= weight)
    }

    /// Moves as far towards `goal` as the bounds allow; true when a bound was met.
    fn step_towards(&self, state: &mut State, goal: &DVector<f64>) -> bool {
        let mut fraction = 1.0_f64;
        let mut blocked = false;
        for index in state.free() {
            let (from, to) = (state.weights[index], goal[index]);
            let wall = to.clamp(self.lower[index], self.upper[index]);
            if wall != to {
                fraction = fraction.min(((wall - from) / (to - from)).max(0.0));
                blocked = true;
            }
        }
        for index in state.free() {
            let (from, to) = (state.weights[index], goal[index]);
            let (lower, upper) = (self.lower[index], self.upper[index]);
            let reached = if blocked {
                from + fraction * (to - from)
            } else {
                to
            };
            state.weights[index] = reached.clamp(lower, upper);
            let wall = to.clamp(lower, upper);
            if wall != to && (wall - from) / (to - from) <= fraction {
                state.weights[index] = wall;
                state.activity[index] = if to < lower {
                    Activity::Lower
                } else {
                    Activity::Upper
                };
            }
        }
        blocked
    }

    /// The bound weight that gains most by moving inwards, measured in units of its tolerance.
    fn worst_bound(&self, state: &State, settled: &[bool]) -> Option<usize> {
        let slope = self.hessian * &state.weights - self.linear;
        let mut worst = None;
        let mut largest = 1.0;
        for (index, activity) in state.activity.iter().enumerate() {
            let inwards = match activity {
                Activity::Free => continue,
                _ if settled[index] || self.lower[index] == self.upper[index] => continue,
                Activity::Lower => -slope[index],
                Activity::Upper => slope[index],
            };
            let excess = inwards / self.slope_tolerance[index];
            if excess > largest {
                largest = excess;
                worst = Some(index);
            }
        }
        worst
    }
}

/// The Cholesky factor of a matrix that is positive definite up to rounding.
fn factor_definite(matrix: DMatrix<f64>) -> Cholesky<f64, Dyn> {
    match Cholesky::new(matrix.clone()) {
        Some(factor) => factor,
        None => factor_rounded(matrix),
    }
}

/// Rounding in a large singular normal matrix can exceed the ridge it was given: raise that until a factor exists.
#[cold]
fn factor_rounded(matrix: DMatrix<f64>) -> Cholesky<f64, Dyn> {
    let unit = matrix.diagonal().mean();
    let mut ridge = 1e-12;
    loop {
        let mut raised = matrix.clone();
        for index in 0..raised.nrows() {
            raised[(index, index)] += ridge * unit;
        }
        if let Some(factor) = Cholesky::new(raised) {
            return factor;
        }
        ridge *= 10.0;
    }
}

struct State {
    weights: DVector<f64>,
    activity: Vec<Activity>,
}

impl State {
    fn free(&self) -> Vec<usize> {
        (0..self.activity.len())
            .filter(|&index| self.activity[index] == Activity::Free)
            .collect()
    }

    fn finish(self, iterations: usize, converged: bool) -> BoundedSolution {
        BoundedSolution {
            weights: self.weights,
            activity: self.activity,
            iterations,
            converged,
        }
    }
}

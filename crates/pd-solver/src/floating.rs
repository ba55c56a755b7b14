//! Parts of a body that nothing holds. Their shape is determined, their place is not: by convention they keep the centroid of rest, and the
//! orientation that is nearest to rest in the least-squares sense (Kabsch 1976).

use crate::multigrid::DisjointSets;
use hex_mesh::HexMesh;
use nalgebra::{Matrix3, Vector3};
use polar_grad::polar_rotation;

/// Stiffness of the springs by which preconditioners hold the nodes of floating parts, in units of elastic stiffness times an edge: against
/// anything but a motion as a whole, next to nothing.
pub(crate) const PIN: f64 = 1e-5;

/// A connected part that nothing holds.
pub(crate) struct FloatingPart {
    pub(crate) nodes: Vec<u32>,
    /// Of the nodes at rest.
    centroid: Vector3<f64>,
    /// From there to each node at rest.
    arms: Vec<Vector3<f64>>,
    /// The same where the Hessian was linearised, and the inverse of their inertia.
    linearised: Vec<Vector3<f64>>,
    inverse_inertia: Matrix3<f64>,
}

impl FloatingPart {
    /// All parts without any of the held nodes, by their first node.
    pub(crate) fn find<'a>(mesh: &HexMesh, held: impl Iterator<Item = &'a u32>) -> Vec<Self> {
        let count = mesh.nodes().len();
        let mut parts = DisjointSets::new(count);
        for element in mesh.elements() {
            for &node in &element[1..] {
                parts.join(element[0], node);
            }
        }
        let mut is_held = vec![false; count];
        for &node in held {
            is_held[parts.root(node) as usize] = true;
        }
        let mut place = vec![usize::MAX; count];
        let mut found: Vec<Vec<u32>> = Vec::new();
        for node in 0..count as u32 {
            let root = parts.root(node) as usize;
            if is_held[root] {
                continue;
            }
            if place[root] == usize::MAX {
                place[root] = found.len();
                found.push(Vec::new());
            }
            found[place[root]].push(node);
        }
        let of = |nodes| Self::new(nodes, mesh.nodes());
        found.into_iter().map(of).collect()
    }

    fn new(nodes: Vec<u32>, rest: &[Vector3<f64>]) -> Self {
        let centroid = mean(&nodes, rest);
        let arms = nodes.iter().map(|&n| rest[n as usize] - centroid).collect();
        Self {
            linearised: vec![Vector3::zeros(); nodes.len()],
            inverse_inertia: Matrix3::zeros(),
            nodes,
            centroid,
            arms,
        }
    }

    /// Prepares [`Self::add_rigid`] at `u`.
    pub(crate) fn linearise(&mut self, u: &[Vector3<f64>]) {
        let middle = mean(&self.nodes, u);
        let mut inertia = Matrix3::zeros();
        for (arm, &node) in self.linearised.iter_mut().zip(&self.nodes) {
            *arm = u[node as usize] - middle;
            inertia += Matrix3::from_diagonal_element(arm.norm_squared()) - *arm * arm.transpose();
        }
        // All nodes on a line: what turns about it moves nothing.
        self.inverse_inertia = inertia.try_inverse().unwrap_or_default();
    }

    /// Adds `stiffness` times the share of `x` that is a motion of the part as a whole: the Hessian has none, and a linear solve with it would
    /// drift along them by roundoff. Where the right-hand side is consistent, the solution is the same.
    pub(crate) fn add_rigid(&self, stiffness: f64, x: &[Vector3<f64>], out: &mut [Vector3<f64>]) {
        let push = mean(&self.nodes, x);
        let nodes = self.nodes.iter().zip(&self.linearised);
        let spin: Vector3<f64> = nodes.map(|(&n, arm)| arm.cross(&x[n as usize])).sum();
        let turn = self.inverse_inertia * spin;
        for (&node, arm) in self.nodes.iter().zip(&self.linearised) {
            out[node as usize] += (push + turn.cross(arm)) * stiffness;
        }
    }

    /// Moves the part as a rigid body to where the convention wants it. The energy of elasticity does not change.
    pub(crate) fn align(&self, u: &mut [Vector3<f64>]) {
        let middle = mean(&self.nodes, u);
        let turn = polar_rotation(&self.correlation(u, &middle).transpose());
        for &node in &self.nodes {
            let x = &mut u[node as usize];
            *x = self.centroid + turn * (*x - middle);
        }
    }

    /// `sum (x - middle) X^T` over nodes at `x`, X being their arms at rest.
    fn correlation(&self, u: &[Vector3<f64>], middle: &Vector3<f64>) -> Matrix3<f64> {
        let terms = self.nodes.iter().zip(&self.arms);
        terms.fold(Matrix3::zeros(), |sum, (&node, arm)| {
            sum + (u[node as usize] - middle) * arm.transpose()
        })
    }

    /// Turns the gradient `b` of a loss by the positions of an aligned state `u` into that of the same loss as a function of the shape alone:
    /// motions of the part as a whole, which alignment takes away, no longer change it.
    ///
    /// With N the rigid motions at `u`, and C the constraints of the convention (the sum of positions, and of `X x x`), alignment takes a
    /// change of shape v to `v - N (C N)^-1 C v`; this is the transposed.
    pub(crate) fn make_consistent(&self, u: &[Vector3<f64>], b: &mut [Vector3<f64>]) {
        let push = mean(&self.nodes, b);
        let middle = mean(&self.nodes, u);
        let mut torque = Vector3::zeros();
        for &node in &self.nodes {
            let b = &mut b[node as usize];
            *b -= push;
            torque += (u[node as usize] - middle).cross(b);
        }
        // sum of X x (w x y) = (sum (X . y) I - y X^T) w
        let correlation = self.correlation(u, &middle);
        let turned = Matrix3::from_diagonal_element(correlation.trace()) - correlation;
        let Some(inverse) = turned.transpose().try_inverse() else {
            return;
        };
        let strength = inverse * torque;
        for (&node, arm) in self.nodes.iter().zip(&self.arms) {
            b[node as usize] -= strength.cross(arm);
        }
    }
}

fn mean(nodes: &[u32], x: &[Vector3<f64>]) -> Vector3<f64> {
    let sum: Vector3<f64> = nodes.iter().map(|&n| x[n as usize]).sum();
    sum / nodes.len() as f64
}

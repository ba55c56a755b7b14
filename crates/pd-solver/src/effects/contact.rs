//! Contact of the surface with itself and with other bodies, by a barrier that nothing passes (Li et al. 2020, "Incremental Potential Contact").
//!
//! Every vertex near a triangle, every two edges near each other, and every vertex near a plane costs
//! `area stiffness dhat phi(d / dhat)`, see [`barrier`]. Areas are those at rest: of a vertex a third of its triangles, of an edge a third of the two
//! beside it; a pair stands for the smaller of its two (twice the triangle's against a vertex; half of that for edges), one of the surface with
//! itself for a third of that. In units of `-stiffness phi'(gap / dhat)`, the pressure is 1 above a plane. Between flat faces of the surface it was
//! measured as 1.0 to 2.0 where dhat is at most 0.4 edges, up to 4 at 0.8 edges, and 6 to 10 where vertex lies on vertex exactly, which all triangles around
//! feel; all that moves are gaps, which are between zero and dhat wherever forces are.
//!
//! Nothing is felt at rest of what the surface has of itself: pairs nearer there than dhat get a smaller one of their own, and triangles that pass
//! through each other at rest are left out of own contact. There is no friction.

mod barrier;
mod broad;
mod ccd;
mod distance;
mod limits;
mod list;
mod report;
mod set_up;
mod topology;
mod tree;

use super::points::Points;
use super::{CoarseView, Effect};
use crate::constant::ConstantMatrix;
use crate::error::SolverError;
use crate::multigrid::Form;
use crate::parameters::Parameters;
use crate::vector::NodalVector;
use barrier::above_plane;
use distance::{Gradient, Hessian};
use list::{PairList, Reach};
use nalgebra::Vector3;
use rayon::prelude::*;
pub use report::ContactReport;
pub(crate) use set_up::ContactSettings;
use set_up::Plane;
use std::mem::take;
use topology::{Pair, Topology};

/// Pairs per task.
const CHUNK: usize = 256;
/// What the second derivative of the barrier is taken for where only its size counts: that at about half the distance.
const TYPICAL: f64 = 6.0;

/// See the module.
pub(crate) struct Contact {
    /// Place in the list of effects.
    index: usize,
    points: Points,
    topology: Topology,
    planes: Vec<Plane>,
    /// First triangle of each obstacle that has some, with its place in the list of obstacles.
    obstacles: Vec<(u32, usize)>,
    /// Triangles of the surface, by own triangles.
    triangles: Vec<u32>,
    own: bool,
    dhat: f64,
    margin: f64,
    /// First entry in [`Parameters::obstacles`].
    first: usize,
    /// Where the vertices of obstacles are.
    obstacle_points: Vec<Vector3<f64>>,
    /// Triangles left out of own contact.
    left_out: Vec<u32>,
    list: PairList,
    active: Vec<Active>,
    on_planes: Vec<OnPlane>,
    /// Memory to work in.
    x: Vec<Vector3<f64>>,
    forces: Vec<Vector3<f64>>,
}

/// A pair that is felt, linearised.
struct Active {
    points: [u32; 4],
    hessian: Hessian,
}

/// A vertex that feels a plane, linearised.
struct OnPlane {
    point: u32,
    plane: u32,
    bend: f64,
}

/// What a pair gives: where, its energy and its gradient.
type Felt = (u32, f64, Gradient);

impl Contact {
    /// Writes the positions of all points, obstacles after the surface's.
    fn gather(&self, u: &[Vector3<f64>], x: &mut Vec<Vector3<f64>>) {
        self.points.gather(u, x);
        x.extend_from_slice(&self.obstacle_points);
    }

    /// Gathers into the memory to work in and makes the list of pairs serve; to be given back.
    fn look(&mut self, u: &[Vector3<f64>]) -> Vec<Vector3<f64>> {
        let mut x = take(&mut self.x);
        self.gather(u, &mut x);
        let reach = self.reach();
        self.list.prepare(&self.topology, &x, reach);
        x
    }

    fn reach(&self) -> Reach {
        Reach {
            own: self.own,
            dhat: self.dhat,
            margin: self.margin,
        }
    }

    /// Zeros for the forces on all points; to be given back.
    fn no_forces(&mut self) -> Vec<Vector3<f64>> {
        let mut forces = take(&mut self.forces);
        forces.clear();
        forces.resize(self.topology.rest.len(), Vector3::zeros());
        forces
    }

    /// Vertices near planes: point, plane and distance.
    fn near_planes(&self, x: &[Vector3<f64>]) -> impl Iterator<Item = (usize, usize, f64)> {
        let own = &x[..self.topology.own_points];
        let planes = self.planes.iter().enumerate();
        planes.flat_map(move |(k, plane)| {
            let distances = own.iter().map(|x| plane.distance(x)).enumerate();
            let near = distances.filter(|(_, d)| *d < self.dhat);
            near.map(move |(p, d)| (p, k, d))
        })
    }

    /// What a form over points is over nodes; points of obstacles are no unknowns.
    fn form(&self, points: &[u32], of_point: impl Fn(usize) -> Vector3<f64>) -> Form {
        let mut form = Form::new();
        for (k, &p) in points.iter().enumerate() {
            let v = of_point(k);
            if v == Vector3::zeros() || !self.topology.is_own(p) {
                continue;
            }
            for &(node, weight) in self.points.terms(p as usize) {
                match form.iter_mut().find(|(n, _)| *n == node) {
                    Some((_, sum)) => *sum += v * weight,
                    None => form.push((node, v * weight)),
                }
            }
        }
        form
    }

    fn product(&self, active: &Active, d: &[Vector3<f64>]) -> Gradient {
        let own = active.points.map(|p| match self.topology.is_own(p) {
            true => d[p as usize],
            false => Vector3::zeros(),
        });
        active.hessian * Gradient::from_fn(|i, _| own[i / 3][i % 3])
    }
}

/// The part of a gradient that belongs to one point.
fn part(gradient: &Gradient, point: usize) -> Vector3<f64> {
    gradient.fixed_rows::<3>(3 * point).into()
}

impl Effect for Contact {
    fn add_constant(&self, _matrix: &mut ConstantMatrix) {}

    fn set_parameters(&mut self, parameters: &Parameters) {
        self.set_obstacles(&parameters.obstacles);
    }

    fn set_obstacles(&mut self, all: &[Vector3<f64>]) {
        let range = self.first..self.first + self.obstacle_points.len();
        self.obstacle_points.copy_from_slice(&all[range]);
    }

    fn energy_gradient(&mut self, u: &[Vector3<f64>], gradient: &mut NodalVector) -> f64 {
        let x = self.look(u);
        let mut forces = self.no_forces();
        let mut energy = 0.0;
        for (point, plane, d) in self.near_planes(&x) {
            let strength = self.topology.strength(point);
            let [e, slope, _] = above_plane(strength, self.dhat, d);
            energy += e;
            forces[point] += self.planes[plane].normal * slope;
        }
        let felt = |(chunk, pairs): (usize, &[Pair])| -> Vec<Felt> {
            let pairs = pairs.iter().zip((chunk * CHUNK) as u32..);
            let of = |(pair, at): (&Pair, u32)| {
                let (energy, gradient) = pair.barrier.energy_gradient(&pair.gather(&x))?;
                Some((at, energy, gradient))
            };
            pairs.filter_map(of).collect()
        };
        let pairs = &self.list.pairs;
        let felt: Vec<Vec<Felt>> = pairs.par_chunks(CHUNK).enumerate().map(felt).collect();
        for (at, e, gradient) in felt.iter().flatten() {
            energy += e;
            for (k, &p) in pairs[*at as usize].points.iter().enumerate() {
                forces[p as usize] += part(gradient, k);
            }
        }
        let own = &forces[..self.topology.own_points];
        self.points.scatter(own, gradient);
        (self.x, self.forces) = (x, forces);
        energy
    }

    fn linearise(&mut self, u: &[Vector3<f64>]) {
        let x = self.look(u);
        let mut on_planes = take(&mut self.on_planes);
        on_planes.clear();
        on_planes.extend(self.near_planes(&x).map(|(point, plane, d)| {
            let [_, _, bend] = above_plane(self.topology.strength(point), self.dhat, d);
            OnPlane {
                point: point as u32,
                plane: plane as u32,
                bend,
            }
        }));
        let of = |pair: &Pair| {
            let hessian = pair.barrier.hessian(&pair.gather(&x))?;
            let points = pair.points;
            Some(Active { points, hessian })
        };
        self.active.clear();
        let pairs = self.list.pairs.par_iter().with_min_len(CHUNK);
        self.active.par_extend(pairs.filter_map(of));
        (self.x, self.on_planes) = (x, on_planes);
    }

    fn hessian_product(&mut self, x: &[Vector3<f64>], out: &mut NodalVector) {
        let mut d = take(&mut self.x);
        self.points.gather(x, &mut d);
        let mut forces = self.no_forces();
        for OnPlane { point, plane, bend } in &self.on_planes {
            let normal = &self.planes[*plane as usize].normal;
            let point = *point as usize;
            forces[point] += normal * (bend * normal.dot(&d[point]));
        }
        let chunks = self.active.par_chunks(CHUNK);
        let products: Vec<Vec<Gradient>> = chunks
            .map(|chunk| chunk.iter().map(|a| self.product(a, &d)).collect())
            .collect();
        for (active, product) in self.active.iter().zip(products.iter().flatten()) {
            for (k, &p) in active.points.iter().enumerate() {
                forces[p as usize] += part(product, k);
            }
        }
        let own = &forces[..self.topology.own_points];
        self.points.scatter(own, out);
        (self.x, self.forces) = (d, forces);
    }

    fn parameter_vjp(&mut self, _u: &[Vector3<f64>], z: &[Vector3<f64>], out: &mut Parameters) {
        let mut d = take(&mut self.x);
        self.points.gather(z, &mut d);
        for active in &self.active {
            let obstacle = |p: &u32| !self.topology.is_own(*p);
            if !active.points.iter().any(obstacle) {
                continue;
            }
            let product = self.product(active, &d);
            for (k, p) in active
                .points
                .iter()
                .enumerate()
                .filter(|(_, p)| obstacle(p))
            {
                let place = self.first + *p as usize - self.topology.own_points;
                out.obstacles[place] -= part(&product, k);
            }
        }
        self.x = d;
    }

    fn coarsen(&self, _view: &CoarseView) -> Option<Box<dyn Effect>> {
        None
    }

    fn is_bounded(&self) -> bool {
        false
    }

    fn limits_steps(&self) -> bool {
        true
    }

    fn step_limit(&mut self, from: &[Vector3<f64>], to: &[Vector3<f64>]) -> f64 {
        let (mut start, mut end) = (Vec::new(), Vec::new());
        self.gather(from, &mut start);
        self.gather(to, &mut end);
        self.free_share(&start, &end)
    }

    fn motion_limit(
        &mut self,
        from: &[Vector3<f64>],
        to: &[Vector3<f64>],
        obstacles: &[Vector3<f64>],
    ) -> f64 {
        let (mut start, mut end) = (Vec::new(), Vec::new());
        self.gather(from, &mut start);
        self.points.gather(to, &mut end);
        let range = self.first..self.first + self.obstacle_points.len();
        end.extend_from_slice(&obstacles[range]);
        self.free_share(&start, &end)
    }

    fn intersection(&mut self, u: &[Vector3<f64>]) -> Option<SolverError> {
        // A solve begins here: its bits do not depend on those before.
        self.list.forget();
        let x = self.look(u);
        let found = self.find_intersection(&x);
        self.x = x;
        found
    }

    fn contact_report(&mut self, u: &[Vector3<f64>]) -> Option<ContactReport> {
        let x = self.look(u);
        let report = self.report(&x);
        self.x = x;
        Some(report)
    }

    fn touches(&mut self, u: &[Vector3<f64>]) -> Vec<Form> {
        let x = self.look(u);
        let on_plane = |(point, plane, d): (usize, usize, f64)| {
            let [_, _, bend] = above_plane(self.topology.strength(point), self.dhat, d);
            let normal = &self.planes[plane].normal;
            self.form(&[point as u32], |_| normal * bend.sqrt())
        };
        let of_pair = |pair: &Pair| {
            let stiffest = pair.barrier.stiffest(&pair.gather(&x))?;
            Some(self.form(&pair.points, |k| part(&stiffest, k)))
        };
        let mut touches: Vec<Form> = self.near_planes(&x).map(on_plane).collect();
        let pairs = self.list.pairs.par_iter().with_min_len(CHUNK);
        touches.par_extend(pairs.filter_map(of_pair));
        self.x = x;
        touches
    }

    fn largest_diagonal(&self) -> f64 {
        let points = 0..self.topology.own_points;
        let strongest = points
            .map(|p| self.topology.strength(p))
            .fold(0.0, f64::max);
        TYPICAL * strongest / self.dhat
    }

    fn queries(&self) -> u64 {
        self.list.searches
    }

    fn bytes(&self) -> usize {
        self.points.bytes()
            + self.topology.bytes()
            + self.list.bytes()
            + size_of_val(&self.active[..])
            + 2 * self.topology.rest.len() * size_of::<Vector3<f64>>()
    }
}

#[cfg(test)]
mod tests;

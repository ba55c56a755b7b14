//! Pressure in a cavity.

use super::points::Points;
use super::{CoarseView, Effect};
use crate::constant::ConstantMatrix;
use crate::error::SolverError;
use crate::parameters::Parameters;
use crate::surface::EmbeddedSurface;
use crate::vector::NodalVector;
use hex_mesh::HexMesh;
use nalgebra::Vector3;
use std::collections::BTreeMap;

/// Energy `-pressure V(u)` with the volume V that walls and caps enclose: `V = -1/6 sum x_a . (x_b x x_c)` over triangles that are
/// counter-clockwise seen from the cavity, out of the flesh.
pub(crate) struct Pressure {
    points: Points,
    /// By points; from `points.len()` on by caps.
    triangles: Vec<[u32; 3]>,
    /// The border of each opening; its middle is a vertex.
    caps: Vec<Vec<u32>>,
    pressure: f64,
    slot: usize,
    /// Positions at the last linearisation.
    linearised: Vec<Vector3<f64>>,
    /// Memory to work in.
    moved: Vec<Vector3<f64>>,
    forces: Vec<Vector3<f64>>,
}

impl Pressure {
    /// `walls` are the vertices of the cavity; `slot` is this effect's place in [`Parameters::pressures`].
    pub(crate) fn new(
        mesh: &HexMesh,
        surface: &EmbeddedSurface,
        walls: &[bool],
        capped: bool,
        slot: usize,
        index: usize,
    ) -> Result<Self, SolverError> {
        let is_wall = |t: &&[u32; 3]| t.iter().all(|&v| walls[v as usize]);
        let walls: Vec<[u32; 3]> = surface.triangles.iter().filter(is_wall).copied().collect();
        if walls.is_empty() {
            let what = "triangle of the surface";
            return Err(SolverError::EmptyRegion { index, what });
        }
        let mut number = BTreeMap::new();
        walls.iter().flatten().for_each(|&v| {
            number.insert(v, 0);
        });
        let vertices: Vec<u32> = number.keys().copied().collect();
        number.values_mut().zip(0..).for_each(|(n, i)| *n = i);
        let mut triangles: Vec<[u32; 3]> = walls.iter().map(|t| t.map(|v| number[&v])).collect();
        let open = open_edges(&triangles);
        if let Some(&(edge, _)) = open.first()
            && !capped
        {
            let rest = surface.positions(mesh, mesh.nodes());
            return Err(SolverError::OpenCavity {
                index,
                edges: open.len(),
                near: rest[vertices[edge as usize] as usize].into(),
            });
        }
        let caps = borders(&open);
        for (cap, border) in caps.iter().enumerate() {
            let middle = (vertices.len() + cap) as u32;
            let edges = border.iter().zip(border.iter().cycle().skip(1));
            triangles.extend(edges.map(|(&a, &b)| [b, a, middle]));
        }
        Ok(Self {
            points: Points::of_surface(mesh, surface, &vertices),
            triangles,
            caps,
            pressure: 0.0,
            slot,
            linearised: Vec::new(),
            moved: Vec::new(),
            forces: Vec::new(),
        })
    }

    /// Writes what the vertices, middles of caps among them, make of nodal vectors.
    fn gather(&self, u: &[Vector3<f64>], out: &mut Vec<Vector3<f64>>) {
        self.points.gather(u, out);
        for border in &self.caps {
            let sum: Vector3<f64> = border.iter().map(|&v| out[v as usize]).sum();
            out.push(sum / border.len() as f64);
        }
    }

    /// Adds forces on the vertices, which are used up, to the nodes.
    fn scatter(&self, forces: &mut [Vector3<f64>], out: &mut NodalVector) {
        let (of_points, of_caps) = forces.split_at_mut(self.points.len());
        for (border, force) in self.caps.iter().zip(of_caps) {
            let share = *force / border.len() as f64;
            border.iter().for_each(|&v| of_points[v as usize] += share);
        }
        self.points.scatter(of_points, out);
    }

    /// Writes `factor dV/dx` at the positions `x` of the vertices, and returns V. A closed surface does not care where the origin is: at a
    /// vertex, for the sake of roundoff.
    fn volume(&self, x: &[Vector3<f64>], factor: f64, gradient: &mut Vec<Vector3<f64>>) -> f64 {
        gradient.clear();
        gradient.resize(x.len(), Vector3::zeros());
        let origin = x[0];
        let mut volume = 0.0;
        for triangle in &self.triangles {
            let [i, j, k] = triangle.map(|v| v as usize);
            let [a, b, c] = [i, j, k].map(|v| x[v] - origin);
            let across = b.cross(&c);
            volume -= a.dot(&across) / 6.0;
            let factor = -factor / 6.0;
            gradient[i] += across * factor;
            gradient[j] += c.cross(&a) * factor;
            gradient[k] += a.cross(&b) * factor;
        }
        volume
    }
}

/// Edges of triangles without their opposite.
fn open_edges(triangles: &[[u32; 3]]) -> Vec<(u32, u32)> {
    let edges = |t: &[u32; 3]| [(t[0], t[1]), (t[1], t[2]), (t[2], t[0])];
    let mut all: BTreeMap<(u32, u32), i32> = BTreeMap::new();
    for (a, b) in triangles.iter().flat_map(edges) {
        let (key, sign) = if a < b { ((a, b), 1) } else { ((b, a), -1) };
        *all.entry(key).or_default() += sign;
    }
    let open = all.into_iter().filter(|(_, count)| *count != 0);
    open.flat_map(|((a, b), count)| {
        let edge = if count > 0 { (a, b) } else { (b, a) };
        std::iter::repeat_n(edge, count.unsigned_abs() as usize)
    })
    .collect()
}

/// The loops that directed edges form.
fn borders(edges: &[(u32, u32)]) -> Vec<Vec<u32>> {
    let mut next: BTreeMap<u32, Vec<u32>> = BTreeMap::new();
    for &(a, b) in edges {
        next.entry(a).or_default().push(b);
    }
    let mut loops = Vec::new();
    while let Some((&first, _)) = next.first_key_value() {
        let mut border = Vec::new();
        let mut at = first;
        while let Some(ends) = next.get_mut(&at) {
            border.push(at);
            let to = ends.pop().expect("removed when empty");
            if ends.is_empty() {
                next.remove(&at);
            }
            at = to;
        }
        loops.push(border);
    }
    loops
}

impl Effect for Pressure {
    fn add_constant(&self, _matrix: &mut ConstantMatrix) {}

    fn is_bounded(&self) -> bool {
        false
    }

    fn set_parameters(&mut self, parameters: &Parameters) {
        self.pressure = parameters.pressures[self.slot];
    }

    fn energy_gradient(&mut self, u: &[Vector3<f64>], gradient: &mut NodalVector) -> f64 {
        let (mut x, mut forces) = (
            std::mem::take(&mut self.moved),
            std::mem::take(&mut self.forces),
        );
        self.gather(u, &mut x);
        let volume = self.volume(&x, -self.pressure, &mut forces);
        self.scatter(&mut forces, gradient);
        (self.moved, self.forces) = (x, forces);
        -self.pressure * volume
    }

    fn linearise(&mut self, u: &[Vector3<f64>]) {
        let mut x = std::mem::take(&mut self.linearised);
        self.gather(u, &mut x);
        self.linearised = x;
    }

    fn hessian_product(&mut self, x: &[Vector3<f64>], out: &mut NodalVector) {
        let (mut d, mut forces) = (
            std::mem::take(&mut self.moved),
            std::mem::take(&mut self.forces),
        );
        self.gather(x, &mut d);
        forces.clear();
        forces.resize(d.len(), Vector3::zeros());
        let at = &self.linearised;
        let origin = at[0];
        let factor = self.pressure / 6.0;
        for triangle in &self.triangles {
            let [i, j, k] = triangle.map(|v| v as usize);
            let [a, b, c] = [i, j, k].map(|v| at[v] - origin);
            forces[i] += (d[j].cross(&c) + b.cross(&d[k])) * factor;
            forces[j] += (d[k].cross(&a) + c.cross(&d[i])) * factor;
            forces[k] += (d[i].cross(&b) + a.cross(&d[j])) * factor;
        }
        self.scatter(&mut forces, out);
        (self.moved, self.forces) = (d, forces);
    }

    fn parameter_vjp(&mut self, _u: &[Vector3<f64>], z: &[Vector3<f64>], out: &mut Parameters) {
        let (mut d, mut gradient) = (Vec::new(), Vec::new());
        self.gather(z, &mut d);
        self.volume(&self.linearised, 1.0, &mut gradient);
        let slope: f64 = d.iter().zip(&gradient).map(|(d, g)| d.dot(g)).sum();
        out.pressures[self.slot] += slope;
    }

    fn coarsen(&self, view: &CoarseView) -> Option<Box<dyn Effect>> {
        Some(Box::new(Self {
            points: self.points.coarsen(view),
            triangles: self.triangles.clone(),
            caps: self.caps.clone(),
            linearised: Vec::new(),
            moved: Vec::new(),
            forces: Vec::new(),
            ..*self
        }))
    }

    fn bytes(&self) -> usize {
        let borders = self.caps.iter().map(|b| size_of_val(b.as_slice()));
        self.points.bytes()
            + size_of_val(self.triangles.as_slice())
            + borders.sum::<usize>()
            + 3 * (self.points.len() + self.caps.len()) * size_of::<Vector3<f64>>()
    }
}

//! From what a scene says of a contact to what the effect works with.

use super::Contact;
use super::broad::piercings;
use super::list::PairList;
use super::topology::Topology;
use crate::effects::build::finite;
use crate::effects::points::Points;
use crate::error::SolverError;
use crate::spec::Obstacle;
use crate::surface::EmbeddedSurface;
use hex_mesh::HexMesh;
use nalgebra::Vector3;
use std::collections::BTreeSet;

/// Margin of the list of pairs, in shares of the barrier's distance, and in mean edges of the surface where that is more.
const MARGIN: f64 = 0.25;
const MARGIN_OF_EDGES: f64 = 0.25;

/// What a scene says of a contact.
pub(crate) struct ContactSettings<'a> {
    /// The vertices of the surface that may touch.
    pub(crate) touching: &'a [bool],
    pub(crate) distance: f64,
    pub(crate) stiffness: f64,
    /// Whether the surface touches itself.
    pub(crate) own: bool,
    pub(crate) obstacles: &'a [Obstacle],
    /// This effect's first entry in [`Parameters::obstacles`](crate::Parameters::obstacles).
    pub(crate) first: usize,
}

/// Everything below it is an obstacle.
pub(super) struct Plane {
    /// Of unit length.
    pub(super) normal: Vector3<f64>,
    offset: f64,
    /// Place in the list of obstacles.
    pub(super) obstacle: usize,
}

impl Plane {
    pub(super) fn distance(&self, x: &Vector3<f64>) -> f64 {
        self.normal.dot(x) - self.offset
    }
}

/// Obstacles as one surface, and planes.
#[derive(Default)]
struct Obstacles {
    points: Vec<Vector3<f64>>,
    triangles: Vec<[u32; 3]>,
    /// First triangle of each that has some, and its place in the list.
    firsts: Vec<(u32, usize)>,
    planes: Vec<Plane>,
}

impl Obstacles {
    fn add(&mut self, place: usize, obstacle: &Obstacle, index: usize) -> Result<(), SolverError> {
        match obstacle {
            Obstacle::Plane { normal, offset } => {
                let numbers = normal.iter().chain([offset]);
                numbers
                    .into_iter()
                    .try_for_each(|&x| finite(index, "plane", x))?;
                let normal = Vector3::from(*normal);
                let length = normal.norm();
                if length <= 0.0 {
                    return Err(SolverError::BadValue {
                        index,
                        field: "normal",
                        value: length,
                        expected: "a direction of a length above zero",
                    });
                }
                self.planes.push(Plane {
                    normal: normal / length,
                    offset: offset / length,
                    obstacle: place,
                });
            }
            Obstacle::Surface {
                vertices,
                triangles,
            } => {
                let mut numbers = vertices.iter().flatten();
                numbers.try_for_each(|&x| finite(index, "vertices", x))?;
                let count = vertices.len();
                let mut corners = triangles.iter().flatten();
                if let Some(&found) = corners.find(|v| **v as usize >= count) {
                    return Err(SolverError::OutOfRange {
                        index,
                        what: "vertex of an obstacle",
                        found: found as usize,
                        count,
                    });
                }
                let first = self.points.len() as u32;
                self.firsts.push((self.triangles.len() as u32, place));
                self.points
                    .extend(vertices.iter().map(|x| Vector3::from(*x)));
                let moved = triangles.iter().map(|t| t.map(|v| v + first));
                self.triangles.extend(moved);
            }
            Obstacle::Named { name } => {
                let name = name.clone();
                return Err(SolverError::Unnamed { index, name });
            }
        }
        Ok(())
    }
}

impl Contact {
    /// # Errors
    /// When no triangle may touch, an obstacle is none, or one passes through the surface at rest.
    pub(crate) fn new(
        mesh: &HexMesh,
        surface: &EmbeddedSurface,
        settings: &ContactSettings,
        index: usize,
    ) -> Result<Self, SolverError> {
        let touches = |t: &u32| {
            let corners = surface.triangles[*t as usize];
            corners.iter().all(|&v| settings.touching[v as usize])
        };
        let all = 0..surface.triangles.len() as u32;
        let triangles: Vec<u32> = all.filter(touches).collect();
        if triangles.is_empty() {
            let what = "triangle of the surface";
            return Err(SolverError::EmptyRegion { index, what });
        }
        let corners = |t: &u32| surface.triangles[*t as usize];
        let vertices: BTreeSet<u32> = triangles.iter().flat_map(corners).collect();
        let vertices: Vec<u32> = vertices.into_iter().collect();
        let number = |v: u32| vertices.binary_search(&v).expect("listed") as u32;
        let mut obstacles = Obstacles::default();
        for (place, obstacle) in settings.obstacles.iter().enumerate() {
            obstacles.add(place, obstacle, index)?;
        }
        let points = Points::of_surface(mesh, surface, &vertices);
        let mut rest = Vec::new();
        points.gather(mesh.nodes(), &mut rest);
        let own_points = rest.len();
        rest.extend_from_slice(&obstacles.points);
        let own = triangles.iter().map(|t| corners(t).map(number));
        let others = obstacles.triangles.iter();
        let others = others.map(|t| t.map(|v| v + own_points as u32));
        let topology = Topology::new(
            rest,
            own_points,
            own.chain(others).collect(),
            triangles.len(),
            (settings.distance, settings.stiffness),
        );
        let firsts = obstacles.firsts.into_iter();
        let firsts = firsts.map(|(first, place)| (first + triangles.len() as u32, place));
        let margin = (MARGIN * settings.distance).max(MARGIN_OF_EDGES * topology.mean_edge());
        let mut contact = Self {
            index,
            points,
            topology,
            planes: obstacles.planes,
            obstacles: firsts.collect(),
            triangles,
            own: settings.own,
            dhat: settings.distance,
            margin,
            first: settings.first,
            obstacle_points: obstacles.points,
            left_out: Vec::new(),
            list: PairList::default(),
            active: Vec::new(),
            on_planes: Vec::new(),
            x: Vec::new(),
            forces: Vec::new(),
        };
        contact.leave_out();
        let rest = contact.look(mesh.nodes());
        match contact.find_intersection(&rest) {
            Some(error) => Err(error),
            None => Ok(contact),
        }
    }

    /// Leaves triangles that pass through each other at rest out of own contact.
    fn leave_out(&mut self) {
        if !self.own {
            return;
        }
        let topology = &mut self.topology;
        let mut found: BTreeSet<u32> = BTreeSet::new();
        for (edge, triangle) in piercings(topology, &topology.rest, true) {
            let ends = topology.edges[edge as usize];
            let corners = topology.triangles[triangle as usize];
            if !(topology.is_own(ends[0]) && topology.is_own(corners[0])) {
                continue;
            }
            let own = topology.triangles[..topology.own_triangles].iter();
            let beside = own
                .zip(0..)
                .filter(|(t, _)| ends.iter().all(|e| t.contains(e)));
            found.extend(beside.map(|(_, t)| t));
            found.insert(triangle);
            for point in ends.iter().chain(&corners) {
                topology.left_out[*point as usize] = true;
            }
        }
        self.left_out = found.iter().map(|t| self.triangles[*t as usize]).collect();
    }
}

#[cfg(test)]
mod tests;

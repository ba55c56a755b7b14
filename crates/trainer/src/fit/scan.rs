//! A scan: another surface, of any topology, that the body's surface is to lie on.

use crate::body::Body;
use crate::error::{Result, TrainerError};
use nalgebra::Vector3;
use rayon::prelude::*;
use serde::Serialize;
use std::collections::HashMap;
use std::path::{Path, PathBuf};
use surface_mesh::{ClosestPoints, Surface, read_surface, vertex_normals};

/// A scan's bounding box may be larger or smaller than the body's by this factor: units differ by 10 at least.
const SIZE_FACTOR: f64 = 4.0;
/// Cosine of the angle between normals up to which they agree: 60 degrees.
const AGREEMENT: f64 = 0.5;
/// Share of what counts that has to find the scan, for a fit to mean something.
const LEAST_FOUND: f64 = 0.1;

/// A scanned surface, ready to be asked for nearest points.
pub struct Scan {
    /// Where it comes from.
    pub path: PathBuf,
    /// The scan with vertices at one place made one.
    pub surface: Surface,
    normals: Vec<Vector3<f64>>,
    /// Whether the edge opposite to each corner of each triangle has no other triangle.
    open: Vec<[bool; 3]>,
    /// Whether such an edge ends at each vertex.
    border: Vec<bool>,
    closest: ClosestPoints,
    /// Vertices of the body farther away than this are left out.
    reach: f64,
}

/// How much of the surface is left out, each part as a share of what all vertices count.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize)]
pub struct LeftOut {
    /// Farther from the scan than its reach.
    pub far: f64,
    /// Nearest to an open border of the scan: it does not cover what lies there.
    pub border: f64,
    /// Facing another way than the scan, by more than 60 degrees.
    pub facing: f64,
}

impl LeftOut {
    /// All of it.
    pub fn total(&self) -> f64 {
        self.far + self.border + self.facing
    }
}

/// Where the vertices of the body find the scan.
pub struct Matches {
    /// The place of the scan nearest to each vertex.
    pub places: Vec<Vector3<f64>>,
    /// The scan's unit normals there.
    pub normals: Vec<Vector3<f64>>,
    /// Distances, scene unit.
    pub distances: Vec<f64>,
    /// What each vertex counts: 0 where it is left out.
    pub weights: Vec<f64>,
    /// What is left out, and why.
    pub left_out: LeftOut,
}

enum Verdict {
    Counts,
    Far,
    Border,
    Facing,
}

impl Scan {
    /// Reads a scan in the frame and unit of the body's neutral surface.
    ///
    /// # Errors
    /// When the file cannot be read, or its bounding box says that frame or unit are others.
    pub fn read(path: &Path, body: &Body, unit: &str, reach: f64) -> Result<Self> {
        let surface = welded(&read_surface(path)?.surface)?;
        check_place(path, &surface, body, unit, reach)?;
        let open = open_edges(surface.triangles());
        Ok(Self {
            path: path.to_path_buf(),
            border: border_vertices(&surface, &open),
            normals: vertex_normals(surface.vertices(), surface.triangles()),
            open,
            closest: ClosestPoints::new(&surface),
            surface,
            reach,
        })
    }

    /// Where the vertices `x` of the body's surface find the scan.
    pub fn matches(&self, body: &Body, x: &[Vector3<f64>]) -> Matches {
        let normals = vertex_normals(x, body.surface.triangles());
        let vertices = x.par_iter().zip(&normals);
        let found = vertices.map(|(x, normal)| self.find(x, normal));
        let mut matches = Matches {
            places: Vec::with_capacity(x.len()),
            normals: Vec::with_capacity(x.len()),
            distances: Vec::with_capacity(x.len()),
            weights: Vec::with_capacity(x.len()),
            left_out: LeftOut::default(),
        };
        let found: Vec<_> = found.collect();
        for ((place, normal, distance, verdict), weight) in
            found.into_iter().zip(&body.vertex_weights)
        {
            let left_out = &mut matches.left_out;
            let counts = match verdict {
                Verdict::Counts => *weight,
                Verdict::Far => {
                    left_out.far += weight;
                    0.0
                }
                Verdict::Border => {
                    left_out.border += weight;
                    0.0
                }
                Verdict::Facing => {
                    left_out.facing += weight;
                    0.0
                }
            };
            matches.places.push(place);
            matches.normals.push(normal);
            matches.distances.push(distance);
            matches.weights.push(counts);
        }
        matches
    }

    fn find(
        &self,
        x: &Vector3<f64>,
        normal: &Vector3<f64>,
    ) -> (Vector3<f64>, Vector3<f64>, f64, Verdict) {
        let nearest = self.closest.to(x);
        let corners = self.surface.triangles()[nearest.triangle].map(|v| v as usize);
        let mut own = Vector3::zeros();
        for (corner, weight) in corners.iter().zip(nearest.weights) {
            own += self.normals[*corner] * weight;
        }
        let own = own.try_normalize(0.0).unwrap_or(own);
        let on_border = match nearest.weights.map(|w| w == 0.0) {
            [false, true, true] => self.border[corners[0]],
            [true, false, true] => self.border[corners[1]],
            [true, true, false] => self.border[corners[2]],
            on_edge => (0..3).any(|i| on_edge[i] && self.open[nearest.triangle][i]),
        };
        let verdict = if nearest.distance > self.reach {
            Verdict::Far
        } else if on_border {
            Verdict::Border
        } else if own.dot(normal) < AGREEMENT {
            Verdict::Facing
        } else {
            Verdict::Counts
        };
        (nearest.position, own, nearest.distance, verdict)
    }

    /// How badly a surface lies on the scan, to choose between starts: mean squared distance, where what is left out is as far as the
    /// reach.
    pub fn misfit(&self, matches: &Matches) -> f64 {
        let counted = matches.distances.iter().zip(&matches.weights);
        let counted: f64 = counted.map(|(d, w)| w * d * d).sum();
        counted + self.reach.powi(2) * matches.left_out.total()
    }

    /// Refuses a start from which next to nothing of the surface finds the scan.
    ///
    /// # Errors
    /// When that is so, with the reason that most vertices have.
    pub fn check_found(&self, left_out: &LeftOut) -> Result<()> {
        if left_out.total() <= 1.0 - LEAST_FOUND {
            return Ok(());
        }
        let percent = 100.0 * (1.0 - left_out.total()).max(0.0);
        let mend = if left_out.facing > left_out.far.max(left_out.border) {
            "most of it faces the other way: turn the scan's triangles round"
        } else {
            "move the scan into the frame of the neutral surface, or give a longer --scan-reach"
        };
        Err(self.wrong(format!(
            "only {percent:.1} % of the body's surface finds the scan within {}: {mend}",
            self.reach
        )))
    }

    fn wrong(&self, problem: String) -> TrainerError {
        TrainerError::Scan {
            path: self.path.clone(),
            problem,
        }
    }
}

/// The same surface with vertices at exactly the same place made one: files cut surfaces open where texture or shading jumps, and
/// these cuts are no borders.
fn welded(surface: &Surface) -> Result<Surface> {
    let mut first: HashMap<[u64; 3], u32> = HashMap::new();
    let mut vertices = Vec::new();
    let mut target = Vec::with_capacity(surface.vertex_count());
    for x in surface.vertices() {
        // Adding zero makes one of the two zeros.
        let key = [x.x, x.y, x.z].map(|x| (x + 0.0).to_bits());
        let index = *first.entry(key).or_insert_with(|| {
            vertices.push(*x);
            vertices.len() as u32 - 1
        });
        target.push(index);
    }
    let triangles = surface.triangles().iter();
    let triangles = triangles.map(|t| t.map(|v| target[v as usize]));
    Ok(Surface::from_triangles(vertices, triangles.collect())?)
}

/// For every triangle, whether the edge opposite to each corner belongs to no other triangle.
fn open_edges(triangles: &[[u32; 3]]) -> Vec<[bool; 3]> {
    let edge = |t: &[u32; 3], i: usize| {
        let (a, b) = (t[(i + 1) % 3], t[(i + 2) % 3]);
        [a.min(b), a.max(b)]
    };
    let mut count: HashMap<[u32; 2], u32> = HashMap::new();
    for t in triangles {
        (0..3).for_each(|i| *count.entry(edge(t, i)).or_default() += 1);
    }
    let open = |t: &[u32; 3]| std::array::from_fn(|i| count[&edge(t, i)] == 1);
    triangles.iter().map(open).collect()
}

fn border_vertices(surface: &Surface, open: &[[bool; 3]]) -> Vec<bool> {
    let mut border = vec![false; surface.vertex_count()];
    for (t, open) in surface.triangles().iter().zip(open) {
        for i in (0..3).filter(|&i| open[i]) {
            border[t[(i + 1) % 3] as usize] = true;
            border[t[(i + 2) % 3] as usize] = true;
        }
    }
    border
}

/// Refuses a scan that cannot lie in the body's frame and unit.
fn check_place(path: &Path, scan: &Surface, body: &Body, unit: &str, reach: f64) -> Result<()> {
    let wrong = |problem: String| {
        Err(TrainerError::Scan {
            path: path.to_path_buf(),
            problem,
        })
    };
    let (size, own) = (scan.diagonal(), body.diagonal);
    if !(own / SIZE_FACTOR..=own * SIZE_FACTOR).contains(&size) {
        return wrong(format!(
            "its bounding box has a diagonal of {size:.4}, the body's one of {own:.4} {unit}: a scan is read in the unit and frame of the \
             neutral surface, so scale it to {unit}, or cut away what is not the body"
        ));
    }
    let ((low, high), (from, to)) = (scan.bounding_box(), body.surface.bounding_box());
    let apart = (0..3).any(|axis| low[axis] > to[axis] + reach || high[axis] < from[axis] - reach);
    if apart {
        let ends = |x: &Vector3<f64>| format!("({:.4}, {:.4}, {:.4})", x.x, x.y, x.z);
        return wrong(format!(
            "it lies beside the body: its bounding box goes from {} to {}, the body's from {} to {} {unit}; a scan is read in the \
             frame of the neutral surface, so move and turn it there",
            ends(&low),
            ends(&high),
            ends(&from),
            ends(&to)
        ));
    }
    Ok(())
}

//! What is solved: the reference box, and bodies from surfaces.

use crate::error::{BenchError, Result};
use hex_mesh::{Axis, HexMesh, NodeRegion, Quadrature, VoxelOptions, voxelise};
use nalgebra::Vector3;
use pd_solver::{EffectSpec, NodeSet, Parameters, Solver, SolverError};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use scene_shapes::actuation::{bending, uniform, waves};
use std::path::Path;
use std::time::Instant;
use surface_mesh::read_surface;

/// Edge of an element of the box, in metres.
pub const EDGE: f64 = 0.01;
/// Energy per volume for a unit misfit, the scale at which other codes report the energy of the box.
pub const STIFFNESS: f64 = 344_827.586;
/// Share of the longest axis below which a body is held.
const HELD_SHARE: f64 = 0.1;

/// A problem to measure.
pub struct Case {
    /// Elements along the axes, of a box.
    pub cells: Option<[usize; 3]>,
    /// The body.
    pub mesh: HexMesh,
    /// Elasticity and what is held.
    pub effects: Vec<EffectSpec>,
    /// Actuation b per sample, `[elements * samples]`.
    pub actuation: Vec<[f64; 6]>,
    /// Seconds that making (and reading, voxelising) the mesh took.
    pub mesh_seconds: f64,
}

impl Case {
    /// The reference box: edge 0.01, the nodes with x = 0 held at rest, an actuation that is constant in an element and bends,
    /// twists and swells the box.
    ///
    /// It is [`bending`] at `c = ((i + 1/2) / nx, (j + 1/2) / ny, (k + 1/2) / nz)`.
    ///
    /// # Errors
    /// When the grid is too large.
    pub fn solid_box(cells: [usize; 3], amplitude: f64) -> Result<Self> {
        let clock = Instant::now();
        let mesh = HexMesh::solid_box(cells, EDGE, Quadrature::Eight);
        let mesh = mesh.map_err(|cause| BenchError::Option {
            option: "--cells",
            value: cells.map(|n| n.to_string()).join(","),
            reason: cause.to_string(),
        })?;
        let mesh_seconds = clock.elapsed().as_secs_f64();
        let actuation = box_actuation(&mesh, cells, amplitude);
        let held = NodeRegion::Plane {
            axis: Axis::X,
            value: 0.0,
        };
        Ok(Self {
            cells: Some(cells),
            mesh,
            effects: effects(NodeSet::Region(held)),
            actuation,
            mesh_seconds,
        })
    }

    /// The box of proportions 2 : 1 : 1 whose number of elements is nearest to `elements`, with the reference actuation.
    ///
    /// # Errors
    /// As [`Case::solid_box`].
    pub fn box_with(elements: usize) -> Result<Self> {
        let target = elements as f64;
        let side = (target / 2.0).cbrt().round().max(1.0);
        let length = (target / (side * side)).round().max(1.0);
        let side = side as usize;
        Self::solid_box([length as usize, side, side], 1.0)
    }

    /// The inside of a closed surface, held in the lowest tenth of its longest axis or where `fix` says, with a smooth random
    /// actuation whose entries stay within `amplitude`.
    ///
    /// # Errors
    /// When the surface cannot be read or voxelised, or `fix` selects no node.
    pub fn body(
        surface: &Path,
        element_size: f64,
        fix: Option<&HalfSpace>,
        amplitude: f64,
        seed: u64,
    ) -> Result<Self> {
        let clock = Instant::now();
        let surface = read_surface(surface)?.surface;
        let voxelised = voxelise(&surface, &VoxelOptions::new(element_size));
        let mesh = voxelised.map_err(|cause| BenchError::Option {
            option: "--element-size",
            value: element_size.to_string(),
            reason: cause.to_string(),
        })?;
        let mesh = mesh.mesh;
        let mesh_seconds = clock.elapsed().as_secs_f64();
        let bounds = Bounds::of(mesh.nodes());
        let half_space = fix.cloned().unwrap_or_else(|| bounds.lowest_tenth());
        let held = half_space.select(&mesh)?;
        let actuation = waves(
            &mesh.sample_positions(),
            (bounds.low, bounds.high),
            amplitude,
            seed,
        );
        Ok(Self {
            cells: None,
            mesh,
            effects: effects(NodeSet::Indices(held)),
            actuation,
            mesh_seconds,
        })
    }

    /// A solver for the body, and the parameters to solve for.
    ///
    /// # Errors
    /// As `Solver::new`.
    pub fn solver(&self) -> std::result::Result<(Solver, Parameters), SolverError> {
        let solver = Solver::new(&self.mesh, &self.effects)?;
        let mut parameters = solver.rest_parameters();
        parameters.actuation.copy_from_slice(&self.actuation);
        Ok((solver, parameters))
    }
}

fn effects(nodes: NodeSet) -> Vec<EffectSpec> {
    let stiffness = STIFFNESS;
    vec![
        EffectSpec::Elasticity { stiffness },
        EffectSpec::Prescribed { nodes },
    ]
}

fn box_actuation(mesh: &HexMesh, cells: [usize; 3], amplitude: f64) -> Vec<[f64; 6]> {
    let per_element = mesh.cells().iter().map(|cell| {
        let c = std::array::from_fn(|axis| (f64::from(cell[axis]) + 0.5) / cells[axis] as f64);
        bending(c, amplitude)
    });
    let samples = mesh.quadrature().len();
    per_element
        .flat_map(|b| std::iter::repeat_n(b, samples))
        .collect()
}

/// A random unit vector over all nodes that is zero on the held ones.
pub fn random_cotangent(nodes: usize, held: &[u32], seed: u64) -> Vec<Vector3<f64>> {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let mut all: Vec<_> = (0..nodes)
        .map(|_| Vector3::from_fn(|_, _| 2.0 * uniform(&mut random) - 1.0))
        .collect();
    for &node in held {
        all[node as usize] = Vector3::zeros();
    }
    let norm = all.iter().map(Vector3::norm_squared).sum::<f64>().sqrt();
    if norm > 0.0 {
        all.iter_mut().for_each(|v| *v /= norm);
    }
    all
}

struct Bounds {
    low: Vector3<f64>,
    high: Vector3<f64>,
}

impl Bounds {
    fn of(points: &[Vector3<f64>]) -> Self {
        let first = points[0];
        Self {
            low: points.iter().fold(first, |low, x| low.inf(x)),
            high: points.iter().fold(first, |high, x| high.sup(x)),
        }
    }

    fn lowest_tenth(&self) -> HalfSpace {
        let extent = self.high - self.low;
        let axis = [Axis::X, Axis::Y, Axis::Z][extent.imax()];
        let value = self.low[axis.index()] + HELD_SHARE * extent.max();
        HalfSpace {
            axis,
            below: true,
            value,
        }
    }
}

/// The nodes on one side of a plane across an axis: `x<0.1`, `z>2`.
#[derive(Debug, Clone)]
pub struct HalfSpace {
    axis: Axis,
    below: bool,
    value: f64,
}

impl HalfSpace {
    /// Reads `AXIS<VALUE` or `AXIS>VALUE`.
    pub fn parse(text: &str) -> std::result::Result<Self, String> {
        Self::try_parse(text)
            .ok_or_else(|| "write an axis, < or >, and a number, such as z<0.1".into())
    }

    fn try_parse(text: &str) -> Option<Self> {
        let at = text.find(['<', '>'])?;
        let axis = match text[..at].trim() {
            "x" | "X" => Axis::X,
            "y" | "Y" => Axis::Y,
            "z" | "Z" => Axis::Z,
            _ => return None,
        };
        let value: f64 = text[at + 1..].trim().parse().ok()?;
        value.is_finite().then_some(Self {
            axis,
            below: text[at..].starts_with('<'),
            value,
        })
    }

    fn select(&self, mesh: &HexMesh) -> Result<Vec<u32>> {
        let sign = if self.below { -1.0 } else { 1.0 };
        let mut normal = [0.0; 3];
        normal[self.axis.index()] = sign;
        let region = NodeRegion::HalfSpace {
            normal,
            offset: sign * self.value,
        };
        let refused = |reason| BenchError::Option {
            option: "--fix",
            value: self.to_string(),
            reason,
        };
        let held = region
            .select(mesh)
            .map_err(|cause| refused(cause.to_string()))?;
        if held.len() == mesh.nodes().len() {
            return Err(refused(
                "it holds every node, so nothing can move: hold fewer".into(),
            ));
        }
        Ok(held)
    }
}

impl std::fmt::Display for HalfSpace {
    fn fmt(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
        let axis = ["x", "y", "z"][self.axis.index()];
        let relation = if self.below { "<" } else { ">" };
        write!(f, "{axis}{relation}{}", self.value)
    }
}

//! The element size that an accuracy asks for: how far a grid alone puts the surface off, told from a few grids.
//!
//! On each grid the body is given one smooth actuation, which deforms it about as much as the largest of the scene's shapes. From grid to grid the
//! surface moves less and less; where it will end follows from how fast (Richardson's extrapolation), and so does the size at which it is near enough.

use crate::body::Body;
use crate::dial::with_element_size;
use crate::error::{Result, TrainerError};
use crate::loss::mean_distance;
use crate::progress::{note, stop_requested};
use crate::rig::Rig;
use crate::scene::Scene;
use crate::simulator::Simulator;
use crate::units::Length;
use actuation_net::{JOINT_SIZE, Output};
use nalgebra::Vector3;
use pd_solver::{SolveOptions, Status, Stop};
use scene_shapes::actuation::waves;
use std::path::Path;
use surface_mesh::{MorphTarget, MorphedSurface};

/// Element sizes between two grids.
const RATIO: f64 = std::f64::consts::SQRT_2;
/// The first grid has elements this many times as large as the scene's.
const COARSEST: f64 = 2.0;
/// Grids that tell how fast the surface comes to its end.
const FEWEST: usize = 3;
/// What is told may be this many times as fine as the finest grid tried.
const BEYOND: f64 = 2.0;
/// Elements of the finest grid that is chosen.
const MOST_ELEMENTS: f64 = 500_000.0;
/// Orders of convergence that are believed: surfaces of voxels that corners and bones cut have about 1, smooth fields 2.
const ORDERS: [f64; 2] = [0.8, 2.0];
/// Accuracy of the equilibria, as a share of what is asked of the grid.
const SOLVER: f64 = 0.05;
/// Amplitudes of the actuation.
const AMPLITUDES: [f64; 2] = [0.02, 0.3];
/// The amplitude that tells which one deforms the body enough.
const FIRST_AMPLITUDE: f64 = 0.1;

/// A grid that was tried.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Tried {
    /// Its element size.
    pub element_size: f64,
    /// Its elements.
    pub elements: usize,
    /// Mean distance of the surface from that on the grid before, which is coarser.
    pub moved: Option<f64>,
}

/// The grid that an accuracy asks for. Lengths are in the scene's unit.
#[derive(Debug, Clone, PartialEq)]
pub struct FittedGrid {
    /// The element size, of three digits.
    pub element_size: f64,
    /// Elements, about.
    pub elements: f64,
    /// Order of convergence.
    pub order: f64,
    /// The grids that tell so.
    pub tried: Vec<Tried>,
}

impl FittedGrid {
    /// In words.
    pub fn summary(&self, asked: &Length, unit: &str) -> String {
        let tried = self.tried.iter().map(|t| match t.moved {
            Some(moved) => format!("{:.3} ({moved:.2e} from the one before)", t.element_size),
            None => format!("{:.3}", t.element_size),
        });
        format!(
            "element_size {} {unit}, about {:.0} elements, for {asked} in the mean over the surface: told from {} {unit}, order {:.1}",
            self.element_size,
            self.elements,
            tried.collect::<Vec<_>>().join(", "),
            self.order
        )
    }
}

/// Finds the largest element size of which the grid alone puts the surface no farther off than `accuracy`, which is in the scene's unit, in the
/// mean over the vertices.
///
/// # Errors
/// When the body cannot be built or simulated, when the accuracy asks for more than half a million elements, and when the user asked to stop.
pub fn fit_element_size(
    scene: &Scene,
    inputs: &MorphedSurface,
    rig: &Rig,
    accuracy: f64,
) -> Result<FittedGrid> {
    let mut element_size = COARSEST * scene.mesh.element_size;
    let mut tried: Vec<Tried> = Vec::new();
    let mut before: Option<OnGrid> = None;
    loop {
        let amplitude = before.as_ref().map(|before| before.amplitude);
        let is_coarse = element_size > scene.mesh.element_size * (1.0 + 1e-9);
        let here = match OnGrid::new(scene, inputs, rig, element_size, amplitude, accuracy) {
            Ok(here) => here,
            Err(TrainerError::GridStopped) => return Err(TrainerError::GridStopped),
            // Bones, regions and thin parts may be too small for grids that nobody asked for.
            Err(_) if is_coarse => {
                (tried, before) = (Vec::new(), None);
                element_size /= RATIO;
                continue;
            }
            Err(error) => return Err(error),
        };
        let count = here.body.mesh.elements().len();
        let moved = before
            .map(|before| mean_distance(&before.surface, &here.surface, &here.body.vertex_weights));
        tried.push(Tried {
            element_size,
            elements: count,
            moved,
        });
        before = Some(here);
        if tried.len() >= FEWEST {
            let fitted = extrapolate(&tried, accuracy, ORDERS);
            // Even if it were to come to its end as fast as anything does.
            let hopeful = extrapolate(&tried, accuracy, [ORDERS[1]; 2]);
            let is_near = fitted.element_size * BEYOND >= element_size;
            let is_last = is_near || count as f64 * RATIO.powi(3) > MOST_ELEMENTS;
            if hopeful.elements > MOST_ELEMENTS || (is_last && fitted.elements > MOST_ELEMENTS) {
                return Err(TrainerError::GridTooFine {
                    element_size: fitted.element_size,
                    elements: fitted.elements,
                    unit: scene.unit.clone(),
                });
            }
            if is_near {
                return Ok(fitted);
            }
        }
        element_size /= RATIO;
    }
}

/// A scene and its text with the element size that its accuracy asks for; says what was found.
///
/// # Errors
/// As [`fit_element_size`], and when the scene asks for no accuracy.
pub fn fitted(
    path: &Path,
    (mut scene, text): (Scene, String),
    inputs: &MorphedSurface,
    rig: &Rig,
) -> Result<(Scene, String)> {
    let Some((asked, accuracy)) = scene.accuracy.clone().zip(scene.accuracy_asked()) else {
        return Err(TrainerError::SceneValue {
            path: path.to_path_buf(),
            key: "accuracy",
            value: "absent".into(),
            mend: "give the accuracy that the grid is to be fitted to, here or by --accuracy",
        });
    };
    let found = fit_element_size(&scene, inputs, rig, accuracy)?;
    note(&found.summary(&asked, &scene.unit));
    scene.mesh.element_size = found.element_size;
    let text = with_element_size(&text, &scene);
    Ok((scene, text))
}

/// The size that the last grids tell, with an order between two.
fn extrapolate(tried: &[Tried], accuracy: f64, [low, high]: [f64; 2]) -> FittedGrid {
    let [.., before, last] = tried else {
        unreachable!("at least {FEWEST} grids were tried");
    };
    let moved = [before, last].map(|t| t.moved.unwrap_or(0.0).max(f64::MIN_POSITIVE));
    let order = ((moved[0] / moved[1]).ln() / RATIO.ln()).clamp(low, high);
    // Of the sum of all that is still to come, each part is smaller by one factor.
    let error = moved[1] / (RATIO.powf(order) - 1.0);
    let size = last.element_size * (accuracy / error).powf(1.0 / order);
    let element_size = three_digits(size.min(tried[0].element_size));
    FittedGrid {
        element_size,
        elements: last.elements as f64 * (last.element_size / element_size).powi(3),
        order,
        tried: tried.to_vec(),
    }
}

/// Down to three digits.
fn three_digits(x: f64) -> f64 {
    let digits = 10.0_f64.powf(2.0 - x.log10().floor());
    let floored = (x * digits).floor() / digits;
    // Through text: the number that is written by three digits.
    let short: f64 = format!("{floored:.2e}").parse().expect("a number");
    short.max(f64::MIN_POSITIVE)
}

/// A body on one grid, deformed.
struct OnGrid {
    body: Body,
    amplitude: f64,
    surface: Vec<Vector3<f64>>,
}

impl OnGrid {
    /// Without an amplitude it takes the one that deforms the body as much as the largest shape does.
    fn new(
        scene: &Scene,
        inputs: &MorphedSurface,
        rig: &Rig,
        element_size: f64,
        amplitude: Option<f64>,
        accuracy: f64,
    ) -> Result<Self> {
        let body = Body::of_scene(scene, inputs.surface.clone(), rig, element_size)?;
        let elements = body.mesh.elements().len();
        let unit = &scene.unit;
        note(&format!(
            "fits the grid: {elements} elements of {element_size:.3} {unit}"
        ));
        let amplitude = match amplitude {
            Some(amplitude) => amplitude,
            None => {
                let surface = deformed(&body, scene, FIRST_AMPLITUDE, accuracy)?;
                let moved = mean_distance(&surface, body.surface.vertices(), &body.vertex_weights);
                let share = largest(&body, &inputs.targets) / moved.max(f64::MIN_POSITIVE);
                let [least, most] = AMPLITUDES;
                (FIRST_AMPLITUDE * share).clamp(least, most)
            }
        };
        let surface = deformed(&body, scene, amplitude, accuracy)?;
        Ok(Self {
            body,
            amplitude,
            surface,
        })
    }
}

/// The surface under a smooth actuation.
fn deformed(
    body: &Body,
    scene: &Scene,
    amplitude: f64,
    accuracy: f64,
) -> Result<Vec<Vector3<f64>>> {
    let points = body.mesh.sample_positions();
    let actuation = waves(&points, body.surface.bounding_box(), amplitude, 1);
    let answer = Output {
        actuation: actuation.iter().flatten().map(|&b| b as f32).collect(),
        joint: [0.0; JOINT_SIZE],
    };
    if stop_requested() {
        return Err(TrainerError::GridStopped);
    }
    let options = SolveOptions::new(Stop::Accuracy(SOLVER * accuracy));
    let mut simulator = Simulator::new(body, scene)?;
    let solution = simulator.equilibrium(&answer, None, &options)?.solution;
    if solution.status != Status::Converged {
        note(&format!(
            "its equilibrium is {:?}: what it tells may be wrong",
            solution.status
        ));
    }
    Ok(body.surface_positions(&solution.positions))
}

/// How far the shape moves the surface that moves it most.
fn largest(body: &Body, targets: &[MorphTarget]) -> f64 {
    let moved = |target: &MorphTarget| {
        let lengths = target.deltas.iter().zip(&body.vertex_weights);
        lengths.map(|(delta, w)| delta.norm() * w).sum::<f64>()
    };
    targets.iter().map(moved).fold(0.0, f64::max)
}

#[cfg(test)]
mod tests;

//! The solver by itself, on arrays in files: a body, an actuation, an equilibrium and the gradient of a loss.
//!
//! Orders, the same in every file: nodes as in `rest.npy`; elements as in `elements.npy`, whose eight corners run over
//! {0, 1}^3 with x slowest and z fastest; samples within an element likewise; actuation entries (11, 12, 13, 22, 23, 33) of b in
//! A = I + sym(b).

use crate::body::Body;
use crate::error::{Result, TrainerError};
use crate::files::{create_folder, remove, write_json};
use crate::npy;
use hex_mesh::{Axis, HexMesh, NodeRegion, Quadrature};
use nalgebra::Vector3;
use pd_solver::{
    Adjoint, AdjointOptions, EffectSpec, Method, NodeSet, Parameters, Solution, SolveOptions,
    Solver, SolverError, Status, Stop,
};
use serde_json::json;
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

/// The body to solve for.
#[derive(Debug, Clone)]
pub enum BodySource {
    /// A solid box of cubes with a corner at the origin.
    Cells {
        /// Cubes along x, y and z.
        cells: [usize; 3],
        /// Edge length.
        size: f64,
    },
    /// The inside of a closed surface.
    Surface {
        /// OBJ, glTF or GLB file.
        path: PathBuf,
        /// Edge length of an element.
        element_size: f64,
    },
}

/// What to solve.
#[derive(Debug, Clone)]
pub struct SolveRequest {
    /// The body.
    pub body: BodySource,
    /// Samples per element: 1, 8 or 27.
    pub samples: usize,
    /// Selections of nodes that are held at rest, such as `x=0`, `z>0.9`, `y=max`.
    pub fix: Vec<String>,
    /// float64 array `[elements, samples, 6]`; zero where not given.
    pub actuation: Option<PathBuf>,
    /// Stopping rule; an accuracy of 1e-5 of the body's diagonal where not given.
    pub stop: Option<Stop>,
    /// Method.
    pub method: Method,
    /// Limit of iterations.
    pub max_iterations: usize,
    /// Energy per volume for a unit misfit.
    pub stiffness: f64,
    /// float64 array `[nodes, 3]`: gradient of a loss by the positions.
    pub cotangent: Option<PathBuf>,
    /// Folder of the output.
    pub out: PathBuf,
}

/// How a solve ended, for the exit code.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct SolveOutcome {
    /// Whether the equilibrium, and the adjoint where asked for, reached their tolerance.
    pub converged: bool,
}

/// Solves, writes `rest.npy`, `elements.npy`, `samples.npy`, `sample_weights.npy`, `positions.npy`, `stats.json` and, with a cotangent
/// whose adjoint has a gradient, `actuation_grad.npy`, `prescribed_grad.npy` and `prescribed.npy`; prints a line or two.
///
/// # Errors
/// When an option does not parse, an input file does not fit, or the output cannot be written. Inputs are read and checked
/// before anything is written.
pub fn solve(request: &SolveRequest) -> Result<SolveOutcome> {
    check_stop(request.stop)?;
    let mesh = build_mesh(request)?;
    let elements = mesh.elements().len();
    let samples = mesh.quadrature().len();
    let fixed = fixed_nodes(&mesh, &request.fix)?;
    let actuation = match &request.actuation {
        Some(path) => Some(npy::read_f64(path, &[elements, samples, 6])?),
        None => None,
    };
    let cotangent = match &request.cotangent {
        Some(path) => Some(npy::read_f64(path, &[mesh.nodes().len(), 3])?),
        None => None,
    };
    let mut solver = match Solver::new(&mesh, &effects(request, fixed)) {
        Err(SolverError::NotHeld { .. }) if request.fix.is_empty() => {
            return Err(TrainerError::Option {
                option: "--fix",
                text: String::new(),
                mend: "nothing holds the body: give at least one selection, such as --fix \"x=min\"",
            });
        }
        other => other?,
    };
    let mut parameters = solver.rest_parameters();
    if let Some(values) = &actuation {
        let rows = values.chunks_exact(6);
        for (b, row) in parameters.actuation.iter_mut().zip(rows) {
            b.copy_from_slice(row);
        }
    }
    let diagonal = extent(mesh.nodes()).norm();
    let options = SolveOptions {
        method: request.method,
        max_iterations: request.max_iterations,
        ..SolveOptions::new(request.stop.unwrap_or(Stop::Accuracy(1e-5 * diagonal)))
    };
    // Not sooner: what is refused leaves no folder behind. Not later: a long solve must not end in a folder that cannot be written.
    let out = create_folder(&request.out)?;
    let solution = solver.solve(&parameters, None, &options)?;
    let adjoint = match &cotangent {
        Some(values) => {
            let rows = values.chunks_exact(3);
            let cotangent: Vec<_> = rows.map(|r| Vector3::new(r[0], r[1], r[2])).collect();
            let options = AdjointOptions::default();
            Some(solver.adjoint(&parameters, &solution, &cotangent, &options)?)
        }
        None => None,
    };
    let residual = residual(&mut solver, &parameters, &solution)?;
    write_mesh(&out, &mesh)?;
    npy::write_vectors(&out.join("positions.npy"), &solution.positions)?;
    remove_stale_gradients(&out)?;
    if let Some(gradient) = adjoint.as_ref().and_then(|a| a.gradient.as_ref()) {
        let flat: Vec<f64> = gradient.actuation.iter().flatten().copied().collect();
        npy::write(
            &out.join("actuation_grad.npy"),
            &[elements, samples, 6],
            &flat,
        )?;
        npy::write_vectors(&out.join("prescribed_grad.npy"), &gradient.prescribed)?;
        let nodes: Vec<i64> = solver.prescribed().iter().map(|&n| i64::from(n)).collect();
        npy::write(&out.join("prescribed.npy"), &[nodes.len()], &nodes)?;
    }
    let stats = stats(&mesh, &solver, &solution, adjoint.as_ref(), residual);
    write_json(&out.join("stats.json"), &stats)?;
    Ok(report(&out, &mesh, &solution, adjoint.as_ref(), residual))
}

/// Gradients of an earlier solve do not belong to this one.
fn remove_stale_gradients(out: &Path) -> Result<()> {
    for name in [
        "actuation_grad.npy",
        "prescribed_grad.npy",
        "prescribed.npy",
    ] {
        remove(&out.join(name))?;
    }
    Ok(())
}

fn check_stop(stop: Option<Stop>) -> Result<()> {
    let (option, value) = match stop {
        Some(Stop::Accuracy(length)) => ("--accuracy", length),
        Some(Stop::RelativeGradient(t)) => ("--rel-grad", t),
        None => return Ok(()),
    };
    if value.is_finite() && value > 0.0 {
        return Ok(());
    }
    Err(TrainerError::Option {
        option,
        text: value.to_string(),
        mend: "give a finite number above zero",
    })
}

fn build_mesh(request: &SolveRequest) -> Result<HexMesh> {
    let mesh_error = |name: String| move |source| TrainerError::Mesh { name, source };
    match &request.body {
        BodySource::Cells { cells, size } => {
            let rule = Quadrature::from_count(request.samples);
            let name = "--samples".to_string();
            let mesh = HexMesh::solid_box(*cells, *size, rule.map_err(mesh_error(name))?);
            mesh.map_err(mesh_error("--cells".into()))
        }
        BodySource::Surface { path, element_size } => {
            let surface = surface_mesh::read_surface(path)?.surface;
            let name = path.display().to_string();
            let body = Body::new(&name, surface, *element_size, request.samples)?;
            eprintln!("{}", body.report);
            Ok(body.mesh)
        }
    }
}

fn effects(request: &SolveRequest, fixed: Vec<u32>) -> Vec<EffectSpec> {
    let mut effects = vec![EffectSpec::Elasticity {
        stiffness: request.stiffness,
    }];
    if !fixed.is_empty() {
        effects.push(EffectSpec::Prescribed {
            nodes: NodeSet::Indices(fixed),
        });
    }
    effects
}

/// All nodes of all selections, by rising index.
fn fixed_nodes(mesh: &HexMesh, selections: &[String]) -> Result<Vec<u32>> {
    let mut nodes = BTreeSet::new();
    for text in selections {
        let region = parse_selection(mesh, text)?;
        let selected = region.select(mesh).map_err(|source| TrainerError::Mesh {
            name: format!("--fix {text}"),
            source,
        })?;
        nodes.extend(selected);
    }
    Ok(nodes.into_iter().collect())
}

/// `x=0`, `x=min`, `y=max`, `z<0.1`, `z>0.9`.
fn parse_selection(mesh: &HexMesh, text: &str) -> Result<NodeRegion> {
    let wrong = || TrainerError::Option {
        option: "--fix",
        text: text.to_string(),
        mend: "write an axis, one of = < >, and a number, `min` or `max`, such as x=0, y=max or z>0.9",
    };
    let text = text.trim();
    let axis = match text.chars().next() {
        Some('x' | 'X') => Axis::X,
        Some('y' | 'Y') => Axis::Y,
        Some('z' | 'Z') => Axis::Z,
        _ => return Err(wrong()),
    };
    let rest = text[1..].trim_start();
    let relation = rest.chars().next().ok_or_else(wrong)?;
    let value = rest.get(1..).ok_or_else(wrong)?.trim();
    let along = mesh.nodes().iter().map(|x| x[axis.index()]);
    let value = match value {
        "min" => along.fold(f64::INFINITY, f64::min),
        "max" => along.fold(f64::NEG_INFINITY, f64::max),
        number => number.parse().map_err(|_| wrong())?,
    };
    if !value.is_finite() {
        return Err(wrong());
    }
    let mut normal = [0.0; 3];
    match relation {
        '=' => Ok(NodeRegion::Plane { axis, value }),
        '>' | '<' => {
            let sign = if relation == '>' { 1.0 } else { -1.0 };
            normal[axis.index()] = sign;
            Ok(NodeRegion::HalfSpace {
                normal,
                offset: sign * value,
            })
        }
        _ => Err(wrong()),
    }
}

fn extent(points: &[Vector3<f64>]) -> Vector3<f64> {
    let low = points.iter().fold(points[0], |a, p| a.inf(p));
    let high = points.iter().fold(points[0], |a, p| a.sup(p));
    high - low
}

/// |g| over the free nodes at the result and at rest.
fn residual(solver: &mut Solver, parameters: &Parameters, solution: &Solution) -> Result<[f64; 2]> {
    let rest = solver.rest().to_vec();
    let (_, gradient) = solver.energy_gradient(parameters, &rest)?;
    let norm = gradient
        .iter()
        .map(|g| g.norm_squared())
        .sum::<f64>()
        .sqrt();
    Ok([solution.stats.gradient_norm, norm])
}

/// |g| over |g at rest|, or |g| itself where the rest shape is an equilibrium; NaN, which JSON writes as null, where |g at rest| is
/// infinite.
fn relative([at_result, at_rest]: [f64; 2]) -> f64 {
    if !at_rest.is_finite() {
        f64::NAN
    } else if at_rest > 0.0 {
        at_result / at_rest
    } else {
        at_result
    }
}

fn write_mesh(out: &Path, mesh: &HexMesh) -> Result<()> {
    let (elements, samples) = (mesh.elements().len(), mesh.quadrature().len());
    npy::write_vectors(&out.join("rest.npy"), mesh.nodes())?;
    let corners: Vec<i64> = mesh
        .elements()
        .iter()
        .flatten()
        .map(|&n| i64::from(n))
        .collect();
    npy::write(&out.join("elements.npy"), &[elements, 8], &corners)?;
    let points = mesh.sample_positions();
    let flat: Vec<f64> = points.iter().flat_map(|p| [p.x, p.y, p.z]).collect();
    npy::write(&out.join("samples.npy"), &[elements, samples, 3], &flat)?;
    let volume = mesh.element_volume();
    let weights: Vec<f64> = mesh
        .quadrature()
        .weights
        .iter()
        .map(|w| w * volume)
        .collect();
    npy::write(&out.join("sample_weights.npy"), &[samples], &weights)
}

/// Peak memory of this process so far in MB, where the system tells (Linux).
fn peak_megabytes() -> Option<f64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find(|l| l.starts_with("VmHWM:"))?;
    let kilobytes: f64 = line.split_whitespace().nth(1)?.parse().ok()?;
    Some(kilobytes / 1024.0)
}

fn stats(
    mesh: &HexMesh,
    solver: &Solver,
    solution: &Solution,
    adjoint: Option<&Adjoint>,
    norms: [f64; 2],
) -> serde_json::Value {
    let s = &solution.stats;
    json!({
        "status": solution.status,
        "iterations": s.iterations,
        "residual": relative(norms),
        "gradient_norm": norms[0],
        "gradient_norm_rest": norms[1],
        "estimated_error": s.estimated_error,
        "energy": s.energy,
        "method": s.method,
        "fell_back": s.fell_back,
        "setup_s": solver.setup_seconds(),
        "forward_s": s.seconds,
        "backward_s": adjoint.map(|a| a.stats.seconds),
        "adjoint_status": adjoint.map(|a| a.status),
        "adjoint_iterations": adjoint.map(|a| a.stats.iterations),
        "adjoint_residual": adjoint.map(|a| a.stats.relative_residual),
        "negative_curvature": adjoint.map(|a| a.stats.negative_curvature),
        "elements": mesh.elements().len(),
        "nodes": mesh.nodes().len(),
        "prescribed": solver.prescribed().len(),
        "samples": mesh.quadrature().len(),
        "work": s.work,
        "peak_mb": peak_megabytes(),
        "threads": rayon::current_num_threads(),
    })
}

fn report(
    out: &Path,
    mesh: &HexMesh,
    solution: &Solution,
    adjoint: Option<&Adjoint>,
    norms: [f64; 2],
) -> SolveOutcome {
    let s = &solution.stats;
    println!(
        "{} elements: {:?} after {} iterations, energy {:.9e}, residual {:.2e}, {:.3} s",
        mesh.elements().len(),
        solution.status,
        s.iterations,
        s.energy,
        relative(norms),
        s.seconds,
    );
    if let Some(a) = adjoint {
        println!(
            "adjoint: {:?} after {} iterations, residual {:.2e}, {:.3} s",
            a.status, a.stats.iterations, a.stats.relative_residual, a.stats.seconds
        );
    }
    println!("written to {}", out.display());
    let adjoint_converged = adjoint.is_none_or(|a| a.status.is_converged());
    SolveOutcome {
        converged: solution.status == Status::Converged && adjoint_converged,
    }
}

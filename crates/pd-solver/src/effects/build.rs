//! The turning of a list of [`EffectSpec`] into batches.

use super::Effect;
use super::contact::{Contact, ContactSettings};
use super::damping::Damping;
use super::dead_load::{DeadLoad, Loads};
use super::elasticity::Elasticity;
use super::inertia::Inertia;
use super::pressure::Pressure;
use super::springs::Springs;
use super::volume::Volume;
use crate::error::SolverError;
use crate::parameters::Parameters;
use crate::spec::{EffectSpec, Obstacle, TimeScheme};
use crate::surface::EmbeddedSurface;
use hex_mesh::HexMesh;
use nalgebra::Vector3;

/// The batches of a list of effects, with the parameters at rest and the prescribed nodes.
pub(crate) struct Batches {
    pub(crate) effects: Vec<Box<dyn Effect>>,
    pub(crate) prescribed: Vec<u32>,
    pub(crate) rest: Parameters,
    /// Nodes that a spring or inertia holds.
    pub(crate) anchored: Vec<u32>,
    /// Whether parts that nothing holds may float.
    pub(crate) may_float: bool,
    /// Energy per volume for a unit misfit.
    pub(crate) elastic_stiffness: f64,
    /// Factors on that per element, where they differ.
    pub(crate) stiffness: Option<Vec<f64>>,
    /// Viscosity over the step that is solved for: the stiffness of friction, which is that of elasticity where rotations follow.
    pub(crate) viscous: f64,
    /// Scales of the actuation per element, where they differ.
    pub(crate) activation: Option<Vec<f64>>,
    /// How the body steps in time, where it does.
    pub(crate) inertia: Option<Stepping>,
}

/// How a body steps in time.
#[derive(Debug, Clone)]
pub(crate) struct Stepping {
    /// Mass of each node.
    pub(crate) masses: Vec<f64>,
    pub(crate) time_step: f64,
    pub(crate) scheme: TimeScheme,
}

impl Stepping {
    /// The length of the step that is solved for: to the middle where the rest is extrapolated.
    pub(crate) fn solved_step(&self) -> f64 {
        match self.scheme {
            TimeScheme::BackwardEuler => self.time_step,
            TimeScheme::Midpoint => self.time_step / 2.0,
        }
    }
}

/// What is being built, and from what.
struct Builder<'a> {
    mesh: &'a HexMesh,
    surface: Option<&'a EmbeddedSurface>,
    specs: &'a [EffectSpec],
    out: Batches,
}

/// Turns what a scene lists into batches; `surface` is what hangs on the body, for the effects that act on it.
pub(crate) fn build(
    mesh: &HexMesh,
    surface: Option<&EmbeddedSurface>,
    specs: &[EffectSpec],
) -> Result<Batches, SolverError> {
    let samples = mesh.elements().len() * mesh.quadrature().len();
    if let Some(surface) = surface {
        surface.check(mesh)?;
    }
    let mut builder = Builder {
        mesh,
        surface,
        specs,
        out: Batches {
            effects: Vec::new(),
            prescribed: Vec::new(),
            anchored: Vec::new(),
            may_float: false,
            elastic_stiffness: 0.0,
            stiffness: None,
            viscous: 0.0,
            activation: None,
            inertia: None,
            rest: Parameters {
                actuation: vec![[0.0; 6]; samples],
                ..Parameters::default()
            },
        },
    };
    builder.fields()?;
    for (index, spec) in specs.iter().enumerate() {
        builder.add(index, spec)?;
    }
    match builder.out.elastic_stiffness > 0.0 {
        true => Ok(builder.out),
        false => Err(SolverError::NoElasticity),
    }
}

impl Builder<'_> {
    /// What other effects need to know before they are built.
    fn fields(&mut self) -> Result<(), SolverError> {
        for (index, spec) in self.specs.iter().enumerate() {
            let once = matches!(
                spec,
                EffectSpec::Elasticity { .. }
                    | EffectSpec::Volume { .. }
                    | EffectSpec::Inertia { .. }
                    | EffectSpec::Damping { .. }
            );
            let kind = spec.kind();
            if once && self.specs[..index].iter().any(|s| s.kind() == kind) {
                return Err(SolverError::DuplicateEffect { index, kind });
            }
            match spec {
                EffectSpec::Elasticity { stiffness } => {
                    positive(index, "stiffness", *stiffness)?;
                    self.out.elastic_stiffness = *stiffness;
                }
                EffectSpec::Stiffness { elements, factor } => {
                    positive(index, "factor", *factor)?;
                    let shares = elements.resolve(self.mesh, index)?;
                    multiply(&mut self.out.stiffness, &shares, *factor);
                }
                EffectSpec::Activation { elements, scale } => {
                    not_negative(index, "scale", *scale)?;
                    let shares = elements.resolve(self.mesh, index)?;
                    multiply(&mut self.out.activation, &shares, *scale);
                }
                EffectSpec::Inertia {
                    density,
                    time_step,
                    scheme,
                } => {
                    positive(index, "density", *density)?;
                    positive(index, "time_step", *time_step)?;
                    self.out.inertia = Some(Stepping {
                        masses: DeadLoad::masses(self.mesh, *density),
                        time_step: *time_step,
                        scheme: *scheme,
                    });
                }
                _ => {}
            }
        }
        Ok(())
    }

    fn add(&mut self, index: usize, spec: &EffectSpec) -> Result<(), SolverError> {
        let mesh = self.mesh;
        let out = &mut self.out;
        let kind = spec.kind();
        match spec {
            EffectSpec::Elasticity { stiffness } => {
                let elasticity = Elasticity::from_mesh(mesh, *stiffness, out.stiffness.as_deref());
                out.effects.push(Box::new(elasticity));
            }
            EffectSpec::Stiffness { .. } | EffectSpec::Activation { .. } => {}
            EffectSpec::Floating {} => out.may_float = true,
            EffectSpec::Prescribed { nodes } => {
                let nodes = nodes.resolve(mesh, index)?;
                out.prescribe(mesh, &nodes, index)?;
            }
            EffectSpec::Springs { points, stiffness } => {
                positive(index, "stiffness", *stiffness)?;
                let first = out.rest.spring_targets.len();
                let springs = Springs::new(mesh, points, *stiffness, first, index)?;
                out.anchored.extend(springs.nodes());
                out.rest.spring_targets.extend(springs.rest_targets());
                out.effects.push(Box::new(springs));
            }
            EffectSpec::Gravity {
                acceleration,
                density,
            } => {
                positive(index, "density", *density)?;
                let acceleration = vector(index, "acceleration", acceleration)?;
                out.load(
                    Loads::Gravity,
                    DeadLoad::masses(mesh, *density),
                    acceleration,
                );
            }
            EffectSpec::Force { region, force } => {
                let force = vector(index, "force", force)?;
                let surface = need(self.surface, index, kind)?;
                let patch = surface.select(region.as_ref(), mesh, index)?;
                let shares = DeadLoad::shares_of_patch(mesh, surface, &patch);
                out.load(Loads::Forces, shares, force);
            }
            EffectSpec::Wind { region, pressure } => {
                let pressure = vector(index, "pressure", pressure)?;
                let surface = need(self.surface, index, kind)?;
                let patch = surface.select(region.as_ref(), mesh, index)?;
                let areas = DeadLoad::areas_facing(mesh, surface, &patch, &pressure);
                out.load(Loads::Forces, areas, pressure);
            }
            EffectSpec::Volume { stiffness } => {
                positive(index, "stiffness", *stiffness)?;
                out.effects.push(Box::new(Volume::new(mesh, *stiffness)));
            }
            EffectSpec::Pressure {
                region,
                capped,
                pressure,
            } => {
                finite(index, "pressure", *pressure)?;
                let surface = need(self.surface, index, kind)?;
                let walls = surface.select(region.as_ref(), mesh, index)?;
                let slot = out.rest.pressures.len();
                let cavity = Pressure::new(mesh, surface, &walls, *capped, slot, index)?;
                out.rest.pressures.push(*pressure);
                out.effects.push(Box::new(cavity));
            }
            EffectSpec::Inertia { .. } => {
                let stepping = out.inertia.as_ref().expect("found before");
                out.rest.inertia = mesh.nodes().to_vec();
                out.anchored.extend(0..mesh.nodes().len() as u32);
                out.effects.push(Box::new(Inertia::new(mesh, stepping)));
            }
            EffectSpec::Damping { viscosity } => {
                positive(index, "viscosity", *viscosity)?;
                let why = "there is no damping where there is no `inertia`: add that effect, or take this one away";
                let stepping =
                    out.inertia
                        .as_ref()
                        .ok_or(SolverError::Excluded { index, kind, why })?;
                out.rest.before = mesh.nodes().to_vec();
                let damping = Damping::new(mesh, *viscosity, stepping);
                out.viscous = viscosity / stepping.solved_step();
                out.effects.push(Box::new(damping));
            }
            EffectSpec::Contact {
                region,
                distance,
                stiffness,
                own,
                obstacles,
            } => {
                positive(index, "distance", *distance)?;
                let stiffness = stiffness.unwrap_or(out.elastic_stiffness);
                positive(index, "stiffness", stiffness)?;
                let surface = need(self.surface, index, kind)?;
                let touching = surface.select(region.as_ref(), mesh, index)?;
                if let Some(Stepping {
                    scheme: TimeScheme::Midpoint,
                    ..
                }) = out.inertia
                {
                    let why = "a midpoint step goes on beyond the place that contact was looked at: use `scheme = \"backward_euler\"`";
                    return Err(SolverError::Excluded { index, kind, why });
                }
                let first = out.rest.obstacles.len();
                for obstacle in obstacles {
                    if let Obstacle::Surface { vertices, .. } = obstacle {
                        let vertices = vertices.iter().map(|x| Vector3::from(*x));
                        out.rest.obstacles.extend(vertices);
                    }
                }
                let settings = ContactSettings {
                    touching: &touching,
                    distance: *distance,
                    stiffness,
                    own: *own,
                    obstacles,
                    first,
                };
                let contact = Contact::new(mesh, surface, &settings, index)?;
                out.effects.push(Box::new(contact));
            }
        }
        Ok(())
    }
}

/// Multiplies the field by what a set says.
fn multiply(field: &mut Option<Vec<f64>>, shares: &[f64], factor: f64) {
    let field = field.get_or_insert_with(|| vec![1.0; shares.len()]);
    for (f, share) in field.iter_mut().zip(shares) {
        *f *= 1.0 + share * (factor - 1.0);
    }
}

fn need<'a>(
    surface: Option<&'a EmbeddedSurface>,
    index: usize,
    kind: &'static str,
) -> Result<&'a EmbeddedSurface, SolverError> {
    surface.ok_or(SolverError::NoSurface { index, kind })
}

impl Batches {
    fn load(&mut self, list: Loads, shares: Vec<f64>, vector: Vector3<f64>) {
        let of_list = match list {
            Loads::Gravity => &mut self.rest.acceleration,
            Loads::Forces => &mut self.rest.forces,
        };
        let load = DeadLoad::new(shares, vector, list, of_list.len());
        of_list.push(vector);
        self.effects.push(Box::new(load));
    }

    fn prescribe(
        &mut self,
        mesh: &HexMesh,
        nodes: &[u32],
        index: usize,
    ) -> Result<(), SolverError> {
        let mut held = vec![false; mesh.nodes().len()];
        for &node in &self.prescribed {
            held[node as usize] = true;
        }
        for &node in nodes {
            if std::mem::replace(&mut held[node as usize], true) {
                return Err(SolverError::PrescribedTwice { index, node });
            }
            self.prescribed.push(node);
            self.rest.prescribed.push(mesh.nodes()[node as usize]);
        }
        Ok(())
    }
}

fn positive(index: usize, field: &'static str, value: f64) -> Result<(), SolverError> {
    check(
        index,
        field,
        value,
        value > 0.0,
        "a finite number above zero",
    )
}

fn not_negative(index: usize, field: &'static str, value: f64) -> Result<(), SolverError> {
    check(
        index,
        field,
        value,
        value >= 0.0,
        "a finite number, zero or more",
    )
}

pub(super) fn finite(index: usize, field: &'static str, value: f64) -> Result<(), SolverError> {
    check(index, field, value, true, "a finite number")
}

fn check(
    index: usize,
    field: &'static str,
    value: f64,
    fits: bool,
    expected: &'static str,
) -> Result<(), SolverError> {
    match value.is_finite() && fits {
        true => Ok(()),
        false => Err(SolverError::BadValue {
            index,
            field,
            value,
            expected,
        }),
    }
}

fn vector(
    index: usize,
    field: &'static str,
    values: &[f64; 3],
) -> Result<Vector3<f64>, SolverError> {
    values.iter().try_for_each(|&v| finite(index, field, v))?;
    Ok(Vector3::from(*values))
}

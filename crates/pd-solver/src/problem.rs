//! The discrete problem on one grid: effects and prescribed nodes, as functions of the nodal positions.

use crate::activation::Activation;
use crate::approach;
use crate::constant::ConstantSystem;
use crate::effects::{Batches, CoarseView, Effect, Stepping, build, springs::Springs};
use crate::element_finder::ElementFinder;
use crate::error::SolverError;
use crate::floating::{FloatingPart, PIN};
use crate::multigrid::{ElementForm, Form, Hierarchy};
use crate::parameters::Parameters;
use crate::solution::Work;
use crate::spec::EffectSpec;
use crate::surface::EmbeddedSurface;
use crate::vector::{NodalVector, max_norm, norm};
use hex_mesh::HexMesh;
use nalgebra::Vector3;
use std::time::{Duration, Instant};

/// Stiffness of the springs that hold a coarse body where prescribed nodes lie inside its elements, in units of elastic
/// stiffness times the edge of a fine element: stiff against the flesh around, which is all that a start needs.
const ANCHOR: f64 = 4.0;

/// Roundoff of a strain times an edge, in units of the size of positions.
const POSITION_ROUNDOFF: f64 = 2e-16;
/// Share of a gradient that is roundoff once motions as a whole are taken out of it.
const CONSISTENT: f64 = 1e-13;

/// How many times farther than rest and held nodes a body has to be to count as blown away.
const AWAY: f64 = 1e9;

/// Everything the methods need to know of a body.
pub(crate) struct Problem {
    effects: Vec<Box<dyn Effect>>,
    /// Parts that nothing holds. On coarser grids their place does not matter.
    pub(crate) floating: Vec<FloatingPart>,
    /// What holds those in preconditioners, and only there: their Hessian is singular.
    pins: Option<Box<dyn Effect>>,
    pub(crate) prescribed: Vec<u32>,
    pub(crate) rest: NodalVector,
    /// How far from the origin that reaches.
    rest_extent: f64,
    pub(crate) rest_parameters: Parameters,
    pub(crate) elements: usize,
    pub(crate) element_size: f64,
    /// Energy per volume for a unit misfit.
    pub(crate) elastic_stiffness: f64,
    /// Factors on that per element for preconditioners, friction among it; absent where they are 1.
    pub(crate) stiffness: Option<Vec<f64>>,
    /// Scales of the actuation, where they differ.
    pub(crate) activation: Option<Activation>,
    /// How the body steps in time, where it does.
    pub(crate) inertia: Option<Stepping>,
    pub(crate) work: Work,
    /// Time in evaluations of energy and gradient since the body was built.
    pub(crate) local_time: Duration,
}

impl Problem {
    pub(crate) fn new(
        mesh: &HexMesh,
        surface: Option<&EmbeddedSurface>,
        specs: &[EffectSpec],
    ) -> Result<Self, SolverError> {
        let Batches {
            effects,
            prescribed,
            rest: rest_parameters,
            anchored,
            may_float,
            elastic_stiffness,
            mut stiffness,
            viscous,
            activation,
            inertia,
        } = build(mesh, surface, specs)?;
        let floating = FloatingPart::find(mesh, prescribed.iter().chain(&anchored));
        if let Some(part) = floating.first() {
            let (node, count) = (part.nodes[0] as usize, part.nodes.len());
            if !may_float {
                return Err(SolverError::NotHeld { node, count });
            }
            if !rest_parameters.acceleration.is_empty() || !rest_parameters.forces.is_empty() {
                return Err(SolverError::Falls { node, count });
            }
        }
        approach::check_floating(mesh, &floating, specs)?;
        let pins = pins(
            &floating,
            elastic_stiffness * mesh.element_size(),
            mesh.nodes(),
        );
        let fields = [
            stiffness.as_ref(),
            activation.as_ref(),
            inertia.as_ref().map(|i| &i.masses),
        ];
        let of_fields = fields.into_iter().flatten().map(|f| size_of_val(&f[..]));
        let work = Work {
            effect_bytes: effects.iter().map(|e| e.bytes()).chain(of_fields).sum(),
            ..Work::default()
        };
        if viscous > 0.0 {
            let factors = stiffness.get_or_insert_with(|| vec![1.0; mesh.elements().len()]);
            let more = viscous / elastic_stiffness;
            factors.iter_mut().for_each(|factor| *factor += more);
        }
        Ok(Self {
            effects,
            floating,
            pins,
            prescribed,
            rest: mesh.nodes().to_vec(),
            rest_extent: max_norm(mesh.nodes()),
            rest_parameters,
            elements: mesh.elements().len(),
            element_size: mesh.element_size(),
            elastic_stiffness,
            stiffness,
            activation: activation.map(Activation::new),
            inertia,
            work,
            local_time: Duration::ZERO,
        })
    }

    /// The same body on the next coarser grid of the hierarchy, `level` being this problem's; `None` where an effect has no coarse twin.
    pub(crate) fn coarsen(&self, hierarchy: &Hierarchy, level: usize) -> Option<Self> {
        let (grid, transfer) = (&hierarchy.grids[level + 1], &hierarchy.transfers[level]);
        let view = CoarseView {
            grid,
            transfer,
            stiffness: self.elastic_stiffness,
        };
        let rest: NodalVector = (0..grid.node_count()).map(|n| grid.position(n)).collect();
        let held = &hierarchy.held[level + 1];
        let prescribed: Vec<u32> = (0..held.len() as u32)
            .filter(|&n| held[n as usize])
            .collect();
        let effects: Option<Vec<Box<dyn Effect>>> =
            self.effects.iter().map(|e| e.coarsen(&view)).collect();
        let effects = effects?;
        let rest_parameters = Parameters {
            actuation: vec![[0.0; 6]; grid.elements.len() * 8],
            prescribed: prescribed.iter().map(|&n| rest[n as usize]).collect(),
            spring_targets: self.rest_parameters.spring_targets.clone(),
            acceleration: self.rest_parameters.acceleration.clone(),
            forces: self.rest_parameters.forces.clone(),
            pressures: self.rest_parameters.pressures.clone(),
            ..Parameters::default()
        };
        Some(Self {
            effects,
            floating: Vec::new(),
            pins: self.pins.as_ref().and_then(|pins| pins.coarsen(&view)),
            prescribed,
            rest_extent: max_norm(&rest),
            rest,
            rest_parameters,
            elements: grid.elements.len(),
            element_size: self.element_size * 2.0,
            elastic_stiffness: self.elastic_stiffness,
            stiffness: None,
            activation: None,
            inertia: None,
            work: Work::default(),
            local_time: Duration::ZERO,
        })
    }

    /// Adds springs from points of the body to targets that follow the others in the parameters.
    pub(crate) fn anchor(&mut self, forms: Vec<(Vec<u32>, Vec<f64>)>, fine_edge: f64) {
        if forms.is_empty() {
            return;
        }
        let stiffness = ANCHOR * self.elastic_stiffness * fine_edge;
        let first = self.rest_parameters.spring_targets.len();
        let springs = Springs::from_forms(forms, stiffness, first, &self.rest);
        self.rest_parameters
            .spring_targets
            .extend(springs.rest_targets());
        self.effects.push(Box::new(springs));
    }

    /// What preconditioners are made of.
    fn in_preconditioners(&self) -> impl Iterator<Item = &Box<dyn Effect>> {
        self.effects.iter().chain(&self.pins)
    }

    /// Linear forms of the effects (springs), each given to one element that holds all its nodes.
    pub(crate) fn element_forms(&self, elements: &[[u32; 8]]) -> Vec<ElementForm> {
        let mut any = false;
        for effect in self.in_preconditioners() {
            effect.for_each_form(&mut |_, _, _| any = true);
        }
        let mut forms = Vec::new();
        if !any {
            return forms;
        }
        let finder = ElementFinder::new(elements, self.rest.len());
        for effect in self.in_preconditioners() {
            effect.for_each_form(&mut |nodes, weights, stiffness| {
                if let Some(element) = finder.with_all(elements, nodes.iter().copied()) {
                    let corners = &elements[element as usize];
                    let of_corner = |c: usize| {
                        let terms = nodes.iter().zip(weights);
                        terms
                            .filter(|(n, _)| **n == corners[c])
                            .map(|(_, w)| w)
                            .sum()
                    };
                    forms.push((element, std::array::from_fn(of_corner), stiffness));
                }
            });
        }
        forms
    }

    /// What touches at `u`, as forms over nodes.
    pub(crate) fn touches(&mut self, u: &[Vector3<f64>]) -> Vec<Form> {
        self.effects.iter_mut().flat_map(|e| e.touches(u)).collect()
    }

    /// Stiffness against changes of volume, an energy per volume, for preconditioners.
    pub(crate) fn volume_stiffness(&self) -> f64 {
        self.effects.iter().map(|e| e.volume_stiffness()).sum()
    }

    /// Assembles and factors the constant matrix.
    pub(crate) fn constant_system(&self) -> Result<ConstantSystem, SolverError> {
        let free = self.free();
        ConstantSystem::factor(&free, &self.rest, self.element_size, |matrix| {
            self.in_preconditioners()
                .for_each(|e| e.add_constant(matrix));
        })
    }

    /// The free nodes, by rising index.
    pub(crate) fn free(&self) -> Vec<u32> {
        let mut held = vec![false; self.len()];
        self.prescribed
            .iter()
            .for_each(|&n| held[n as usize] = true);
        (0..self.len() as u32)
            .filter(|&n| !held[n as usize])
            .collect()
    }

    /// Moves the parts that float to where the convention wants them.
    pub(crate) fn align_floating(&self, u: &mut [Vector3<f64>]) {
        self.floating.iter().for_each(|part| part.align(u));
    }

    /// Adds to a product with the Hessian what makes it regular for parts that float, as stiff as the pins of preconditioners.
    pub(crate) fn add_rigid(&self, x: &[Vector3<f64>], out: &mut [Vector3<f64>]) {
        let stiffness = PIN * self.elastic_stiffness * self.element_size;
        let parts = self.floating.iter();
        parts.for_each(|part| part.add_rigid(stiffness, x, out));
    }

    /// Makes the gradient `b` by the positions at an aligned `u` one that parts which float can answer.
    pub(crate) fn make_consistent(&self, u: &[Vector3<f64>], b: &mut [Vector3<f64>]) {
        if self.floating.is_empty() {
            return;
        }
        let before = norm(b);
        let parts = self.floating.iter();
        parts.for_each(|part| part.make_consistent(u, b));
        // What only moves parts as a whole leaves roundoff, which is no right-hand side for a singular matrix.
        if norm(b) <= CONSISTENT * before {
            b.fill(Vector3::zeros());
        }
    }

    /// Number of nodes.
    pub(crate) fn len(&self) -> usize {
        self.rest.len()
    }

    pub(crate) fn set_parameters(&mut self, parameters: &Parameters) {
        self.effects
            .iter_mut()
            .for_each(|e| e.set_parameters(parameters));
    }

    /// Whether all entries of the actuation are finite, seen from what effects took over.
    pub(crate) fn actuation_is_finite(&self) -> bool {
        self.effects.iter().all(|e| e.actuation_is_finite())
    }

    /// Writes the mean A of every element.
    pub(crate) fn mean_actuation(&self, out: &mut [[f64; 6]]) {
        self.effects.iter().for_each(|e| e.mean_actuation(out));
    }

    /// Whether the constant matrix bounds the Hessian.
    pub(crate) fn is_bounded(&self) -> bool {
        self.effects.iter().all(|e| e.is_bounded())
    }

    /// Whether an effect limits steps, and calls for Newton's method.
    pub(crate) fn limits_steps(&self) -> bool {
        self.effects.iter().any(|e| e.limits_steps())
    }

    /// The share of the way from the positions `from` to the positions `to` that a step may go.
    pub(crate) fn step_limit(&mut self, from: &[Vector3<f64>], to: &[Vector3<f64>]) -> f64 {
        let limits = self.effects.iter_mut().map(|e| e.step_limit(from, to));
        limits.fold(1.0, f64::min)
    }

    /// What effects see of contact.
    pub(crate) fn contacts(&mut self) -> impl Iterator<Item = &mut Box<dyn Effect>> {
        self.effects.iter_mut().filter(|e| e.limits_steps())
    }

    /// The norm of the gradient at `u` without contact, which knows no scale where things pass through each other.
    pub(crate) fn gradient_norm_apart(
        &mut self,
        u: &[Vector3<f64>],
        gradient: &mut NodalVector,
    ) -> f64 {
        gradient.fill(Vector3::zeros());
        for effect in self.effects.iter_mut().filter(|e| !e.limits_steps()) {
            effect.energy_gradient(u, gradient);
        }
        self.clear_prescribed(gradient);
        norm(gradient)
    }

    /// Writes the prescribed positions into `u`.
    pub(crate) fn impose(&self, parameters: &Parameters, u: &mut [Vector3<f64>]) {
        for (&node, position) in self.prescribed.iter().zip(&parameters.prescribed) {
            u[node as usize] = *position;
        }
    }

    /// Energy at `u`; `gradient` is overwritten, and zero at prescribed nodes.
    pub(crate) fn evaluate(&mut self, u: &[Vector3<f64>], gradient: &mut NodalVector) -> f64 {
        self.evaluate_by(gradient, |effect, out| effect.energy_gradient(u, out))
    }

    /// [`Problem::evaluate`] where most of the body is at rest.
    pub(crate) fn evaluate_at_rest(
        &mut self,
        u: &[Vector3<f64>],
        gradient: &mut NodalVector,
    ) -> f64 {
        self.evaluate_by(gradient, |effect, out| {
            effect.energy_gradient_at_rest(u, out)
        })
    }

    /// Remembers the parameters, for [`Problem::add_gradient_change`].
    pub(crate) fn remember_parameters(&mut self) {
        self.effects
            .iter_mut()
            .for_each(|e| e.remember_parameters());
    }

    /// Adds about what the gradient at `u` has changed by since the parameters were remembered, if only the actuation has: false, if that is
    /// nothing. Zero at prescribed nodes, if `out` was.
    pub(crate) fn add_gradient_change(&self, u: &[Vector3<f64>], out: &mut NodalVector) -> bool {
        let mut any = false;
        for effect in &self.effects {
            any |= effect.add_gradient_change(u, out);
        }
        self.clear_prescribed(out);
        any
    }

    fn evaluate_by(
        &mut self,
        gradient: &mut NodalVector,
        f: impl Fn(&mut dyn Effect, &mut NodalVector) -> f64,
    ) -> f64 {
        let clock = Instant::now();
        gradient.fill(Vector3::zeros());
        let mut energy = 0.0;
        for effect in &mut self.effects {
            energy += f(effect.as_mut(), gradient);
            self.work.local_projections += effect.projections();
        }
        self.work.evaluations += 1;
        self.clear_prescribed(gradient);
        self.local_time += clock.elapsed();
        energy
    }

    pub(crate) fn linearise(&mut self, u: &[Vector3<f64>]) {
        self.effects.iter_mut().for_each(|e| e.linearise(u));
        self.after_linearisation(u);
    }

    /// [`Problem::linearise`], and the gradient at `u`; `gradient` is overwritten, and zero at prescribed nodes.
    pub(crate) fn linearise_with_gradient(
        &mut self,
        u: &[Vector3<f64>],
        gradient: &mut NodalVector,
    ) {
        gradient.fill(Vector3::zeros());
        for effect in &mut self.effects {
            effect.linearise_with_gradient(u, gradient);
            self.work.local_projections += effect.projections();
        }
        self.work.evaluations += 1;
        self.clear_prescribed(gradient);
        self.after_linearisation(u);
    }

    fn after_linearisation(&mut self, u: &[Vector3<f64>]) {
        self.floating.iter_mut().for_each(|part| part.linearise(u));
        self.work.linearisations += 1;
        self.work.smallest_pair_sum = self
            .effects
            .iter()
            .filter_map(|e| e.smallest_pair_sum())
            .reduce(f64::min);
    }

    /// `out = H x` with all rows, those of prescribed nodes too.
    pub(crate) fn full_hessian_product(&mut self, x: &[Vector3<f64>], out: &mut NodalVector) {
        out.fill(Vector3::zeros());
        self.effects
            .iter_mut()
            .for_each(|e| e.hessian_product(x, out));
        self.work.hessian_products += 1;
    }

    /// Adds `-(d gradient / d parameters)^T z` for all parameters but the prescribed positions.
    pub(crate) fn parameter_vjp(
        &mut self,
        u: &[Vector3<f64>],
        z: &[Vector3<f64>],
        out: &mut Parameters,
    ) {
        self.effects
            .iter_mut()
            .for_each(|e| e.parameter_vjp(u, z, out));
        if let Some(activation) = &self.activation {
            activation.scale(&mut out.actuation);
        }
    }

    pub(crate) fn clear_prescribed(&self, x: &mut [Vector3<f64>]) {
        for &node in &self.prescribed {
            x[node as usize] = Vector3::zeros();
        }
    }

    /// A gradient norm that is roundoff for this body, its held nodes being where they are in `u`: no method can go below it. Strains are
    /// differences of positions, which have the roundoff of their size. Free nodes of a start may be anywhere and say nothing.
    pub(crate) fn gradient_floor(&self, u: &[Vector3<f64>]) -> f64 {
        let stiffest: f64 = self.effects.iter().map(|e| e.largest_diagonal()).sum();
        let of_positions = POSITION_ROUNDOFF * self.extent(u);
        let length = (1e-15 * self.element_size).max(of_positions);
        length * stiffest * (self.len() as f64).sqrt()
    }

    /// How far from the origin rest reaches, and the held nodes where they are in `u`.
    fn extent(&self, u: &[Vector3<f64>]) -> f64 {
        let held = self.prescribed.iter().map(|&n| u[n as usize].norm());
        held.fold(self.rest_extent, f64::max)
    }

    /// Whether the energy falls without end, as under a pressure that no wall can bear, and `u` is how far that went: a stall there is no place where
    /// floating point tells no more, but the end of its range.
    pub(crate) fn ran_away(&self, u: &[Vector3<f64>]) -> bool {
        !self.is_bounded() && max_norm(u) > AWAY * self.extent(u)
    }

    /// Searches of contact for what is near so far.
    pub(crate) fn queries(&self) -> u64 {
        self.effects.iter().map(|e| e.queries()).sum()
    }

    /// Samples whose volume is turned inside out where [`Problem::evaluate`] was last asked.
    pub(crate) fn inverted_where_evaluated(&self) -> usize {
        let effects = self.effects.iter();
        effects.map(|e| e.inverted_where_evaluated()).sum()
    }

    /// Samples whose volume is turned inside out at `u`.
    pub(crate) fn inverted_samples(&self, u: &[Vector3<f64>]) -> usize {
        self.effects.iter().map(|e| e.inverted_samples(u)).sum()
    }
}

/// Weak springs at all nodes of parts that float; nothing where there are none.
fn pins(floating: &[FloatingPart], unit: f64, rest: &[Vector3<f64>]) -> Option<Box<dyn Effect>> {
    let nodes = floating.iter().flat_map(|part| &part.nodes);
    let forms: Vec<_> = nodes.map(|&n| (vec![n], vec![1.0])).collect();
    if forms.is_empty() {
        return None;
    }
    Some(Box::new(Springs::from_forms(forms, PIN * unit, 0, rest)))
}

//! One suite that every effect keeps: gradient, Hessian product, symmetry, parameter derivatives, majorisation.

mod common;

use common::{Numbers, boundary, difference, dot, elasticity, held, nodes_where};
use hex_mesh::{HexMesh, NodeRegion, Quadrature};
use nalgebra::Vector3;
use pd_solver::{
    AdjointOptions, EffectSpec, ElementSet, Method, NodeSet, Obstacle, Parameters, SolveOptions,
    Solver, SpringPoints, Status, Stop, TimeScheme,
};

/// The body, its solver, and parameters and a state away from any special place.
struct Case {
    mesh: HexMesh,
    solver: Solver,
    parameters: Parameters,
    state: Vec<Vector3<f64>>,
    numbers: Numbers,
    /// Step of parameters in differences of solves, and the error that it leaves.
    step: (f64, f64),
}

impl Case {
    fn new(quadrature: Quadrature, extra: impl FnOnce(&HexMesh) -> Vec<EffectSpec>) -> Self {
        let mesh = common::small_box(quadrature);
        let wall = nodes_where(&mesh, |x| x.x == 0.0);
        let mut effects = vec![elasticity(), held(wall)];
        effects.extend(extra(&mesh));
        let surface = boundary(&mesh);
        let solver = Solver::on_surface(&mesh, &surface, &effects).expect("a valid problem");
        let mut numbers = Numbers::new(7);
        let mut parameters = solver.rest_parameters();
        let direction = random_like(&parameters, &mut numbers);
        parameters = parameters.moved(0.1, &direction);
        let noise = numbers.vectors(mesh.nodes().len(), 0.02);
        let mut state: Vec<_> = mesh.nodes().iter().zip(noise).map(|(x, n)| x + n).collect();
        for (&node, x) in solver.prescribed().iter().zip(&parameters.prescribed) {
            state[node as usize] = *x;
        }
        Self {
            mesh,
            solver,
            parameters,
            state,
            numbers,
            step: (1e-3, 1e-7),
        }
    }

    /// A direction that leaves the prescribed nodes where they are.
    fn direction(&mut self) -> Vec<Vector3<f64>> {
        let mut d = self.numbers.vectors(self.mesh.nodes().len(), 1.0);
        for &node in self.solver.prescribed() {
            d[node as usize] = Vector3::zeros();
        }
        d
    }

    fn energy(&mut self, u: &[Vector3<f64>]) -> f64 {
        self.solver
            .energy_gradient(&self.parameters, u)
            .expect("fits")
            .0
    }

    fn gradient(&mut self, u: &[Vector3<f64>]) -> Vec<Vector3<f64>> {
        self.solver
            .energy_gradient(&self.parameters, u)
            .expect("fits")
            .1
    }

    fn gradient_is_the_slope_of_the_energy(&mut self) {
        let (state, d) = (self.state.clone(), self.direction());
        let slope = difference(1e-4, |t| self.energy(&shifted(&state, t, &d)));
        let exact = dot(&self.gradient(&state), &d);
        close(slope, exact, 1e-9);
    }

    fn hessian_is_the_slope_of_the_gradient_and_symmetric(&mut self) {
        let state = self.state.clone();
        let (a, b) = (self.direction(), self.direction());
        let slope = difference(1e-4, |t| dot(&self.gradient(&shifted(&state, t, &a)), &b));
        let product = |case: &mut Self, x: &[Vector3<f64>]| {
            case.solver
                .hessian_product(&case.parameters, &state, x)
                .expect("fits")
        };
        let (ha, hb) = (product(self, &a), product(self, &b));
        close(slope, dot(&ha, &b), 1e-9);
        close(dot(&ha, &b), dot(&hb, &a), 1e-12);
    }

    fn parameters_move_the_equilibrium_as_the_adjoint_says(&mut self) {
        let options = common::tight();
        let at = self
            .solver
            .solve(&self.parameters, None, &options)
            .expect("fits");
        assert_eq!(at.status, Status::Converged);
        let cotangent = self.numbers.vectors(self.mesh.nodes().len(), 1.0);
        let exact = AdjointOptions {
            tolerance: 1e-13,
            ..AdjointOptions::default()
        };
        let adjoint = self
            .solver
            .adjoint(&self.parameters, &at, &cotangent, &exact)
            .expect("fits");
        let gradient = adjoint.gradient.expect("converged");
        let direction = random_like(&self.parameters, &mut self.numbers);
        let (step, error) = self.step;
        let slope = difference(step, |t| {
            let parameters = self.parameters.moved(t, &direction);
            let solution = self
                .solver
                .solve(&parameters, Some(&at.positions), &options)
                .expect("fits");
            dot(&solution.positions, &cotangent)
        });
        close(slope, gradient.dot(&direction), error);
    }

    fn energy_never_rises(&mut self) {
        let mut u = self.state.clone();
        let mut last = self.energy(&u);
        let one_step = SolveOptions {
            max_iterations: 1,
            ..SolveOptions::new(Stop::RelativeGradient(1e-15)).with_method(Method::LocalGlobal)
        };
        for _ in 0..60 {
            let next = self
                .solver
                .solve(&self.parameters, Some(&u), &one_step)
                .expect("fits");
            let energy = next.stats.energy;
            assert!(energy <= last + 1e-14 * last.abs(), "{energy} after {last}");
            last = energy;
            u = next.positions;
        }
    }
}

fn shifted(u: &[Vector3<f64>], t: f64, d: &[Vector3<f64>]) -> Vec<Vector3<f64>> {
    u.iter().zip(d).map(|(u, d)| u + d * t).collect()
}

fn random_like(p: &Parameters, numbers: &mut Numbers) -> Parameters {
    Parameters {
        actuation: numbers.actuation(p.actuation.len(), 1.0),
        prescribed: numbers.vectors(p.prescribed.len(), 0.2),
        spring_targets: numbers.vectors(p.spring_targets.len(), 1.0),
        acceleration: numbers.vectors(p.acceleration.len(), 1.0),
        forces: numbers.vectors(p.forces.len(), 1.0),
        pressures: (0..p.pressures.len()).map(|_| numbers.next()).collect(),
        inertia: numbers.vectors(p.inertia.len(), 0.2),
        before: numbers.vectors(p.before.len(), 0.2),
        obstacles: numbers.vectors(p.obstacles.len(), 0.1),
    }
}

fn close(a: f64, b: f64, tolerance: f64) {
    let error = (a - b).abs() / b.abs().max(1e-3);
    assert!(error <= tolerance, "{a} against {b}: {error:e}");
}

/// The whole suite for one list of effects.
macro_rules! conformance {
    ($name:ident, $quadrature:expr, $extra:expr) => {
        conformance!($name, $quadrature, $extra, (1e-3, 1e-7));
    };
    ($name:ident, $quadrature:expr, $extra:expr, $step:expr) => {
        mod $name {
            use super::*;

            fn case() -> Case {
                Case {
                    step: $step,
                    ..Case::new($quadrature, $extra)
                }
            }

            #[test]
            fn gradient() {
                case().gradient_is_the_slope_of_the_energy();
            }

            #[test]
            fn hessian() {
                case().hessian_is_the_slope_of_the_gradient_and_symmetric();
            }

            #[test]
            fn parameters() {
                case().parameters_move_the_equilibrium_as_the_adjoint_says();
            }

            #[test]
            fn monotone() {
                case().energy_never_rises();
            }
        }
    };
}

fn springs_at_nodes(mesh: &HexMesh) -> Vec<EffectSpec> {
    let nodes = nodes_where(mesh, |x| x.x == 1.0);
    vec![EffectSpec::Springs {
        points: SpringPoints::Nodes(NodeSet::Indices(nodes)),
        stiffness: 0.3,
    }]
}

fn embedded_springs(mesh: &HexMesh) -> Vec<EffectSpec> {
    let points: Vec<_> = (0..12)
        .map(|i| Vector3::new(0.3 + 0.06 * i as f64, 0.1 + 0.05 * i as f64, 0.5))
        .collect();
    let embedding = hex_mesh::embed(mesh, &points).expect("points in reach");
    vec![EffectSpec::Springs {
        points: SpringPoints::Embedded {
            points: embedding.vertices().to_vec(),
            factors: (0..12).map(|i| 0.1 * i as f64).collect(),
        },
        stiffness: 2.0,
    }]
}

fn gravity(_: &HexMesh) -> Vec<EffectSpec> {
    vec![EffectSpec::Gravity {
        acceleration: [0.0, 0.1, -0.4],
        density: 1.3,
    }]
}

fn region_where_x_is_above_half() -> NodeRegion {
    NodeRegion::HalfSpace {
        normal: [1.0, 0.0, 0.0],
        offset: 0.5,
    }
}

fn soft_and_stiff(mesh: &HexMesh) -> Vec<EffectSpec> {
    let painted = (0..mesh.elements().len()).map(|e| (e % 5) as f64 / 4.0);
    vec![
        EffectSpec::Stiffness {
            elements: ElementSet::Region(region_where_x_is_above_half()),
            factor: 40.0,
        },
        EffectSpec::Stiffness {
            elements: ElementSet::Painted(painted.collect()),
            factor: 0.2,
        },
    ]
}

fn half_passive(_: &HexMesh) -> Vec<EffectSpec> {
    vec![EffectSpec::Activation {
        elements: ElementSet::Region(region_where_x_is_above_half()),
        scale: 0.25,
    }]
}

fn volume(_: &HexMesh) -> Vec<EffectSpec> {
    vec![EffectSpec::Volume { stiffness: 5.0 }]
}

fn pressure(_: &HexMesh) -> Vec<EffectSpec> {
    let all = EffectSpec::Pressure {
        region: None,
        capped: false,
        pressure: 0.1,
    };
    let end = EffectSpec::Pressure {
        region: Some(region_where_x_is_above_half()),
        capped: true,
        pressure: -0.05,
    };
    vec![all, end]
}

fn force_and_wind(_: &HexMesh) -> Vec<EffectSpec> {
    vec![
        EffectSpec::Force {
            region: Some(region_where_x_is_above_half()),
            force: [0.0, 0.05, -0.1],
        },
        EffectSpec::Wind {
            region: None,
            pressure: [-0.1, 0.0, 0.05],
        },
    ]
}

fn inertia(scheme: TimeScheme) -> EffectSpec {
    EffectSpec::Inertia {
        density: 1.5,
        time_step: 0.7,
        scheme,
    }
}

fn euler(_: &HexMesh) -> Vec<EffectSpec> {
    vec![inertia(TimeScheme::BackwardEuler)]
}

fn damped_midpoint(_: &HexMesh) -> Vec<EffectSpec> {
    vec![
        inertia(TimeScheme::Midpoint),
        EffectSpec::Damping { viscosity: 0.8 },
    ]
}

/// A plane below and a tilted sheet above, both near enough to be felt, and what the body has of itself.
fn contact(_: &HexMesh) -> Vec<EffectSpec> {
    let sheet = Obstacle::Surface {
        vertices: vec![
            [0.31, 0.12, 0.56],
            [0.93, 0.17, 0.59],
            [0.88, 0.64, 0.57],
            [0.27, 0.69, 0.58],
        ],
        triangles: vec![[0, 1, 2], [0, 2, 3]],
    };
    let plane = Obstacle::Plane {
        normal: [0.02, 0.03, 1.0],
        offset: -0.07,
    };
    vec![EffectSpec::Contact {
        region: None,
        distance: 0.11,
        stiffness: Some(0.7),
        own: true,
        obstacles: vec![plane, sheet],
    }]
}

fn everything(mesh: &HexMesh) -> Vec<EffectSpec> {
    let mut all = springs_at_nodes(mesh);
    all.extend(gravity(mesh));
    all.extend(embedded_springs(mesh));
    all.extend(soft_and_stiff(mesh));
    all.extend(half_passive(mesh));
    all.extend(volume(mesh));
    all.extend(pressure(mesh));
    all.extend(force_and_wind(mesh));
    all.extend(damped_midpoint(mesh));
    all
}

conformance!(elasticity_one_sample, Quadrature::One, |_| vec![]);
conformance!(elasticity_eight_samples, Quadrature::Eight, |_| vec![]);
conformance!(elasticity_27_samples, Quadrature::TwentySeven, |_| vec![]);
conformance!(nodal_springs, Quadrature::Eight, springs_at_nodes);
conformance!(point_springs, Quadrature::Eight, embedded_springs);
// Third derivatives jump where nearest features change.
conformance!(touching, Quadrature::Eight, contact, (1e-6, 1e-6));
conformance!(weight, Quadrature::Eight, gravity);
conformance!(stiffness_field, Quadrature::Eight, soft_and_stiff);
conformance!(activation_mask, Quadrature::Eight, half_passive);
conformance!(kept_volume, Quadrature::Eight, volume);
conformance!(pressed_walls, Quadrature::Eight, pressure);
conformance!(loads_on_the_surface, Quadrature::Eight, force_and_wind);
conformance!(backward_euler, Quadrature::Eight, euler);
conformance!(midpoint_with_damping, Quadrature::Eight, damped_midpoint);
conformance!(all_effects, Quadrature::One, everything);

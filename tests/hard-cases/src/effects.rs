//! Effects beside elasticity, where they are at their worst.

mod cavities;
mod contact;
mod motion;
mod volume;

use crate::body::{Body, METHODS, elasticity, held, max_distance, name, nodes_where};
use crate::case::{Case, Entry, Finding, Section};
use crate::check::{checked_solve, gradient_holds};
use hex_mesh::{HexMesh, NodeRegion, Quadrature};
use nalgebra::Vector3;
use pd_solver::{
    AdjointOptions, AdjointStatus, EffectSpec, ElementSet, SolveOptions, Status, Stop,
};

pub fn cases() -> Vec<Case> {
    let all: [Entry; 17] = [
        (
            "cavity nearly closed",
            "an opening of one cell: refused, and told where, unless it is capped; capped, it holds the volume of a closed one and pushes nowhere",
            |_| cavities::nearly_closed(),
        ),
        (
            "pressure without equilibrium",
            "a cavity blown up so hard that volume wins over elasticity however far it goes: no method may call anything an end",
            |_| cavities::bursts(),
        ),
        (
            "pressure of zero",
            "a cavity without pressure: not a bit changes, and the gradient by the pressure is there",
            |_| cavities::without_pressure(),
        ),
        (
            "volume inside out",
            "a mirrored body that keeps its volume: the nearest matrix of determinant 1 is far from all of it",
            |_| volume::finds_rest(|x| Vector3::new(-x.x, x.y, x.z)),
        ),
        (
            "volume crushed to a point",
            "every free node stands where the others do, and volume is to be kept",
            |_| volume::finds_rest(|_| Vector3::repeat(0.3)),
        ),
        (
            "volume crushed to a plane",
            "no volume at all, and no direction in which there is some",
            |_| volume::finds_rest(|x| Vector3::new(x.x, x.y, 0.5)),
        ),
        (
            "volume a thousand times stiffer",
            "next to incompressible, pulled to 1.4 times its length: the volume stays, and nothing locks",
            |_| volume::pulled(),
        ),
        (
            "stiff beside soft, 1e4",
            "a bar of two materials that is pulled: springs in series",
            |_| in_series(1e4),
        ),
        (
            "stiff beside soft, 1e6",
            "the same with a contrast of a million, where the stiff part stretches by a billionth of its length",
            |_| in_series(1e6),
        ),
        (
            "passive everywhere",
            "no material follows an actuation that would turn it inside out: the body stays at rest, and its gradient is zero",
            |_| passive(),
        ),
        (
            "huge time step",
            "a million units of time at once: the end is the static equilibrium, and energy does not grow",
            |_| motion::huge_step(),
        ),
        (
            "tiny time step",
            "a billionth of a unit of time: the body flies on as it flew",
            |_| motion::tiny_step(),
        ),
        (
            "huge viscosity",
            "friction a billion times the stiffness: what is bent stays bent",
            |_| motion::viscous(false),
        ),
        (
            "huge viscosity, flying",
            "the same in free flight, turning: strain stays (midpoint, which goes on in a straight line, but for its order), linear momentum too",
            |_| motion::viscous(true),
        ),
        (
            "contact at first touch",
            "a face that stands exactly where the barrier begins: nothing is felt, and not a bit changes",
            |_| contact::first_touch(),
        ),
        (
            "contact from deep",
            "a face a thousandth of the barrier's distance over the floor, and weight: it is pushed off, and nothing passes",
            |_| contact::deep_start(),
        ),
        (
            "contact from behind",
            "a start that stands in the floor: refused, and told where",
            |_| contact::through_the_floor(),
        ),
    ];
    all.into_iter()
        .map(|(name, story, run)| Case::new(Section::Effects, format!("effect {name}"), story, run))
        .collect()
}

/// A bar of cubes of a quarter, held at x = 0, with more effects.
fn bar(cells: [usize; 3], extra: Vec<EffectSpec>) -> Body {
    let mesh = HexMesh::solid_box(cells, 0.25, Quadrature::Eight).expect("a valid box");
    let wall = nodes_where(&mesh, |x| x.x == 0.0);
    let effects = [vec![elasticity(), held(wall)], extra].concat();
    Body::on_boundary(mesh, &effects)
}

fn beyond(x: f64) -> NodeRegion {
    NodeRegion::HalfSpace {
        normal: [1.0, 0.0, 0.0],
        offset: x,
    }
}

/// The second half of a bar is stiffer, or softer; each half stretches by the force over its stiffness.
fn in_series(contrast: f64) -> Finding {
    let mut finding = Finding::default();
    for factor in [contrast, 1.0 / contrast] {
        let force = 1e-3 * f64::min(factor, 1.0);
        let mut body = bar(
            [16, 4, 4],
            vec![
                EffectSpec::Stiffness {
                    elements: ElementSet::Region(beyond(2.0)),
                    factor,
                },
                EffectSpec::Force {
                    region: Some(beyond(4.0)),
                    force: [force, 0.0, 0.0],
                },
            ],
        );
        body.stiffest = f64::max(factor, 1.0);
        let parameters = body.solver.rest_parameters();
        for method in METHODS {
            let options = SolveOptions {
                max_iterations: 20_000,
                ..SolveOptions::new(Stop::RelativeGradient(1e-10)).with_method(method)
            };
            let (solution, part) = checked_solve(&mut body, &parameters, None, &options);
            finding.merge(part);
            finding.require(solution.status == Status::Converged, || {
                format!("{} at {factor:e}: {:?}", name(method), solution.status)
            });
            let mean = |at: f64| {
                let nodes = nodes_where(&body.mesh, |x| x.x == at);
                let sum: f64 = nodes
                    .iter()
                    .map(|&n| solution.positions[n as usize].x)
                    .sum();
                sum / nodes.len() as f64 - at
            };
            let (near, far) = (mean(2.0), mean(4.0) - mean(2.0));
            // Two units long, of area one.
            let exact = [2.0 * force, 2.0 * force / factor];
            // The end shares the force by its triangles, which is not quite even, and the halves meet in a face that neither moves alone.
            let off = (near / exact[0] - 1.0)
                .abs()
                .max((far / exact[1] - 1.0).abs());
            finding.require(off < 2e-3, || {
                format!(
                    "{} at {factor:e}: {off:.1e} off springs in series",
                    name(method)
                )
            });
            if method == METHODS[4] {
                finding.merge(gradient_holds(&mut body, &parameters, &solution, method));
            }
        }
    }
    finding
}

/// An actuation beyond all sense, and a scale of zero.
fn passive() -> Finding {
    let everywhere = EffectSpec::Activation {
        elements: ElementSet::Region(beyond(-1.0)),
        scale: 0.0,
    };
    let mut body = bar([9, 4, 4], vec![everywhere]);
    let parameters = body.actuated(|e, s| {
        let t = (e * 8 + s) as f64;
        std::array::from_fn(|i| 5.0 * (t * (i + 1) as f64).sin())
    });
    let mut finding = Finding::default();
    for method in METHODS {
        let options = SolveOptions::new(Stop::Accuracy(1e-9)).with_method(method);
        let (solution, part) = checked_solve(&mut body, &parameters, None, &options);
        finding.merge(part);
        let moved = max_distance(&solution.positions, body.mesh.nodes());
        finding.require(
            solution.status == Status::Converged && moved < 1e-12,
            || {
                format!(
                    "{}: {:?}, moved by {moved:.1e}",
                    name(method),
                    solution.status
                )
            },
        );
        let cotangent = vec![Vector3::new(1.0, -0.5, 0.25); solution.positions.len()];
        let options = AdjointOptions::default();
        let adjoint = body
            .solver
            .adjoint(&parameters, &solution, &cotangent, &options)
            .expect("a state of this body");
        finding.require(adjoint.status == AdjointStatus::Converged, || {
            format!("{}: adjoint {:?}", name(method), adjoint.status)
        });
        let zero =
            { adjoint.gradient }.is_some_and(|g| g.actuation.iter().flatten().all(|b| *b == 0.0));
        finding.require(zero, || {
            format!("{}: passive material has a gradient", name(method))
        });
    }
    finding
}

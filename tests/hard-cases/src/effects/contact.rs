//! Contact at its first touch, as deep as it goes, and where it must refuse.

use super::{Body, Finding, bar, checked_solve, gradient_holds};
use pd_solver::{EffectSpec, Method, Obstacle, SolveOptions, SolverError, Status, Stop};

const DISTANCE: f64 = 0.05;

/// A bar that is held at one end over a floor `gap` below it, which it may touch.
fn over_floor(gap: f64, load: f64) -> Body {
    bar(
        [6, 3, 3],
        vec![
            EffectSpec::Gravity {
                acceleration: [0.0, 0.0, -load],
                density: 1.0,
            },
            EffectSpec::Contact {
                region: None,
                distance: DISTANCE,
                stiffness: None,
                own: false,
                obstacles: vec![Obstacle::Plane {
                    normal: [0.0, 0.0, 1.0],
                    offset: -gap,
                }],
            },
        ],
    )
}

/// The smallest distance from the floor, where any is felt.
fn nearest(body: &mut Body, u: &[nalgebra::Vector3<f64>]) -> Option<f64> {
    let reports = body.solver.contact_reports(u).ok()?;
    reports.first()?.nearest
}

/// All of the lower face stands exactly where the barrier begins: nothing is felt, and nothing moves.
pub(super) fn first_touch() -> Finding {
    let mut body = over_floor(DISTANCE, 0.0);
    let parameters = body.solver.rest_parameters();
    let options = SolveOptions::new(Stop::Accuracy(1e-9));
    let (solution, mut finding) = checked_solve(&mut body, &parameters, None, &options);
    finding.require(solution.status == Status::Converged, || {
        format!("{:?}", solution.status)
    });
    let still = solution.positions == body.mesh.nodes();
    finding.require(still, || "the body moves, with nothing that pushes".into());
    finding
}

/// The lower face stands a thousandth of that distance over the floor, and weight presses: what is pushed up comes to rest at a distance between nothing
/// and that of the barrier, and its gradient is right.
pub(super) fn deep_start() -> Finding {
    let mut body = over_floor(1e-3 * DISTANCE, 0.05);
    let parameters = body.solver.rest_parameters();
    let options = SolveOptions::new(Stop::RelativeGradient(1e-11));
    let (solution, mut finding) = checked_solve(&mut body, &parameters, None, &options);
    finding.require(solution.status == Status::Converged, || {
        format!("{:?}", solution.status)
    });
    let gap = nearest(&mut body, &solution.positions);
    finding.require(gap.is_some_and(|gap| gap > 0.0 && gap < DISTANCE), || {
        format!("rests at a distance of {gap:?}")
    });
    let floor = solution
        .positions
        .iter()
        .map(|x| x.z)
        .fold(f64::INFINITY, f64::min);
    finding.require(floor > -1e-3 * DISTANCE, || {
        "passed through the floor".into()
    });
    let gradient = gradient_holds(&mut body, &parameters, &solution, Method::Newton);
    finding.merge(gradient);
    finding
}

/// A start that stands in the floor is refused, and told where.
pub(super) fn through_the_floor() -> Finding {
    let mut body = over_floor(0.5, 0.0);
    let mut finding = Finding::default();
    let sunk: Vec<_> = { body.mesh.nodes().iter() }
        .map(|x| x - nalgebra::Vector3::z() * (0.7 * x.x))
        .collect();
    let parameters = body.solver.rest_parameters();
    let options = SolveOptions::new(Stop::Accuracy(1e-9));
    let refused = body.solver.solve(&parameters, Some(&sunk), &options).err();
    let told = matches!(&refused, Some(SolverError::Intersects { .. }));
    finding.require(told, || format!("{refused:?}"));
    finding
}

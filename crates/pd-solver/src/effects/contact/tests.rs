//! The effect as a whole against sums over all pairs there are, and limits of motions that can be told by hand.

use super::broad::Near;
use super::distance::tests::{Numbers, slope};
use super::*;
use crate::spec::Obstacle;
use crate::surface::EmbeddedSurface;
use crate::vector::{add_scaled, dot, zeros};
use hex_mesh::{HexMesh, Quadrature, embed};

pub(super) const DHAT: f64 = 0.3;
const STIFFNESS: f64 = 2.0;
pub(super) const INDEX: usize = 5;
/// Obstacles of other effects before those of this one, and behind.
const FIRST: usize = 2;

/// Two blocks of `n` cells along each edge of length 1, one above the other by 0.5.
pub(super) fn blocks(n: i32) -> HexMesh {
    let gap = n + n.div_euclid(2);
    let cube = (0..n).flat_map(|x| (0..n).flat_map(move |y| (0..n).map(move |z| [x, y, z])));
    let cells = cube.flat_map(|[x, y, z]| [[x, y, z], [x, y, z + gap]]);
    let corner = Vector3::new(-0.5, -0.5, 0.0);
    HexMesh::from_cells(
        cells.collect(),
        corner,
        1.0 / f64::from(n),
        Quadrature::Eight,
    )
    .unwrap()
}

/// A triangle beside the lower block by 0.2, and two above the upper one by 0.2.
fn sheets() -> [Obstacle; 2] {
    let beside = vec![[0.7, -0.3, 0.2], [0.7, 0.35, 0.3], [0.7, 0.05, 0.9]];
    let above = [[-0.3, -0.3], [0.4, -0.2], [0.35, 0.4], [-0.2, 0.3]];
    let sheet = |vertices, triangles: &[[u32; 3]]| Obstacle::Surface {
        vertices,
        triangles: triangles.to_vec(),
    };
    [
        sheet(beside, &[[0, 1, 2]]),
        sheet(
            above.map(|[x, y]| [x, y, 2.7]).to_vec(),
            &[[0, 1, 2], [0, 2, 3]],
        ),
    ]
}

/// Below the lower block by 0.2, and at its side by 0.25; their normals are of any length.
pub(super) fn planes() -> [Obstacle; 2] {
    let plane = |normal, offset| Obstacle::Plane { normal, offset };
    [plane([0.0, 0.0, 2.0], -0.4), plane([3.0, 0.0, 0.0], -2.25)]
}

/// Planes first and last.
pub(super) fn all_obstacles() -> Vec<Obstacle> {
    let ([beside, above], [floor, wall]) = (sheets(), planes());
    vec![floor, beside, above, wall]
}

pub(super) fn made(
    mesh: &HexMesh,
    surface: &EmbeddedSurface,
    own: bool,
    distance: f64,
    obstacles: &[Obstacle],
) -> Result<Contact, SolverError> {
    let settings = ContactSettings {
        touching: &vec![true; surface.points.len()],
        distance,
        stiffness: STIFFNESS,
        own,
        obstacles,
        first: FIRST,
    };
    Contact::new(mesh, surface, &settings, INDEX)
}

pub(super) fn contact(n: i32, own: bool, obstacles: &[Obstacle]) -> (Contact, NodalVector) {
    let mesh = blocks(n);
    let surface = EmbeddedSurface::boundary(&mesh);
    let contact = made(&mesh, &surface, own, DHAT, obstacles).unwrap();
    (contact, mesh.nodes().to_vec())
}

/// The upper block farther down, and up to `uneven` of noise.
fn lowered(rest: &[Vector3<f64>], by: f64, uneven: f64) -> NodalVector {
    let mut numbers = Numbers(11);
    let mut moved = |x: &Vector3<f64>| {
        let noise = numbers.quad()[0] * uneven;
        x + noise - Vector3::z() * if x.z > 1.25 { by } else { 0.0 }
    };
    rest.iter().map(&mut moved).collect()
}

fn random(count: usize, seed: u64) -> NodalVector {
    let mut numbers = Numbers(seed);
    (0..count).map(|_| numbers.quad()[0]).collect()
}

fn along(u: &[Vector3<f64>], t: f64, way: &[Vector3<f64>]) -> NodalVector {
    let mut out = zeros(u.len());
    add_scaled(u, t, way, &mut out);
    out
}

/// Everything that may touch, however far away.
fn all_pairs(contact: &Contact) -> Vec<Pair> {
    let t = &contact.topology;
    let [points, edges, triangles] =
        [t.rest.len(), t.edges.len(), t.triangles.len()].map(|n| n as u32);
    let faces = (0..points).flat_map(|v| (0..triangles).map(move |f| Near::VertexTriangle(v, f)));
    let lines = (0..edges).flat_map(|e| (e + 1..edges).map(move |f| Near::EdgeEdge(e, f)));
    let is_meant = |pair: &Pair| contact.own || !pair.points.iter().all(|p| t.is_own(*p));
    let pairs = faces.chain(lines).filter_map(|near| t.pair(near));
    pairs.filter(is_meant).collect()
}

pub(super) fn positions(contact: &Contact, u: &[Vector3<f64>]) -> Vec<Vector3<f64>> {
    let mut x = Vec::new();
    contact.gather(u, &mut x);
    x
}

/// Point, normal and distance of all vertices from all planes.
fn all_on_planes(contact: &Contact, x: &[Vector3<f64>]) -> Vec<(usize, Vector3<f64>, f64)> {
    let points = 0..contact.topology.own_points;
    let of = |p: usize| {
        let planes = contact.planes.iter();
        planes.map(move |plane| (p, plane.normal, plane.distance(&x[p])))
    };
    points.flat_map(of).collect()
}

fn energy(contact: &mut Contact, u: &[Vector3<f64>]) -> f64 {
    contact.energy_gradient(u, &mut zeros(u.len()))
}

fn gradient(contact: &mut Contact, u: &[Vector3<f64>]) -> NodalVector {
    let mut out = zeros(u.len());
    contact.energy_gradient(u, &mut out);
    out
}

/// A surface inside the blocks, whose vertices are between nodes.
fn inside() -> (Contact, NodalVector) {
    let mesh = blocks(2);
    let mut surface = EmbeddedSurface::boundary(&mesh);
    let shrunk = |x: &Vector3<f64>| {
        let centre = Vector3::z() * if x.z > 1.25 { 2.0 } else { 0.5 };
        centre + (x - centre) * 0.9
    };
    let x = surface.positions(&mesh, mesh.nodes());
    let x: Vec<_> = x.iter().map(shrunk).collect();
    surface.points = embed(&mesh, &x).unwrap().vertices().to_vec();
    let contact = made(&mesh, &surface, true, DHAT, &all_obstacles()).unwrap();
    (contact, mesh.nodes().to_vec())
}

/// With and without what the surface has of itself, with all kinds of obstacles and with some, and between nodes.
fn cases() -> Vec<(Contact, NodalVector)> {
    let all = all_obstacles();
    let cases = [
        (true, &all[..]),
        (false, &all[..]),
        (true, &all[..1]),
        (true, &[]),
    ];
    let made = cases.map(|(own, obstacles)| contact(4, own, obstacles));
    let all = made.into_iter().chain([inside()]);
    let lower = |(contact, rest): (Contact, NodalVector)| (contact, lowered(&rest, 0.37, 0.02));
    all.map(lower).collect()
}

#[test]
fn the_energy_is_the_sum_over_all_pairs_and_planes() {
    let mut tasks = 0;
    for (mut contact, u) in cases() {
        let x = positions(&contact, &u);
        let of_pair = |pair: &Pair| pair.barrier.energy_gradient(&pair.gather(&x)).map(|e| e.0);
        let pairs: Vec<f64> = all_pairs(&contact).iter().filter_map(of_pair).collect();
        let on_planes = all_on_planes(&contact, &x);
        let of_plane = |(p, _, d): &(usize, Vector3<f64>, f64)| {
            above_plane(contact.topology.strength(*p), DHAT, *d)[0]
        };
        let planes: Vec<f64> = on_planes.iter().map(of_plane).collect();
        let parts: Vec<f64> = [pairs, planes].concat();
        let expected: f64 = parts.iter().sum();
        let found = energy(&mut contact, &u);
        assert!(expected > 1e-3 && (found / expected - 1.0).abs() < 1e-12);
        tasks = tasks.max(contact.list.pairs.len() / CHUNK);
        // What is seen of all this: how much of it there is, and the nearest.
        let apart = |pair: &Pair| {
            let squared = distance::squared_distance(pair.barrier.kind, &pair.gather(&x));
            Some(squared.sqrt()).filter(|d| *d < pair.barrier.dhat)
        };
        let pairs = all_pairs(&contact);
        let near = pairs.iter().filter_map(apart);
        let near = near.chain(on_planes.iter().map(|(_, _, d)| *d).filter(|d| *d < DHAT));
        let near: Vec<f64> = near.collect();
        let report = contact.contact_report(&u).unwrap();
        assert_eq!((report.index, report.felt), (INDEX, near.len()));
        let nearest = near.into_iter().fold(f64::INFINITY, f64::min);
        assert!((report.nearest.unwrap() - nearest).abs() < 1e-12);
    }
    assert!(tasks >= 2, "{tasks}");
}

#[test]
fn nothing_near_is_nothing_felt() {
    let (mut contact, rest) = contact(2, true, &all_obstacles()[2..3]);
    let far: NodalVector = rest.iter().map(|x| x - Vector3::z()).collect();
    assert_eq!(energy(&mut contact, &far), 0.0);
    let report = contact.contact_report(&far).unwrap();
    assert_eq!((report.felt, report.nearest), (0, None));
    assert!(contact.touches(&far).is_empty());
}

#[test]
fn the_gradient_is_the_slope_of_the_energy() {
    for (mut contact, u) in cases() {
        for seed in 0..4 {
            let way = random(u.len(), 100 + seed);
            let expected = slope(1e-6, |t| energy(&mut contact, &along(&u, t, &way)));
            let found = dot(&gradient(&mut contact, &u), &way);
            assert!((found - expected).abs() < 1e-6 * expected.abs().max(1.0));
        }
    }
}

#[test]
fn products_are_slopes_of_the_gradient() {
    for (mut contact, u) in cases() {
        for seed in 0..4 {
            let (way, other) = (random(u.len(), 200 + seed), random(u.len(), 300 + seed));
            let at =
                |contact: &mut Contact, t| dot(&gradient(contact, &along(&u, t, &way)), &other);
            let expected = slope(1e-8, |t| at(&mut contact, t));
            contact.linearise(&u);
            // It is added to what is there.
            let mut product = other.clone();
            contact.hessian_product(&way, &mut product);
            let found = dot(&product, &other) - dot(&other, &other);
            assert!(
                (found - expected).abs() < 1e-5 * expected.abs().max(1.0),
                "{found} {expected}"
            );
        }
    }
}

/// The derivative by where obstacles are goes to their places among those of all effects.
#[test]
fn what_obstacles_change_is_the_slope_of_the_gradient() {
    let (mut contact, rest) = contact(2, true, &all_obstacles());
    let u = lowered(&rest, 0.37, 0.02);
    let count = contact.obstacle_points.len();
    let mut obstacles = random(FIRST + count + 3, 7);
    obstacles[FIRST..][..count].copy_from_slice(&contact.obstacle_points);
    for seed in 0..4 {
        let (z, way) = (
            random(u.len(), 400 + seed),
            random(obstacles.len(), 500 + seed),
        );
        let at = |t| {
            contact.set_obstacles(&along(&obstacles, t, &way));
            dot(&gradient(&mut contact, &u), &z)
        };
        let expected = -slope(1e-8, at);
        let parameters = Parameters {
            obstacles: obstacles.clone(),
            ..Parameters::default()
        };
        contact.set_obstacles(&along(&obstacles, 1.0, &way));
        contact.set_parameters(&parameters);
        assert_eq!(contact.obstacle_points, obstacles[FIRST..][..count]);
        contact.linearise(&u);
        let mut out = Parameters {
            obstacles: zeros(obstacles.len()),
            ..Parameters::default()
        };
        contact.parameter_vjp(&u, &z, &mut out);
        let found = dot(&out.obstacles, &way);
        assert!(expected.abs() > 1e-3);
        assert!(
            (found - expected).abs() < 1e-5 * expected.abs().max(1.0),
            "{found} {expected}"
        );
    }
}

/// Forms over nodes are those over points, of which obstacles have none.
#[test]
fn touches_are_the_stiffest_forms_of_all_that_is_felt() {
    for (mut contact, u) in cases() {
        let x = positions(&contact, &u);
        let z = random(u.len(), 31);
        let mut at_points = positions(&contact, &z);
        at_points[contact.topology.own_points..].fill(Vector3::zeros());
        let of_pair = |pair: &Pair| {
            let form = pair.barrier.stiffest(&pair.gather(&x))?;
            let z = pair.gather(&at_points);
            Some((0..4).map(|k| part(&form, k).dot(&z[k])).sum::<f64>())
        };
        let on_plane = |(p, normal, d): (usize, Vector3<f64>, f64)| {
            let [_, _, bend] = above_plane(contact.topology.strength(p), DHAT, d);
            (bend > 0.0).then(|| bend.sqrt() * normal.dot(&at_points[p]))
        };
        let planes = all_on_planes(&contact, &x).into_iter().filter_map(on_plane);
        let mut expected: Vec<f64> = planes.collect();
        expected.extend(all_pairs(&contact).iter().filter_map(of_pair));
        let touches = contact.touches(&u);
        let of_form = |form: &Form| {
            form.iter()
                .map(|(n, v)| v.dot(&z[*n as usize]))
                .sum::<f64>()
        };
        let mut found: Vec<f64> = touches.iter().map(of_form).collect();
        for values in [&mut expected, &mut found] {
            values.sort_by(f64::total_cmp);
        }
        assert_eq!(found.len(), expected.len());
        let off = found.iter().zip(&expected).map(|(a, b)| (a - b).abs());
        assert!(off.fold(0.0, f64::max) < 1e-10);
        // Nodes are named once in a form, and none for nothing.
        for form in &touches {
            let mut nodes: Vec<u32> = form.iter().map(|(n, _)| *n).collect();
            nodes.sort_unstable();
            nodes.dedup();
            assert_eq!(nodes.len(), form.len());
            assert!(form.iter().all(|(_, v)| *v != Vector3::zeros()));
        }
    }
}

#[test]
fn the_largest_diagonal_is_that_of_the_largest_vertex_at_about_half_the_distance() {
    let (contact, _) = contact(2, true, &planes());
    let strengths = (0..contact.topology.own_points).map(|p| contact.topology.strength(p));
    let strongest = strengths.fold(0.0, f64::max);
    assert_eq!(contact.largest_diagonal(), TYPICAL * strongest / DHAT);
    assert!(contact.limits_steps() && !contact.is_bounded());
}

/// A motion ends where a tenth of the distance is left; sheets and planes are 0.2 and 0.25 away, the blocks 0.5 from each other.
#[test]
fn steps_keep_a_tenth_of_all_distances() {
    let down = |by: f64| move |x: &Vector3<f64>| x - Vector3::z() * by;
    let upper = |by: f64| move |x: &Vector3<f64>| down(if x.z > 1.25 { by } else { 0.0 })(x);
    let aside = |by: f64| move |x: &Vector3<f64>| x + Vector3::x() * by;
    let share = |own, obstacles: &[&Obstacle], to: &dyn Fn(&Vector3<f64>) -> Vector3<f64>| {
        let obstacles: Vec<Obstacle> = obstacles.iter().map(|o| (*o).clone()).collect();
        let (mut contact, rest) = contact(2, own, &obstacles);
        let to: NodalVector = rest.iter().map(to).collect();
        contact.step_limit(&rest, &to)
    };
    let is = |found: f64, expected: f64| {
        assert!(
            (found - expected).abs() < 1e-9,
            "{found} instead of {expected}"
        );
    };
    let ([floor, wall], [beside, above]) = (planes(), sheets());
    is(share(false, &[&floor], &down(0.5)), 0.9 * 0.2 / 0.5);
    is(share(false, &[&floor], &down(0.17)), 1.0);
    is(share(false, &[&floor], &down(0.19)), 0.18 / 0.19);
    is(share(false, &[&floor], &down(-3.0)), 1.0);
    is(share(false, &[&floor], &down(-0.05)), 1.0);
    // The nearer end of two.
    let turned = |x: &Vector3<f64>| x - Vector3::new(0.3, 0.0, 0.5);
    is(share(false, &[&floor, &wall], &turned), 0.36);
    is(share(false, &[&wall], &turned), 0.9 * 0.25 / 0.3);
    is(share(true, &[], &upper(1.0)), 0.45);
    is(share(true, &[], &upper(0.44)), 1.0);
    is(share(false, &[], &upper(1.0)), 1.0);
    is(share(false, &[&beside], &aside(0.6)), 0.3);
    is(share(false, &[&above], &down(-0.5)), 0.36);
    is(
        share(true, &[&above, &beside, &floor, &wall], &upper(4.0)),
        0.45 / 4.0,
    );
    // A step that leads nowhere is for the energy to refuse.
    is(
        share(true, &planes().each_ref(), &|_| Vector3::repeat(f64::NAN)),
        1.0,
    );
}

/// What moves with an obstacle keeps its distance; what stands in its way does not.
#[test]
fn body_and_obstacles_move_together_as_far_as_both_may() {
    let (mut contact, rest) = contact(2, true, &all_obstacles());
    let count = contact.obstacle_points.len();
    let moved = |by: f64| {
        let mut all = random(FIRST + count + 3, 9);
        let ends = contact
            .obstacle_points
            .iter()
            .map(|x| x - Vector3::z() * by);
        all[FIRST..][..count]
            .iter_mut()
            .zip(ends)
            .for_each(|(x, end)| *x = end);
        all
    };
    let (still, pressed) = (moved(0.0), moved(0.5));
    let mut is = |to: &[Vector3<f64>], obstacles: &[Vector3<f64>], expected: f64| {
        let found = contact.motion_limit(&rest, to, obstacles);
        assert!(
            (found - expected).abs() < 1e-9,
            "{found} instead of {expected}"
        );
    };
    is(&rest, &still, 1.0);
    is(&rest, &pressed, 0.36);
    is(&lowered(&rest, 0.4, 0.0), &pressed, 1.0);
}

/// Along the way that a limit was asked for nothing is searched for again, nor near where the list was made.
#[test]
fn a_limit_leaves_a_list_that_serves_all_of_the_way() {
    let (mut contact, rest) = contact(2, true, &all_obstacles());
    assert!(contact.intersection(&rest).is_none());
    let before = contact.queries();
    let near = lowered(&rest, 0.02, 0.0);
    assert_eq!(contact.step_limit(&rest, &near), 1.0);
    assert_eq!(contact.queries(), before);
    let far = lowered(&rest, 1.0, 0.0);
    let share = contact.step_limit(&rest, &far);
    assert_eq!(contact.queries(), before + 1);
    let ways: NodalVector = far.iter().zip(&rest).map(|(a, b)| a - b).collect();
    for t in [1.0, 0.5, 0.0] {
        energy(&mut contact, &along(&rest, share * t, &ways));
    }
    assert_eq!(contact.queries(), before + 1);
    // A solve begins with a search of its own.
    assert!(contact.intersection(&rest).is_none());
    assert_eq!(contact.queries(), before + 2);
}

//! The parts of the cycle against plain sums, on bodies of many shapes.

use super::element_matrix::{CoreSum, ZERO, add_galerkin};
use super::*;
use crate::vector::{dot, norm};
use hex_mesh::{HexMesh, Quadrature, QuadratureRule};
use nalgebra::Matrix3;
use polar_grad::testing::Random;

/// Cells of a box for which `keep` holds.
fn cells(n: [i32; 3], keep: impl Fn([i32; 3]) -> bool) -> Vec<[i32; 3]> {
    let all = (0..n[0])
        .flat_map(|x| (0..n[1]).flat_map(move |y| (0..n[2]).map(move |z| [x - 3, y + 2, z])));
    all.filter(|c| keep([c[0] + 3, c[1] - 2, c[2]])).collect()
}

/// Bodies with odd extents, thin, bent, hollow, of two pieces, touching in an edge, and numbered backwards.
fn bodies() -> Vec<(&'static str, HexMesh)> {
    let shapes = [
        ("box", cells([12, 7, 9], |_| true)),
        ("one thick along x", cells([1, 12, 13], |_| true)),
        ("one thick along y", cells([11, 1, 12], |_| true)),
        ("one thick along z", cells([12, 13, 1], |_| true)),
        ("rod", cells([40, 1, 1], |_| true)),
        ("L", cells([13, 4, 13], |c| c[0] < 4 || c[2] < 4)),
        (
            "hollow",
            cells([9, 9, 9], |c| c.iter().any(|x| !(2..7).contains(x))),
        ),
        ("two pieces", cells([13, 6, 5], |c| c[0] < 5 || c[0] > 6)),
        (
            "two that touch in an edge",
            cells([10, 10, 4], |c| (c[0] < 5) == (c[1] < 5)),
        ),
        ("comb", cells([12, 6, 6], |c| c[2] < 2 || c[0] % 2 == 0)),
        (
            "two flaps",
            cells([12, 8, 14], |c| {
                c[2] < 10 || c[0] == 7 || (c[0] < 2 && c[1] < 3)
            }),
        ),
    ];
    let mut all = Vec::new();
    for (name, cells) in shapes {
        let backwards = cells.iter().rev().copied().collect();
        for (cells, name) in [(cells, name), (backwards, "backwards")] {
            let origin = Vector3::new(0.3, -1.0, 2.0);
            let mesh = HexMesh::from_cells(cells, origin, 0.1, Quadrature::Eight).unwrap();
            all.push((name, mesh));
        }
    }
    all
}

/// Nodes in the lowest layer along x of every connected piece.
fn held(mesh: &HexMesh) -> Vec<u32> {
    let x = |n: u32| mesh.nodes()[n as usize].x;
    let low = mesh.nodes().iter().map(|p| p.x).fold(f64::MAX, f64::min);
    let all = 0..mesh.nodes().len() as u32;
    all.filter(|&n| x(n) < low + 0.05 || (x(n) - low - 0.7).abs() < 0.01)
        .collect()
}

fn random_state(mesh: &HexMesh, random: &mut Random) -> NodalVector {
    let noise = |x: &Vector3<f64>| x * 1.1 + random.matrix().column(0) * 0.01;
    mesh.nodes().iter().map(noise).collect()
}

fn multigrid(mesh: &HexMesh) -> Multigrid {
    keeping_volume(mesh, 0.0)
}

/// With a stiffness against changes of volume; that of elasticity is 3.
fn keeping_volume(mesh: &HexMesh, stiffness: f64) -> Multigrid {
    let held = held(mesh);
    let hierarchy = Hierarchy::new(mesh, &held, None).expect("a hierarchy");
    let forms = vec![Vec::new(); hierarchy.grids.len()];
    Multigrid::new(hierarchy, (3.0, stiffness), 8, forms)
}

/// Stiff forms over nodes that share an element, and over nodes that share none.
fn touching(mesh: &HexMesh, random: &mut Random) -> Vec<Form> {
    let count = mesh.nodes().len() as u32;
    let mut vector = || random.matrix().column(0).into_owned() * 20.0;
    let near = mesh.elements().iter().step_by(7);
    let mut forms: Vec<Form> = near
        .map(|e| vec![(e[0], vector()), (e[6], vector())])
        .collect();
    let far = (0..count / 2).step_by(11);
    forms.extend(far.map(|n| vec![(n, vector()), (count - 1 - n, vector())]));
    forms
}

/// Interpolation reproduces every linear function; each coarse grid holds the whole volume and as many pieces as the fine one.
#[test]
fn coarse_grids_carry_the_body() {
    for (name, mesh) in bodies() {
        let hierarchy = Hierarchy::new(&mesh, &held(&mesh), None).expect(name);
        let pieces = |grid: &Grid| {
            let mut sets = DisjointSets::new(grid.node_count());
            for nodes in &grid.elements {
                nodes.iter().for_each(|&n| sets.join(nodes[0], n));
            }
            (0..grid.node_count() as u32)
                .filter(|&n| sets.root(n) == n)
                .count()
        };
        for (pair, transfer) in hierarchy.grids.windows(2).zip(&hierarchy.transfers) {
            let (fine, coarse) = (&pair[0], &pair[1]);
            for node in 0..fine.node_count() {
                let from: Vector3<f64> = transfer
                    .interpolation
                    .row(node)
                    .map(|(c, w)| coarse.position(c as usize) * w as f64)
                    .sum();
                let away = (from - fine.position(node)).norm();
                assert!(away < 1e-6, "{name}: {away:e}");
            }
            let volume = |g: &Grid| (0..g.elements.len()).map(|e| g.volume(e)).sum::<f64>();
            assert!(
                (volume(fine) / volume(coarse) - 1.0).abs() < 1e-12,
                "{name}"
            );
            assert!(
                coarse.fill.iter().all(|&f| f > 0.0 && f < 1.0 + 1e-12),
                "{name}"
            );
            assert_eq!(pieces(fine), pieces(coarse), "{name}");
            assert!(coarse.elements.len() < fine.elements.len(), "{name}");
        }
    }
}

/// The finest operator against the sum over eight points of each element, all with the element's core, in double precision.
#[test]
fn the_finest_operator_is_the_sum_over_all_points() {
    let mut random = Random::new(3);
    for (name, mesh) in bodies() {
        let mut mg = keeping_volume(&mesh, 20.0);
        let touching = touching(&mesh, &mut random);
        mg.set_touches(touching.clone());
        let u = random_state(&mesh, &mut random);
        mg.build(0, &u, Curvature::Projected);
        let grid = &mg.hierarchy.grids[0];
        let x: NodalVector = (0..grid.node_count())
            .map(|_| random.matrix().column(0).into_owned())
            .collect();
        let rule = QuadratureRule::new(Quadrature::Eight);
        let size = grid.size(0);
        let unit = stiffness(&size)[LINEAR[0]];
        let mut expected = vec![Vector3::zeros(); x.len()];
        for (nodes, core) in grid.elements.iter().zip(&mg.cores) {
            for (gradients, weight) in rule.gradients(size.x).iter().zip(&rule.weights) {
                let nodes = || nodes.iter().map(|&n| n as usize).zip(gradients);
                let gradient: Matrix3<f64> = nodes().map(|(n, w)| x[n] * w.transpose()).sum();
                let mut stress = gradient;
                for m in core.as_chunks::<9>().0 {
                    let m = Matrix3::from_row_iterator(m.iter().map(|&m| m as f64));
                    stress -= m * m.dot(&gradient);
                }
                nodes().for_each(|(n, w)| expected[n] += stress * w * (*weight / unit));
            }
        }
        let at_centre = QuadratureRule::new(Quadrature::One).gradients(size.x)[0];
        for nodes in &grid.elements {
            let nodes = || nodes.iter().map(|&n| n as usize).zip(&at_centre);
            let mean = |x: &[Vector3<f64>]| -> Matrix3<f64> {
                nodes().map(|(n, w)| x[n] * w.transpose()).sum()
            };
            let f = mean(&u);
            let normal = f.try_inverse().expect("regular").transpose() * f.determinant();
            let stress = normal * (20.0 / 3.0 * normal.dot(&mean(&x)) / normal.norm_squared());
            nodes().for_each(|(n, w)| expected[n] += stress * w / unit);
        }
        for form in &touching {
            let value: f64 = form.iter().map(|(n, v)| v.dot(&x[*n as usize])).sum();
            let forces = form.iter().map(|(n, v)| (*n, v * (value / mg.unit)));
            forces.for_each(|(n, force)| expected[n as usize] += force);
        }
        let level = &mut mg.levels[0];
        level.layout.pack(&x, 1.0, &mut level.x);
        level.b.fill(0.0);
        level.residual();
        let mut found = x.clone();
        level.layout.unpack(&level.y, -1.0, &mut found);
        let difference: NodalVector = found.iter().zip(&expected).map(|(a, b)| a - b).collect();
        let relative = norm(&difference) / norm(&expected);
        assert!(relative < 1e-5, "{name}: {relative:e}");
        if let Operator::Fine(operator) = &level.operator {
            assert!(
                operator.occupancy() > 0.05,
                "{name}: {}",
                operator.occupancy()
            );
        }
    }
}

/// The matrices next to the finest level are the sums of what its elements' own matrices are on the corners of their parents.
#[test]
fn the_first_coarse_matrices_are_those_of_the_children() {
    let mut random = Random::new(8);
    for (name, mesh) in bodies() {
        let mut mg = multigrid(&mesh);
        mg.build(0, &random_state(&mesh, &mut random), Curvature::Projected);
        let size = mg.hierarchy.grids[0].size(0);
        let scale = 1.0 / stiffness(&size)[LINEAR[0]];
        let mut tables = CoreTables::default();
        let own = tables.number(&size, &[[0.0, 1.0]; 3], 0, scale) as usize;
        let coarse = &mg.coarse[0];
        for (element, found) in coarse.matrices.iter().enumerate() {
            let mut expected = ZERO;
            for child in coarse.children(element) {
                let (mut sum, mut matrix) = (CoreSum::new(), ZERO);
                sum.add(&tables.tables[own], &mg.cores[child.element as usize], 1.0);
                sum.write(&mut matrix);
                add_galerkin(&matrix, &child.interval, child.held, &mut expected);
            }
            let pairs = || {
                let found = found.as_flattened().as_flattened();
                found.iter().zip(expected.as_flattened().as_flattened())
            };
            let error = pairs().map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
            let largest = pairs().map(|(_, b)| b.abs()).fold(0.0, f32::max);
            assert!(error < 1e-5 * largest, "{name} {element}: {error:e}");
        }
    }
}

/// The coarse operator is `P^T A P` with the same P that moves vectors, prescribed nodes left out on both levels; next to the finest
/// level nearly so, for there the cores are left out where they meet hourglass modes.
#[test]
fn coarse_operators_are_galerkin_products() {
    let mut random = Random::new(4);
    for (name, mesh) in bodies() {
        let mut mg = keeping_volume(&mesh, 20.0);
        mg.set_touches(touching(&mesh, &mut random));
        mg.build(0, &random_state(&mesh, &mut random), Curvature::Projected);
        for l in 0..mg.levels.len() - 1 {
            let (fine, coarse) = mg.levels.split_at_mut(l + 1);
            let (fine, coarse) = (&mut fine[l], &mut coarse[0]);
            for node in 0..coarse.held.len() {
                for at in coarse.layout.components(node) {
                    coarse.x[at] = if coarse.held[node] {
                        0.0
                    } else {
                        random.matrix()[0] as f32
                    };
                }
            }
            fine.x.fill(0.0);
            mg.corrections[l].interpolate(&coarse.x, &fine.layout, &mut fine.x);
            fine.b.fill(0.0);
            fine.residual();
            let mut through_fine = coarse.layout.zeros();
            mg.corrections[l].restrict(&fine.y, &coarse.layout, &mut through_fine);
            coarse.b.fill(0.0);
            coarse.residual();
            let (mut error, mut size) = (0.0f64, 0.0f64);
            for node in (0..coarse.held.len()).filter(|&n| !coarse.held[n]) {
                for at in coarse.layout.components(node) {
                    error = error.max((through_fine[at] - coarse.y[at]).abs() as f64);
                    size = size.max(coarse.y[at].abs() as f64);
                }
            }
            assert!(
                error < if l == 0 { 0.2 } else { 2e-5 } * size,
                "{name} level {l}: {error:e} of {size:e}"
            );
        }
    }
}

/// Flaps are smoothed where there are some, as long as they are few: their elements see what those of the body see.
#[test]
fn flaps_are_parts_of_the_body() {
    let mut random = Random::new(6);
    let mut with_flaps = Vec::new();
    for (name, mesh) in bodies() {
        let mut mg = keeping_volume(&mesh, 20.0);
        if mg.flaps.is_none() {
            continue;
        }
        with_flaps.push(name);
        mg.build(0, &random_state(&mesh, &mut random), Curvature::True);
        let level = &mut mg.levels[0];
        for at in (0..level.held.len()).flat_map(|n| level.layout.components(n)) {
            level.x[at] = random.matrix()[0] as f32;
        }
        // With the forces of these very positions there is nothing to smooth.
        level.b.fill(0.0);
        level.residual();
        level.b = level.y.iter().map(|y| -y).collect();
        let before = level.x.clone();
        mg.smooth_flaps(0);
        let change = |level: &Level| {
            let pairs = level.x.iter().zip(&before);
            pairs.map(|(a, b)| (a - b).abs()).fold(0.0, f32::max)
        };
        assert!(
            change(&mg.levels[0]) < 1e-4,
            "{name}: {}",
            change(&mg.levels[0])
        );
        mg.levels[0].b.iter_mut().for_each(|b| *b += 1.0);
        mg.smooth_flaps(0);
        assert!(change(&mg.levels[0]) > 0.01, "{name}");
    }
    assert_eq!(with_flaps, ["two flaps", "backwards"]);
    // Flaps that are held do not bend.
    let (_, mesh) = bodies()
        .into_iter()
        .find(|(name, _)| *name == "two flaps")
        .unwrap();
    let all: Vec<u32> = (0..mesh.nodes().len() as u32).collect();
    let above = |&n: &u32| mesh.nodes()[n as usize].z > 2.95;
    let held: Vec<u32> = all.into_iter().filter(above).collect();
    let hierarchy = Hierarchy::new(&mesh, &held, None).expect("a hierarchy");
    let forms = vec![Vec::new(); hierarchy.grids.len()];
    let multigrid = Multigrid::new(hierarchy, (3.0, 0.0), 8, forms);
    assert!(multigrid.flaps.is_none());
}

/// One cycle is a symmetric positive definite operator, and its result is zero at prescribed nodes.
#[test]
fn the_cycle_is_symmetric_and_positive() {
    let mut random = Random::new(5);
    let cases = bodies().into_iter().flat_map(|body| {
        [(0.0, false), (20.0, false), (20.0, true)].map(|case| (body.clone(), case))
    });
    for ((name, mesh), (stiffness, touches)) in cases {
        let mut mg = keeping_volume(&mesh, stiffness);
        let u = random_state(&mesh, &mut random);
        mg.build(0, &u, Curvature::Projected);
        if touches {
            mg.touch(touching(&mesh, &mut random), &u);
        }
        let held = held(&mesh);
        let mut vector = || -> NodalVector {
            let mut v: NodalVector = (0..mesh.nodes().len())
                .map(|_| random.matrix().column(0).into_owned())
                .collect();
            held.iter().for_each(|&n| v[n as usize] = Vector3::zeros());
            v
        };
        let (a, b) = (vector(), vector());
        let (mut ma, mut mb) = (a.clone(), b.clone());
        mg.apply(0, &a, &mut ma);
        mg.apply(0, &b, &mut mb);
        assert!(
            held.iter().all(|&n| ma[n as usize] == Vector3::zeros()),
            "{name}"
        );
        let (ab, ba) = (dot(&ma, &b), dot(&a, &mb));
        let size = (dot(&a, &ma) * dot(&b, &mb)).sqrt();
        assert!(dot(&a, &ma) > 0.0 && dot(&b, &mb) > 0.0, "{name}");
        assert!(
            (ab - ba).abs() < 1e-4 * size,
            "{name}: {ab:e} {ba:e} of {size:e}"
        );
    }
}

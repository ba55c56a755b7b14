//! Gaps of real bodies: lips, eyelids, fingers, arms and trunk stay apart in the mesh and in the embedding.

mod common;

use std::collections::{BinaryHeap, HashMap};
use std::time::Instant;

use common::{data_file, data_shape, path, share_node};
use hex_mesh::{Embedding, Splitting, VoxelOptions, Voxelised, embed, voxelise};
use nalgebra::Vector3;
use surface_mesh::{MorphedSurface, Surface, read_surface, vertex_normals};

/// Grids at several heights against the body, so that gaps lie anywhere within cells.
fn grids(size: f64) -> impl Iterator<Item = VoxelOptions> {
    let shifts = [0.0, 0.25, 0.5, 0.75].map(|shift| Some(Vector3::repeat(shift * size)));
    let origins = std::iter::once(None).chain(shifts);
    origins.map(move |origin| VoxelOptions {
        origin,
        ..VoxelOptions::new(size)
    })
}

fn embedded(surface: &Surface, options: &VoxelOptions) -> (Voxelised, Embedding) {
    let start = Instant::now();
    let voxelised = voxelise(surface, options).unwrap();
    let voxelise_time = start.elapsed();
    let embedding = voxelised.embed_surface(surface).unwrap();
    let embed_time = start.elapsed() - voxelise_time;
    let report = &voxelised.report;
    eprintln!(
        "{} elements, {} cells split, voxelised in {voxelise_time:?}, embedded in {embed_time:?}",
        report.elements, report.split_cells
    );
    (voxelised, embedding)
}

/// Distances along the edges of the surface from a vertex, up to a limit.
fn along_surface(edges: &[Vec<(u32, f64)>], from: u32, limit: f64) -> HashMap<u32, f64> {
    // Positive floats sort as their bits do.
    let mut queue = BinaryHeap::from([(std::cmp::Reverse(0_u64), from)]);
    let mut done = HashMap::new();
    while let Some((std::cmp::Reverse(bits), vertex)) = queue.pop() {
        let distance = f64::from_bits(bits);
        if done.contains_key(&vertex) {
            continue;
        }
        done.insert(vertex, distance);
        for &(other, length) in &edges[vertex as usize] {
            if distance + length < limit {
                queue.push((std::cmp::Reverse((distance + length).to_bits()), other));
            }
        }
    }
    done
}

fn edges(surface: &Surface) -> Vec<Vec<(u32, f64)>> {
    let mut edges = vec![Vec::new(); surface.vertex_count()];
    for triangle in surface.triangles() {
        for (a, b) in [(0, 1), (1, 2), (2, 0)].map(|(i, j)| (triangle[i], triangle[j])) {
            let [from, to] = [a, b].map(|v| surface.vertices()[v as usize]);
            edges[a as usize].push((b, (to - from).norm()));
            edges[b as usize].push((a, (to - from).norm()));
        }
    }
    edges
}

/// Pairs of vertices that face each other across a gap narrower than `reach` and lie more than `far` apart along the surface.
fn facing_pairs(surface: &Surface, reach: f64, far: f64) -> Vec<[u32; 2]> {
    let vertices = surface.vertices();
    let normals = vertex_normals(vertices, surface.triangles());
    let bin = |v: &Vector3<f64>| -> [i64; 3] { v.map(|x| (x / reach).floor() as i64).into() };
    let mut bins: HashMap<[i64; 3], Vec<u32>> = HashMap::new();
    for (index, vertex) in (0..).zip(vertices) {
        bins.entry(bin(vertex)).or_default().push(index);
    }
    let edges = edges(surface);
    let mut pairs = Vec::new();
    for (a, p) in (0_u32..).zip(vertices) {
        let mut near = Vec::new();
        for step in 0..27 {
            let home = bin(p);
            let steps = [step / 9 - 1, step / 3 % 3 - 1, step % 3 - 1];
            near.extend(
                bins.get(&std::array::from_fn(|i| home[i] + steps[i]))
                    .into_iter()
                    .flatten(),
            );
        }
        near.retain(|&b: &u32| {
            let across = vertices[b as usize] - p;
            let [n, m] = [a, b].map(|v| normals[v as usize]);
            let slant = 0.7 * across.norm();
            b > a && across.norm() < reach && across.dot(&n) > slant && across.dot(&m) < -slant
        });
        if !near.is_empty() {
            let around = along_surface(&edges, a, far);
            pairs.extend(
                { near }
                    .into_iter()
                    .filter(|b| !around.contains_key(b))
                    .map(|b| [a, b]),
            );
        }
    }
    pairs
}

/// No element, and no two that touch, carry vertices that face each other across a gap. `thin` says whether parts of the body are so
/// thin that they have no element within a cell's length at this size: they are carried from where they grow.
fn check_gaps(file: &str, size: f64, thin: bool) {
    let Some(surface) = data_shape(file) else {
        return;
    };
    let pairs = facing_pairs(&surface, size, 5.0 * size);
    assert!(!pairs.is_empty(), "{file} has gaps");
    for options in grids(size) {
        let (voxelised, embedding) = embedded(&surface, &options);
        let mesh = &voxelised.mesh;
        let touching = |embedding: &Embedding| {
            let carrier = |vertex: u32| embedding.vertices()[vertex as usize].element;
            let touch = |[a, b]: &&[u32; 2]| share_node(mesh, carrier(*a), carrier(*b));
            pairs
                .iter()
                .copied()
                .filter(|pair| touch(&pair))
                .collect::<Vec<_>>()
        };
        let by_cube = touching(&embed(mesh, surface.vertices()).unwrap());
        let mut by_part = touching(&embedding);
        eprintln!(
            "{file}: {} pairs across gaps, {} touch by nearest cube, {} by part",
            pairs.len(),
            by_cube.len(),
            by_part.len()
        );
        if thin {
            let is_near = |&vertex: &u32| {
                let carrier = embedding.vertices()[vertex as usize].element as usize;
                let xi =
                    (surface.vertices()[vertex as usize] - mesh.element_corner(carrier)) / size;
                (xi - xi.map(|x| x.clamp(0.0, 1.0))).amax() < 1.0
            };
            by_part.retain(|pair| pair.iter().all(is_near));
        }
        assert!(by_part.is_empty(), "{file} {options:?}: {by_part:?}");
    }
}

/// Fingers thinner than a cell: with thin parts covered, each has elements that it shares with no other.
#[test]
fn covered_fingers_do_not_fuse() {
    let Some(surface) = data_shape("body_makehuman/neutral_body.obj") else {
        return;
    };
    let pairs = facing_pairs(&surface, 0.02, 0.1);
    for options in grids(0.02) {
        let options = VoxelOptions {
            split: Some(Splitting {
                cover_thin: true,
                ..Splitting::default()
            }),
            ..options
        };
        let (voxelised, embedding) = embedded(&surface, &options);
        let carrier = |vertex: u32| embedding.vertices()[vertex as usize].element;
        for [a, b] in pairs.iter().map(|pair| pair.map(carrier)) {
            assert!(!share_node(&voxelised.mesh, a, b), "{options:?}");
        }
        assert!(embedding.max_outside_distance() < 0.02);
        assert!(voxelised.report.relative_volume_error() < 0.025);
    }
}

#[test]
fn nothing_fuses_across_gaps() {
    check_gaps("face_ict/neutral_skin.obj", 0.5, false);
    check_gaps("face_makehuman/neutral_head.obj", 0.005, false);
    check_gaps("body_makehuman/neutral_body.obj", 0.02, true);
    check_gaps("body_makehuman/neutral_body.obj", 0.01, false);
    check_gaps("shapes/penguin.obj", 0.05, false);
}

/// From the hand to the hip beside it, the way leads over the shoulder; from foot to foot, it leads over the crotch.
#[test]
fn arms_and_legs_hang_together_above_only() {
    let Some(surface) = data_shape("body_makehuman/neutral_body.obj") else {
        return;
    };
    for options in grids(0.02) {
        let (Voxelised { mesh, .. }, embedding) = embedded(&surface, &options);
        let carrier = |score: &dyn Fn(&Vector3<f64>) -> f64| {
            let vertices = surface.vertices().iter().zip(embedding.vertices());
            let best = vertices.min_by(|(a, _), (b, _)| score(a).total_cmp(&score(b)));
            best.unwrap().1.element
        };
        let top = |a: u32, b: u32| {
            let path = path(&mesh, a, b);
            assert!(!path.is_empty());
            let heights = path
                .iter()
                .map(|&element| mesh.element_corner(element as usize).y);
            heights.fold(f64::MIN, f64::max)
        };
        let hand = carrier(&|v| v.x);
        let height = mesh.element_corner(hand as usize).y;
        let hip = carrier(&|v| (v.y - height).abs() + (v.x + 0.15).abs());
        let [left, right] = [-0.1, 0.1].map(|x| carrier(&|v| v.y + (v.x - x).abs()));
        eprintln!(
            "tops {} {}, hand at {height}",
            top(hand, hip),
            top(left, right)
        );
        assert!(top(hand, hip) > 1.2);
        assert!((0.7..0.9).contains(&top(left, right)));
    }
}

/// The face with its units.
fn face() -> Option<(Surface, MorphedSurface)> {
    let skin = data_shape("face_ict/neutral_skin.obj")?;
    let units = read_surface(data_file("face_ict/train_units.glb")?).unwrap();
    assert_eq!(skin.vertex_count(), units.surface.vertex_count());
    Some((skin, units))
}

/// How far a unit moves each vertex.
fn motion(units: &MorphedSurface, name: &str) -> Vec<Vector3<f64>> {
    let target = units.target_index(name).unwrap();
    units.targets[target].deltas.clone()
}

/// Across the closed mouth: pairs of a vertex that stays when the jaw opens and one that moves, from the middle of the mouth outwards.
fn lip_pairs(skin: &Surface, units: &MorphedSurface) -> Vec<[u32; 2]> {
    let moved: Vec<f64> = motion(units, "jawOpen").iter().map(|d| d.norm()).collect();
    let most = moved.iter().copied().fold(0.0, f64::max);
    let pairs = facing_pairs(skin, 0.25, 2.0);
    let oriented = pairs.iter().map(|&[a, b]| {
        if moved[a as usize] < moved[b as usize] {
            [a, b]
        } else {
            [b, a]
        }
    });
    let mut pairs: Vec<_> = oriented
        .filter(|pair| {
            let [upper, lower] = pair.map(|v| moved[v as usize]);
            upper < 0.2 * most && lower > 0.4 * most
        })
        .collect();
    let aside = |pair: &[u32; 2]| skin.vertices()[pair[0] as usize].x.abs();
    pairs.sort_by(|a, b| aside(a).total_cmp(&aside(b)));
    pairs
}

#[test]
fn lips_are_separate() {
    let Some((skin, units)) = face() else { return };
    let pairs = lip_pairs(&skin, &units);
    let aside = |vertex: u32| skin.vertices()[vertex as usize].x.abs();
    let corner = pairs.iter().map(|pair| aside(pair[0])).fold(0.0, f64::max);
    eprintln!("{} pairs, the last {corner} cm aside", pairs.len());
    for options in grids(0.5) {
        let (Voxelised { mesh, .. }, embedding) = embedded(&skin, &options);
        let carrier = |vertex: u32| embedding.vertices()[vertex as usize].element;
        for pair in &pairs {
            let [upper, lower] = pair.map(carrier);
            assert_ne!(upper, lower, "{options:?}");
            // A cell's length from the corner, elements of both lips meet in its nodes.
            let touch = share_node(&mesh, upper, lower);
            assert!(!touch || aside(pair[0]) > corner - 0.5, "{options:?}");
        }
        let [upper, lower] = pairs[0];
        let around = path(&mesh, carrier(upper), carrier(lower));
        let side = |&e: &u32| (mesh.element_corner(e as usize).x + 0.25).abs() + 0.25;
        let widest = around.iter().map(side).fold(0.0, f64::max);
        let [p, q] = [upper, lower].map(|v| skin.vertices()[v as usize]);
        eprintln!(
            "{p:.3?} {q:.3?}: {} elements around, {widest} aside",
            around.len()
        );
        assert!(around.len() >= 7 && widest > corner, "{options:?}");
    }
}

/// Pairs of a vertex on the upper lid's edge and the one of the lower lid that it meets when the eye blinks.
fn lid_pairs(skin: &Surface, units: &MorphedSurface) -> Vec<[u32; 2]> {
    let blink = motion(units, "eyeBlink_L");
    let most = blink.iter().map(|d| d.norm()).fold(0.0, f64::max);
    let still: Vec<u32> = (0..skin.vertex_count() as u32)
        .filter(|&v| blink[v as usize].norm() < 0.25 * most)
        .collect();
    let nearest = |among: &[u32], point: Vector3<f64>| {
        let distance = |v: &u32| (skin.vertices()[*v as usize] - point).norm();
        let best = among
            .iter()
            .copied()
            .min_by(|a, b| distance(a).total_cmp(&distance(b)));
        best.unwrap()
    };
    let upper = (0..skin.vertex_count()).filter(|&v| blink[v].norm() > 0.9 * most);
    upper
        .map(|v| [v as u32, nearest(&still, skin.vertices()[v] + blink[v])])
        .collect()
}

#[test]
fn eyelids_are_separate() {
    let Some((skin, units)) = face() else { return };
    let left = lid_pairs(&skin, &units);
    // The face is symmetric, and only one eye blinks among the units.
    let mirror = |vertex: u32| {
        let v = skin.vertices()[vertex as usize];
        let mirrored = Vector3::new(-v.x, v.y, v.z);
        let distance = |u: &Vector3<f64>| (u - mirrored).norm();
        let all = (0..).zip(skin.vertices());
        let best = all.min_by(|(_, a), (_, b)| distance(a).total_cmp(&distance(b)));
        best.unwrap().0
    };
    let right: Vec<_> = left.iter().map(|pair| pair.map(mirror)).collect();
    for options in grids(0.5) {
        let (Voxelised { mesh, .. }, embedding) = embedded(&skin, &options);
        let carrier = |vertex: u32| embedding.vertices()[vertex as usize].element;
        for pairs in [&left, &right] {
            let mut shortest = usize::MAX;
            for [upper, lower] in pairs.iter().map(|pair| pair.map(carrier)) {
                assert!(!share_node(&mesh, upper, lower), "{options:?}");
                shortest = shortest.min(path(&mesh, upper, lower).len());
            }
            let [p, q] = pairs[0].map(|v| skin.vertices()[v as usize]);
            eprintln!(
                "{} pairs, the first {p:.3?} {q:.3?}: {shortest} elements",
                pairs.len()
            );
        }
    }
}

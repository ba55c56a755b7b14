//! Moves a surface apart where it passes through itself.

use crate::self_intersections::{edge_pierces, for_overlapping};
use crate::{Surface, SurfaceError};
use nalgebra::Vector3;

/// What is pushed apart in a round stays apart by this share of a triangle's size, so that it does not pass back by roundoff.
const GAP: f64 = 0.02;
/// The most that a round moves a vertex, in sizes of the triangle that it passes through.
const LARGEST: f64 = 0.2;
/// Rounds before what is left is left.
const ROUNDS: usize = 100;
/// Passes of smoothing over what a round moves.
const SMOOTHINGS: usize = 2;

/// What [`separate`] did.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Separation {
    /// Edges that passed through triangles with which they share no vertex.
    pub before: usize,
    /// Those that still do: above zero where the surface passes too far through itself.
    pub after: usize,
    /// Vertices that were moved.
    pub moved: usize,
    /// The farthest that one was moved, in the unit of the surface.
    pub farthest: f64,
}

/// Moves a closed surface apart where it passes through itself a little, as scanned and sculpted faces do in the corners of the mouth.
///
/// Every edge that passes through a triangle has its end behind the triangle pushed out in front of it, and the triangle pushed back, by half the
/// way each; the moves are smoothed over neighbours, and so on until nothing passes through anything. What passes through by more
/// than about an edge may stay: see [`Separation::after`]. A surface that is inside out counts as turned right.
///
/// # Errors
/// When a vertex that is not finite would be made, which finite ones of a sensible size never do.
pub fn separate(surface: &Surface) -> Result<(Surface, Separation), SurfaceError> {
    let triangles = surface.triangles();
    let outwards = surface.signed_volume().signum();
    let mut x = surface.vertices().to_vec();
    let mut found = piercings(&x, triangles);
    let mut done = Separation {
        before: found.len(),
        ..Separation::default()
    };
    for _ in 0..ROUNDS {
        if found.is_empty() {
            break;
        }
        let moves = pushes(&x, triangles, &found, outwards);
        x.iter_mut().zip(&moves).for_each(|(x, d)| *x += d);
        found = piercings(&x, triangles);
    }
    done.after = found.len();
    for (x, rest) in x.iter().zip(surface.vertices()) {
        let distance = (x - rest).norm();
        done.moved += usize::from(distance > 0.0);
        done.farthest = done.farthest.max(distance);
    }
    Ok((surface.with_vertices(x)?, done))
}

/// An edge through a triangle.
struct Piercing {
    edge: [u32; 2],
    triangle: u32,
}

/// All edges that pass through triangles with which they share no vertex, each once for a triangle.
fn piercings(x: &[Vector3<f64>], triangles: &[[u32; 3]]) -> Vec<Piercing> {
    let mut found = Vec::new();
    let mut look = |one: u32, other: u32| {
        let (a, b) = (triangles[one as usize], triangles[other as usize]);
        let corners = b.map(|v| x[v as usize]);
        for i in 0..3 {
            let edge = [a[i], a[(i + 1) % 3]];
            // The triangle on the other side of the edge sees it the other way round.
            if edge[0] > edge[1] || edge.iter().any(|v| b.contains(v)) {
                continue;
            }
            if edge_pierces(&edge.map(|v| x[v as usize]), &corners) {
                found.push(Piercing {
                    edge,
                    triangle: other,
                });
            }
        }
    };
    for_overlapping(x, triangles, |one, other| {
        look(one, other);
        look(other, one);
    });
    found
}

/// How far every vertex is to be moved in a round.
fn pushes(
    x: &[Vector3<f64>],
    triangles: &[[u32; 3]],
    found: &[Piercing],
    outwards: f64,
) -> Vec<Vector3<f64>> {
    let mut sums = vec![(Vector3::zeros(), 0.0_f64); x.len()];
    for piercing in found {
        let corners = triangles[piercing.triangle as usize];
        let [a, b, c] = corners.map(|v| x[v as usize]);
        let normal = (b - a).cross(&(c - a)) * outwards;
        let doubled_area = normal.norm();
        if doubled_area <= 0.0 {
            continue;
        }
        let normal = normal / doubled_area;
        let depths = piercing.edge.map(|v| normal.dot(&(a - x[v as usize])));
        let behind = usize::from(depths[1] > depths[0]);
        let size = doubled_area.sqrt();
        let push = (0.5 * depths[behind] + GAP * size).min(LARGEST * size);
        let mut add = |v: u32, d: Vector3<f64>| {
            sums[v as usize].0 += d;
            sums[v as usize].1 += 1.0;
        };
        add(piercing.edge[behind], normal * push);
        corners.iter().for_each(|&v| add(v, -normal * push));
    }
    let mut moves: Vec<Vector3<f64>> = sums.iter().map(|(d, n)| *d / f64::max(*n, 1.0)).collect();
    for _ in 0..SMOOTHINGS {
        smooth(&mut moves, triangles);
    }
    moves
}

/// Takes every move half way to the mean of its neighbours'.
fn smooth(moves: &mut [Vector3<f64>], triangles: &[[u32; 3]]) {
    let mut sums = vec![(Vector3::<f64>::zeros(), 0.0); moves.len()];
    for t in triangles {
        for i in 0..3 {
            let beside = moves[t[(i + 1) % 3] as usize] + moves[t[(i + 2) % 3] as usize];
            sums[t[i] as usize].0 += beside;
            sums[t[i] as usize].1 += 2.0;
        }
    }
    for (d, (sum, n)) in moves.iter_mut().zip(sums) {
        if n > 0.0 {
            *d = (*d + sum / n) / 2.0;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::primitives::icosphere;
    use crate::self_intersections;

    /// Two balls of radius 1 as one surface, their middles so far from the origin.
    fn balls(offset: f64) -> Surface {
        let ball = icosphere(3, 1.0);
        let mut vertices = Vec::new();
        let mut triangles = Vec::new();
        for (side, turn) in [(-1.0, 1.0), (1.0, -1.0)] {
            let first = vertices.len() as u32;
            let middle = Vector3::new(side * offset, 0.01, 0.02);
            // Turned half around, so that the two are no mirror images.
            let turned = |x: &Vector3<f64>| Vector3::new(turn * x.x, turn * x.y, x.z);
            vertices.extend(ball.vertices().iter().map(|x| turned(x) + middle));
            triangles.extend(ball.triangles().iter().map(|t| t.map(|v| v + first)));
        }
        Surface::from_triangles(vertices, triangles).unwrap()
    }

    #[test]
    fn what_passes_through_a_little_is_moved_apart_and_nothing_else() {
        let crossed = balls(0.985);
        assert!(!self_intersections(crossed.vertices(), crossed.triangles()).is_empty());
        let (apart, done) = separate(&crossed).unwrap();
        assert!(done.before > 0);
        assert_eq!(done.after, 0);
        assert!(self_intersections(apart.vertices(), apart.triangles()).is_empty());
        assert!(done.farthest < 0.06, "{done:?}");
        let pairs = apart.vertices().iter().zip(crossed.vertices());
        let moved: Vec<_> = pairs.filter(|(a, b)| a != b).collect();
        assert_eq!(moved.len(), done.moved);
        // Only where the balls meet.
        assert!(moved.iter().all(|(_, b)| b.x.abs() < 0.4), "{done:?}");
    }

    #[test]
    fn a_surface_that_is_inside_out_is_moved_apart_too() {
        let crossed = balls(0.985);
        let turned = crossed.triangles().iter().map(|&[a, b, c]| [a, c, b]);
        let turned = Surface::from_triangles(crossed.vertices().to_vec(), turned.collect());
        let (apart, done) = separate(&turned.unwrap()).unwrap();
        assert_eq!(done.after, 0);
        assert!(self_intersections(apart.vertices(), apart.triangles()).is_empty());
        // The wrong way would have pushed one through the other.
        assert!(done.farthest < 0.06, "{done:?}");
    }

    #[test]
    fn a_surface_that_passes_through_nothing_is_left_as_it_is() {
        let surface = balls(1.1);
        let (same, done) = separate(&surface).unwrap();
        assert_eq!(same, surface);
        assert_eq!(done, Separation::default());
    }

    #[test]
    fn what_passes_far_through_itself_is_told() {
        let deep = balls(0.5);
        let (end, done) = separate(&deep).unwrap();
        let left = self_intersections(end.vertices(), end.triangles());
        assert_eq!(done.after == 0, left.is_empty());
        assert!(end.vertices().iter().all(|x| x.norm().is_finite()));
    }
}

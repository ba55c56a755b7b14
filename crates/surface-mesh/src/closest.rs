//! The point of a surface nearest to a given point, by a tree of boxes around triangles.

use nalgebra::Vector3;

use crate::Surface;
use crate::surface::doubled_area;

/// Triangles of a leaf: testing four costs about as much as visiting two more boxes.
const LEAF: usize = 4;

/// Where a surface is nearest to a point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ClosestPoint {
    /// Index into [`Surface::triangles`]; the lowest where several are equally near.
    pub triangle: usize,
    /// Weights of the triangle's corners, at least 0 and summing to 1. A weight of exactly 0 says that the point lies on the
    /// opposite edge.
    pub weights: [f64; 3],
    /// The point itself, in the surface's unit.
    pub position: Vector3<f64>,
    /// Its distance from the point asked about.
    pub distance: f64,
}

/// Finds nearest points of one surface for many points. Holds a copy of the triangles.
///
/// ```
/// use nalgebra::Vector3;
/// use surface_mesh::{ClosestPoints, primitives};
///
/// let sphere = primitives::icosphere(3, 1.0);
/// let nearest = ClosestPoints::new(&sphere).to(&Vector3::new(0.0, 0.0, 3.0));
/// assert!((nearest.distance - 2.0).abs() < 0.01);
/// ```
#[derive(Clone, Debug)]
pub struct ClosestPoints {
    corners: Vec<[Vector3<f64>; 3]>,
    /// Triangles, those of each subtree together.
    order: Vec<u32>,
    /// Subtrees in depth-first order: a left child follows its parent.
    nodes: Vec<Node>,
}

#[derive(Clone, Debug)]
struct Node {
    low: Vector3<f64>,
    high: Vector3<f64>,
    /// Range of `order`.
    start: u32,
    end: u32,
    /// The right child, or 0 for a leaf.
    right: u32,
}

/// Squared distance and the rest of a nearest point found so far.
type Best = (f64, ClosestPoint);

impl ClosestPoints {
    /// Sorts the triangles of a surface, in `O(n log n)`.
    pub fn new(surface: &Surface) -> Self {
        let triangles = surface.triangles().iter();
        let corners: Vec<_> = triangles.map(|&t| surface.triangle_points(t)).collect();
        let count = corners.len();
        let mut tree = Self {
            corners,
            order: (0..count as u32).collect(),
            nodes: Vec::new(),
        };
        tree.split(0, count);
        tree
    }

    /// Appends the subtree of `order[start..end]`.
    fn split(&mut self, start: usize, end: usize) {
        let corners = &self.corners;
        let part = &mut self.order[start..end];
        let points = || part.iter().flat_map(|&t| corners[t as usize]);
        let low = points().fold(Vector3::repeat(f64::INFINITY), |low, x| low.inf(&x));
        let high = points().fold(Vector3::repeat(f64::NEG_INFINITY), |high, x| high.sup(&x));
        let node = self.nodes.len();
        self.nodes.push(Node {
            low,
            high,
            start: start as u32,
            end: end as u32,
            right: 0,
        });
        if part.len() <= LEAF {
            return;
        }
        let axis = (high - low).imax();
        let middle = part.len() / 2;
        let centre = |t: u32| corners[t as usize].iter().map(|x| x[axis]).sum::<f64>();
        part.select_nth_unstable_by(middle, |&a, &b| {
            centre(a).total_cmp(&centre(b)).then(a.cmp(&b))
        });
        self.split(start, start + middle);
        self.nodes[node].right = self.nodes.len() as u32;
        self.split(start + middle, end);
    }

    /// The point of the surface nearest to `point`.
    ///
    /// A `point` that is not finite gives a distance that is not finite.
    pub fn to(&self, point: &Vector3<f64>) -> ClosestPoint {
        let nothing = ClosestPoint {
            triangle: usize::MAX,
            weights: [1.0, 0.0, 0.0],
            position: self.corners[0][0],
            distance: 0.0,
        };
        let (squared, nearest) = self.search(0, point, (f64::INFINITY, nothing));
        ClosestPoint {
            distance: squared.sqrt(),
            ..nearest
        }
    }

    fn search(&self, node: usize, point: &Vector3<f64>, mut best: Best) -> Best {
        let Node {
            start, end, right, ..
        } = self.nodes[node];
        if right == 0 {
            for &t in &self.order[start as usize..end as usize] {
                let triangle = t as usize;
                let (weights, position) = closest_on_triangle(&self.corners[triangle], point);
                let squared = (point - position).norm_squared();
                if (squared, triangle) < (best.0, best.1.triangle) {
                    let found = ClosestPoint {
                        triangle,
                        weights,
                        position,
                        distance: 0.0,
                    };
                    best = (squared, found);
                }
            }
            return best;
        }
        let mut children = [node + 1, right as usize].map(|child| {
            let Node { low, high, .. } = &self.nodes[child];
            let outside = point.sup(low).inf(high) - point;
            (outside.norm_squared(), child)
        });
        if children[1].0 < children[0].0 {
            children.swap(0, 1);
        }
        for (squared, child) in children {
            // Equal distances are searched too: the lowest triangle wins.
            if squared <= best.0 {
                best = self.search(child, point, best);
            }
        }
        best
    }
}

/// Weights of the corners and the place nearest to a point; a triangle without area is its edges.
fn closest_on_triangle(
    corners: &[Vector3<f64>; 3],
    point: &Vector3<f64>,
) -> ([f64; 3], Vector3<f64>) {
    let normal = doubled_area(corners);
    let squared = normal.norm_squared();
    let part = |i: usize| {
        let (a, b) = (corners[(i + 1) % 3], corners[(i + 2) % 3]);
        (b - a).cross(&(point - a)).dot(&normal) / squared
    };
    let weights = [part(0), part(1), part(2)];
    if squared > 0.0 && weights.iter().all(|w| *w > 0.0) {
        return (weights, place(corners, &weights));
    }
    let edges = (0..3).map(|i| {
        let (a, b) = ((i + 1) % 3, (i + 2) % 3);
        let along = corners[b] - corners[a];
        let length = along.norm_squared();
        let t = match length > 0.0 {
            true => ((point - corners[a]).dot(&along) / length).clamp(0.0, 1.0),
            false => 0.0,
        };
        let mut weights = [0.0; 3];
        (weights[a], weights[b]) = (1.0 - t, t);
        (weights, place(corners, &weights))
    });
    let distance = |x: &([f64; 3], Vector3<f64>)| (x.1 - point).norm_squared();
    let nearest = edges.min_by(|a, b| distance(a).total_cmp(&distance(b)));
    nearest.expect("a triangle has three edges")
}

fn place(corners: &[Vector3<f64>; 3], weights: &[f64; 3]) -> Vector3<f64> {
    corners[0] * weights[0] + corners[1] * weights[1] + corners[2] * weights[2]
}

//! Geometric nested dissection of the nodes of a voxel body.
//!
//! Nodes of a voxel grid only couple within one cell, so all nodes of one grid plane separate what lies on its two sides.
//! Cutting the longest extent in the middle, again and again, and numbering each cut after its two sides gives a factor close
//! to the quality of general graph partitioners at the cost of a sort (George 1973).

use nalgebra::Vector3;

/// Parts of at most this many nodes are not cut further: below it the cuts only add bookkeeping.
const LEAF: usize = 32;

/// A fill-reducing order of elimination.
pub(crate) struct Dissection {
    /// Entry k is the index of the point that is eliminated k-th.
    pub(crate) order: Vec<usize>,
    /// The leaves and separators, all runs of the order: where each ends. Rises up to the number of points.
    pub(crate) ends: Vec<usize>,
}

impl Dissection {
    fn push(&mut self, run: Vec<usize>) {
        self.order.extend(run);
        self.ends.push(self.order.len());
    }
}

/// A fill-reducing order of the given points.
///
/// `spacing` is the edge length of the grid that the points lie on. Points need not fill a box, and several may share a place.
pub(crate) fn nested_dissection(points: &[Vector3<f64>], spacing: f64) -> Dissection {
    let mut dissection = Dissection {
        order: Vec::with_capacity(points.len()),
        ends: Vec::new(),
    };
    let Some(first) = points.first() else {
        return dissection;
    };
    let low = points.iter().fold(*first, |a, p| a.inf(p));
    let lattice: Vec<[i64; 3]> = points
        .iter()
        .map(|p| {
            let q = (p - low) / spacing;
            [q.x.round() as i64, q.y.round() as i64, q.z.round() as i64]
        })
        .collect();
    dissect(&lattice, (0..points.len()).collect(), &mut dissection);
    dissection
}

fn dissect(lattice: &[[i64; 3]], part: Vec<usize>, out: &mut Dissection) {
    if part.len() <= LEAF {
        out.push(part);
        return;
    }
    let extent = |axis: usize| {
        let coordinates = part.iter().map(|&i| lattice[i][axis]);
        let (low, high) = coordinates.fold((i64::MAX, i64::MIN), |(l, h), c| (l.min(c), h.max(c)));
        high - low
    };
    let axis = (0..3).max_by_key(|&a| extent(a)).expect("three axes");
    if extent(axis) < 2 {
        out.push(part);
        return;
    }
    let mut coordinates: Vec<i64> = part.iter().map(|&i| lattice[i][axis]).collect();
    let middle = part.len() / 2;
    let (_, &mut cut, _) = coordinates.select_nth_unstable(middle);
    // A cut at the very end would leave one side empty and the recursion without progress.
    let low = part
        .iter()
        .map(|&i| lattice[i][axis])
        .min()
        .expect("not empty");
    let high = low + extent(axis);
    let cut = cut.clamp(low + 1, high - 1);
    let side = |wanted: std::cmp::Ordering| -> Vec<usize> {
        let keep = |&&i: &&usize| lattice[i][axis].cmp(&cut) == wanted;
        part.iter().filter(keep).copied().collect()
    };
    let (left, separator, right) = (
        side(std::cmp::Ordering::Less),
        side(std::cmp::Ordering::Equal),
        side(std::cmp::Ordering::Greater),
    );
    dissect(lattice, left, out);
    dissect(lattice, right, out);
    out.push(separator);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_point_once() {
        let points: Vec<_> = (0..7 * 9 * 5)
            .map(|i| Vector3::new((i % 7) as f64, (i / 7 % 9) as f64, (i / 63) as f64) * 0.25)
            .collect();
        let dissection = nested_dissection(&points, 0.25);
        assert!(dissection.ends.is_sorted_by(|a, b| a < b));
        assert_eq!(dissection.ends.last(), Some(&points.len()));
        let mut order = dissection.order;
        assert_ne!(order, (0..points.len()).collect::<Vec<_>>());
        order.sort_unstable();
        assert_eq!(order, (0..points.len()).collect::<Vec<_>>());
    }

    #[test]
    fn degenerate_sets_end() {
        assert!(nested_dissection(&[], 1.0).order.is_empty());
        let same = vec![Vector3::new(1.0, 2.0, 3.0); 100];
        assert_eq!(nested_dissection(&same, 1.0).order.len(), 100);
        let line: Vec<_> = (0..100).map(|i| Vector3::new(i as f64, 0.0, 0.0)).collect();
        assert_eq!(nested_dissection(&line, 1.0).order.len(), 100);
    }
}

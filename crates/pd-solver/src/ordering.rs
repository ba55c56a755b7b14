//! Geometric nested dissection of the nodes of a voxel body.
//!
//! Nodes of a voxel grid only couple within one cell, so all nodes of one grid plane separate what lies on its two sides.
//! Cutting at the plane with fewest nodes of those near the middle, again and again, and numbering each cut after its two sides
//! gives an order with little fill at the cost of counting (George 1973).

use nalgebra::Vector3;

/// Parts of at most this many nodes are not cut further: below it the cuts only add bookkeeping.
const LEAF: usize = 32;

/// Least share of the other points that a cut leaves on either side, where there is such a cut. Of 0.3, 0.4 and 0.45, the first
/// gave the smallest factors of boxes, an L and a hollow box.
const FAIR: f64 = 0.3;

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
    let cuts = (0..3).filter_map(|axis| smallest_cut(lattice, &part, axis));
    let Some((_, axis, cut)) = cuts.min() else {
        out.push(part);
        return;
    };
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

/// The plane across an axis that holds fewest of a part's points, of those that leave a fair share on both sides: the number of
/// points in it, the axis and the coordinate. `None` where no plane has points on both sides.
fn smallest_cut(lattice: &[[i64; 3]], part: &[usize], axis: usize) -> Option<(usize, usize, i64)> {
    let coordinates = part.iter().map(|&i| lattice[i][axis]);
    let (low, high) = coordinates.fold((i64::MAX, i64::MIN), |(l, h), c| (l.min(c), h.max(c)));
    let mut counts = vec![0; (high - low + 1) as usize];
    for &i in part {
        counts[(lattice[i][axis] - low) as usize] += 1;
    }
    let mut before = 0;
    let mut cuts = Vec::with_capacity(counts.len());
    for (count, cut) in counts.iter().zip(low..) {
        let smaller = before.min(part.len() - before - count);
        if smaller > 0 {
            let unfair = (smaller as f64) < FAIR * (part.len() - count) as f64;
            cuts.push((unfair, *count, std::cmp::Reverse(smaller), cut));
        }
        before += count;
    }
    // Where no cut is fair, the fairest is the one with most points on its smaller side.
    let fair = cuts.iter().filter(|c| !c.0).min();
    let (_, count, _, cut) = fair.or_else(|| cuts.iter().min_by_key(|c| (c.2, c.1)))?;
    Some((*count, axis, *cut))
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

    /// The first cut of an L goes through an arm, not along it.
    #[test]
    fn cuts_where_the_body_is_thin() {
        let all = (0..20 * 20 * 6).map(|i| [i / 120, i / 6 % 20, i % 6]);
        let points: Vec<_> = all
            .filter(|c| c[0] < 5 || c[1] < 5)
            .map(|c| Vector3::from(c.map(f64::from)))
            .collect();
        let dissection = nested_dissection(&points, 1.0);
        let runs = &dissection.ends;
        let last = runs[runs.len() - 1] - runs[runs.len() - 2];
        assert_eq!(last, 5 * 6);
    }
}

//! What contact tells of itself.

use super::Contact;
use super::distance::Nearest;
use nalgebra::Vector3;
use serde::Serialize;

/// What one contact effect sees at given positions: see [`Solver::contact_reports`](crate::Solver::contact_reports).
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ContactReport {
    /// Position in the list of effects.
    pub index: usize,
    /// Triangles of the surface that pass through others at rest, which real faces have at the corners of the mouth. They, and what touches
    /// them, are left out of the contact of the surface with itself.
    pub left_out: Vec<u32>,
    /// Pairs of vertices with triangles or planes, and of edges, that are felt.
    pub felt: usize,
    /// The smallest distance among what is felt, in scene units; absent where nothing is.
    pub nearest: Option<f64>,
}

impl Contact {
    pub(super) fn report(&self, x: &[Vector3<f64>]) -> ContactReport {
        let pairs = self.list.pairs.iter().filter_map(|pair| {
            let d = Nearest::of(pair.barrier.kind, &pair.gather(x)).squared();
            let d = d.sqrt();
            (d < pair.barrier.dhat).then_some(d)
        });
        let planes = self.near_planes(x).map(|(_, _, d)| d);
        let (mut felt, mut nearest) = (0, f64::INFINITY);
        for d in pairs.chain(planes) {
            felt += 1;
            nearest = nearest.min(d);
        }
        ContactReport {
            index: self.index,
            left_out: self.left_out.clone(),
            felt,
            nearest: (felt > 0).then_some(nearest),
        }
    }
}

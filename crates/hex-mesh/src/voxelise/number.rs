//! Numbering the nodes of candidates.

use std::collections::HashMap;

use super::candidates::Candidate;
use super::corners::Corners;

/// The nodes of elements: the lattice point of each node, and the nodes of each element.
pub(crate) struct NumberedParts {
    pub points: Vec<u32>,
    pub elements: Vec<[u32; 8]>,
    node_at: Vec<u32>,
    /// Nodes of the classes above 0, by lattice point and class.
    further: HashMap<(u32, u8), u32>,
}

const UNUSED: u32 = u32::MAX;

impl NumberedParts {
    /// Numbers nodes as elements first use them, corner by corner.
    pub fn new(elements: &[Candidate], corners: &Corners) -> Self {
        let mut numbered = Self {
            points: Vec::new(),
            elements: Vec::new(),
            node_at: vec![UNUSED; corners.point_count()],
            further: HashMap::new(),
        };
        for &candidate in elements {
            let points = corners.points(candidate.cell);
            let is_split = corners.touches_split(candidate.cell);
            let nodes = std::array::from_fn(|corner| match is_split {
                true => {
                    let class = corners.class(candidate.cell, corner, candidate.part);
                    numbered.number(points[corner], class)
                }
                false => numbered.number(points[corner], 0),
            });
            numbered.elements.push(nodes);
        }
        numbered
    }

    fn number(&mut self, point: u32, class: u8) -> u32 {
        let node = match class {
            0 => &mut self.node_at[point as usize],
            class => self.further.entry((point, class)).or_insert(UNUSED),
        };
        if *node == UNUSED {
            *node = self.points.len() as u32;
            self.points.push(point);
        }
        *node
    }
}

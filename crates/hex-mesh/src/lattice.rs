//! Numbering the corners of a set of cells.

use crate::grid_box::GridBox;
use crate::{HexMeshError, corner_offset};

/// How nodes are numbered.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(crate) enum NodeOrder {
    /// As elements first use them, corner by corner: nodes lie in memory as elements do.
    FirstUse,
    /// By x, then y, then z.
    Lexicographic,
}

/// The corners of cells: the integer lattice point of each node, and the nodes of each cell.
pub(crate) struct NumberedNodes {
    pub points: Vec<[i32; 3]>,
    pub elements: Vec<[u32; 8]>,
}

const UNUSED: u32 = u32::MAX;

/// Numbers the corners that `cells` use; cells that share a lattice point share the node.
pub(crate) fn number_nodes(
    cells: &[[i32; 3]],
    order: NodeOrder,
) -> Result<NumberedNodes, HexMeshError> {
    let cell_box = GridBox::around(cells)?;
    let lattice = cell_box.corners();
    let strides = lattice.strides();
    let steps: [usize; 8] = std::array::from_fn(|corner| {
        let offset = corner_offset(corner);
        (0..3).map(|axis| offset[axis] * strides[axis]).sum()
    });

    let mut occupied = vec![false; lattice.len()];
    let mut elements = Vec::with_capacity(cells.len());
    let mut node_at = vec![UNUSED; lattice.len()];
    let mut places = Vec::new();
    for (entry, &cell) in cells.iter().enumerate() {
        let place = lattice.index(cell).expect("the box surrounds its cells");
        if std::mem::replace(&mut occupied[place], true) {
            return Err(HexMeshError::DuplicateCell { cell, entry });
        }
        elements.push(steps.map(|step| {
            let node = &mut node_at[place + step];
            if *node == UNUSED {
                *node = places.len() as u32;
                places.push(place + step);
            }
            *node
        }));
    }
    if order == NodeOrder::Lexicographic {
        renumber_by_place(&mut places, &mut elements);
    }
    let points = places.iter().map(|&place| lattice.point(place)).collect();
    Ok(NumberedNodes { points, elements })
}

fn renumber_by_place(places: &mut [usize], elements: &mut [[u32; 8]]) {
    let mut order: Vec<u32> = (0..places.len() as u32).collect();
    order.sort_unstable_by_key(|&node| places[node as usize]);
    let mut rank = vec![0; places.len()];
    for (new, &old) in order.iter().enumerate() {
        rank[old as usize] = new as u32;
    }
    places.sort_unstable();
    for node in elements.iter_mut().flatten() {
        *node = rank[*node as usize];
    }
}

//! Which elements meet at a node.

/// One corner of one element.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct ElementCorner {
    /// Index of the element.
    pub element: u32,
    /// Corner of that element, 0 to 7.
    pub corner: u8,
}

/// The element corners that meet at each node, in compressed rows, by rising element within a row.
///
/// The transpose of [`HexMesh::elements`](crate::HexMesh::elements): it turns a scatter over elements into a gather over nodes,
/// which runs in parallel and adds in one fixed order.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct NodeElements {
    offsets: Vec<usize>,
    corners: Vec<ElementCorner>,
}

impl NodeElements {
    pub(crate) fn new(node_count: usize, elements: &[[u32; 8]]) -> Self {
        let mut offsets = vec![0; node_count + 1];
        for &node in elements.iter().flatten() {
            offsets[node as usize + 1] += 1;
        }
        for node in 0..node_count {
            offsets[node + 1] += offsets[node];
        }
        let mut next = offsets.clone();
        let unset = ElementCorner {
            element: 0,
            corner: 0,
        };
        let mut corners = vec![unset; elements.len() * 8];
        for (element, nodes) in elements.iter().enumerate() {
            for (corner, &node) in nodes.iter().enumerate() {
                let slot = &mut next[node as usize];
                corners[*slot] = ElementCorner {
                    element: element as u32,
                    corner: corner as u8,
                };
                *slot += 1;
            }
        }
        Self { offsets, corners }
    }

    /// Start of each node's row in [`NodeElements::corners`], and the total at the end: `[nodes + 1]`.
    #[must_use]
    pub fn offsets(&self) -> &[usize] {
        &self.offsets
    }

    /// The rows of all nodes one after another: `[8 * elements]`.
    #[must_use]
    pub fn corners(&self) -> &[ElementCorner] {
        &self.corners
    }

    /// The element corners that meet at `node`.
    ///
    /// # Panics
    /// When `node` is not a node of the mesh.
    #[must_use]
    pub fn at(&self, node: usize) -> &[ElementCorner] {
        &self.corners[self.offsets[node]..self.offsets[node + 1]]
    }
}

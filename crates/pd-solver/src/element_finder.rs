//! Which elements hold which nodes.

/// Elements around each node as linked lists, lowest element first.
pub(crate) struct ElementFinder {
    /// Eight times an element and the node's corner of it.
    first: Vec<u32>,
    next: Vec<[u32; 8]>,
}

impl ElementFinder {
    pub(crate) fn new(elements: &[[u32; 8]], nodes: usize) -> Self {
        let mut first = vec![u32::MAX; nodes];
        let mut next = vec![[u32::MAX; 8]; elements.len()];
        for (element, nodes) in elements.iter().enumerate().rev() {
            for (corner, &node) in nodes.iter().enumerate() {
                let head = &mut first[node as usize];
                next[element][corner] = std::mem::replace(head, (element * 8 + corner) as u32);
            }
        }
        Self { first, next }
    }

    /// The first element that has all of these nodes.
    pub(crate) fn with_all(
        &self,
        elements: &[[u32; 8]],
        mut nodes: impl Iterator<Item = u32> + Clone,
    ) -> Option<u32> {
        let place = |at: u32| (at != u32::MAX).then_some(at);
        let first = place(self.first[nodes.next()? as usize]);
        let after = |at: &u32| place(self.next[*at as usize / 8][*at as usize % 8]);
        let mut around = std::iter::successors(first, after).map(|at| at / 8);
        around.find(|e| {
            let corners = &elements[*e as usize];
            nodes.clone().all(|n| corners.contains(&n))
        })
    }
}

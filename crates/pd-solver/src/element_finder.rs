//! Which elements hold which nodes: preconditioners take what an effect does as forms over the corners of one element each.

use nalgebra::Vector3;

/// A form over the corners of one element, by its coefficients of all corners' x, y and z: the Hessian has its square.
pub(crate) struct Touch {
    pub(crate) element: u32,
    pub(crate) vector: [[f64; 8]; 3],
}

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

    /// The elements that a node is a corner of.
    pub(crate) fn around(&self, node: u32) -> impl Iterator<Item = u32> {
        let place = |at: u32| (at != u32::MAX).then_some(at);
        let first = place(self.first[node as usize]);
        let after = move |at: &u32| place(self.next[*at as usize / 8][*at as usize % 8]);
        std::iter::successors(first, after).map(|at| at / 8)
    }

    /// Cuts a form over any nodes into forms over elements: into one where an element has all of them.
    pub(crate) fn cut(
        &self,
        elements: &[[u32; 8]],
        form: &[(u32, Vector3<f64>)],
        out: &mut Vec<Touch>,
    ) {
        let mut rest = form.to_vec();
        while let Some(&(node, _)) = rest.first() {
            let held = |e: &u32| {
                let corners = &elements[*e as usize];
                rest.iter().filter(|(n, _)| corners.contains(n)).count()
            };
            let Some(element) = self.around(node).max_by_key(held) else {
                return;
            };
            let corners = &elements[element as usize];
            let mut vector = [[0.0; 8]; 3];
            rest.retain(|(node, v)| {
                let corner = corners.iter().position(|n| n == node);
                if let Some(corner) = corner {
                    vector.iter_mut().zip(v).for_each(|(row, v)| row[corner] += v);
                }
                corner.is_none()
            });
            out.push(Touch { element, vector });
        }
    }
}

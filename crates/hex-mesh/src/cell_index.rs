//! Look-up from integer cells to elements.

use std::collections::HashMap;
use std::hash::{BuildHasherDefault, Hasher};

/// Multiplies and rotates each word: cells are small integers that nobody chose to collide, and this is several times faster than
/// the standard hasher.
#[derive(Debug, Clone, Default)]
struct CellHasher(u64);

impl CellHasher {
    fn mix(&mut self, word: u64) {
        self.0 = (self.0.rotate_left(5) ^ word).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    }
}

impl Hasher for CellHasher {
    fn write(&mut self, bytes: &[u8]) {
        for chunk in bytes.chunks(8) {
            let mut word = [0; 8];
            word[..chunk.len()].copy_from_slice(chunk);
            self.mix(u64::from_le_bytes(word));
        }
    }

    fn write_usize(&mut self, length: usize) {
        self.mix(length as u64);
    }

    fn finish(&self) -> u64 {
        // The map takes buckets from the low bits; a product's well-mixed bits are the high ones.
        self.0.rotate_left(26)
    }
}

/// The elements of each integer cell. A cell may hold several elements: pieces of material that must not be fused.
#[derive(Debug, Clone)]
pub struct CellIndex {
    first: HashMap<[i32; 3], u32, BuildHasherDefault<CellHasher>>,
    /// The next element of the same cell, or `NONE`.
    next: Vec<u32>,
}

const NONE: u32 = u32::MAX;

impl CellIndex {
    /// Indexes elements by `cells`, the integer cell of each element.
    #[must_use]
    pub fn new(cells: &[[i32; 3]]) -> Self {
        let mut first = HashMap::with_capacity_and_hasher(cells.len(), Default::default());
        let mut next = vec![NONE; cells.len()];
        // From last to first, so that every chain rises.
        for (element, &cell) in cells.iter().enumerate().rev() {
            next[element] = first.insert(cell, element as u32).unwrap_or(NONE);
        }
        Self { first, next }
    }

    /// The elements of a cell, by rising index; none when the cell is not in the mesh.
    pub fn elements(&self, cell: [i32; 3]) -> impl Iterator<Item = u32> {
        let first = self.first.get(&cell).copied();
        std::iter::successors(first, |&element| {
            Some(self.next[element as usize]).filter(|&next| next != NONE)
        })
    }
}

//! Collects the entries of the constant matrix, column by column.

use rayon::prelude::*;

/// The constant matrix over the free nodes while effects add to it.
///
/// Nodes of a voxel body have at most 26 neighbours, so a search in the column finds an entry's place faster than sorting all
/// contributions would.
pub(crate) struct ConstantMatrix {
    row_of_node: Vec<Option<u32>>,
    diagonal: Vec<f64>,
    /// Entries below the diagonal, unsorted.
    columns: Vec<Vec<(u32, f64)>>,
}

/// The lower triangle, compressed by columns; rows rise within a column, the diagonal first.
pub(crate) struct LowerTriangle {
    pub(crate) starts: Vec<u32>,
    pub(crate) rows: Vec<u32>,
    pub(crate) values: Vec<f64>,
}

impl ConstantMatrix {
    /// An empty matrix; `row_of_node[node]` is the row of a free node.
    pub(crate) fn new(row_of_node: Vec<Option<u32>>) -> Self {
        let free = row_of_node.iter().flatten().count();
        Self {
            row_of_node,
            diagonal: vec![0.0; free],
            columns: vec![Vec::new(); free],
        }
    }

    /// Adds the symmetric block `stiffness * weights weights^T` of one linear form over some nodes.
    pub(crate) fn add_outer(&mut self, nodes: &[u32], weights: &[f64], stiffness: f64) {
        self.add_block(nodes, |a, b| stiffness * weights[a] * weights[b]);
    }

    /// Adds a symmetric block over some nodes; `entry(a, b)` is asked for local indices, once for each pair.
    pub(crate) fn add_block(&mut self, nodes: &[u32], entry: impl Fn(usize, usize) -> f64) {
        for (a, &node_a) in nodes.iter().enumerate() {
            let Some(row_a) = self.row_of_node[node_a as usize] else {
                continue;
            };
            self.diagonal[row_a as usize] += entry(a, a);
            for (b, &node_b) in nodes.iter().enumerate().skip(a + 1) {
                let Some(row_b) = self.row_of_node[node_b as usize] else {
                    continue;
                };
                let (row, column) = (row_a.max(row_b), row_a.min(row_b));
                let column = &mut self.columns[column as usize];
                match column.iter_mut().find(|(r, _)| *r == row) {
                    Some((_, value)) => *value += entry(a, b),
                    None => column.push((row, entry(a, b))),
                }
            }
        }
    }

    /// The lower triangle of what was added.
    pub(crate) fn compress(self) -> LowerTriangle {
        let mut columns = self.columns;
        columns
            .par_iter_mut()
            .with_min_len(1024)
            .for_each(|c| c.sort_unstable_by_key(|(row, _)| *row));
        let nonzeros = columns.iter().map(|c| c.len() + 1).sum();
        let mut lower = LowerTriangle {
            starts: Vec::with_capacity(columns.len() + 1),
            rows: Vec::with_capacity(nonzeros),
            values: Vec::with_capacity(nonzeros),
        };
        for ((j, column), diagonal) in columns.iter().enumerate().zip(&self.diagonal) {
            lower.starts.push(lower.rows.len() as u32);
            lower.rows.push(j as u32);
            lower.values.push(*diagonal);
            lower.rows.extend(column.iter().map(|(row, _)| *row));
            lower.values.extend(column.iter().map(|(_, value)| *value));
        }
        lower.starts.push(lower.rows.len() as u32);
        lower
    }
}

impl LowerTriangle {
    /// Rows and columns.
    pub(crate) fn size(&self) -> usize {
        self.starts.len() - 1
    }

    /// Rows and values of a column.
    pub(crate) fn column(&self, j: usize) -> impl Iterator<Item = (usize, f64)> + '_ {
        let range = self.starts[j] as usize..self.starts[j + 1] as usize;
        let rows = self.rows[range.clone()].iter().map(|&r| r as usize);
        rows.zip(self.values[range].iter().copied())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Blocks that overlap and hold a node that is not free, against the dense sum.
    #[test]
    fn overlapping_blocks_add_up() {
        let row_of_node = vec![Some(2), None, Some(0), Some(1), Some(3)];
        let blocks: [(&[u32], &[f64]); 3] = [
            (&[0, 1, 2], &[1.0, 2.0, -3.0]),
            (&[2, 0, 4], &[0.5, 4.0, 1.5]),
            (&[3], &[2.0]),
        ];
        let mut dense = [[0.0; 4]; 4];
        let mut matrix = ConstantMatrix::new(row_of_node.clone());
        for (nodes, weights) in blocks {
            matrix.add_outer(nodes, weights, 3.0);
            for (a, wa) in nodes.iter().zip(weights) {
                for (b, wb) in nodes.iter().zip(weights) {
                    if let (Some(i), Some(j)) = (row_of_node[*a as usize], row_of_node[*b as usize])
                    {
                        dense[i as usize][j as usize] += 3.0 * wa * wb;
                    }
                }
            }
        }
        let lower = matrix.compress();
        let mut found = 0;
        for (j, expected) in dense.iter().enumerate() {
            for (i, value) in lower.column(j) {
                assert!(i >= j && (value - expected[i]).abs() < 1e-14);
                found += 1;
            }
        }
        let below = (0..4).flat_map(|i| (0..=i).map(move |j| (i, j)));
        assert_eq!(found, below.filter(|&(i, j)| dense[i][j] != 0.0).count());
    }
}

//! Lists of variable length in one: neighbours of leaves, control points of points.

use std::ops::Range;

/// Rows of variable length, stored flat: row `i` is `index[offsets[i]..offsets[i + 1]]`.
#[derive(Debug, Clone, Default)]
pub struct Rows {
    /// One more than rows.
    pub offsets: Vec<u32>,
    /// Entries of all rows.
    pub index: Vec<u32>,
}

impl Rows {
    /// Row `i`.
    pub fn row(&self, i: usize) -> &[u32] {
        &self.index[self.range(i)]
    }

    /// Where row `i` lies in `index`.
    pub fn range(&self, i: usize) -> Range<usize> {
        self.offsets[i] as usize..self.offsets[i + 1] as usize
    }

    /// Adds one row.
    pub fn push_row(&mut self, row: impl IntoIterator<Item = u32>) {
        if self.offsets.is_empty() {
            self.offsets.push(0);
        }
        self.index.extend(row);
        self.offsets.push(self.index.len() as u32);
    }
}

//! A sparse square matrix of 3x3 blocks, in block rows.

use crate::error::{Error, Result, check_finite};
use crate::math::{Mat3, Real, Vec3};

/// The blocks of a square matrix, row by row.
#[derive(Debug, Clone, Default)]
pub(crate) struct BlockRows {
    /// Entries of row `i`: from `starts[i]` to `starts[i + 1]`.
    starts: Vec<usize>,
    columns: Vec<u32>,
    values: Vec<Mat3>,
}

impl BlockRows {
    /// Row `i` has the blocks `values[k]` in block columns `columns[k]` for `k` from
    /// `starts[i]` to `starts[i + 1]`. `starts` has one entry more than there are rows.
    ///
    /// # Errors
    /// `InvalidShape` if the arrays do not fit together, `InvalidValue` for a non-finite entry.
    pub fn new(starts: Vec<usize>, columns: Vec<u32>, values: Vec<Mat3>) -> Result<Self> {
        let n = starts.len().saturating_sub(1);
        let ordered = starts.first() == Some(&0) && starts.windows(2).all(|w| w[0] <= w[1]) && starts.last() == Some(&values.len());
        if !ordered || columns.len() != values.len() {
            return Err(Error::shape(
                "block rows of W",
                "starts that rise from 0 to the number of blocks, one column per block",
                format!("{} starts, {} columns, {} blocks", starts.len(), columns.len(), values.len()),
                "pass the row pointers, column indices and values of a block sparse row matrix",
            ));
        }
        if let Some(column) = columns.iter().find(|&&j| j as usize >= n) {
            return Err(Error::shape("block columns of W", format!("indices below {n}"), column, "W must be square"));
        }
        check_finite("W", values.iter().flat_map(|w| w.iter()))?;
        Ok(Self { starts, columns, values })
    }

    /// No rows yet; to be filled by [`BlockRows::push_row`].
    pub fn empty() -> Self {
        Self { starts: vec![0], ..Self::default() }
    }

    /// Number of block rows.
    pub fn len(&self) -> usize {
        self.starts.len().saturating_sub(1)
    }

    /// Number of blocks.
    pub fn block_count(&self) -> usize {
        self.values.len()
    }

    /// Adds a row; its columns must be below the number of rows that there will be.
    pub fn push_row(&mut self, row: impl Iterator<Item = (usize, Mat3)>) {
        for (j, w) in row {
            self.columns.push(j as u32);
            self.values.push(w);
        }
        self.starts.push(self.values.len());
    }

    /// Block row `i` as pairs of block column and block.
    pub fn row(&self, i: usize) -> impl Iterator<Item = (usize, &Mat3)> {
        let row = self.starts[i]..self.starts[i + 1];
        self.columns[row.clone()].iter().map(|&j| j as usize).zip(&self.values[row])
    }

    /// The block in row `i` and column `j`, if it is stored. The columns of the row must rise.
    pub fn block(&self, i: usize, j: usize) -> Option<&Mat3> {
        let row = self.starts[i]..self.starts[i + 1];
        let found = self.columns[row.clone()].binary_search(&(j as u32)).ok()?;
        Some(&self.values[row.start + found])
    }

    /// Row `i` times a vector.
    pub fn product(&self, i: usize, x: &[Vec3]) -> Vec3 {
        let row = self.starts[i]..self.starts[i + 1];
        let mut sum = Vec3::zeros();
        for (j, w) in self.columns[row.clone()].iter().zip(&self.values[row]) {
            sum += w * x[*j as usize];
        }
        sum
    }

    /// The matrix times a factor.
    ///
    /// # Errors
    /// `InvalidValue` if an entry is no longer finite.
    pub fn scaled(&self, factor: Real) -> Result<Self> {
        Self::new(self.starts.clone(), self.columns.clone(), self.values.iter().map(|w| w * factor).collect())
    }

    /// The same blocks, each mapped to another by its row and column.
    pub fn map(&mut self, transform: impl Fn(usize, usize, &Mat3) -> Mat3) {
        for i in 0..self.len() {
            for k in self.starts[i]..self.starts[i + 1] {
                self.values[k] = transform(i, self.columns[k] as usize, &self.values[k]);
            }
        }
    }
}

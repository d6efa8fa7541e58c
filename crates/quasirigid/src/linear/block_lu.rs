//! LU factors of a sparse matrix of 3x3 blocks, of the form `L_i W_ij + D_i`
//! (`D` on the diagonal only), in an order that keeps them sparse.
//!
//! A contact is coupled with those that touch one of its two bodies, and the graph of that falls into parts quickly when contacts
//! are eliminated by least degree: the factors of a heap of 276 capsules cost 0.1 million operations, the full matrix 378
//! million. What is left when all remaining contacts are coupled with each other is factored as a full matrix, with row
//! exchanges ([`crate::linear::dense_lu`]); blocks before that are pivots as they come, inverted as 3x3 matrices. `W` is
//! semidefinite, and whoever calls adds something positive to its diagonal: that is what makes it safe.

use super::block_rows::BlockRows;
use super::dense_lu::DenseLu;
use crate::math::{Mat3, Real, Vec3};
use nalgebra::{DMatrix, DVector};

/// Rows between two readings of the clock.
const ROWS_AT_ONCE: usize = 16;

/// The order of elimination, and which blocks the factors have.
#[derive(Debug, Clone)]
pub(crate) struct BlockPattern {
    /// Contact that is eliminated at place `k`.
    order: Vec<usize>,
    /// Place of a contact.
    place: Vec<usize>,
    /// From here on the matrix is full.
    sparse: usize,
    /// Columns (places) right of the diagonal in row `k < sparse` of `U`: from `upper_starts[k]`; they rise.
    upper_starts: Vec<usize>,
    upper: Vec<u32>,
    /// Columns (places, below `sparse`) left of the diagonal in row `k` of `L`: from `lower_starts[k]`; they rise.
    lower_starts: Vec<usize>,
    lower: Vec<u32>,
}

/// Factors of one matrix.
#[derive(Debug)]
pub(crate) struct BlockLu<'a> {
    pattern: &'a BlockPattern,
    /// Inverse pivots of the first `sparse` places.
    inverses: Vec<Mat3>,
    upper: Vec<Mat3>,
    lower: Vec<Mat3>,
    full: DenseLu,
}

/// Neighbours as bits, one row of words per contact.
struct Graph {
    words: usize,
    bits: Vec<u64>,
}

impl Graph {
    fn of(w: &BlockRows) -> Self {
        let n = w.len();
        let words = n.div_ceil(64);
        let mut graph = Self { words, bits: vec![0; words * n] };
        for i in 0..n {
            for (j, _) in w.row(i).filter(|(j, _)| *j != i) {
                graph.bits[i * words + j / 64] |= 1 << (j % 64);
                graph.bits[j * words + i / 64] |= 1 << (i % 64);
            }
        }
        graph
    }

    fn neighbours(&self, i: usize) -> Vec<usize> {
        let mut found = Vec::new();
        for (word, &bits) in self.bits[i * self.words..(i + 1) * self.words].iter().enumerate() {
            let mut bits = bits;
            while bits != 0 {
                found.push(64 * word + bits.trailing_zeros() as usize);
                bits &= bits - 1;
            }
        }
        found
    }

    fn degree(&self, i: usize) -> usize {
        self.bits[i * self.words..(i + 1) * self.words].iter().map(|bits| bits.count_ones() as usize).sum()
    }

    /// Takes `i` out; its `neighbours` become neighbours of each other.
    fn eliminate(&mut self, i: usize, neighbours: &[usize]) {
        let words = self.words;
        let row = self.bits[i * words..(i + 1) * words].to_vec();
        for &j in neighbours {
            let other = &mut self.bits[j * words..(j + 1) * words];
            for (a, b) in other.iter_mut().zip(&row) {
                *a |= b;
            }
            other[j / 64] &= !(1 << (j % 64));
            other[i / 64] &= !(1 << (i % 64));
        }
    }
}

impl BlockPattern {
    /// For matrices with the blocks of `w`.
    pub(crate) fn new(w: &BlockRows) -> Self {
        let n = w.len();
        let mut graph = Graph::of(w);
        let mut degrees: Vec<usize> = (0..n).map(|i| graph.degree(i)).collect();
        let mut left: Vec<usize> = (0..n).collect();
        let (mut order, mut rows) = (Vec::with_capacity(n), Vec::new());
        while let Some((at, &i)) = left.iter().enumerate().min_by_key(|(_, i)| (degrees[**i], **i)) {
            if degrees[i] + 1 >= left.len() {
                break;
            }
            left.remove(at);
            order.push(i);
            let neighbours = graph.neighbours(i);
            graph.eliminate(i, &neighbours);
            for &j in &neighbours {
                degrees[j] = graph.degree(j);
            }
            rows.push(neighbours);
        }
        let sparse = order.len();
        order.extend(left);
        let mut place = vec![0; n];
        for (k, &i) in order.iter().enumerate() {
            place[i] = k;
        }
        let mut lower_rows = vec![Vec::new(); n];
        let (mut upper_starts, mut upper) = (vec![0], Vec::new());
        for (k, row) in rows.iter().enumerate() {
            let start = upper.len();
            upper.extend(row.iter().map(|&j| place[j] as u32));
            upper[start..].sort_unstable();
            for &j in &upper[start..] {
                lower_rows[j as usize].push(k as u32);
            }
            upper_starts.push(upper.len());
        }
        let (mut lower_starts, mut lower) = (vec![0], Vec::new());
        for row in &lower_rows {
            lower.extend_from_slice(row);
            lower_starts.push(lower.len());
        }
        Self { order, place, sparse, upper_starts, upper, lower_starts, lower }
    }

    /// Multiplications and additions of one factorisation, about.
    pub(crate) fn cost(&self) -> Real {
        let sparse: usize = self.upper_starts.windows(2).map(|row| (row[1] - row[0] + 1).pow(2)).sum();
        // A block product takes about four times as long per operation as the same in a large product of matrices.
        27.0 * sparse as Real + 0.25 * ((3 * (self.order.len() - self.sparse)) as Real).powi(3) / 3.0
    }

    /// Factors of the matrix with blocks `left_i W_ij`, and `diagonal_i` added on the diagonal. `None` if a pivot cannot be inverted, or if
    /// `late`, asked now and then, says that there is no time left.
    pub(crate) fn factor(&self, w: &BlockRows, left: &[Mat3], diagonal: &[Mat3], late: &dyn Fn() -> bool) -> Option<BlockLu<'_>> {
        let n = self.order.len();
        let mut inverses = Vec::with_capacity(self.sparse);
        let (mut upper, mut lower) = (vec![Mat3::zeros(); self.upper.len()], vec![Mat3::zeros(); self.lower.len()]);
        let mut full = DMatrix::zeros(3 * (n - self.sparse), 3 * (n - self.sparse));
        // One row of the matrix, block by block; zero again after each row.
        let mut row = vec![Mat3::zeros(); n];
        for k in 0..n {
            if k % ROWS_AT_ONCE == ROWS_AT_ONCE - 1 && late() {
                return None;
            }
            let i = self.order[k];
            for (j, block) in w.row(i) {
                row[self.place[j]] += left[i] * block;
            }
            row[k] += diagonal[i];
            let left_of_diagonal = self.lower_starts[k]..self.lower_starts[k + 1];
            for (above, entry) in self.lower[left_of_diagonal.clone()].iter().zip(&mut lower[left_of_diagonal]) {
                let above = *above as usize;
                let multiplier = row[above] * inverses[above];
                *entry = multiplier;
                row[above] = Mat3::zeros();
                let range = self.upper_starts[above]..self.upper_starts[above + 1];
                for (column, block) in self.upper[range.clone()].iter().zip(&upper[range]) {
                    row[*column as usize] -= multiplier * block;
                }
            }
            if k < self.sparse {
                inverses.push(row[k].try_inverse().filter(|inverse| inverse.iter().all(|x| x.is_finite()))?);
                row[k] = Mat3::zeros();
                for entry in self.upper_starts[k]..self.upper_starts[k + 1] {
                    upper[entry] = std::mem::take(&mut row[self.upper[entry] as usize]);
                }
            } else {
                for (column, block) in row[self.sparse..].iter_mut().enumerate() {
                    full.fixed_view_mut::<3, 3>(3 * (k - self.sparse), 3 * column).copy_from(block);
                    *block = Mat3::zeros();
                }
            }
        }
        Some(BlockLu { pattern: self, inverses, upper, lower, full: DenseLu::new(full, late)? })
    }
}

impl BlockLu<'_> {
    /// Replaces the right-hand side by the solution, contact by contact.
    pub(crate) fn solve(&self, b: &mut [Vec3]) {
        let BlockPattern { order, sparse, upper_starts, lower_starts, .. } = self.pattern;
        let (n, sparse) = (order.len(), *sparse);
        let mut x: Vec<Vec3> = order.iter().map(|&i| b[i]).collect();
        for k in 0..n {
            let range = lower_starts[k]..lower_starts[k + 1];
            let mut sum = x[k];
            for (column, block) in self.pattern.lower[range.clone()].iter().zip(&self.lower[range]) {
                sum -= block * x[*column as usize];
            }
            x[k] = sum;
        }
        let mut tail = DVector::from_iterator(3 * (n - sparse), x[sparse..].iter().flat_map(|x| [x.x, x.y, x.z]));
        self.full.solve(&mut tail);
        for (k, x) in x[sparse..].iter_mut().enumerate() {
            *x = tail.fixed_rows::<3>(3 * k).into_owned();
        }
        for k in (0..sparse).rev() {
            let range = upper_starts[k]..upper_starts[k + 1];
            let mut sum = x[k];
            for (column, block) in self.pattern.upper[range.clone()].iter().zip(&self.upper[range]) {
                sum -= block * x[*column as usize];
            }
            x[k] = self.inverses[k] * sum;
        }
        for (x, &i) in x.iter().zip(order) {
            b[i] = *x;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// A matrix with a strong diagonal and, at random, a share of the other blocks; not symmetric.
    fn random(n: usize, share: Real, seed: u64) -> BlockRows {
        let mut state = seed.wrapping_mul(0x9E37_79B9_7F4A_7C15) | 1;
        let mut next = move || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 11) as Real / (1u64 << 52) as Real - 1.0
        };
        let (mut starts, mut columns, mut values) = (vec![0], Vec::new(), Vec::new());
        for i in 0..n {
            for j in 0..n {
                if i == j || next().abs() < share {
                    columns.push(j as u32);
                    values.push(Mat3::from_fn(|_, _| next()) * 0.3 + if i == j { Mat3::identity() * 3.0 } else { Mat3::zeros() });
                }
            }
            starts.push(values.len());
        }
        BlockRows::new(starts, columns, values).unwrap()
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]

        #[test]
        fn factors_solve_the_system_sparse_or_full(
            n in 0usize..70, share in prop_oneof![Just(0.0), 0.0..0.2f64, Just(1.0)], seed in 0u64..1000,
        ) {
            let w = random(n, share, seed);
            let left: Vec<Mat3> = (0..n).map(|i| Mat3::identity() * (1.0 + i as Real / n as Real)).collect();
            let diagonal: Vec<Mat3> = (0..n).map(|i| Mat3::identity() * (0.2 * n as Real) * (1.0 + (i % 3) as Real)).collect();
            let x: Vec<Vec3> = (0..n).map(|i| Vec3::new(1.0, i as Real, -0.5)).collect();
            let mut b: Vec<Vec3> = (0..n).map(|i| left[i] * w.row(i).map(|(j, w)| w * x[j]).sum::<Vec3>() + diagonal[i] * x[i]).collect();
            let pattern = BlockPattern::new(&w);
            pattern.factor(&w, &left, &diagonal, &|| false).unwrap().solve(&mut b);
            let error = b.iter().zip(&x).map(|(b, x)| (b - x).norm()).sum::<Real>() / (1.0 + x.iter().map(Vec3::norm).sum::<Real>());
            prop_assert!(error < 1e-10, "{n} contacts, share {share}: {error:e}");
        }
    }

    /// A chain has factors as sparse as itself, whatever its length and order.
    #[test]
    fn a_chain_stays_a_chain() {
        let n = 100;
        let place = |k: usize| (37 * k) % n;
        let mut rows = vec![Vec::new(); n];
        for k in 0..n {
            for other in k.saturating_sub(1)..(k + 2).min(n) {
                rows[place(k)].push((place(other) as u32, if k == other { Mat3::identity() * 3.0 } else { Mat3::identity() }));
            }
        }
        let (mut starts, mut columns, mut values) = (vec![0], Vec::new(), Vec::new());
        for mut row in rows {
            row.sort_by_key(|(j, _)| *j);
            columns.extend(row.iter().map(|(j, _)| *j));
            values.extend(row.iter().map(|(_, w)| *w));
            starts.push(values.len());
        }
        let pattern = BlockPattern::new(&BlockRows::new(starts, columns, values).unwrap());
        assert!(pattern.upper.len() <= n && pattern.sparse >= n - 3, "{} blocks", pattern.upper.len());
    }

    #[test]
    fn a_singular_matrix_has_no_factors() {
        let w = random(4, 0.0, 1);
        let zero = vec![Mat3::zeros(); 4];
        assert!(BlockPattern::new(&w).factor(&w, &zero, &zero, &|| false).is_none());
    }
}

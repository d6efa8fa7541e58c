//! The Delassus operator as a sparse matrix of 3x3 blocks: for tests, export, and problems that come from elsewhere.

use super::{ContactBlock, Delassus, MatrixFree};
use crate::error::{Error, Result};
use crate::linear::block_lu::BlockPattern;
use crate::linear::block_rows::BlockRows;
use crate::math::{Mat3, Real, Vec3};
use std::sync::OnceLock;

/// Factors that cost more than this many products with the matrix are not computed: a Krylov method is faster.
const MOST_EXPENSIVE_FACTORS: Real = 200.0;

/// `W` (m/N) in block rows, with the reactions it is applied to.
///
/// The matrix is used as given: a source that is slightly asymmetric is solved as it is, not symmetrised.
#[derive(Debug, Clone, Default)]
pub struct Assembled {
    rows: BlockRows,
    blocks: Vec<ContactBlock>,
    reactions: Vec<Vec3>,
    pattern: OnceLock<BlockPattern>,
}

impl Assembled {
    /// From block rows: row `i` has the blocks `values[k]` in block columns `columns[k]` for `k` from `starts[i]` to `starts[i + 1]`.
    /// `starts` has one entry more than there are contacts. Blocks in m/N, contact frames.
    ///
    /// # Errors
    /// `InvalidShape` if the arrays do not fit together, `InvalidValue` for a
    /// non-finite entry or a diagonal block that is not positive definite.
    pub fn from_block_rows(starts: Vec<usize>, columns: Vec<u32>, values: Vec<Mat3>) -> Result<Self> {
        Self::from_rows(BlockRows::new(starts, columns, values)?)
    }

    fn from_rows(rows: BlockRows) -> Result<Self> {
        let n = rows.len();
        let mut blocks = Vec::with_capacity(n);
        for i in 0..n {
            let diagonal = rows.row(i).filter(|(j, _)| *j == i).map(|(_, w)| *w).sum::<Mat3>();
            blocks.push(ContactBlock::new(&diagonal).ok_or_else(|| {
                let got = format!("{:.3e} in block {i}", diagonal);
                Error::value(
                    "W",
                    "positive definite 3x3 blocks on the diagonal (m/N)",
                    got,
                    "give every contact a compliance in all three directions",
                )
            })?);
        }
        Ok(Self { rows, blocks, reactions: vec![Vec3::zeros(); n], pattern: OnceLock::new() })
    }

    /// From all `n x n` blocks, row by row; blocks that are zero are left out.
    ///
    /// # Errors
    /// As [`Assembled::from_block_rows`]; `InvalidShape` also if the number of blocks is not `n * n`.
    pub fn from_dense(n: usize, blocks: &[Mat3]) -> Result<Self> {
        if blocks.len() != n * n {
            return Err(Error::shape("blocks of W", format!("{n} x {n} = {} blocks", n * n), blocks.len(), "pass all blocks, row by row"));
        }
        Self::gather(n, |i, j| Some(blocks[i * n + j]).filter(|w| i == j || *w != Mat3::zeros()))
    }

    /// The matrix that a matrix-free operator stands for. Cost grows with the square of the number of contacts.
    ///
    /// # Errors
    /// As [`Assembled::from_block_rows`].
    pub fn from_matrix_free(w: &MatrixFree) -> Result<Self> {
        let mut assembled = Self::gather(w.len(), |i, j| (i == j || w.is_coupled(i, j)).then(|| w.block(i, j)))?;
        for (i, block) in assembled.blocks.iter_mut().enumerate() {
            block.set_drag(w.diagonal_block(i).drag());
        }
        Ok(assembled)
    }

    fn gather(n: usize, block: impl Fn(usize, usize) -> Option<Mat3>) -> Result<Self> {
        let (mut starts, mut columns, mut values) = (vec![0], Vec::new(), Vec::new());
        for i in 0..n {
            for j in 0..n {
                if let Some(w) = block(i, j) {
                    columns.push(j as u32);
                    values.push(w);
                }
            }
            starts.push(values.len());
        }
        Self::from_block_rows(starts, columns, values)
    }

    /// Block row `i` as pairs of block column and block (m/N).
    pub fn row(&self, i: usize) -> impl Iterator<Item = (usize, &Mat3)> {
        self.rows.row(i)
    }

    /// The block in row `i` and column `j`, if it is stored. The columns of the row must rise.
    pub(crate) fn block(&self, i: usize, j: usize) -> Option<&Mat3> {
        self.rows.block(i, j)
    }

    /// The blocks alone.
    pub(crate) fn rows(&self) -> &BlockRows {
        &self.rows
    }

    /// The order of elimination for factors of this matrix; found at the first call.
    pub(crate) fn pattern(&self) -> &BlockPattern {
        self.pattern.get_or_init(|| BlockPattern::new(&self.rows))
    }

    /// The rows and columns of `contacts`, which rise. All reactions are zero.
    pub(crate) fn part(&self, contacts: &[usize]) -> Self {
        let mut part = Self { rows: BlockRows::empty(), reactions: vec![Vec3::zeros(); contacts.len()], ..Self::default() };
        for &i in contacts {
            part.rows.push_row(self.row(i).filter_map(|(j, w)| contacts.binary_search(&j).ok().map(|k| (k, *w))));
            part.blocks.push(self.blocks[i]);
        }
        part
    }

    /// The matrix times a factor > 0, with no reactions.
    pub(crate) fn scaled(&self, factor: Real) -> Option<Self> {
        self.rows.scaled(factor).and_then(Self::from_rows).ok()
    }

    /// The same blocks, each mapped to another by its row and column.
    pub(crate) fn map(&self, transform: impl Fn(usize, usize, &Mat3) -> Mat3) -> BlockRows {
        let mut mapped = self.rows.clone();
        mapped.map(transform);
        mapped
    }

    /// The full matrix, `3n x 3n` numbers row by row, m/N. For export.
    pub fn to_dense(&self) -> Vec<Real> {
        let width = 3 * self.len();
        let mut dense = vec![0.0; width * width];
        for i in 0..self.len() {
            for (j, w) in self.row(i) {
                for r in 0..3 {
                    for c in 0..3 {
                        dense[(3 * i + r) * width + 3 * j + c] += w[(r, c)];
                    }
                }
            }
        }
        dense
    }
}

impl Delassus for Assembled {
    fn len(&self) -> usize {
        self.blocks.len()
    }

    fn diagonal_block(&self, i: usize) -> &ContactBlock {
        &self.blocks[i]
    }

    fn set_reactions(&mut self, f: &[Vec3]) {
        self.reactions.copy_from_slice(f);
    }

    fn displacement(&self, i: usize) -> Vec3 {
        self.rows.product(i, &self.reactions)
    }

    fn add_reaction(&mut self, i: usize, change: &Vec3) {
        self.reactions[i] += change;
    }

    fn solve_directly(&self, left: &[Mat3], diagonal: &[Mat3], b: &mut [Vec3], late: &dyn Fn() -> bool) -> bool {
        let pattern = self.pattern();
        if pattern.cost() > MOST_EXPENSIVE_FACTORS * 9.0 * self.rows.block_count() as Real {
            return false;
        }
        let factors = pattern.factor(&self.rows, left, diagonal, late);
        factors.as_ref().inspect(|factors| factors.solve(b)).is_some()
    }
}

#[cfg(test)]
mod tests {
    use super::super::NO_BODY;
    use super::*;
    use crate::math::{Mat3x6, Rot};
    use proptest::prelude::*;

    /// Numbers in (-1, 1) from a seed: a linear congruential generator, the same everywhere.
    fn numbers(seed: u64) -> impl FnMut() -> Real {
        let mut state = seed.wrapping_mul(0x9E37_79B9_7F4A_7C15) | 1;
        move || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 11) as Real / (1u64 << 52) as Real - 1.0
        }
    }

    /// Contacts on four bodies and on a fixed one, with a Gaussian isotropic and a rotated tensor compliance on each patch of one body.
    fn random_operator(n: usize, seed: u64) -> MatrixFree {
        let mut w = MatrixFree::new();
        fill(&mut w, n, seed);
        w
    }

    fn fill(w: &mut MatrixFree, n: usize, seed: u64) {
        let mut next = numbers(seed);
        let places: Vec<Vec3> = (0..n).map(|_| Vec3::from_fn(|_, _| next())).collect();
        let axes: Vec<Mat3> =
            (0..n).map(|_| Rot::from_scaled_axis(Vec3::from_fn(|_, _| 3.0 * next())).to_rotation_matrix().into_inner()).collect();
        w.clear(4);
        for i in 0..n {
            let a = (i % 4) as u32;
            let b = if i % 5 == 0 { NO_BODY } else { ((i + 1) % 4) as u32 };
            let (ja, jb) = (Mat3x6::from_fn(|_, _| next()), Mat3x6::from_fn(|_, _| next()));
            w.push_contact(a, &ja, b, &jb, &axes[i]);
            for j in (0..n).filter(|j| j % 4 == i % 4) {
                let gaussian = (-(places[i] - places[j]).norm_squared()).exp();
                w.push_isotropic(j, gaussian + if i == j { 0.1 } else { 0.0 });
                w.push_tensor(j, &(Mat3::new(2.0, 0.5, 0.0, 0.5, 1.0, 0.0, 0.0, 0.0, 3.0) * gaussian));
            }
        }
        w.finish().unwrap();
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]

        #[test]
        fn matrix_free_and_assembled_agree(n in 1usize..24, seed in 0u64..1000) {
            let mut free = random_operator(n, seed);
            let mut assembled = Assembled::from_matrix_free(&free).unwrap();
            let mut next = numbers(seed + 1);
            let f: Vec<Vec3> = (0..n).map(|_| Vec3::from_fn(|_, _| next())).collect();
            free.set_reactions(&f);
            assembled.set_reactions(&f);
            let change = Vec3::new(0.3, -0.2, 0.7);
            free.add_reaction(n / 2, &change);
            assembled.add_reaction(n / 2, &change);
            let scale = (0..n).flat_map(|i| assembled.row(i).map(|(_, w)| w.norm()).collect::<Vec<_>>()).sum::<Real>() / n as Real;
            for i in 0..n {
                let difference = (free.displacement(i) - assembled.displacement(i)).norm() / scale;
                prop_assert!(difference < 1e-14, "contact {i}: {difference:e}");
                prop_assert_eq!(free.diagonal_block(i), assembled.diagonal_block(i));
            }
        }

        #[test]
        fn the_operator_is_symmetric_and_dissipative(n in 1usize..16, seed in 0u64..1000) {
            let w = Assembled::from_matrix_free(&random_operator(n, seed)).unwrap().to_dense();
            let w = nalgebra::DMatrix::from_row_slice(3 * n, 3 * n, &w);
            let skew = (&w - w.transpose()).norm() / w.norm();
            prop_assert!(skew < 1e-14, "skew part {skew:e}");
            let lowest = w.clone().symmetric_eigenvalues().min() / w.norm();
            prop_assert!(lowest > -1e-13, "lowest eigenvalue {lowest:e}");
        }
    }

    #[test]
    fn refilled_operator_forgets_the_last_step() {
        let (mut reused, mut fresh) = (random_operator(20, 3), random_operator(7, 4));
        reused.set_reactions(&[Vec3::new(3.0, 2.0, 1.0); 20]);
        fill(&mut reused, 7, 4);
        assert_eq!(reused.len(), 7);
        assert!((0..7).all(|i| reused.displacement(i) == Vec3::zeros()), "reactions of the last step survived");
        for w in [&mut reused, &mut fresh] {
            w.set_reactions(&[Vec3::new(1.0, 2.0, 3.0); 7]);
        }
        assert!((0..7).all(|i| reused.displacement(i) == fresh.displacement(i)));
    }

    #[test]
    fn bad_matrices_are_refused_with_the_contact_named() {
        let unit = Mat3::identity();
        assert!(Assembled::from_dense(2, &[unit; 3]).unwrap_err().to_string().contains("4 blocks, got 3"));
        let singular = [unit, Mat3::zeros(), Mat3::zeros(), Mat3::from_diagonal(&Vec3::new(1.0, 1.0, 0.0))];
        assert!(Assembled::from_dense(2, &singular).unwrap_err().to_string().contains("block 1"));
        assert!(Assembled::from_dense(1, &[unit * Real::NAN]).is_err());
        assert!(Assembled::from_block_rows(vec![0, 1], vec![1], vec![unit]).is_err());
        assert!(Assembled::from_block_rows(vec![0, 2], vec![0], vec![unit]).is_err());
        assert!(Assembled::from_block_rows(vec![], vec![], vec![]).is_err());
        assert_eq!(Assembled::from_dense(0, &[]).unwrap().len(), 0);

        let mut w = MatrixFree::new();
        w.clear(1);
        let j = Mat3x6::from_fn(|r, c| if r == c { 1.0 } else { 0.0 });
        w.push_contact(0, &j, NO_BODY, &Mat3x6::zeros(), &unit);
        w.push_contact(NO_BODY, &j, NO_BODY, &j, &unit);
        assert_eq!(w.finish(), Err(1));
        w.clear(1);
        w.push_contact(0, &j, 1, &j, &unit);
        assert_eq!(w.finish(), Err(0));
        w.clear(1);
        w.push_contact(0, &j, NO_BODY, &j, &unit);
        w.push_isotropic(1, 1.0);
        assert_eq!(w.finish(), Err(0));
    }
}

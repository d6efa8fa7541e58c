//! LU factors of a full matrix with row exchanges, in panels, so that nearly all of the work is products of matrices.

use crate::math::Real;
use nalgebra::{DMatrix, DVector};

/// Columns factored at a time. 16 and 64 cost up to 20 % more at 300 to 1,500 unknowns.
const PANEL: usize = 32;

/// `P A = L U`, in the place of `A`.
#[derive(Debug)]
pub(crate) struct DenseLu {
    factors: DMatrix<Real>,
    /// Row that was exchanged with row `k` at step `k`.
    exchanges: Vec<usize>,
}

impl DenseLu {
    /// `None` if a pivot is zero or not finite, or if `late`, asked before every panel, says that there is no time left.
    pub(crate) fn new(mut a: DMatrix<Real>, late: &dyn Fn() -> bool) -> Option<Self> {
        let n = a.nrows();
        let mut exchanges = Vec::with_capacity(n);
        for start in (0..n).step_by(PANEL) {
            if late() {
                return None;
            }
            let end = (start + PANEL).min(n);
            for k in start..end {
                let pivot = k + a.view((k, k), (n - k, 1)).column(0).iamax();
                let size = a[(pivot, k)];
                if size == 0.0 || !size.is_finite() {
                    return None;
                }
                exchanges.push(pivot);
                if pivot != k {
                    a.swap_rows(pivot, k);
                }
                let inverse = 1.0 / size;
                a.view_mut((k + 1, k), (n - k - 1, 1)).scale_mut(inverse);
                // The rest of the panel at once, the rest of the matrix after the panel.
                let (mut left, mut right) = a.columns_range_pair_mut(k..k + 1, k + 1..end);
                let multipliers = left.view_mut((k + 1, 0), (n - k - 1, 1));
                for mut column in right.column_iter_mut() {
                    let above = column[k];
                    if above != 0.0 {
                        column.rows_mut(k + 1, n - k - 1).axpy(-above, &multipliers.column(0), 1.0);
                    }
                }
            }
            if end == n {
                break;
            }
            let (panel, mut rest) = a.columns_range_pair_mut(start..end, end..n);
            let width = end - start;
            for mut column in rest.column_iter_mut() {
                for k in 0..width {
                    let above = column[start + k];
                    column.rows_mut(start + k + 1, width - k - 1).axpy(
                        -above,
                        &panel.view((start + k + 1, k), (width - k - 1, 1)).column(0),
                        1.0,
                    );
                }
            }
            let upper = rest.rows(start, width).into_owned();
            rest.rows_mut(end, n - end).gemm(-1.0, &panel.rows(end, n - end), &upper, 1.0);
        }
        Some(Self { factors: a, exchanges })
    }

    /// Replaces the right-hand side by the solution.
    pub(crate) fn solve(&self, b: &mut DVector<Real>) {
        for (k, pivot) in self.exchanges.iter().enumerate() {
            b.swap_rows(k, *pivot);
        }
        let n = self.exchanges.len();
        for k in 0..n {
            let known = b[k];
            b.rows_mut(k + 1, n - k - 1).axpy(-known, &self.factors.view((k + 1, k), (n - k - 1, 1)).column(0), 1.0);
        }
        for k in (0..n).rev() {
            b[k] /= self.factors[(k, k)];
            let known = b[k];
            b.rows_mut(0, k).axpy(-known, &self.factors.view((0, k), (k, 1)).column(0), 1.0);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn factors_solve_the_system() {
        for n in [1, 2, 31, 32, 33, 100] {
            let mut state = 7u64;
            let a = DMatrix::from_fn(n, n, |_, _| {
                state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
                (state >> 11) as Real / (1u64 << 52) as Real - 1.0
            });
            let x = DVector::from_fn(n, |i, _| 1.0 + i as Real);
            let mut b = &a * &x;
            DenseLu::new(a, &|| false).unwrap().solve(&mut b);
            let error = (&b - &x).norm() / x.norm();
            assert!(error < 1e-10, "{n} unknowns: {error:e}");
        }
        assert!(DenseLu::new(DMatrix::zeros(3, 3), &|| false).is_none());
        assert!(DenseLu::new(DMatrix::from_element(2, 2, Real::NAN), &|| false).is_none());
    }
}

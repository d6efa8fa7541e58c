//! Anderson acceleration: the sweeps as a fixed-point iteration, extrapolated from the last few.
//!
//! A sweep maps reactions `x` to `G(x)`; the solution is where `r = G(x) - x` is zero. While contacts keep their
//! status `G` is affine or nearly so, and a combination of past sweeps predicts where `r` vanishes (Walker and Ni
//! 2011, type II). With `dr_k`, `dg_k` the changes of `r` and `G(x)` from one sweep to the next:
//!
//! ```text
//! gamma = argmin | r - sum gamma_k dr_k |,      x_next = G(x) - sum gamma_k dg_k
//! ```
//!
//! The least-squares problem is solved through its normal equations, of at most [`DEPTH`] unknowns. The extrapolated forces are
//! projected on their cones. Whether the step helped is decided by the caller, from the change of the next sweep.

// Small dense algebra reads best with its indices.
#![allow(clippy::needless_range_loop)]

use crate::math::{Real, Vec3};

/// Sweeps remembered. 5 needs up to 20 % more sweeps on half-space pads, 16 up to 25 % fewer, at twice the cost of a step.
const DEPTH: usize = 8;

/// Added to the diagonal of the scaled normal equations: directions that past sweeps do not distinguish are left as they are.
const DAMPING: Real = 1e-12;

type Small = [Real; DEPTH];

/// The last few sweeps.
#[derive(Debug, Clone, Default)]
pub(crate) struct Anderson {
    /// `dr_k`, N: slot after slot of `n` vectors.
    residual_changes: Vec<Vec3>,
    /// `dg_k`, N: slot after slot of `n` vectors.
    image_changes: Vec<Vec3>,
    last_residual: Vec<Vec3>,
    last_image: Vec<Vec3>,
    /// `dr_j . dr_k`, N^2.
    gram: [Small; DEPTH],
    /// Slots in use, and the slot to overwrite next.
    used: usize,
    next: usize,
    /// Whether `last_residual` and `last_image` are those of the sweep before.
    started: bool,
}

impl Anderson {
    /// Makes room for `n` contacts.
    pub(crate) fn reserve(&mut self, n: usize) {
        if self.last_image.len() < n {
            for slots in [&mut self.residual_changes, &mut self.image_changes] {
                slots.resize(DEPTH * n, Vec3::zeros());
            }
            self.last_residual.resize(n, Vec3::zeros());
            self.last_image.resize(n, Vec3::zeros());
        }
    }

    /// Forgets all sweeps.
    pub(crate) fn restart(&mut self) {
        (self.used, self.next, self.started) = (0, 0, false);
    }

    /// What the last sweep gave, before it was extrapolated, N.
    pub(crate) fn last_image(&self, n: usize) -> &[Vec3] {
        &self.last_image[..n]
    }

    /// `before` went into a sweep and `f` came out of it. Extrapolates `f` (N) if there are enough past sweeps, and
    /// returns whether it did. `feasible` puts the reaction of a contact back to where it may be.
    pub(crate) fn extrapolate(&mut self, before: &[Vec3], f: &mut [Vec3], feasible: impl Fn(usize, &Vec3) -> Vec3) -> bool {
        let first = !self.started;
        if !first {
            self.remember_change(before, f);
        }
        for i in 0..f.len() {
            self.last_residual[i] = f[i] - before[i];
            self.last_image[i] = f[i];
        }
        self.started = true;
        if first {
            return false;
        }
        let n = f.len();
        let mut rhs = [0.0; DEPTH];
        for k in 0..self.used {
            rhs[k] = dot(&self.residual_changes[k * n..(k + 1) * n], &self.last_residual[..n]);
        }
        let Some(gamma) = solve_normal_equations(&self.gram, &rhs, self.used) else {
            self.restart();
            return false;
        };
        for k in 0..self.used {
            for (f, dg) in f.iter_mut().zip(&self.image_changes[k * n..(k + 1) * n]) {
                *f -= dg * gamma[k];
            }
        }
        for (i, f) in f.iter_mut().enumerate() {
            *f = feasible(i, f);
        }
        true
    }

    fn remember_change(&mut self, before: &[Vec3], f: &[Vec3]) {
        let (n, slot) = (f.len(), self.next);
        let range = slot * n..(slot + 1) * n;
        let (dr, dg) = (&mut self.residual_changes[range.clone()], &mut self.image_changes[range.clone()]);
        for i in 0..n {
            dr[i] = (f[i] - before[i]) - self.last_residual[i];
            dg[i] = f[i] - self.last_image[i];
        }
        self.next = (slot + 1) % DEPTH;
        self.used = (self.used + 1).min(DEPTH);
        for k in 0..self.used {
            let product = dot(&self.residual_changes[range.clone()], &self.residual_changes[k * n..(k + 1) * n]);
            self.gram[slot][k] = product;
            self.gram[k][slot] = product;
        }
    }
}

fn dot(x: &[Vec3], y: &[Vec3]) -> Real {
    x.iter().zip(y).map(|(x, y)| x.dot(y)).sum()
}

/// Cholesky on the first `n` rows, scaled to a unit diagonal. `None` if rounding has made them indefinite.
fn solve_normal_equations(gram: &[Small; DEPTH], rhs: &Small, n: usize) -> Option<Small> {
    let scale: Small = std::array::from_fn(|k| if k < n && gram[k][k] > 0.0 { 1.0 / gram[k][k].sqrt() } else { 0.0 });
    let mut l = [[0.0; DEPTH]; DEPTH];
    for i in 0..n {
        for j in 0..=i {
            let mut sum = gram[i][j] * scale[i] * scale[j] + if i == j { DAMPING } else { 0.0 };
            for k in 0..j {
                sum -= l[i][k] * l[j][k];
            }
            if i != j {
                l[i][j] = sum / l[j][j];
            } else if sum > 0.0 {
                l[i][i] = sum.sqrt();
            } else {
                return None;
            }
        }
    }
    let mut x = [0.0; DEPTH];
    for i in 0..n {
        x[i] = rhs[i] * scale[i];
        for k in 0..i {
            x[i] -= l[i][k] * x[k];
        }
        x[i] /= l[i][i];
    }
    for i in (0..n).rev() {
        for k in i + 1..n {
            x[i] -= l[k][i] * x[k];
        }
        x[i] /= l[i][i];
    }
    Some(std::array::from_fn(|k| x[k] * scale[k]))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Six frictionless unknowns under an affine contraction: as many sweeps as unknowns and one more, then exact.
    #[test]
    fn affine_iteration_is_solved_in_as_many_sweeps_as_it_has_unknowns() {
        let rates = [0.99, 0.95, 0.9, 0.7, 0.4, -0.3];
        let image = |x: &[Vec3]| -> Vec<Vec3> { x.iter().zip(rates).map(|(x, a)| Vec3::new(a * x.x + 1.0, 0.0, 0.0)).collect() };
        let mut anderson = Anderson::default();
        anderson.reserve(6);
        let mut x = vec![Vec3::zeros(); 6];
        for _ in 0..9 {
            let before = x.clone();
            x = image(&before);
            anderson.extrapolate(&before, &mut x, |_, x| *x);
        }
        for (x, a) in x.iter().zip(rates) {
            let error = (x.x * (1.0 - a) - 1.0).abs();
            assert!(error < 1e-6, "rate {a}: {error:e}");
        }
    }
}

//! Anderson acceleration of the sweeps.

// The loops below read like the algebra that they are.
#![allow(clippy::needless_range_loop)]

use super::residual::project_on_cone;
use crate::math::{Real, Vec3};

/// Sweeps remembered.
pub(super) const DEPTH: usize = 8;

/// The last few sweeps, each as the change from one to the next of `x`, what went in, and of `r = G(x) - x`, what the sweep did to it.
#[derive(Debug, Clone, Default)]
pub(super) struct Anderson {
    /// Per slot, `n` vectors: difference of `r`, N.
    residuals: Vec<Vec3>,
    /// Per slot, `n` vectors: difference of `G(x)`, N.
    images: Vec<Vec3>,
    last_residual: Vec<Vec3>,
    last_image: Vec<Vec3>,
    gram: [[Real; DEPTH]; DEPTH],
    used: usize,
    next: usize,
    started: bool,
}

impl Anderson {
    pub(super) fn reset(&mut self, n: usize) {
        for slots in [&mut self.residuals, &mut self.images] {
            slots.resize(DEPTH * n, Vec3::zeros());
        }
        self.last_residual.resize(n, Vec3::zeros());
        self.last_image.resize(n, Vec3::zeros());
        self.restart();
    }

    pub(super) fn restart(&mut self) {
        (self.used, self.next, self.started) = (0, 0, false);
    }

    pub(super) fn last_image(&self) -> &[Vec3] {
        &self.last_image
    }

    /// `before` went into the sweep and `f` came out of it; on return `f` is extrapolated (true) or as it was (false).
    pub(super) fn extrapolate(&mut self, before: &[Vec3], f: &mut [Vec3], mu: &[Real]) -> bool {
        let n = f.len();
        if self.started {
            let slot = self.next;
            let range = slot * n..(slot + 1) * n;
            let (dr, dg) = (&mut self.residuals[range.clone()], &mut self.images[range]);
            for i in 0..n {
                dr[i] = (f[i] - before[i]) - self.last_residual[i];
                dg[i] = f[i] - self.last_image[i];
            }
            self.next = (slot + 1) % DEPTH;
            self.used = (self.used + 1).min(DEPTH);
            for k in 0..self.used {
                let g = dot(&self.residuals[slot * n..(slot + 1) * n], &self.residuals[k * n..(k + 1) * n]);
                self.gram[slot][k] = g;
                self.gram[k][slot] = g;
            }
        }
        for i in 0..n {
            self.last_residual[i] = f[i] - before[i];
        }
        self.last_image.copy_from_slice(f);
        if !self.started {
            self.started = true;
            return false;
        }
        let mut rhs = [0.0; DEPTH];
        for k in 0..self.used {
            rhs[k] = dot(&self.residuals[k * n..(k + 1) * n], &self.last_residual);
        }
        let Some(gamma) = solve_gram(&self.gram, &rhs, self.used) else {
            self.restart();
            return false;
        };
        for k in 0..self.used {
            for (f, dg) in f.iter_mut().zip(&self.images[k * n..(k + 1) * n]) {
                *f -= dg * gamma[k];
            }
        }
        for (f, mu) in f.iter_mut().zip(mu) {
            *f = project_on_cone(f, *mu);
        }
        true
    }
}

fn dot(x: &[Vec3], y: &[Vec3]) -> Real {
    x.iter().zip(y).map(|(x, y)| x.dot(y)).sum()
}

/// Cholesky with a little on the diagonal.
fn solve_gram(gram: &[[Real; DEPTH]; DEPTH], rhs: &[Real; DEPTH], used: usize) -> Option<[Real; DEPTH]> {
    let mut l = *gram;
    let mut x = *rhs;
    // Scaled to unit diagonal.
    let scale: [Real; DEPTH] = std::array::from_fn(|k| if k < used && gram[k][k] > 0.0 { 1.0 / gram[k][k].sqrt() } else { 0.0 });
    for i in 0..used {
        for j in 0..=i {
            let mut sum = gram[i][j] * scale[i] * scale[j];
            if i == j {
                sum += 1e-12;
            }
            for k in 0..j {
                sum -= l[i][k] * l[j][k];
            }
            if i == j {
                if sum.is_nan() || sum <= 0.0 {
                    return None;
                }
                l[i][i] = sum.sqrt();
            } else {
                l[i][j] = sum / l[j][j];
            }
        }
    }
    for i in 0..used {
        x[i] *= scale[i];
        for k in 0..i {
            x[i] -= l[i][k] * x[k];
        }
        x[i] /= l[i][i];
    }
    for i in (0..used).rev() {
        for k in i + 1..used {
            x[i] -= l[k][i] * x[k];
        }
        x[i] /= l[i][i];
    }
    for k in 0..used {
        x[k] *= scale[k];
    }
    Some(x)
}

//! A damped Newton step, for problems on which sweeps converge slowly: a rigid box on a hundred support points, a stack, a wedge.
//!
//! Let `S_i(b_i)` be the exact solution of contact `i` ([`crate::delassus::ContactBlock::solve`]) for the displacement
//! `b_i = delta_i - W_ii f_i` that the others leave it. The solution of the whole problem is the root of
//!
//! ```text
//! F_i(f) = f_i - S_i(b_i)
//! ```
//!
//! `S_i` is smooth as long as the contact stays open, stuck or slipping, so this is a case for a
//! semismooth Newton method (Alart and Curnier 1991 use another function with the same roots). With
//! `T_i = -dS_i/db_i` (N/m), known in closed form ([`slope`]), a step `d` solves
//!
//! ```text
//! d_i + T_i ((W d)_i - W_ii d_i) = -F_i(f)
//! ```
//!
//! by GMRES, which asks for products `W d` only and, with `W` a few rigid bodies plus small compliances, needs about as many of them as the
//! bodies have coordinates.
//!
//! Two things make it robust. First, damping by a proximal term: `alpha W_ii (f_i - f_i^before)` is added to the
//! displacement, which means: for this step each contact is softer by the share `alpha`, about the forces it has. `alpha` falls
//! by ten with every full step and rises when a step had to be shortened. Second, forces may leave their cones on the way.
//! Projecting them back after each step would push the bodies about, each contact a little, by far more than the step had gained;
//! the natural map measures the violation instead, and a last sweep puts everything exactly into the cones.

use crate::delassus::{Delassus, natural_map, relative, slope};
use crate::math::{Mat3, Real, Vec3};

/// Krylov vectors at most per step: memory of 40 times the reactions. A step that
/// would need more is cut short, which the damping makes up for.
const DEPTH: usize = 40;

/// The linear system is solved to this share of its right-hand side. Looser: more steps;
/// tighter: more products per step. 0.1 and 0.001 cost the same in total within 20 %.
const FORCING: Real = 0.01;

/// Damping to which a solve can come back: contacts twice as soft.
const FULL_DAMPING: Real = 1.0;

/// Damping by which a solve starts, times its residual. A warm start that sweeps have brought to 1e-7 is near the
/// solution: with full damping it would go to it in four short steps instead of one or two. A box pushed by fingers on
/// its stand: 44 instead of 47 sweeps, and a fifth less time. 0.1 to 10 cost the same within 5 %.
const FIRST_DAMPING: Real = 10.0;

/// Smallest damping; below it the term is lost in rounding.
const LEAST_DAMPING: Real = 1e-12;

/// The same for exact steps, which without it would be arbitrary along forces that move nothing.
const LEAST_DIRECT_DAMPING: Real = 1e-9;

/// Step lengths tried.
const LENGTHS: [Real; 5] = [1.0, 0.5, 0.25, 0.1, 0.03];

/// Scratch and damping of a run of steps.
#[derive(Debug, Clone, Default)]
pub(crate) struct Newton {
    /// Krylov basis, vector after vector of `n`.
    basis: Vec<Vec3>,
    /// `T_i`, N/m.
    slopes: Vec<Mat3>,
    /// `d`, N.
    step: Vec<Vec3>,
    /// Reactions before the step, N.
    before: Vec<Vec3>,
    damping: Real,
    /// Whether [`Delassus::solve_directly`] is asked before GMRES.
    pub(crate) direct: bool,
}

impl Newton {
    /// Makes room for `n` contacts.
    pub(crate) fn reserve(&mut self, n: usize) {
        if self.step.len() < n {
            self.basis.resize((DEPTH + 1) * n, Vec3::zeros());
            self.slopes.resize(n, Mat3::zeros());
            self.step.resize(n, Vec3::zeros());
            self.before.resize(n, Vec3::zeros());
        }
    }

    /// Begins a run of steps from forces with this residual, no unit.
    pub(crate) fn restart(&mut self, residual: Real) {
        self.damping = if self.direct { FULL_DAMPING } else { (FIRST_DAMPING * residual).clamp(LEAST_DAMPING, FULL_DAMPING) };
    }

    /// One step. `f` (N) moves, not necessarily within the cones; `w` holds it on entry and on return. `late` is asked after
    /// every product and ends the search early. A step to forces larger than `limit` (N, norm of all) is not taken.
    pub(crate) fn advance<W: Delassus>(
        &mut self,
        w: &mut W,
        delta_free: &[Vec3],
        mu: &[Real],
        f: &mut [Vec3],
        limit: Real,
        late: &dyn Fn() -> bool,
    ) {
        let n = f.len();
        let residual = residual_about(w, delta_free, mu, f, 0.0, f);
        self.before[..n].copy_from_slice(f);
        self.find_direction(w, delta_free, mu, f, late);
        let mut best = (Real::INFINITY, 0.0);
        for length in LENGTHS {
            let moved = self.place(w, f, length);
            let damped = residual_about(w, delta_free, mu, f, self.damping, &self.before[..n]);
            if damped < best.0 && norm(f) <= limit {
                best = (damped, length);
            }
            // A full step that ends where the damped problem is solved, as far as its own
            // softness shows, or any step that keeps half of what it promised.
            let solved = length == 1.0 && damped <= self.damping * moved;
            if solved || damped <= (1.0 - 0.5 * length) * residual || late() {
                break;
            }
        }
        let (_, length) = best;
        self.place(w, f, length);
        if length == 1.0 {
            self.damping = (0.1 * self.damping).max(if self.direct { LEAST_DIRECT_DAMPING } else { LEAST_DAMPING });
        } else if length < 0.2 {
            self.damping = (10.0 * self.damping).min(FULL_DAMPING);
        }
    }

    /// `f = before + length d`. Returns how far that is, relative to `f`.
    fn place<W: Delassus>(&self, w: &mut W, f: &mut [Vec3], length: Real) -> Real {
        let (mut moved, mut force) = (0.0, 0.0);
        for ((f, before), step) in f.iter_mut().zip(&self.before).zip(&self.step) {
            let change = step * length;
            *f = if length == 0.0 { *before } else { before + change };
            moved += change.norm_squared();
            force += f.norm_squared();
        }
        w.set_reactions(f);
        relative(moved, force)
    }

    /// Solves `d_i + T_i ((W d)_i - W_ii d_i) = S_i(b_i) - f_i` for `d` by GMRES (Saad and Schultz 1986), from zero.
    fn find_direction<W: Delassus>(&mut self, w: &mut W, delta_free: &[Vec3], mu: &[Real], f: &[Vec3], late: &dyn Fn() -> bool) {
        let n = f.len();
        // The damped contact has block (1 + alpha) W_ii; by scaling, its solution for b is that of W_ii for b / (1 + alpha).
        let softer = 1.0 + self.damping;
        for i in 0..n {
            let block = w.diagonal_block(i);
            let b = (w.displacement(i) + delta_free[i]) / softer - block.matrix() * f[i];
            let drag = block.drag() * softer;
            let (solution, status) = block.solve_dragged(&b, mu[i], drag);
            self.basis[i] = solution - f[i];
            self.slopes[i] = slope(block.matrix(), &b, mu[i], drag, &solution, status) / softer;
        }
        self.step[..n].fill(Vec3::zeros());
        let length = norm(&self.basis[..n]);
        if !(length > 0.0 && length.is_finite()) {
            return;
        }
        if self.direct {
            let diagonal: Vec<Mat3> = (0..n).map(|i| Mat3::identity() - self.slopes[i] * w.diagonal_block(i).matrix()).collect();
            self.step[..n].copy_from_slice(&self.basis[..n]);
            if w.solve_directly(&self.slopes[..n], &diagonal, &mut self.step[..n], late) {
                return;
            }
            self.step[..n].fill(Vec3::zeros());
        }
        scale(&mut self.basis[..n], 1.0 / length);
        // Column k of the Hessenberg matrix, turned upper triangular by the rotations; `rest` is the right-hand side turned along.
        let mut triangle = [[0.0; DEPTH + 1]; DEPTH];
        let mut rotations = [(1.0, 0.0); DEPTH];
        let mut rest = [0.0; DEPTH + 1];
        rest[0] = length;
        let mut used = 0;
        while used < DEPTH && rest[used].abs() > FORCING * length && !(used > 0 && late()) {
            let k = used;
            let column = &mut triangle[k];
            let (old, new) = self.basis.split_at_mut((k + 1) * n);
            let (last, new) = (&old[k * n..], &mut new[..n]);
            w.set_reactions(last);
            for i in 0..n {
                new[i] = last[i] + self.slopes[i] * (w.displacement(i) - w.diagonal_block(i).matrix() * last[i]);
            }
            for (j, vector) in old.chunks_exact(n).enumerate() {
                column[j] = dot(vector, new);
                for (x, y) in new.iter_mut().zip(vector) {
                    *x -= y * column[j];
                }
            }
            let remainder = norm(new);
            for (j, (cosine, sine)) in rotations[..k].iter().enumerate() {
                (column[j], column[j + 1]) = (cosine * column[j] + sine * column[j + 1], cosine * column[j + 1] - sine * column[j]);
            }
            let diagonal = column[k].hypot(remainder);
            if !(diagonal > 0.0 && diagonal.is_finite()) {
                break;
            }
            let (cosine, sine) = (column[k] / diagonal, remainder / diagonal);
            rotations[k] = (cosine, sine);
            column[k] = diagonal;
            (rest[k], rest[k + 1]) = (cosine * rest[k], -sine * rest[k]);
            used += 1;
            if remainder <= 1e-14 * diagonal {
                break;
            }
            scale(new, 1.0 / remainder);
        }
        for k in (0..used).rev() {
            let weight = rest[k] / triangle[k][k];
            for (rest, entry) in rest[..k].iter_mut().zip(&triangle[k]) {
                *rest -= weight * entry;
            }
            for (d, vector) in self.step[..n].iter_mut().zip(&self.basis[k * n..(k + 1) * n]) {
                *d += vector * weight;
            }
        }
    }
}

/// Natural-map residual of `f`, which `w` holds, for contacts softened by the share `damping` about the forces `centre`.
/// With `damping` 0 the residual of the problem itself.
pub(crate) fn residual_about<W: Delassus>(w: &W, delta_free: &[Vec3], mu: &[Real], f: &[Vec3], damping: Real, centre: &[Vec3]) -> Real {
    let (mut error, mut force) = (0.0, 0.0);
    for i in 0..f.len() {
        let block = w.diagonal_block(i);
        let mut delta = w.displacement(i) + delta_free[i];
        if damping > 0.0 {
            delta += block.matrix() * (f[i] - centre[i]) * damping;
        }
        error += natural_map(&delta, &block.without_drag(&f[i], &delta), mu[i], block.rho()).norm_squared();
        force += f[i].norm_squared();
    }
    relative(error, force)
}

fn dot(x: &[Vec3], y: &[Vec3]) -> Real {
    x.iter().zip(y).map(|(x, y)| x.dot(y)).sum()
}

fn norm(x: &[Vec3]) -> Real {
    dot(x, x).sqrt()
}

fn scale(x: &mut [Vec3], factor: Real) {
    for x in x {
        *x *= factor;
    }
}

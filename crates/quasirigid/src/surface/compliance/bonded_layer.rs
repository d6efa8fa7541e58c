//! Green's function of an elastic layer of thickness h that is bonded to a rigid backing.
//!
//! A tangential or normal load that varies as a wave of number k over the surface has a displacement in closed form.
//! With `w = k h`, `kappa = 3 - 4 nu` and `G = E / (2 (1 + nu))`, displacement per traction times `G k` is
//!
//! ```text
//! D  = 2 kappa cosh 2w + 1 + kappa^2 + 4 w^2
//! N^ = (1 - nu) (2 kappa sinh 2w - 4 w) / D                        normal, under a normal load
//! L^ = (1 - nu) (2 kappa sinh 2w + 4 w) / D                        tangential, along the wave
//! T^ = tanh w                                                      tangential, across the wave
//! X^ = (kappa (kappa - 1)/2 (cosh 2w - 1) - 2 w^2) / D             tangential under a normal load, a quarter wave apart
//! ```
//!
//! (from the plane Navier equations with no displacement at the bottom; N^ is the kernel of Dhaliwal and Rau, Int. J.
//! Eng. Sci. 8, 1970; a test below solves those equations numerically.) For large w these are the constants `1 - nu`,
//! `1 - nu`, `1` and `1/2 - nu` of a half-space. The rest decays like `exp(-2 w)`, so that in space, with `rho =
//! r/h`, the layer is the half-space plus four bounded functions, which are tabulated here:
//!
//! ```text
//! N = (1 - nu)/rho   + int (N^ - (1 - nu)) J0(w rho) dw            A = (1 - nu/2)/rho + int ((L^ + T^)/2 - (1 - nu/2)) J0(w rho) dw
//! X = (1/2 - nu)/rho + int (X^ - (1/2 - nu)) J1(w rho) dw          B = nu/(2 rho)     + int ((T^ - L^)/2 - nu/2) J2(w rho) dw
//! ```

use super::influence::Influence;
use crate::math::Real;
use std::f64::consts::PI;

/// Beyond this distance (thicknesses) the surface stands still: displacements there are below 1e-4 of those beside the load.
const REACH: Real = 8.0;

/// Nodes of the table for each thickness of distance. Cubic between them, it is good to 1e-7.
const NODES_PER_THICKNESS: usize = 20;

/// The integrands are cut at this w: exp(-36).
const LAST_WAVE: Real = 18.0;

/// Panels of 16 Gauss points: J0(8 w) goes through one period in 0.8, a panel is 0.9 wide.
const PANELS: usize = 20;

/// Own terms are tabulated up to this disc radius (thicknesses), at this many nodes for each thickness.
const LARGEST_DISC: Real = 8.0;
const DISCS_PER_THICKNESS: usize = 10;

/// What a bonded layer has beyond a half-space, as functions of distance over thickness. One table for each Poisson's ratio.
#[derive(Debug, Clone)]
pub(super) struct LayerTable {
    /// Value of the four functions at a node, and their slope times the distance of two nodes.
    nodes: Vec<[Influence; 2]>,
    /// N and A of a uniformly loaded disc on itself (mean over the disc), by its radius over h.
    discs: Vec<[Real; 2]>,
    /// N and A of the half-space, times r.
    half_space: [Real; 2],
}

/// The transforms N^, L^, T^, X^ at `w = k h`.
fn transform(w: Real, nu: Real) -> [Real; 4] {
    let kappa = 3.0 - 4.0 * nu;
    // exp(-2w) is taken out of numerators and denominator, so that nothing overflows.
    let one = (-2.0 * w).exp();
    let (sinh, cosh) = (0.5 * (1.0 - one * one), 0.5 * (1.0 + one * one));
    let d = 2.0 * kappa * cosh + (1.0 + kappa * kappa + 4.0 * w * w) * one;
    let normal = (1.0 - nu) * (2.0 * kappa * sinh - 4.0 * w * one) / d;
    let along = (1.0 - nu) * (2.0 * kappa * sinh + 4.0 * w * one) / d;
    let coupling = (0.5 * kappa * (kappa - 1.0) * (cosh - one) - 2.0 * w * w * one) / d;
    [normal, along, w.tanh(), coupling]
}

/// What the integrals of one Poisson's ratio share: waves w with their weights, and the four integrands but for their Bessel functions.
struct Waves {
    w: Vec<Real>,
    excess: Vec<Influence>,
}

impl Waves {
    fn new(nu: Real) -> Self {
        let (points, weights) = gauss_legendre();
        let half = 0.5 * LAST_WAVE / PANELS as Real;
        let (mut w, mut excess) = (Vec::new(), Vec::new());
        let far = Influence::half_space(nu);
        for panel in 0..PANELS {
            for (x, g) in points.iter().zip(weights) {
                let wave = half * (2.0 * panel as Real + 1.0 + x);
                let [normal, along, across, coupling] = transform(wave, nu);
                let near = Influence { n: normal, x: coupling, a: 0.5 * (along + across), b: 0.5 * (across - along) };
                w.push(wave);
                excess.push((near - far) * (half * g));
            }
        }
        Self { w, excess }
    }

    /// The excess at distance `rho`, and its slope.
    fn at(&self, rho: Real) -> [Influence; 2] {
        let mut sums = [Influence::default(); 2];
        for (&w, excess) in self.w.iter().zip(&self.excess) {
            let x = w * rho;
            let (j0, j1) = (libm::j0(x), libm::j1(x));
            // J1(x)/x and J2(x) where the quotients lose their digits: the first terms of their series.
            let small = x < 1e-3;
            let j1_over_x = if small { 0.5 - x * x / 16.0 } else { j1 / x };
            let j2 = if small { x * x / 8.0 } else { 2.0 * j1_over_x - j0 };
            let j2_over_x = if small { x / 8.0 } else { j2 / x };
            sums[0] = sums[0] + Influence { n: excess.n * j0, x: excess.x * j1, a: excess.a * j0, b: excess.b * j2 };
            let [d0, d1, d2] = [-j1, j0 - j1_over_x, j1 - 2.0 * j2_over_x].map(|slope| slope * w);
            sums[1] = sums[1] + Influence { n: excess.n * d0, x: excess.x * d1, a: excess.a * d0, b: excess.b * d2 };
        }
        sums
    }

    /// N and A of the excess of a uniformly loaded disc of radius `a` (over h), its mean over the disc: the transform
    /// of either is `2 J1(w a)/(w a)`.
    fn on_disc(&self, a: Real) -> [Real; 2] {
        let mut sums = [0.0; 2];
        for (&w, excess) in self.w.iter().zip(&self.excess) {
            let x = w * a;
            let shape = if x < 1e-3 { 1.0 - x * x / 8.0 } else { 2.0 * libm::j1(x) / x };
            sums[0] += excess.n * shape * shape;
            sums[1] += excess.a * shape * shape;
        }
        sums
    }
}

impl LayerTable {
    /// Tabulates the layer of Poisson's ratio `nu`: a few milliseconds.
    pub fn new(nu: Real) -> Self {
        let waves = Waves::new(nu);
        let step = 1.0 / NODES_PER_THICKNESS as Real;
        let count = REACH as usize * NODES_PER_THICKNESS + 1;
        let node = |k: usize| {
            let [value, slope] = waves.at(k as Real * step);
            [value, slope * step]
        };
        let discs = (0..=LARGEST_DISC as usize * DISCS_PER_THICKNESS).map(|k| waves.on_disc(k as Real / DISCS_PER_THICKNESS as Real));
        let far = Influence::half_space(nu);
        Self { nodes: (0..count).map(node).collect(), discs: discs.collect(), half_space: [far.n, far.a] }
    }

    /// The excess over the half-space at the distance `rho` (over h); `None` beyond the reach of the layer, where the surface stands still.
    #[inline]
    pub fn excess(&self, rho: Real) -> Option<Influence> {
        let place = rho * NODES_PER_THICKNESS as Real;
        let k = place as usize;
        let [[p, m], [q, n]] = [self.nodes.get(k)?, self.nodes.get(k + 1)?];
        // Cubic Hermite polynomials in t.
        let t = place - k as Real;
        let (t2, t3) = (t * t, t * t * t);
        let (h, g) = (3.0 * t2 - 2.0 * t3, t3 - t2);
        Some(*p * (1.0 - h) + *m * (g - t2 + t) + *q * h + *n * g)
    }

    /// N and A at the middle of the load.
    pub fn excess_at_load(&self) -> [Real; 2] {
        [self.nodes[0][0].n, self.nodes[0][0].a]
    }

    /// N and A under a uniformly loaded disc of radius `a` (over h), half-space and excess: what no point that stands
    /// for that disc may be stiffer than.
    pub fn of_disc(&self, a: Real) -> [Real; 2] {
        let at = |a: Real| {
            let place = a * DISCS_PER_THICKNESS as Real;
            let k = (place as usize).min(self.discs.len() - 2);
            let t = place - k as Real;
            [0, 1].map(|i| 2.0 * self.half_space[i] / a + self.discs[k][i] * (1.0 - t) + self.discs[k + 1][i] * t)
        };
        if a <= LARGEST_DISC {
            return at(a);
        }
        // A disc far wider than the layer is thick is a foundation: pressure and displacement are proportional, so that a force has 1/a^2.
        at(LARGEST_DISC).map(|value| value * (LARGEST_DISC / a).powi(2))
    }
}

/// Points and weights of Gauss and Legendre on [-1, 1], 16 of them: roots of the Legendre polynomial by Newton's method.
fn gauss_legendre() -> ([Real; 16], [Real; 16]) {
    const N: usize = 16;
    let (mut points, mut weights) = ([0.0; N], [0.0; N]);
    for i in 0..N {
        let mut x = -(PI * (i as Real + 0.75) / (N as Real + 0.5)).cos();
        for _ in 0..8 {
            let (mut p, mut before) = (1.0, 0.0);
            for k in 0..N {
                let k = k as Real;
                (p, before) = (((2.0 * k + 1.0) * x * p - k * before) / (k + 1.0), p);
            }
            let slope = N as Real * (x * p - before) / (x * x - 1.0);
            x -= p / slope;
            weights[i] = 2.0 / ((1.0 - x * x) * slope * slope);
        }
        points[i] = x;
    }
    (points, weights)
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Matrix4, Vector4};

    /// Surface displacement `[normal, along]` (times G k) of a layer under a wave of unit normal or tangential
    /// traction, by the Navier equations: solutions `exp(s k z)` and `z exp(s k z)`, s = +-1, their coefficients from
    /// the four conditions at the bottom and on top.
    fn plane_layer(w: Real, nu: Real, normal_load: bool) -> [Real; 2] {
        let kappa = 3.0 - 4.0 * nu;
        // k = 1, G = 1. u_x = U(z) cos x, u_z = V(z) sin x. With U = (a + b z) e^(s z), the Navier equations give V =
        // s (a + b z - kappa s b) e^(s z) up to sign.
        let field = |s: Real, linear: bool, z: Real| {
            let e = (s * (z - w)).exp();
            let (u, du) = if linear { (z * e, (1.0 + s * z) * e) } else { (e, s * e) };
            let (v, dv) = if linear { ((-kappa + s * z) * e, (-kappa * s + z + s) * e) } else { (s * e, e) };
            (u, du, v, dv)
        };
        let columns = [(1.0, false), (1.0, true), (-1.0, false), (-1.0, true)].map(|(s, linear)| {
            let (u0, _, v0, _) = field(s, linear, 0.0);
            let (u, du, v, dv) = field(s, linear, w);
            // sigma_zz = 2 / (1 - 2 nu) ((1 - nu) V' - nu U) sin x, sigma_xz = (U' + V) cos x.
            let lambda = 2.0 * nu / (1.0 - 2.0 * nu);
            (Vector4::new(u0, v0, (lambda + 2.0) * dv - lambda * u, du + v), [v, u])
        });
        let matrix = Matrix4::from_columns(&columns.map(|(column, _)| column));
        let load = if normal_load { Vector4::new(0.0, 0.0, 1.0, 0.0) } else { Vector4::new(0.0, 0.0, 0.0, 1.0) };
        let c = matrix.lu().solve(&load).unwrap();
        [0, 1].map(|i| (0..4).map(|k| c[k] * columns[k].1[i]).sum())
    }

    #[test]
    fn transforms_solve_the_plane_layer() {
        for nu in [0.0, 0.2, 0.3, 0.45, 0.49, 0.499] {
            for w in [0.05, 0.3, 1.0, 2.0, 5.0] {
                let [normal, along, _, coupling] = transform(w, nu);
                let [by_normal, by_tangential] = [plane_layer(w, nu, true), plane_layer(w, nu, false)];
                let errors = [
                    by_normal[0] - normal,
                    by_tangential[1] - along,
                    by_normal[1].abs() - coupling.abs(),
                    by_normal[1].abs() - by_tangential[0].abs(),
                ];
                let worst = errors.iter().fold(0.0, |worst: Real, e| worst.max(e.abs()));
                assert!(
                    worst < 1e-9,
                    "nu {nu}, w {w}: off by {worst:e}; {by_normal:?} {by_tangential:?}, transforms {:?}",
                    transform(w, nu)
                );
            }
        }
    }

    #[test]
    fn transforms_tend_to_confined_compression_and_to_the_half_space() {
        for nu in [0.0, 0.3, 0.45, 0.499] {
            let w = 1e-3;
            let [normal, along, across, coupling] = transform(w, nu).map(|value| value / w);
            // h/M and h/G, M = 2 G (1 - nu)/(1 - 2 nu).
            let confined = (1.0 - 2.0 * nu) / (2.0 * (1.0 - nu));
            assert!(
                (normal - confined).abs() < 1e-5 && (along - 1.0).abs() < 1e-5 && (across - 1.0).abs() < 1e-5,
                "nu {nu}: {normal} {along} {across}"
            );
            assert!(coupling.abs() < 2e-3, "nu {nu}: coupling {coupling}");
            let deep = transform(30.0, nu);
            for (value, half_space) in deep.iter().zip([1.0 - nu, 1.0 - nu, 1.0, 0.5 - nu]) {
                assert!((value - half_space).abs() < 1e-12, "nu {nu}: {deep:?}");
            }
        }
    }

    #[test]
    fn table_is_the_integral_and_the_surface_stands_still_where_it_ends() {
        for nu in [0.0, 0.3, 0.45, 0.499] {
            let (table, waves) = (LayerTable::new(nu), Waves::new(nu));
            for k in 0..400 {
                let rho = 0.0123 + 0.0199 * k as Real;
                let (by_table, exact) = (table.excess(rho).unwrap(), waves.at(rho)[0]);
                let off = (by_table - exact).largest();
                assert!(off < 3e-7, "nu {nu}, rho {rho}: off by {off:e}");
            }
            let far = (table.excess(7.99).unwrap() + Influence::half_space(nu) * (1.0 / 7.99)).largest();
            assert!(far < 1e-3, "nu {nu}: {far:e} at the end of the table");
        }
    }
}

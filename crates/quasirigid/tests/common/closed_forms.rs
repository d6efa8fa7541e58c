//! Closed forms of contact mechanics, after K. L. Johnson, *Contact Mechanics* (1985), and the scene that they are held against.

#![allow(dead_code)] // each test uses some

use quasirigid::Parameters;
use quasirigid::collider::{ComplianceModel, Material};
use quasirigid::math::Real;
use quasirigid::scenes::{Indentation, IndentationOptions};
use std::f64::consts::PI;

/// Elastic figures of one body: Young's modulus, Pa, and Poisson's ratio.
pub type Elastic = (Real, Real);

/// As good as rigid.
pub const RIGID: Elastic = (1e13, 0.3);

/// Radius of the ball, m, and the depth around which the tests are, m: contact radius 3.16 mm, a/R = 0.063.
pub const RADIUS: Real = 0.05;
pub const DEPTH: Real = 2e-4;

/// A ball of radius R pressed by d into a flat (Hertz; Johnson, section 4.2).
#[derive(Debug, Clone, Copy)]
pub struct Hertz {
    /// Contact radius a = sqrt(R d), m.
    pub a: Real,
    /// Normal force P = 4/3 E* sqrt(R) d^(3/2), N.
    pub p: Real,
    /// Largest pressure p0 = 3 P / (2 pi a^2), Pa.
    pub p0: Real,
    /// Tangential stiffness of the full-stick contact, 8 a G*, N/m, with 1/G* = (2
    /// - nu_1)/G_1 + (2 - nu_2)/G_2 (Mindlin; Johnson, eq. 7.43).
    pub k_t: Real,
    /// Torsional stiffness of the full-stick contact, 16/3 G a^3, N m/rad, with 1/G = 1/G_1 + 1/G_2 (Johnson, section 7.4).
    pub k_r: Real,
}

impl Hertz {
    pub fn new(d: Real, [one, two]: [Elastic; 2]) -> Self {
        let over_e = |(e, nu): Elastic| (1.0 - nu * nu) / e;
        let over_g = |(e, nu): Elastic| 2.0 * (1.0 + nu) / e;
        let e_star = 1.0 / (over_e(one) + over_e(two));
        let a = (RADIUS * d).sqrt();
        let p = 4.0 / 3.0 * e_star * RADIUS.sqrt() * d.powf(1.5);
        let g_star = 1.0 / ((2.0 - one.1) * over_g(one) + (2.0 - two.1) * over_g(two));
        let g = 1.0 / (over_g(one) + over_g(two));
        Self { a, p, p0: 1.5 * p / (PI * a * a), k_t: 8.0 * a * g_star, k_r: 16.0 / 3.0 * g * a.powi(3) }
    }

    /// Pressure at distance r from the middle, Pa.
    pub fn pressure(&self, r: Real) -> Real {
        self.p0 * (1.0 - (r / self.a).powi(2)).max(0.0).sqrt()
    }

    /// Mean pressure over the ring between two radii, Pa.
    pub fn ring_pressure(&self, from: Real, to: Real) -> Real {
        let inside = |r: Real| 1.0 - (1.0 - (r / self.a).powi(2)).max(0.0).powf(1.5);
        self.p * (inside(to) - inside(from)) / (PI * (to * to - from * from))
    }
}

/// Twist of a Hertz patch that slips outside the radius c a (Lubkin): angle in mu P / (G a^2) and moment in mu P a.
///
/// A sum of stuck discs of radii s from c to a gives, by Abel's transform, with I(s) = mu p0 (K(k) - E(k)) and k^2 = 1 - s^2/a^2,
///
/// ```text
/// angle = I(c) / (2 G)        M = 8/3 (c^3 I(c) + 3 integral_c^a s^2 I(s) ds)
/// ```
pub fn lubkin(c: Real) -> (Real, Real) {
    let spread = |s: Real| 1.5 / PI * elliptic_k_less_e(s);
    // Simpson's rule; I has a logarithm at s = 0 that s^2 takes the edge off.
    let (steps, mut integral) = (2_000, 0.0);
    let h = (1.0 - c) / Real::from(steps);
    for k in 0..=steps {
        let weight = if k == 0 || k == steps { 1.0 } else { Real::from(2 + 2 * (k % 2)) };
        let s = c + h * Real::from(k);
        integral += weight * h / 3.0 * s * s * spread(s);
    }
    (0.5 * spread(c), 8.0 / 3.0 * (c.powi(3) * spread(c) + 3.0 * integral))
}

/// K(k) - E(k) with complementary modulus s = sqrt(1 - k^2), 0 < s <= 1, by the arithmetic-geometric mean.
fn elliptic_k_less_e(s: Real) -> Real {
    let (mut a, mut g, mut power) = (1.0, s, 0.5);
    let mut sum = 0.5 * (1.0 - s * s);
    while a - g > 1e-15 {
        let c: Real = 0.5 * (a - g);
        (a, g) = (0.5 * (a + g), (a * g).sqrt());
        power *= 2.0;
        sum += power * c * c;
    }
    PI / (2.0 * a) * sum
}

/// A material of a half-space that answers at once.
pub fn half_space((e, nu): Elastic, mu: Real) -> Material {
    let test = Material {
        name: "test".into(),
        density: 1000.0,
        friction: mu.into(),
        young_modulus: e,
        poisson_ratio: nu,
        layer_thickness: 0.01,
        relaxation_time: 0.0,
        model: ComplianceModel::HalfSpace,
    };
    test.checked().unwrap()
}

/// The scene with `n` control points on a piece of 1.6 contact radii at [`DEPTH`] of the
/// ball (or of the flat, if it is the finer side), half as many on the other.
pub fn indentation([ball, flat]: [Elastic; 2], mu: Real, n: usize, fine_ball: bool) -> Indentation {
    let (ball_control_points, flat_control_points) = if fine_ball { (n, n / 2) } else { (n / 2, n) };
    let options = IndentationOptions {
        // Without margin: what touches overlaps before it yields, by geometry.
        params: Parameters { contact_margin: 1e-6, ..Parameters::default() },
        radius: RADIUS,
        reach: 1.6 * (RADIUS * DEPTH).sqrt(),
        ball_control_points,
        flat_control_points,
        ball: half_space(ball, mu),
        flat: half_space(flat, mu),
    };
    Indentation::new(&options).unwrap()
}

/// Mean spacing of the control points that carry the contacts, m.
pub fn spacing(scene: &Indentation) -> Real {
    let skin = |body| scene.world.skin(body).unwrap().unwrap().surface.control.spacing;
    skin(scene.ball).min(skin(scene.flat))
}

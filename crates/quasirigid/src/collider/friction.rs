//! Friction of a material: Coulomb's law, and what goes beyond it.
//!
//! ```text
//! |f_t| <= mu_s f_n                            while the contact sticks
//! f_t = -(mu(v) f_n + c A v) v_t / v           while it slips, v = |v_t|
//! mu(v) = mu_k + (mu_s - mu_k) exp(-(v/v_s)^2)
//! ```
//!
//! `mu_s`, `mu_k` static and kinetic coefficient (-), `v_s` Stribeck velocity (m/s), `c` viscous coefficient (Pa s/m),
//! `A` area of the contact (m^2). The exponential is that of B. Armstrong-Helouvry, P. Dupont, C. Canudas de Wit, *A
//! survey of models, analysis tools and compensation methods for the control of machines with friction*, Automatica 30
//! (1994), section 2. With `mu_k = mu_s` and `c = 0` this is Coulomb's law, the default.
//!
//! With a [`Anisotropy`] the circle of Coulomb becomes an ellipse. `docs/friction.md` has the derivation.

use crate::error::{Error, Result, check_finite, check_non_negative, check_positive};
use crate::math::{Real, Vec3};
use serde::{Deserialize, Serialize};

/// Stribeck velocity where none is given, m/s: as in the simulations of C. Canudas de Wit, H. Olsson, K. J. Astrom, P.
/// Lischinsky, *A new model for control of systems with friction*, IEEE Trans. Automatic Control 40 (1995).
pub const USUAL_STRIBECK_VELOCITY: Real = 1e-3;

/// Larger coefficients are mistakes, and their squares are not far from where numbers end.
const MOST_FRICTION: Real = 1e6;

/// Ratios of the two axes of an ellipse that are accepted. Beyond, the tangential rows of the
/// contact problem would differ by more than the solver's precision allows for.
const RATIOS: std::ops::RangeInclusive<Real> = 0.01..=100.0;

/// Friction of a material against itself, or of a pair in the friction table of a world.
/// Plain data; [`Friction::check`] is called wherever one enters a world.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Friction {
    /// `mu_s`: tangential over normal force at which a contact that sticks begins to slip (-).
    pub static_coefficient: Real,
    /// `mu_k`: the same while it slips fast (-). At most `mu_s`; equal for Coulomb's law.
    pub kinetic_coefficient: Real,
    /// `v_s`: slip speed at which the coefficient has fallen by 63 % of the way
    /// from `mu_s` to `mu_k` (m/s). Without meaning if they are equal.
    pub stribeck_velocity: Real,
    /// `c`: tangential traction per slip speed in a contact that slips (Pa s/m), on top of the above.
    pub viscous_coefficient: Real,
    /// The direction along which the coefficients above hold; `None` if they are the same in all directions.
    pub anisotropy: Option<Anisotropy>,
}

/// Friction that depends on the direction of slip, as on brushed metal, wood or scales: an ellipse instead of a circle.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Anisotropy {
    /// Direction along which the coefficients hold, unit vector in the frame of the
    /// surface's points (of a finger: of the link that carries the pad).
    pub direction: Vec3,
    /// Coefficients across the direction over those along it (-), static and kinetic alike.
    pub ratio: Real,
}

impl Friction {
    /// Coulomb's law with one coefficient (-).
    ///
    /// # Errors
    /// A coefficient that is not finite and >= 0.
    pub fn coulomb(coefficient: Real) -> Result<Self> {
        let friction = Self::from(coefficient);
        friction.check()?;
        Ok(friction)
    }

    /// With a coefficient `kinetic` (-) that holds while a contact slips faster than about
    /// `stribeck_velocity` (m/s); [`USUAL_STRIBECK_VELOCITY`] if in doubt.
    ///
    /// # Errors
    /// See [`Friction::check`].
    pub fn with_kinetic(self, kinetic: Real, stribeck_velocity: Real) -> Result<Self> {
        let friction = Self { kinetic_coefficient: kinetic, stribeck_velocity, ..self };
        friction.check()?;
        Ok(friction)
    }

    /// With a tangential traction of `viscous_coefficient` (Pa s/m) times the slip speed.
    ///
    /// # Errors
    /// See [`Friction::check`].
    pub fn with_viscous(self, viscous_coefficient: Real) -> Result<Self> {
        let friction = Self { viscous_coefficient, ..self };
        friction.check()?;
        Ok(friction)
    }

    /// With coefficients that hold along `direction` (frame of the surface's points, any length), and `ratio` times as large across it.
    ///
    /// # Errors
    /// A direction that is not finite or is zero; a ratio outside 0.01 to 100.
    pub fn with_anisotropy(self, direction: Vec3, ratio: Real) -> Result<Self> {
        check_finite("direction of anisotropic friction", direction.iter())?;
        let length = direction.norm();
        if length <= 0.0 {
            return Err(Error::value(
                "direction of anisotropic friction",
                "a vector that is not zero",
                format!("{:?}", direction.as_slice()),
                ANISOTROPY,
            ));
        }
        let friction = Self { anisotropy: Some(Anisotropy { direction: direction / length, ratio }), ..self };
        friction.check()?;
        Ok(friction)
    }

    /// Refuses coefficients that no friction has.
    ///
    /// # Errors
    /// Non-finite numbers; a negative coefficient or one above 1e6; a kinetic coefficient above the static one; a Stribeck
    /// velocity <= 0; a ratio of the anisotropy outside 0.01 to 100, or a direction of it that is no unit vector.
    pub fn check(&self) -> Result<()> {
        check_non_negative("friction coefficient", self.static_coefficient, "-")?;
        if self.static_coefficient > MOST_FRICTION {
            return Err(Error::value(
                "friction coefficient",
                format!("at most {MOST_FRICTION:e}"),
                self.static_coefficient,
                "10 is glue already",
            ));
        }
        check_non_negative("kinetic friction coefficient", self.kinetic_coefficient, "-")?;
        if self.kinetic_coefficient > self.static_coefficient {
            return Err(Error::value(
                "kinetic friction coefficient",
                format!("at most the static one, {}", self.static_coefficient),
                self.kinetic_coefficient,
                "for friction that rises with speed use the viscous coefficient",
            ));
        }
        check_positive("Stribeck velocity", self.stribeck_velocity, "m/s")?;
        check_non_negative("viscous friction coefficient", self.viscous_coefficient, "Pa s/m")?;
        let Some(anisotropy) = &self.anisotropy else { return Ok(()) };
        check_finite("direction of anisotropic friction", anisotropy.direction.iter())?;
        if (anisotropy.direction.norm() - 1.0).abs() > 1e-6 {
            let got = format!("{:?}", anisotropy.direction.as_slice());
            return Err(Error::value("direction of anisotropic friction", "a unit vector", got, "make it with with_anisotropy"));
        }
        if RATIOS.contains(&anisotropy.ratio) {
            return Ok(());
        }
        let expected = format!("a ratio from {} to {}", RATIOS.start(), RATIOS.end());
        Err(Error::value(
            "friction across the direction over that along it",
            expected,
            anisotropy.ratio,
            "1 is friction alike in all directions",
        ))
    }

    /// Whether it is velocity-weakening: `mu_k < mu_s`.
    pub fn is_velocity_weakening(&self) -> bool {
        self.kinetic_coefficient < self.static_coefficient
    }

    /// `mu(v)` (-) along the direction at slip speed `v` (m/s), without the viscous part. Exactly `mu_s` at rest.
    pub fn coefficient(&self, speed: Real) -> Real {
        stribeck(self.static_coefficient, self.kinetic_coefficient, self.stribeck_velocity, speed)
    }

    /// By how much coefficients are larger against slip along the unit tangent `t` (frame of the points) than along the direction:
    /// `sqrt(t . T t)` with the friction tensor `T = r^2 1 + (1 - r^2) d d^T`, `d` the direction and `r` the ratio.
    ///
    /// In a tangent plane that holds `d` this is 1 along it and `r` across. In a plane to which `d`
    /// is normal it is `r` in all directions: every tangent is across the direction.
    pub fn share_along(&self, t: &Vec3) -> Real {
        self.anisotropy.as_ref().map_or(1.0, |anisotropy| {
            let (r2, along) = (anisotropy.ratio * anisotropy.ratio, anisotropy.direction.dot(t));
            (r2 + (1.0 - r2) * along * along).sqrt()
        })
    }
}

const ANISOTROPY: &str = "give the direction along which the coefficients hold";

/// `mu_k + (mu_s - mu_k) exp(-(v/v_s)^2)`, written so that it is `mu_s` to the last bit at `v = 0`.
pub(crate) fn stribeck(static_coefficient: Real, kinetic_coefficient: Real, stribeck_velocity: Real, speed: Real) -> Real {
    let x = speed / stribeck_velocity;
    static_coefficient + (static_coefficient - kinetic_coefficient) * (-x * x).exp_m1()
}

impl From<Real> for Friction {
    /// Coulomb's law with one coefficient (-), not checked: whatever takes the friction does that.
    fn from(coefficient: Real) -> Self {
        Self {
            static_coefficient: coefficient,
            kinetic_coefficient: coefficient,
            stribeck_velocity: USUAL_STRIBECK_VELOCITY,
            viscous_coefficient: 0.0,
            anisotropy: None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn coefficient_goes_from_static_to_kinetic() {
        let friction = Friction::coulomb(0.6).unwrap().with_kinetic(0.35, 2e-3).unwrap();
        assert_eq!(friction.coefficient(0.0), 0.6);
        // 1e-12 m/s, a stuck contact seen through rounding, is at rest to the last bit.
        assert_eq!(friction.coefficient(1e-12), 0.6);
        let at = friction.coefficient(2e-3);
        assert!((at - (0.35 + 0.25 * (-1.0_f64).exp())).abs() < 1e-15, "{at}");
        assert!((friction.coefficient(1.0) - 0.35).abs() < 1e-15);
        let plain = Friction::coulomb(0.6).unwrap();
        assert_eq!(plain.coefficient(0.3), 0.6);
        assert!(friction.is_velocity_weakening() && !plain.is_velocity_weakening());
    }

    #[test]
    fn shares_along_the_direction_are_those_of_the_ellipse() {
        let friction = Friction::coulomb(0.5).unwrap().with_anisotropy(Vec3::new(3.0, 0.0, 0.0), 2.0).unwrap();
        assert!((friction.share_along(&Vec3::x()) - 1.0).abs() < 1e-15);
        assert!((friction.share_along(&Vec3::y()) - 2.0).abs() < 1e-15);
        // The dissipation per slip and normal force, |D t| with D = diag(1, 2).
        let t = Vec3::new(0.6, 0.8, 0.0);
        assert!((friction.share_along(&t) - 0.6_f64.hypot(1.6)).abs() < 1e-15);
        assert_eq!(Friction::from(0.5).share_along(&t), 1.0);
    }

    #[test]
    fn coefficients_out_of_range_are_refused() {
        let ok = Friction::coulomb(0.5).unwrap();
        assert!(Friction::coulomb(-0.1).is_err() && Friction::coulomb(Real::NAN).is_err());
        for kinetic in [-0.1, 0.6, Real::NAN] {
            assert!(ok.with_kinetic(kinetic, 1e-3).is_err(), "{kinetic}");
        }
        for speed in [0.0, -1.0, Real::INFINITY] {
            assert!(ok.with_kinetic(0.3, speed).is_err(), "{speed}");
        }
        assert!(ok.with_viscous(-1.0).is_err());
        for (direction, ratio) in [(Vec3::zeros(), 2.0), (Vec3::x() * Real::NAN, 2.0), (Vec3::x(), 0.0), (Vec3::x(), Real::INFINITY)] {
            assert!(ok.with_anisotropy(direction, ratio).is_err(), "{direction} {ratio}");
        }
        let message = ok.with_kinetic(0.6, 1e-3).unwrap_err().to_string();
        assert!(message.contains("at most the static one, 0.5") && message.contains("0.6"), "{message}");
        let anisotropy = Some(Anisotropy { direction: Vec3::new(2.0, 0.0, 0.0), ratio: 2.0 });
        assert!(Friction { anisotropy, ..ok }.check().is_err());
    }
}

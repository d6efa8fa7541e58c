//! What one point of a flat elastic surface does to another: four functions of their distance.

use crate::math::Real;
use std::ops::{Add, Mul, Sub};

/// The four functions of distance that make up the block between two points of a flat surface.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(super) struct Influence {
    /// Normal displacement under a normal force.
    pub n: Real,
    /// Radial displacement under a normal force.
    pub x: Real,
    /// Mean of the tangential displacements along and across the line to a tangential force.
    pub a: Real,
    /// Half of their difference.
    pub b: Real,
}

impl Influence {
    /// Boussinesq and Cerruti, times r.
    pub fn half_space(nu: Real) -> Self {
        Self { n: 1.0 - nu, x: 0.5 - nu, a: 1.0 - 0.5 * nu, b: 0.5 * nu }
    }

    /// The largest of the four, without sign.
    #[cfg(test)]
    pub fn largest(&self) -> Real {
        [self.n, self.x, self.a, self.b].iter().fold(0.0, |largest: Real, value| largest.max(value.abs()))
    }
}

impl Add for Influence {
    type Output = Self;
    #[inline]
    fn add(self, other: Self) -> Self {
        Self { n: self.n + other.n, x: self.x + other.x, a: self.a + other.a, b: self.b + other.b }
    }
}

impl Sub for Influence {
    type Output = Self;
    #[inline]
    fn sub(self, other: Self) -> Self {
        self + other * -1.0
    }
}

impl Mul<Real> for Influence {
    type Output = Self;
    #[inline]
    fn mul(self, factor: Real) -> Self {
        Self { n: self.n * factor, x: self.x * factor, a: self.a * factor, b: self.b * factor }
    }
}

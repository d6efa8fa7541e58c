//! Compliance between two points of a surface that is one along their normals and another across them.

use crate::math::{Mat3, Real, Vec3};
use std::ops::{Add, Mul, Sub};

/// `t P_i P_j + n m_i m_j^T` between points with the unit normals `m_i` and `m_j`, `P = I - m m^T`.
#[derive(Debug, Clone, Copy, Default, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct AxialCompliance {
    /// Across the normals, m/N.
    pub tangential: Real,
    /// Along the normals, m/N.
    pub normal: Real,
}

impl AxialCompliance {
    /// The same in both directions, m/N.
    pub fn isotropic(value: Real) -> Self {
        Self { tangential: value, normal: value }
    }

    /// The block between points with these normals, m/N. A congruence of two matrices, one along normals and one across them: it is positive
    /// definite if both are, however the normals point.
    pub fn block(&self, normal_i: &Vec3, normal_j: &Vec3) -> Mat3 {
        let [across_i, across_j] = [normal_i, normal_j].map(|m| Mat3::identity() - m * m.transpose());
        across_i * across_j * self.tangential + normal_i * (normal_j * self.normal).transpose()
    }
}

impl Add for AxialCompliance {
    type Output = Self;
    #[inline]
    fn add(self, other: Self) -> Self {
        Self { tangential: self.tangential + other.tangential, normal: self.normal + other.normal }
    }
}

impl Sub for AxialCompliance {
    type Output = Self;
    #[inline]
    fn sub(self, other: Self) -> Self {
        self + other * -1.0
    }
}

impl Mul<Real> for AxialCompliance {
    type Output = Self;
    #[inline]
    fn mul(self, factor: Real) -> Self {
        Self { tangential: self.tangential * factor, normal: self.normal * factor }
    }
}

//! Four numbers side by side: arithmetic on arrays of fixed length, which the compiler turns into vector instructions.

use crate::math::Real;
use std::ops::{Add, AddAssign, Mul, Sub};

/// Numbers in a [`Lane`].
pub(crate) const LANES: usize = 4;

/// Four numbers that go through the same arithmetic.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Lane(pub [Real; LANES]);

impl Lane {
    pub const ZERO: Self = Self([0.0; LANES]);

    #[inline(always)]
    pub fn splat(value: Real) -> Self {
        Self([value; LANES])
    }

    /// The smaller of each pair (of numbers that are not NaN: then it is one instruction).
    #[inline(always)]
    pub fn min(self, other: Self) -> Self {
        self.zip(other, |a, b| if a < b { a } else { b })
    }

    /// The larger of each pair.
    #[inline(always)]
    pub fn max(self, other: Self) -> Self {
        self.zip(other, |a, b| if a > b { a } else { b })
    }

    /// Sum of the four, in a fixed order.
    #[inline(always)]
    pub fn sum(self) -> Real {
        let [a, b, c, d] = self.0;
        (a + b) + (c + d)
    }

    #[inline(always)]
    fn zip(self, other: Self, f: impl Fn(Real, Real) -> Real) -> Self {
        let (a, b) = (self.0, other.0);
        Self([f(a[0], b[0]), f(a[1], b[1]), f(a[2], b[2]), f(a[3], b[3])])
    }
}

impl Add for Lane {
    type Output = Self;
    #[inline(always)]
    fn add(self, other: Self) -> Self {
        self.zip(other, |a, b| a + b)
    }
}

impl Sub for Lane {
    type Output = Self;
    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        self.zip(other, |a, b| a - b)
    }
}

impl Mul for Lane {
    type Output = Self;
    #[inline(always)]
    fn mul(self, other: Self) -> Self {
        self.zip(other, |a, b| a * b)
    }
}

impl AddAssign for Lane {
    #[inline(always)]
    fn add_assign(&mut self, other: Self) {
        *self = *self + other;
    }
}

/// Three lanes: four vectors.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Lane3 {
    pub x: Lane,
    pub y: Lane,
    pub z: Lane,
}

impl Lane3 {
    pub const ZERO: Self = Self { x: Lane::ZERO, y: Lane::ZERO, z: Lane::ZERO };

    #[inline(always)]
    pub fn splat(v: &crate::math::Vec3) -> Self {
        Self { x: Lane::splat(v.x), y: Lane::splat(v.y), z: Lane::splat(v.z) }
    }

    #[inline(always)]
    pub fn set(&mut self, lane: usize, v: &crate::math::Vec3) {
        (self.x.0[lane], self.y.0[lane], self.z.0[lane]) = (v.x, v.y, v.z);
    }

    #[inline(always)]
    pub fn dot(self, other: Self) -> Lane {
        self.x * other.x + self.y * other.y + self.z * other.z
    }

    #[inline(always)]
    pub fn scale(self, by: Lane) -> Self {
        Self { x: self.x * by, y: self.y * by, z: self.z * by }
    }

    #[inline(always)]
    pub fn sum(self) -> crate::math::Vec3 {
        crate::math::Vec3::new(self.x.sum(), self.y.sum(), self.z.sum())
    }
}

impl Sub for Lane3 {
    type Output = Self;
    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        Self { x: self.x - other.x, y: self.y - other.y, z: self.z - other.z }
    }
}

impl AddAssign for Lane3 {
    #[inline(always)]
    fn add_assign(&mut self, other: Self) {
        self.x += other.x;
        self.y += other.y;
        self.z += other.z;
    }
}

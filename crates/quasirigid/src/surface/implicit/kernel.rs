//! The weight of a point by its distance.

use crate::error::{Error, Result, check_positive};
use crate::math::Real;
use crate::surface::search::lane::Lane;

/// Bandwidth over point spacing of [`Kernel::for_spacing`].
const BANDWIDTH_PER_SPACING: Real = 2.0;
/// Cutoff over bandwidth of [`Kernel::for_spacing`].
const CUTOFF_PER_BANDWIDTH: Real = 1.8;
/// The polynomial that stands for the exponential is good up to here.
const MAX_CUTOFF_PER_BANDWIDTH: Real = 3.0;

/// The weight `theta(r) = exp(-r^2/h^2) - exp(-c^2/h^2)` for r under the cutoff c, 0 beyond: continuous.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Kernel {
    bandwidth: Real,
    cutoff: Real,
    inverse_bandwidth2: Real,
    at_cutoff: Real,
    /// The square of cutoff over bandwidth.
    end: Real,
}

impl Kernel {
    /// Bandwidth `h` and cutoff `c`, m.
    ///
    /// # Errors
    /// [`Error::InvalidValue`] if one is not finite and positive, or the cutoff is over 3 bandwidths.
    pub fn new(bandwidth: Real, cutoff: Real) -> Result<Self> {
        check_positive("kernel bandwidth", bandwidth, "m")?;
        check_positive("kernel cutoff", cutoff, "m")?;
        let ratio = cutoff / bandwidth;
        if ratio > MAX_CUTOFF_PER_BANDWIDTH {
            let expected = format!("at most {MAX_CUTOFF_PER_BANDWIDTH} bandwidths");
            return Err(Error::value(
                "kernel cutoff",
                expected,
                format!("{ratio} bandwidths"),
                "points that far have no weight to speak of",
            ));
        }
        let end = ratio * ratio;
        Ok(Self { bandwidth, cutoff, inverse_bandwidth2: 1.0 / (bandwidth * bandwidth), at_cutoff: exp_minus(Lane::splat(end)).0[0], end })
    }

    /// The kernel for points `spacing` (m) apart: bandwidth 2 spacings, cutoff 3.6; about 40 points of a flat surface have weight.
    ///
    /// # Errors
    /// [`Error::InvalidValue`] if the spacing is not finite and positive.
    pub fn for_spacing(spacing: Real) -> Result<Self> {
        check_positive("point spacing", spacing, "m")?;
        let bandwidth = BANDWIDTH_PER_SPACING * spacing;
        Self::new(bandwidth, CUTOFF_PER_BANDWIDTH * bandwidth)
    }

    /// Bandwidth h, m.
    pub fn bandwidth(&self) -> Real {
        self.bandwidth
    }

    /// Cutoff c, m: points farther away have no weight.
    pub fn cutoff(&self) -> Real {
        self.cutoff
    }

    /// Weights at squared distances `r2` (m^2): past the cutoff exactly 0, since the exponent stops there.
    #[inline]
    pub(crate) fn weights(&self, r2: Lane) -> Lane {
        exp_minus((r2 * Lane::splat(self.inverse_bandwidth2)).min(Lane::splat(self.end))) - Lane::splat(self.at_cutoff)
    }

    /// Weight at squared distance `r2` (m^2).
    pub fn weight(&self, r2: Real) -> Real {
        self.weights(Lane::splat(r2)).0[0].max(0.0)
    }
}

/// `exp(-q)` for 0 <= q <= 9, to 1e-6 (to 1e-10 below 3.3): Taylor series of `exp(-q/16)`, then four squarings. Several times faster
/// than the library function, and the same bits on every platform.
#[inline(always)]
pub(crate) fn exp_minus(q: Lane) -> Lane {
    let c = Lane::splat;
    let t = q * c(-1.0 / 16.0);
    let t2 = t * t;
    let low = c(1.0) + t + t2 * (c(0.5) + t * c(1.0 / 6.0));
    let high = (c(1.0 / 24.0) + t * c(1.0 / 120.0)) + t2 * (c(1.0 / 720.0) + t * c(1.0 / 5040.0) + t2 * c(1.0 / 40320.0));
    let e = low + t2 * t2 * high;
    let e2 = e * e;
    let e4 = e2 * e2;
    let e8 = e4 * e4;
    e8 * e8
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_fast_exponential_is_the_exponential() {
        for i in 0..=900 {
            let q = i as Real * 0.01;
            let error = exp_minus(Lane::splat(q)).0[0] / (-q).exp() - 1.0;
            let bound = if q < 3.3 { 1e-10 } else { 1e-6 };
            assert!(error.abs() < bound, "exp(-{q}): relative error {error:e}");
        }
    }

    #[test]
    fn the_kernel_is_continuous_and_refuses_nonsense() {
        let kernel = Kernel::for_spacing(0.001).unwrap();
        let c = kernel.cutoff();
        assert_eq!(kernel.weight(c * c), 0.0);
        assert!(kernel.weight(0.999 * c * c) < 1e-3 && kernel.weight(0.0) > 0.9);
        for bad in [0.0, -1.0, Real::NAN, Real::INFINITY] {
            assert!(Kernel::for_spacing(bad).is_err() && Kernel::new(bad, 1.0).is_err() && Kernel::new(1.0, bad).is_err());
        }
        assert!(Kernel::new(1.0, 4.0).is_err());
    }
}

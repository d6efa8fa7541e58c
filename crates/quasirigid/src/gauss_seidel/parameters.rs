//! What the solver is asked for, what it reports, and the check of a problem that comes from outside.

use serde::{Deserialize, Serialize};
use std::time::Duration;

use crate::error::{Error, Result, check_finite, check_non_negative, check_positive};
use crate::math::{Real, Vec3};

/// When to stop.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SolverParameters {
    /// Residual asked for, no unit (see [`crate::delassus::natural_map_residual`]). Default 1e-8.
    /// Larger: fewer sweeps, but a held object settles over several steps and shakes by that share of the contact forces. Below about
    /// 1e-13 rounding is in the way and every solve ends at the cap.
    pub tolerance: Real,
    /// Sweeps at most. Default 1000. Smaller: a cold start on a stiff problem ends early, and says so.
    pub max_sweeps: u32,
    /// Sweeps at least; taken as 1 if 0. Default 2. More: only time is lost. Less, too: one
    /// sweep a step leaves a slow mode that the motion of the step feeds again.
    pub min_sweeps: u32,
    /// Time at most; overrun by a few passes over the contacts, and four sweeps are done in any case. Default none. A
    /// budget makes the result depend on the machine: two runs are then no longer the same bit by bit.
    pub time_budget: Option<Duration>,
    /// What `tolerance` is compared with. Default [`Measure::UnitFree`].
    pub measure: Measure,
    /// Whether the warm start is a prediction of reactions that change: then it need not be improved beyond a
    /// tenth of the tolerance. Default false: one of something at rest is always improved a hundredfold, so
    /// that what is held does not creep by the tolerance. A step sets it from the changes of its reactions.
    pub predicted: bool,
}

impl Default for SolverParameters {
    fn default() -> Self {
        Self { tolerance: 1e-8, max_sweeps: 1000, min_sweeps: 2, time_budget: None, measure: Measure::UnitFree, predicted: false }
    }
}

/// Which of the two residuals the solver is asked to bring down.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub enum Measure {
    /// [`crate::delassus::natural_map_residual`]: no unit, each contact judged by its own stiffness. What a step uses.
    #[default]
    UnitFree,
    /// [`crate::delassus::residual_as_given`]: the numbers as they are, whatever their units. What the literature of the problem uses, and
    /// [`crate::solve_system::solve_system`] for problems from elsewhere.
    AsGiven,
}

impl SolverParameters {
    /// Refuses parameters out of range.
    ///
    /// # Errors
    /// `InvalidValue` if the tolerance is not finite and positive, or no sweep is allowed.
    pub fn check(&self) -> Result<()> {
        check_positive("tolerance", self.tolerance, "no unit")?;
        if self.max_sweeps == 0 {
            return Err(Error::value(
                "max_sweeps",
                "at least 1",
                0,
                "the solver needs one sweep to find any reaction; 1000 is the default",
            ));
        }
        Ok(())
    }
}

/// Why the solver stopped.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub enum Stop {
    /// The residual is within the tolerance, and the errors are small beside `delta_free` too.
    Converged,
    /// `max_sweeps` were done.
    SweepCap,
    /// Nothing that was tried made the reactions better, and sweeps were left: there is no solution, or rounding is in the way. Only
    /// [`super::solve_system`] says so; a step goes on to its cap.
    Stagnated,
    /// `time_budget` was used up.
    TimeBudget,
    /// The caller wanted it to stop ([`crate::solve_system::solve_system_until`]).
    Interrupted,
    /// A NaN or infinity came up. All reactions are zero and the residual is infinite.
    NonFinite,
}

impl Stop {
    /// Whether the reactions are as good as asked for.
    pub fn converged(self) -> bool {
        self == Self::Converged
    }
}

/// How a solve went.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SolveReport {
    /// Sweeps done, Newton steps counted as one each. A Newton step takes the time of 10 to 20 sweeps.
    pub sweeps: u32,
    /// How many of the sweeps were Newton steps; 0 for soft grasps.
    pub newton_steps: u32,
    /// Natural-map residual of the reactions returned, no unit. Never an estimate.
    pub residual: Real,
    /// Why it ended.
    pub stop: Stop,
}

/// Checks a problem from outside before [`crate::gauss_seidel::solve`]: lengths,
/// finite displacements (m), friction coefficients not negative.
///
/// # Errors
/// `InvalidShape` if a length is not `contacts`, `InvalidValue` for a bad number.
pub fn check_problem(contacts: usize, delta_free: &[Vec3], mu: &[Real]) -> Result<()> {
    for (what, length) in [("delta_free", delta_free.len()), ("mu", mu.len())] {
        if length != contacts {
            return Err(Error::shape(
                what,
                format!("one entry for each of {contacts} contacts"),
                length,
                "give all arrays the length of W",
            ));
        }
    }
    check_finite("delta_free", delta_free.iter().flat_map(|d| d.iter()))?;
    mu.iter().enumerate().try_for_each(|(i, &mu)| check_non_negative(&format!("mu of contact {i}"), mu, "no unit"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bad_problems_and_parameters_are_refused() {
        let zero = Vec3::zeros();
        assert!(check_problem(2, &[zero; 2], &[0.0, 0.5]).is_ok());
        assert!(check_problem(2, &[zero; 3], &[0.5; 2]).is_err());
        assert!(check_problem(1, &[Vec3::new(0.0, Real::NAN, 0.0)], &[0.5]).is_err());
        assert!(check_problem(2, &[zero; 2], &[0.5, -0.1]).unwrap_err().to_string().contains("contact 1"));
        assert!(SolverParameters::default().check().is_ok());
        for tolerance in [0.0, -1.0, Real::NAN, Real::INFINITY] {
            assert!(SolverParameters { tolerance, ..Default::default() }.check().is_err());
        }
        assert!(SolverParameters { max_sweeps: 0, ..Default::default() }.check().is_err());
    }
}

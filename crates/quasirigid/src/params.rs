//! Every tolerance and limit of the engine: unit, default, and what changes when it is touched.

use crate::collider::FrictionRule;
use crate::error::{Error, Result, check_finite, check_non_negative, check_positive};
use crate::gauss_seidel::SolverParameters;
use crate::math::{Real, Vec3};
use serde::{Deserialize, Serialize};
use std::time::Duration;

/// A body that would move, or turn, by more than this in one step before contact forces is
/// quarantined before it acts on others, m or rad. Far above any motion in a grasp, and far below
/// where squares of numbers overflow.
pub(crate) const ABSURD_DISPLACEMENT: Real = 100.0;

/// Parameters of a world. Plain data; [`Parameters::check`] is called when a world is made or its parameters are replaced.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Parameters {
    /// Time step, s. Default 1e-3. Larger steps stay stable (all is implicit) but damp motion more.
    pub dt: Real,
    /// Gravity, m/s^2, world frame. Default (0, 0, -9.81).
    pub gravity: Vec3,
    /// `delta_c` of the paper: contacts up to this gap enter the problem, m. Default 2e-4. Too small and a neighbour that is pushed into
    /// contact during the solve is missed for one step; too large and the solver drags contacts that stay open.
    pub contact_margin: Real,
    /// Speed at which an overlap that a step finds at its start is pushed apart, m/s. Default 0.02. Surfaces that touch do not
    /// overlap, however hard they press: this is for bodies that were put into each other. The gap that the solver sees is cut at
    /// this speed times `dt`, so that what is pushed out leaves at about this speed instead of overlap over `dt`. Lower is gentler
    /// and takes longer; infinity removes any overlap in one step, and throws apart what was in it.
    pub push_out_speed: Real,
    /// Sphere tests that collision may spend in a step, shared evenly by the pairs of bodies that are near each other; each gets
    /// at least 2,000 (some 15 µs), since with less too few contacts are left to hold anything. Default: no limit. When it is
    /// spent the traversal stops and the report says `budget_exhausted`: patches are then made of fewer, larger contacts. They
    /// hold as hard, but not as still: which points stand for a patch may change as the bodies move.
    pub traversal_budget: usize,
    /// Sphere tests are done with this much more margin, m, and their result is kept until the two bodies have
    /// moved by it. Default 5e-4. Larger means fewer traversals and more control points to test in each step.
    /// Where control points are far apart it is a tenth of their spacing, if that is more.
    pub traversal_slack: Real,
    /// Projections on a surface stop when the distance left is below this, m. Default 1e-10.
    pub projection_tolerance: Real,
    /// A projection is kept, with its tangent plane for the surface, until its control point has moved this far from
    /// where it was made, m. Default 1e-6: on a radius of 1 mm the plane is then off by 5e-10 m. On flatter surfaces
    /// that do not deform it is kept until the plane is off by as much. 0 projects again in every step.
    pub projection_slack: Real,
    /// Contacts are searched for again only in every so many-th step, at least 1. Default 1. In between every contact keeps its foot
    /// and tangent plane, which move with the body that they are on, and only gap and slip follow the motion; a control point
    /// that moves by more than `contact_margin` against the other body is projected all the same. Larger saves most of collision
    /// and of the elastic part of the contact problem while things move. What it costs: over a move `d` on a radius `R` a gap is
    /// off by `d^2/(2R)`, until the next search. 4 is a good choice for 1 kHz haptics.
    pub collision_every: u32,
    /// Spheres are refitted after deformation up to this level of the tree, 0 being the root; nodes above are inflated by
    /// the largest displacement instead. Default 6. Higher saves time, and makes the upper spheres looser.
    pub refit_level: u32,
    /// Surface points and spheres follow a control point when its elastic displacement has changed by more than this, m. Default 1e-7.
    /// The control points keep the exact value.
    pub deformation_threshold: Real,
    /// Where two surfaces meet and the one with the coarser control points is more than this many times stiffer, it counts as
    /// rigid: it would deform by a thousandth of what the other does, at the same cost. Default 1000,
    /// as wood is to a fingertip; infinity never does so. Holds for pairs that meet after it was set.
    pub rigid_beyond: Real,
    /// How the friction coefficients of two materials make that of their pair. Default: the geometric mean. Pairs in the friction table
    /// ([`crate::World::set_friction`]) do not use it.
    pub friction_rule: FrictionRule,
    /// Threads. Default 1. The result is the same bits for any number.
    pub threads: usize,
    /// When the solver stops.
    pub solver: SolverParameters,
    /// Time that a step may take, for a loop that must keep up with the clock: some 0.8 `dt`. Default: none. The solver gets what the
    /// stages before it have left, less what the stage after it took in the last step, but never less than a quarter; when that is used
    /// up it stops at the best that it has, which obeys Coulomb's law and does not pull, and the report says
    /// [`crate::gauss_seidel::Stop::TimeBudget`]. The next step goes on from there. The result then depends on the machine: two runs are
    /// no longer the same bit by bit. `solver.max_sweeps` of 20 to 40 is a limit of the same kind that is the same everywhere.
    pub step_budget: Option<Duration>,
}

impl Default for Parameters {
    fn default() -> Self {
        Self {
            dt: 1e-3,
            gravity: Vec3::new(0.0, 0.0, -9.81),
            contact_margin: 2e-4,
            push_out_speed: 0.02,
            traversal_budget: usize::MAX,
            traversal_slack: 5e-4,
            projection_tolerance: 1e-10,
            projection_slack: 1e-6,
            collision_every: 1,
            refit_level: 6,
            deformation_threshold: 1e-7,
            rigid_beyond: 1e3,
            friction_rule: FrictionRule::default(),
            threads: 1,
            solver: SolverParameters::default(),
            step_budget: None,
        }
    }
}

impl Parameters {
    /// Time that the solver may take in a step that began `elapsed` ago, if what comes
    /// after it takes `rest`: [`Parameters::step_budget`] and the solver's own.
    pub(crate) fn solver_budget(&self, elapsed: Duration, rest: Duration) -> Option<Duration> {
        let left = self.step_budget.map(|budget| budget.saturating_sub(elapsed + rest).max(budget / 4));
        left.into_iter().chain(self.solver.time_budget).min()
    }

    /// Refuses parameters out of range.
    ///
    /// # Errors
    /// [`Error::InvalidValue`] for the first parameter that is out of range.
    pub fn check(&self) -> Result<()> {
        check_positive("dt", self.dt, "s")?;
        check_finite("gravity", self.gravity.iter())?;
        check_non_negative("contact_margin", self.contact_margin, "m")?;
        if self.push_out_speed.is_nan() || self.push_out_speed <= 0.0 {
            return Err(Error::value("push_out_speed", "> 0 m/s, or infinity", self.push_out_speed, "0.02 is the default"));
        }
        check_non_negative("traversal_slack", self.traversal_slack, "m")?;
        check_non_negative("projection_slack", self.projection_slack, "m")?;
        if self.collision_every == 0 {
            return Err(Error::value("collision_every", "at least 1", 0, "1 searches in every step"));
        }
        check_positive("projection_tolerance", self.projection_tolerance, "m")?;
        check_non_negative("deformation_threshold", self.deformation_threshold, "m")?;
        if self.rigid_beyond.is_nan() || self.rigid_beyond < 1.0 {
            return Err(Error::value("rigid_beyond", "a ratio of at least 1, or infinity", self.rigid_beyond, "1000 is the default"));
        }
        self.solver.check()?;
        if self.threads == 0 || self.threads > 1024 {
            return Err(Error::value("threads", "between 1 and 1024", self.threads, "give the number of cores to use"));
        }
        if self.step_budget == Some(Duration::ZERO) {
            return Err(Error::value("step_budget", "a time > 0 s", 0, "0.8 dt keeps up with the clock; leave it out for no limit"));
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_solver_gets_what_the_other_stages_leave_and_a_quarter_at_least() {
        let us = Duration::from_micros;
        let mut params = Parameters::default();
        assert_eq!(params.solver_budget(us(500), us(100)), None);
        params.step_budget = Some(us(800));
        assert_eq!(params.solver_budget(us(300), us(100)), Some(us(400)));
        assert_eq!(params.solver_budget(us(900), us(100)), Some(us(200)));
        params.solver.time_budget = Some(us(150));
        assert_eq!(params.solver_budget(us(300), us(100)), Some(us(150)));
        assert!(params.check().is_ok());
        params.step_budget = Some(Duration::ZERO);
        assert!(params.check().unwrap_err().to_string().contains("step_budget"));
    }
}

//! The report of a step.

use crate::gauss_seidel::Stop;
use crate::math::Real;
use serde::{Deserialize, Serialize};
use std::time::Duration;

/// The five stages, in order: the names of modules, timers and headings.
pub const STAGES: [&str; 5] = ["free_motion", "collision", "contact_problem", "gauss_seidel", "constrained_motion"];

/// Parts of stages that are timed on their own, those of the paper's two tables: of collision, of
/// collision, of the contact problem, of the contact problem, of the constrained motion.
pub const PARTS: [&str; 5] = ["traverse", "interpenetration", "w_rigid", "w_deform", "hierarchy_update"];

/// Time of every stage of one step, and of its parts that the benchmark lists.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct StageTimes {
    /// Stage 1.
    pub free_motion: Duration,
    /// Stage 2.
    pub collision: Duration,
    /// Stage 3.
    pub contact_problem: Duration,
    /// Stage 4.
    pub gauss_seidel: Duration,
    /// Stage 5.
    pub constrained_motion: Duration,
    /// Of stage 2: sphere trees traversed.
    pub traverse: Duration,
    /// Of stage 2: control points projected.
    pub interpenetration: Duration,
    /// Of stage 3: the rigid part of W, and gaps and slips of the free motion.
    pub w_rigid: Duration,
    /// Of stage 3: the elastic part of W, and the diagonal blocks of both.
    pub w_deform: Duration,
    /// Of stage 5: displacements of the patches summed; and of stage 2: spheres refitted before they are traversed.
    pub hierarchy_update: Duration,
}

impl StageTimes {
    /// The five stages, in the order of [`STAGES`].
    pub fn stages(&self) -> [Duration; 5] {
        [self.free_motion, self.collision, self.contact_problem, self.gauss_seidel, self.constrained_motion]
    }

    /// The parts, in the order of [`PARTS`].
    pub fn parts(&self) -> [Duration; 5] {
        [self.traverse, self.interpenetration, self.w_rigid, self.w_deform, self.hierarchy_update]
    }

    /// The whole step.
    pub fn total(&self) -> Duration {
        self.stages().iter().sum()
    }
}

/// What [`crate::World::step`] returns.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct StepReport {
    /// Time at the end of the step, s.
    pub time: Real,
    /// Contacts in the problem.
    pub contacts: usize,
    /// Gauss-Seidel sweeps, Newton steps counted as one each.
    pub sweeps: u32,
    /// How many of the sweeps were Newton steps, each of which takes the time of 10 to 20; 0 for soft grasps.
    pub newton_steps: u32,
    /// Natural-map residual of the reactions, no unit.
    pub residual: Real,
    /// Why the solver stopped.
    pub stop: Stop,
    /// The traversal budget ran out: some contacts are coarser than the leaves.
    pub budget_exhausted: bool,
    /// Largest indentation of any patch over the thickness of its layer, -. Compliances are those of small strains: beyond
    /// 0.5 they are not to be trusted. [`crate::World::indentations`] has those of every patch.
    pub indentation: Real,
    /// Contacts left out because neither body could move and neither surface could deform there.
    pub ill_posed: usize,
    /// Bodies that became non-finite in this step and were rolled back and quarantined.
    pub quarantined: Vec<crate::world::BodyHandle>,
    /// Pairs of bodies that have penetrated each other by half or more, or lie one inside the other: they are pushed apart the shortest way
    /// at [`crate::Parameters::push_out_speed`]. Of several equal ways, as for bodies with one centre, the first in a fixed order is taken.
    pub penetrated: Vec<(crate::world::BodyHandle, crate::world::BodyHandle)>,
    /// Time of every stage.
    pub times: StageTimes,
}

impl StepReport {
    /// One report for several steps: this one, of the last, with what must not be missed
    /// of those before: every body that was quarantined, every pair that
    /// was fully penetrated, the deepest indentation, the sum of ill-posed contacts,
    /// whether any budget was exhausted, and the residual and the reason to stop of the worst solve.
    #[must_use]
    pub fn after(mut self, mut before: Self) -> Self {
        before.quarantined.append(&mut self.quarantined);
        self.quarantined = before.quarantined;
        self.penetrated.retain(|pair| !before.penetrated.contains(pair));
        before.penetrated.append(&mut self.penetrated);
        self.penetrated = before.penetrated;
        self.indentation = self.indentation.max(before.indentation);
        self.ill_posed += before.ill_posed;
        self.budget_exhausted |= before.budget_exhausted;
        // A solve that did not converge is worse than one that did, whatever its residual.
        let rank = |converged: bool, residual: Real| (!converged, if residual.is_nan() { Real::INFINITY } else { residual });
        if rank(before.stop.converged(), before.residual) > rank(self.converged(), self.residual) {
            (self.residual, self.stop) = (before.residual, before.stop);
        }
        self
    }

    /// Whether the solver reached its tolerance.
    pub fn converged(&self) -> bool {
        self.stop == Stop::Converged
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_report_of_several_steps_keeps_the_worst() {
        let step = |time, residual, stop, ill_posed| StepReport {
            time,
            contacts: 3,
            sweeps: 2,
            newton_steps: 0,
            residual,
            stop,
            budget_exhausted: ill_posed > 0,
            indentation: 0.1 * time,
            ill_posed,
            quarantined: Vec::new(),
            penetrated: Vec::new(),
            times: StageTimes::default(),
        };
        let first = step(1.0, 1e-9, Stop::Converged, 2);
        let cut = step(2.0, 1e-12, Stop::SweepCap, 0);
        let last = step(3.0, 1e-10, Stop::Converged, 1);
        let all = last.after(cut.after(first));
        assert_eq!((all.time, all.residual, all.stop), (3.0, 1e-12, Stop::SweepCap));
        assert_eq!(all.indentation, 0.1 * 3.0);
        assert_eq!((all.ill_posed, all.budget_exhausted, all.converged()), (3, true, false));
    }
}

//! Scratch and caches of a step, kept from one to the next so that a step allocates nothing. No state
//! lives here, but for the contacts and reactions of the last step, which a user may read.

use crate::collision::Collision;
use crate::constrained_motion::Scratch as MotionScratch;
use crate::contact_problem::ContactProblem;
use crate::free_motion::FreeMotion;
use crate::gauss_seidel::Scratch as SolverScratch;
use std::time::Duration;

/// Output and scratch of every stage.
#[derive(Debug, Default)]
pub struct Workspace {
    /// Stage 1, by slot of the body.
    pub free: Vec<FreeMotion>,
    /// Stage 2.
    pub collision: Collision,
    /// Stage 3, and the reactions of stage 4.
    pub problem: ContactProblem,
    /// Stage 4.
    pub solver: SolverScratch,
    /// Stage 5.
    pub motion: MotionScratch,
    /// Time that stage 5 took in the last step.
    pub motion_time: Duration,
}

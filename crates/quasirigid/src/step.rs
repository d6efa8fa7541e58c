//! One step: five stages in order, each timed. The table of contents of the crate.

use crate::collision::collision;
use crate::constrained_motion::constrained_motion;
use crate::contact_problem::contact_problem;
use crate::free_motion::{StepContext, free_motions};
use crate::gauss_seidel::{self, SolverParameters};
use crate::report::{StageTimes, StepReport};
use crate::world::World;
use std::time::{Duration, Instant};

impl World {
    /// Advances the world by one time step `dt` and says how it went.
    ///
    /// After warm-up a step allocates nothing (with one thread), and the result is the same bits for any number of threads.
    pub fn step(&mut self) -> StepReport {
        match self.pool.take() {
            None => self.step_here(),
            Some(pool) => {
                let report = pool.install(|| self.step_here());
                self.pool = Some(pool);
                report
            }
        }
    }

    fn step_here(&mut self) -> StepReport {
        let Self { params, bodies, pairs, friction, workspace: ws, .. } = self;
        let mut times = StageTimes::default();
        let start = Instant::now();
        let mut clock = start;

        free_motions(bodies, &StepContext::of(params), &mut ws.free);
        times.free_motion = lap(&mut clock);

        collision(&mut ws.collision, bodies, &ws.free, pairs, friction, params, self.steps);
        times.collision = lap(&mut clock);

        contact_problem(&mut ws.problem, &mut ws.collision.contacts, pairs, bodies, &ws.free, params.dt);
        times.contact_problem = lap(&mut clock);

        let problem = &mut ws.problem;
        let time_budget = params.solver_budget(clock - start, ws.motion_time);
        let solved = gauss_seidel::solve(
            &mut problem.w,
            &problem.delta_free,
            &problem.mu,
            &mut problem.reactions,
            &mut problem.status,
            &SolverParameters { foretold: problem.foretold, time_budget, ..params.solver.clone() },
            &mut ws.solver,
        );
        problem.unfinished = if solved.stop.converged() { 0.0 } else { solved.residual };
        times.gauss_seidel = lap(&mut clock);

        constrained_motion(&mut ws.motion, bodies, pairs, &ws.collision.contacts, &ws.problem, &ws.free, params);
        times.constrained_motion = lap(&mut clock);
        ws.motion_time = times.constrained_motion;

        times.traverse = ws.collision.traverse_time;
        times.interpenetration = ws.collision.projection_time;
        times.w_rigid = ws.problem.rigid_time;
        times.w_deform = ws.problem.deform_time;
        times.hierarchy_update = ws.collision.refit_time + ws.motion.hierarchy_time;
        self.steps += 1;
        self.hands_arrived();
        let quarantined = self.workspace.motion.quarantined.iter().map(|&dense| self.handle_of(dense)).collect();
        StepReport {
            time: self.time(),
            contacts: self.workspace.problem.len(),
            sweeps: solved.sweeps,
            newton_steps: solved.newton_steps,
            residual: solved.residual,
            stop: solved.stop,
            coarse: self.workspace.collision.coarse,
            ill_posed: self.workspace.problem.ill_posed,
            quarantined,
            times,
        }
    }
}

fn lap(clock: &mut Instant) -> Duration {
    let now = Instant::now();
    now - std::mem::replace(clock, now)
}

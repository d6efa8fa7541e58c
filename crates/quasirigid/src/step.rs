//! One step: five stages in order, each timed. The table of contents of the crate.

use crate::collision::collision;
use crate::constrained_motion::constrained_motion;
use crate::contact_problem::contact_problem;
use crate::free_motion::{StepContext, free_motions};
use crate::gauss_seidel::{self, SolverParameters};
use crate::world::World;
use crate::world::report::{StageTimes, StepReport};
use std::time::{Duration, Instant};

impl World {
    /// Advances the world by one time step `dt` and reports how it went.
    ///
    /// After warm-up a step allocates nothing (with one thread), and the result is the same bits for any number of threads.
    pub fn step(&mut self) -> StepReport {
        let mut pool = std::mem::take(&mut self.pool);
        let report = match pool.of_this_process(self.params.threads) {
            None => self.step_here(),
            Some(threads) => threads.install(|| self.step_here()),
        };
        self.pool = pool;
        report
    }

    fn step_here(&mut self) -> StepReport {
        let Self { params, objects, pairs, friction, workspace: ws, .. } = self;
        let mut times = StageTimes::default();
        let start = Instant::now();
        let mut clock = start;

        free_motions(&mut objects.bodies, &StepContext::of(params), &mut ws.free);
        times.free_motion = lap(&mut clock);

        collision(&mut ws.collision, objects, &ws.free, pairs, friction, params, self.steps);
        times.collision = lap(&mut clock);

        contact_problem(&mut ws.problem, &mut ws.collision.contacts, pairs, objects, &ws.free, params.dt);
        times.contact_problem = lap(&mut clock);

        let problem = &mut ws.problem;
        let time_budget = params.solver_budget(clock - start, ws.motion_time);
        let solved = gauss_seidel::solve(
            &mut problem.w,
            &problem.delta_free,
            &problem.mu,
            &mut problem.unknowns,
            &mut problem.status,
            &SolverParameters { predicted: problem.predicted, time_budget, ..params.solver.clone() },
            &mut ws.solver,
        );
        problem.take_solution(&ws.collision.contacts, if solved.stop.converged() { 0.0 } else { solved.residual });
        times.gauss_seidel = lap(&mut clock);

        constrained_motion(&mut ws.motion, objects, pairs, &ws.collision.contacts, &ws.problem, &ws.free, params);
        times.constrained_motion = lap(&mut clock);
        ws.motion_time = times.constrained_motion;

        times.traverse = ws.collision.traverse_time;
        times.interpenetration = ws.collision.projection_time;
        times.w_rigid = ws.problem.rigid_time;
        times.w_deform = ws.problem.deform_time;
        times.hierarchy_update = ws.collision.refit_time + ws.motion.hierarchy_time;
        self.steps += 1;
        self.update_hand_poses();
        let quarantined = self.workspace.motion.quarantined.iter().map(|&slot| self.body_at(slot)).collect();
        let handles = |&(a, b): &(u32, u32)| (self.body_at(a), self.body_at(b));
        let penetrated = self.workspace.collision.penetrated.iter().map(handles).collect();
        StepReport {
            time: self.time(),
            contacts: self.workspace.problem.len(),
            sweeps: solved.sweeps,
            newton_steps: solved.newton_steps,
            residual: solved.residual,
            stop: solved.stop,
            budget_exhausted: self.workspace.collision.budget_exhausted,
            indentation: self.workspace.motion.indentation,
            ill_posed: self.workspace.problem.ill_posed,
            quarantined,
            penetrated,
            times,
        }
    }
}

fn lap(clock: &mut Instant) -> Duration {
    let now = Instant::now();
    now - std::mem::replace(clock, now)
}

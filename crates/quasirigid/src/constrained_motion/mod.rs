//! Stage 5: what the reactions do to poses and surfaces (design 3.5).

mod deformation;
pub mod integrate;
mod slip;

pub use integrate::advance;

use crate::body::BodyEntry;
use crate::collision::{Contact, Pair};
use crate::contact_problem::ContactProblem;
use crate::free_motion::{FreeMotion, StepContext, is_sound};
use crate::math::{Vec3, Vec6};
use crate::params::Parameters;
use std::time::{Duration, Instant};

/// Scratch and output of the stage.
#[derive(Debug, Default)]
pub struct Scratch {
    /// Dense indices of bodies that became non-finite in this step.
    pub quarantined: Vec<usize>,
    /// Time to sum the displacements of all patches.
    pub hierarchy_time: Duration,
    deformation: deformation::Scratch,
    forces: Vec<Vec6>,
}

/// `dx = dx_free + A^-1 J^T f`; then the elastic displacements.
pub fn constrained_motion(
    scratch: &mut Scratch,
    bodies: &mut [BodyEntry],
    pairs: &mut [Pair],
    contacts: &[Contact],
    problem: &ContactProblem,
    free: &[FreeMotion],
    params: &Parameters,
) {
    let context = StepContext::of(params);
    let reactions = &problem.reactions;
    slip::remember(pairs, contacts, problem, context.dt);
    deformation::remember(&mut scratch.deformation, pairs, bodies, contacts, problem, params);
    generalized_forces(&mut scratch.forces, bodies, contacts, reactions);
    scratch.quarantined.clear();
    for (index, ((entry, free), force)) in bodies.iter_mut().zip(free).zip(&scratch.forces).enumerate() {
        if free.set_aside {
            scratch.quarantined.push(index);
        }
        if entry.quarantined {
            continue;
        }
        let dx = free.displacement + free.response(force);
        let before = entry.body.state();
        advance(&mut entry.body, free, &dx, force, &context);
        if !(is_sound(&dx) && entry.body.is_finite()) {
            // Nothing non-finite leaves the step: back to where it was, out of the way, and reported.
            entry.body.restore(&before);
            entry.quarantined = true;
            scratch.quarantined.push(index);
        }
    }
    let start = Instant::now();
    deformation::deform_skins(bodies, pairs, params);
    scratch.hierarchy_time = start.elapsed();
}

/// `J^T f` of every body: N and N m about the centre of mass of a free body, N m for each joint of a finger.
fn generalized_forces(forces: &mut Vec<Vec6>, bodies: &[BodyEntry], contacts: &[Contact], reactions: &[Vec3]) {
    forces.clear();
    forces.resize(bodies.len(), Vec6::zeros());
    for (contact, f) in contacts.iter().zip(reactions) {
        let force = contact.frame * f;
        for (body, sign) in [(contact.body_a, 1.0), (contact.body_b, -1.0)] {
            let entry = &bodies[body as usize];
            if entry.body.dof() > 0 {
                forces[body as usize] += entry.body.point_jacobian(entry.skin_link, &contact.point).transpose() * force * sign;
            }
        }
    }
}

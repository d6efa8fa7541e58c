//! Stage 5: what the reactions do to poses and surfaces (design 3.5).

mod deformation;
pub mod integrate;
mod slip;

pub use integrate::advance;

use crate::contact_problem::{ContactProblem, warm_start};
use crate::free_motion::{FreeMotion, StepContext, is_sound};
use crate::math::{Real, Vec3, Vec6};
use crate::objects::Objects;
use crate::pair::{Contact, Pair};
use crate::params::Parameters;
use std::time::{Duration, Instant};

/// Scratch and output of the stage.
#[derive(Debug, Default)]
pub struct Scratch {
    /// Slots of bodies that became non-finite in this step.
    pub quarantined: Vec<u32>,
    /// Largest indentation of a patch over the thickness of its layer, -.
    pub indentation: Real,
    /// Time to sum the displacements of all patches.
    pub hierarchy_time: Duration,
    deformation: deformation::Scratch,
    loaded_before: Vec<u32>,
    forces: Vec<Vec6>,
}

/// `dx = dx_free + A^-1 J^T f`; then the elastic displacements.
pub(crate) fn constrained_motion(
    scratch: &mut Scratch,
    objects: &mut Objects,
    pairs: &mut [Pair],
    contacts: &[Contact],
    problem: &ContactProblem,
    free: &[FreeMotion],
    params: &Parameters,
) {
    let context = StepContext::of(params);
    let reactions = &problem.reactions;
    slip::remember(pairs, contacts, problem, context.dt);
    deformation::remember(&mut scratch.deformation, pairs, objects, contacts, problem, params);
    scratch.indentation = pairs.iter().flat_map(|pair| pair.indentations(objects)).fold(0.0, Real::max);
    warm_start::remember(&mut scratch.loaded_before, pairs, contacts, problem);
    generalized_forces(&mut scratch.forces, objects, contacts, reactions);
    scratch.quarantined.clear();
    for (slot, entry) in objects.bodies.iter_mut() {
        let (free, force) = (&free[slot as usize], &scratch.forces[slot as usize]);
        if free.quarantined {
            scratch.quarantined.push(slot);
        }
        if entry.quarantined {
            continue;
        }
        let dx = free.displacement + free.response(force);
        let before = entry.body.state();
        advance(&mut entry.body, free, &dx, force, &context);
        if !(is_sound(&dx) && entry.body.is_finite()) {
            // A body whose state became non-finite is put back to the start of the step, quarantined and reported.
            entry.body.restore(&before);
            entry.quarantined = true;
            scratch.quarantined.push(slot);
        }
    }
    let start = Instant::now();
    deformation::deform_skins(&mut objects.colliders, pairs, params);
    scratch.hierarchy_time = start.elapsed();
}

/// `J^T f` of every body: N and N m about the centre of mass of a free body, N m for each joint of a finger.
fn generalized_forces(forces: &mut Vec<Vec6>, objects: &Objects, contacts: &[Contact], reactions: &[Vec3]) {
    forces.clear();
    forces.resize(objects.bodies.slot_count(), Vec6::zeros());
    for (contact, f) in contacts.iter().zip(reactions) {
        let force = contact.acts_along * f;
        for (collider, sign) in [(contact.collider_a, 1.0), (contact.collider_b, -1.0)] {
            let side = objects.side(collider);
            if side.body.body.dof() > 0 {
                forces[side.collider.body as usize] += side.point_jacobian(&contact.acts_at).transpose() * force * sign;
            }
        }
    }
}

//! Stage 3: `delta = W f + delta_free` for the contacts found (design 3.3).
//!
//! `W = W_rigid + W_deform` is filled in its matrix-free form; [`ContactProblem::assembled`] gives the matrix for tests, export and users' own problems.

mod elastic;
mod elastic_rows;
mod free_gap;

pub use elastic_rows::ElasticRows;

use crate::body::{BodyEntry, pair_friction};
use crate::collision::{Contact, Pair};
use crate::error::Result;
use crate::free_motion::FreeMotion;
use crate::gauss_seidel::{Assembled, ContactStatus, MatrixFree, NO_BODY};
use crate::math::{Mat3x6, Real, Vec3};
use std::time::{Duration, Instant};

/// The problem that Gauss-Seidel solves, and its solution.
#[derive(Debug, Default)]
pub struct ContactProblem {
    /// Delassus operator, m/N, in contact frames (normal, tangent1, tangent2).
    pub w: MatrixFree,
    /// Gap (normal) and slip (tangents) at the end of the step without reactions, m.
    pub delta_free: Vec<Vec3>,
    /// Friction coefficient of each contact.
    pub mu: Vec<Real>,
    /// Reactions, N: the warm start on entry to the solver, the solution after.
    pub reactions: Vec<Vec3>,
    /// Whether any of the warm start is a forecast rather than the last reaction: something is in motion.
    pub foretold: bool,
    /// Open, stick or slip, as the solver left it.
    pub status: Vec<ContactStatus>,
    /// Contacts that had to be left out because their block of `W` was not positive definite (no body of the pair can move there and neither gives).
    pub ill_posed: usize,
    /// Time to fill the rigid part and `delta_free`.
    pub rigid_time: Duration,
    /// Time to fill the elastic part, and the diagonal blocks of both.
    pub deform_time: Duration,
    rigid: Vec<RigidRows>,
    elastic: elastic::Scratch,
}

/// Rigid part of one contact: `J S` of either side with the slot of its body.
#[derive(Debug, Clone, Copy)]
struct RigidRows {
    a: (u32, Mat3x6),
    b: (u32, Mat3x6),
}

impl ContactProblem {
    /// Number of contacts.
    pub fn len(&self) -> usize {
        self.delta_free.len()
    }

    /// Whether there are no contacts.
    pub fn is_empty(&self) -> bool {
        self.delta_free.is_empty()
    }

    /// `W` as a sparse matrix of 3x3 blocks.
    ///
    /// # Errors
    /// None for a problem that a step has filled: its blocks were checked.
    pub fn assembled(&self) -> Result<Assembled> {
        Assembled::from_matrix_free(&self.w)
    }
}

/// Fills the problem. `contacts` is ordered by pair; contacts that cannot be solved are taken out of it.
pub fn contact_problem(
    out: &mut ContactProblem,
    contacts: &mut Vec<Contact>,
    pairs: &mut [Pair],
    bodies: &[BodyEntry],
    free: &[FreeMotion],
    dt: Real,
) {
    out.ill_posed = 0;
    loop {
        fill(out, contacts, pairs, bodies, free, dt);
        let filled = Instant::now();
        let finished = out.w.finish();
        out.deform_time += filled.elapsed();
        match finished {
            Ok(()) => return,
            Err(ill_posed) => {
                contacts.remove(ill_posed);
                out.ill_posed += 1;
            }
        }
    }
}

fn fill(out: &mut ContactProblem, contacts: &[Contact], pairs: &mut [Pair], bodies: &[BodyEntry], free: &[FreeMotion], dt: Real) {
    out.w.clear(bodies.len());
    out.delta_free.clear();
    out.mu.clear();
    out.reactions.clear();
    out.foretold = false;
    out.status.clear();
    out.status.resize(contacts.len(), ContactStatus::Open);
    (out.rigid_time, out.deform_time) = (Duration::ZERO, Duration::ZERO);
    // Rows of a pair that has lost touch are not those of the contacts that it may find later.
    for (index, pair) in pairs.iter_mut().enumerate() {
        if contacts.binary_search_by_key(&(index as u32), |contact| contact.pair).is_err() {
            pair.elastic.forget();
        }
    }
    let mut first = 0;
    while first < contacts.len() {
        let index = contacts[first].pair;
        let end = contacts[first..].iter().position(|c| c.pair != index).map_or(contacts.len(), |count| first + count);
        let start = Instant::now();
        let patch = &contacts[first..end];
        let pair = &mut pairs[index as usize];
        let (entry_a, entry_b) = (&bodies[pair.a as usize], &bodies[pair.b as usize]);
        if let (Some(skin_a), Some(skin_b)) = (entry_a.active_skin(), entry_b.active_skin()) {
            let mu = pair_friction(&skin_a.material, &skin_b.material);
            out.rigid.clear();
            for contact in patch {
                out.delta_free.push(free_gap::delta_free(contact, pair, bodies, free, dt));
                out.mu.push(mu);
                let warm_start = warm_start(pair, contact.control_point as usize);
                out.foretold |= warm_start != pair.reaction[contact.control_point as usize];
                out.reactions.push(warm_start);
                out.rigid.push(RigidRows {
                    a: rigid_rows(contact, pair.a, entry_a, &free[pair.a as usize], 1.0),
                    b: rigid_rows(contact, pair.b, entry_b, &free[pair.b as usize], -1.0),
                });
            }
            let elastic_axes = entry_a.body.link_pose(entry_a.skin_link).rotation.to_rotation_matrix().into_inner().transpose();
            let prepared = Instant::now();
            out.rigid_time += prepared - start;
            let axes_b = entry_b.body.link_pose(entry_b.skin_link).rotation.to_rotation_matrix().into_inner();
            let turn = elastic_axes * axes_b;
            if !pair.elastic.hold_for(patch, &turn, dt) {
                pair.elastic.start(patch, &turn, dt);
                out.elastic.fill_rows(&mut pair.elastic, patch, [skin_a, skin_b], &turn, &axes_b.transpose(), dt);
            }
            for (i, (contact, RigidRows { a, b })) in patch.iter().zip(&out.rigid).enumerate() {
                out.w.push_contact(a.0, &a.1, b.0, &b.1, &(elastic_axes * contact.frame));
                pair.elastic.push_row(&mut out.w, i, first);
            }
            out.deform_time += prepared.elapsed();
        }
        first = end;
    }
}

/// The reaction that a control point would have if it changed as it did in the last step.
fn warm_start(pair: &Pair, control_point: usize) -> Vec3 {
    let (last, trend) = (pair.reaction[control_point], pair.trend[control_point]);
    if last.x + trend.x > 0.0 { last + trend } else { last }
}

/// `J S` of one body at one contact, in the contact frame: its part of `W_rigid` is `(J S)(J S)^T` as `A^-1 = S S^T`. The sign makes relative displacement a - b.
fn rigid_rows(contact: &Contact, body: u32, entry: &BodyEntry, free: &FreeMotion, sign: Real) -> (u32, Mat3x6) {
    if free.dof == 0 {
        return (NO_BODY, Mat3x6::zeros());
    }
    let jacobian = entry.body.point_jacobian(entry.skin_link, &contact.point);
    (body, contact.frame.transpose() * jacobian * free.inverse_root * sign)
}

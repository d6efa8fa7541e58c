//! Stage 3: `delta = W f + delta_free` for the contacts found (design 3.3).
//!
//! `W = W_rigid + W_deform` is filled in its matrix-free form; [`ContactProblem::assembled`] gives the matrix for tests, export and users' own problems.

mod elastic;
mod elastic_rows;
mod free_gap;

pub use elastic_rows::ElasticRows;

use crate::body::BodyEntry;
use crate::collision::{Contact, Pair};
use crate::error::Result;
use crate::free_motion::FreeMotion;
use crate::gauss_seidel::{Assembled, ContactStatus, Delassus, MatrixFree, NO_BODY};
use crate::math::{Mat3, Mat3x6, Real, Vec3};
use std::time::{Duration, Instant};

/// The problem that Gauss-Seidel solves, and its solution.
#[derive(Debug, Default)]
pub struct ContactProblem {
    /// Delassus operator, m/N, in contact frames (normal, tangent1, tangent2).
    pub w: MatrixFree,
    /// Gap (normal) and slip (tangents) at the end of the step without reactions, m.
    pub delta_free: Vec<Vec3>,
    /// Friction coefficient of each contact, along its tangent1.
    pub mu: Vec<Real>,
    /// Reactions, N: the warm start on entry to the solver, the solution after.
    pub reactions: Vec<Vec3>,
    /// Whether any of the warm start is a forecast rather than the last reaction: something is in motion.
    pub foretold: bool,
    /// Residual of the reactions if the solver did not get to its tolerance, otherwise 0. Set with the solution.
    pub unfinished: Real,
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
    /// Serial numbers of the elastic rows that `w` holds, patch by patch, and the last one given out.
    held: Vec<u64>,
    serial: u64,
}

/// Rigid part of one contact: `J S` of either side with the slot of its body.
#[derive(Debug, Clone, Copy)]
struct RigidRows {
    a: (u32, Mat3x6),
    b: (u32, Mat3x6),
}

impl ContactProblem {
    /// `delta_free` (m) and reactions (N) of the problem that is left when viscous drag is taken for a load: a plain Coulomb problem with the same `W` and `mu`, and the same
    /// displacements. For export; without drag these are those of the step.
    pub fn coulomb_part(&self) -> (Vec<Vec3>, Vec<Vec3>) {
        let (mut delta_free, mut reactions) = (self.delta_free.clone(), self.reactions.clone());
        let dragged = |i: &usize| self.w.diagonal_block(*i).drag() > 0.0;
        for j in (0..self.len()).filter(dragged) {
            let delta = self.w.displacement(j) + self.delta_free[j];
            reactions[j] = self.w.diagonal_block(j).without_drag(&self.reactions[j], &delta);
            let drag = self.reactions[j] - reactions[j];
            for (i, free) in delta_free.iter_mut().enumerate() {
                *free += self.w.block(i, j) * drag;
            }
        }
        (delta_free, reactions)
    }

    /// Slip of contact `i` over the step, m: the tangential displacement of the two material points against each other. Exactly 0 where it sticks.
    pub fn slip(&self, i: usize, contact: &Contact) -> Real {
        if self.status[i] == ContactStatus::Stick {
            return 0.0;
        }
        let delta = self.w.displacement(i) + self.delta_free[i];
        delta.y.hypot(delta.z / contact.stretch())
    }

    /// No problem yet; elastic rows that pairs keep from this one are not taken for those filled from now on.
    pub(crate) fn started_anew(&self) -> Self {
        Self { serial: self.serial, ..Self::default() }
    }

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
            Err(first) => {
                // All at once: whether a contact can be solved is a matter of its own block, and that is the same without the others.
                let before = contacts.len();
                let mut i = 0;
                contacts.retain(|_| {
                    i += 1;
                    i - 1 < first || (i - 1 > first && out.w.is_well_posed(i - 1))
                });
                out.ill_posed += before - contacts.len();
            }
        }
    }
}

fn fill(out: &mut ContactProblem, contacts: &[Contact], pairs: &mut [Pair], bodies: &[BodyEntry], free: &[FreeMotion], dt: Real) {
    let hold = refresh_elastic_rows(out, contacts, pairs, bodies, dt);
    if hold {
        out.w.clear_rigid(bodies.len());
    } else {
        out.w.clear(bodies.len());
    }
    out.delta_free.clear();
    out.mu.clear();
    out.reactions.clear();
    out.foretold = false;
    out.unfinished = 0.0;
    out.status.clear();
    out.status.resize(contacts.len(), ContactStatus::Open);
    out.rigid_time = Duration::ZERO;
    let mut first = 0;
    for patch in contacts.chunk_by(|c, d| c.pair == d.pair) {
        let start = Instant::now();
        let pair = &pairs[patch[0].pair as usize];
        let (entry_a, entry_b) = (&bodies[pair.a as usize], &bodies[pair.b as usize]);
        if entry_a.active_skin().is_some() && entry_b.active_skin().is_some() {
            out.rigid.clear();
            for contact in patch {
                out.delta_free.push(free_gap::delta_free(contact, pair, bodies, free, dt));
                out.mu.push(coefficient(contact, pair, [entry_a, entry_b]));
                let warm_start = warm_start(pair, contact.control_point as usize);
                out.foretold |= warm_start != pair.reaction[contact.control_point as usize];
                out.reactions.push(warm_start);
                out.rigid.push(RigidRows {
                    a: rigid_rows(contact, pair.a, entry_a, &free[pair.a as usize], 1.0),
                    b: rigid_rows(contact, pair.b, entry_b, &free[pair.b as usize], -1.0),
                });
            }
            let elastic_axes = axes(entry_a).transpose();
            let prepared = Instant::now();
            out.rigid_time += prepared - start;
            // c A v as a force per displacement over the step.
            let drag = pair.friction.viscous_coefficient() / dt;
            for (i, (contact, RigidRows { a, b })) in patch.iter().zip(&out.rigid).enumerate() {
                out.w.push_contact(a.0, &a.1, b.0, &b.1, &(elastic_axes * contact.frame));
                if drag > 0.0 {
                    out.w.set_drag(drag * contact.area);
                }
                if !hold {
                    pair.elastic.push_row(&mut out.w, i, first);
                }
            }
            out.deform_time += prepared.elapsed();
        }
        first += patch.len();
    }
}

/// `mu` of one contact, at the slip speed that it had at the end of the last step.
fn coefficient(contact: &Contact, pair: &Pair, bodies: [&BodyEntry; 2]) -> Real {
    pair.friction.constant().unwrap_or_else(|| {
        let speed = pair.slip_speed.get(contact.control_point as usize).copied().unwrap_or(0.0);
        let [turn_a, turn_b] = bodies.map(axes);
        pair.friction.coefficient(&contact.frame, speed, [&turn_a, &turn_b])
    })
}

/// Brings the elastic rows of every pair in touch up to date. Returns whether the operator of the last step holds these very rows.
fn refresh_elastic_rows(out: &mut ContactProblem, contacts: &[Contact], pairs: &mut [Pair], bodies: &[BodyEntry], dt: Real) -> bool {
    let start = Instant::now();
    // Rows of a pair that has lost touch are not those of the contacts that it may find later.
    for (index, pair) in pairs.iter_mut().enumerate() {
        if contacts.binary_search_by_key(&(index as u32), |contact| contact.pair).is_err() {
            pair.elastic.forget();
        }
    }
    let (mut same, mut patches) = (true, 0);
    for patch in contacts.chunk_by(|c, d| c.pair == d.pair) {
        let pair = &mut pairs[patch[0].pair as usize];
        let (entry_a, entry_b) = (&bodies[pair.a as usize], &bodies[pair.b as usize]);
        let (Some(skin_a), Some(skin_b)) = (entry_a.active_skin(), entry_b.active_skin()) else { continue };
        let axes_b = axes(entry_b);
        let turn = axes(entry_a).transpose() * axes_b;
        let shares = [skin_a, skin_b].map(|skin| 1.0 - skin.memory(dt));
        if !pair.elastic.hold_for(patch, &turn, shares) {
            out.serial += 1;
            pair.elastic.start(patch, &turn, shares, out.serial);
            out.elastic.fill_rows(&mut pair.elastic, patch, [skin_a, skin_b], &turn, &axes_b.transpose(), shares);
        }
        let serial = pair.elastic.serial();
        if let Some(held) = out.held.get_mut(patches) {
            same &= std::mem::replace(held, serial) == serial;
        } else {
            out.held.push(serial);
            same = false;
        }
        patches += 1;
    }
    same &= out.held.len() == patches;
    out.held.truncate(patches);
    out.deform_time = start.elapsed();
    same
}

/// Rotation from the link that carries the surface to the world.
fn axes(entry: &BodyEntry) -> Mat3 {
    entry.body.link_pose(entry.skin_link).rotation.to_rotation_matrix().into_inner()
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::body::{Amount, ComplianceModel, MassProperties, Material, Motion, RigidBody};
    use crate::math::Pose;
    use crate::surface::{ComplianceMatrix, Surface, shapes};
    use crate::{Parameters, World};
    use std::sync::Arc;

    #[test]
    fn contacts_where_nothing_moves_and_nothing_gives_are_left_out_all_at_once() {
        let size = Vec3::repeat(0.02);
        let cube = Surface::build(shapes::sample_box(size, 1_200).unwrap(), Some(150)).unwrap();
        // Every other control point gives, the rest do not.
        let gives = |i: usize| i.is_multiple_of(2);
        let n = 3 * cube.control.len();
        let matrix = nalgebra::DMatrix::from_fn(n, n, |i, j| if i == j && gives(i / 3) { 1e-4 } else { 0.0 });
        let matrix = ComplianceModel::Matrix(Arc::new(ComplianceMatrix::new(&matrix).unwrap()));
        let mass = MassProperties::cuboid(size, Amount::Mass(0.1)).unwrap();
        let plate = Arc::new(Surface::build(shapes::sample_half_space(0.1, 900).unwrap(), Some(100)).unwrap());
        let mut world = World::new(Parameters::default()).unwrap();
        let steel = Material::preset("steel").unwrap();
        world.add_body(RigidBody::fixed("plate", Pose::identity()).unwrap(), Some((plate, steel.clone()))).unwrap();
        let cube_body = RigidBody::free("cube", mass, Motion::Inertial, Pose::translation(0.0, 0.0, 0.01)).unwrap();
        world.add_body(cube_body, Some((Arc::new(cube), steel.with_model(matrix).unwrap()))).unwrap();
        let report = world.step();
        let all: Vec<u32> = world.contacts().iter().map(|contact| contact.control_point).collect();
        assert!(report.ill_posed == 0 && all.len() > 10, "{report:?}");

        // The same contacts, were the cube held fast.
        let held = vec![FreeMotion::none(); 2];
        let World { workspace: ws, pairs, bodies, params, .. } = &mut world;
        let (contacts, filled) = (&mut ws.collision.contacts, ws.problem.serial);
        contact_problem(&mut ws.problem, contacts, pairs, bodies, &held, params.dt);
        let left: Vec<u32> = contacts.iter().map(|contact| contact.control_point).collect();
        assert_eq!(left, all.iter().copied().filter(|&c| gives(c as usize)).collect::<Vec<_>>());
        assert_eq!((ws.problem.ill_posed, ws.problem.len()), (all.len() - left.len(), left.len()));
        assert!(ws.problem.serial - filled <= 2, "elastic rows were filled {} times", ws.problem.serial - filled);
    }
}

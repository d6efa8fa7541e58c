//! Stage 3: `delta = W f + delta_free` for the contacts found (design 3.3).
//!
//! `W = W_rigid + W_deform` is filled in its matrix-free form; [`ContactProblem::assembled`]
//! gives the matrix for tests, export and users' own problems.

mod elastic;
mod elastic_operator;
mod free_gap;
mod rows;
mod stored;
pub(crate) mod warm_start;

pub(crate) use elastic_operator::{Node, SideOperator};
pub use rows::ElasticRows;
pub(crate) use stored::StoredProblem;

use crate::delassus::{Assembled, ContactStatus, Delassus, MatrixFree, NO_BODY};
use crate::error::Result;
use crate::free_motion::FreeMotion;
use crate::math::{Mat3, Mat3x6, Real, Vec3};
use crate::objects::{Objects, Side};
use crate::pair::{Contact, Pair};
use rows::Origin;
use std::time::{Duration, Instant};

/// The problem that Gauss-Seidel solves, and its solution.
#[derive(Debug, Default)]
pub struct ContactProblem {
    /// Delassus operator, m/N, in the axes of [`friction_axes`]: contact frames (normal, tangent1, tangent2) where friction is isotropic.
    pub w: MatrixFree,
    /// Gap (normal) and slip (tangents) at the end of the step without reactions, m, in the same axes.
    pub delta_free: Vec<Vec3>,
    /// Friction coefficient of each contact, along its tangent1.
    pub mu: Vec<Real>,
    /// Unknowns of the solver, N, `D^-1 f` with `D = diag(1, 1, mu_2/mu_1)`: the warm start on entry, the solution after.
    pub unknowns: Vec<Vec3>,
    /// Reactions `f` in contact frames, N. Set with the solution.
    pub reactions: Vec<Vec3>,
    /// Whether any of the warm start is extrapolated rather than the last reaction: something is in motion.
    pub predicted: bool,
    /// Residual of the reactions if the solver did not get to its tolerance, otherwise 0. Set with the solution.
    pub unfinished: Real,
    /// Open, stick or slip, as the solver left it.
    pub status: Vec<ContactStatus>,
    /// Contacts that had to be left out because their block of `W` was not positive
    /// definite (neither body can move there and neither surface deforms).
    pub ill_posed: usize,
    /// Time to fill the rigid part and `delta_free`.
    pub rigid_time: Duration,
    /// Time to fill the elastic part, and the diagonal blocks of both.
    pub deform_time: Duration,
    rigid: Vec<RigidRows>,
    elastic: elastic::Scratch,
    /// Elastic rows of the pairs that have touched, in the order of the pairs, kept while their contacts stay the same.
    elastic_rows: Vec<ElasticRows>,
    /// Serial numbers of the elastic rows that `w` holds, patch by patch, and the last one given out.
    held: Vec<u64>,
    serial: u64,
}

impl Clone for ContactProblem {
    /// What may be read of the problem, and the elastic rows; no scratch.
    fn clone(&self) -> Self {
        Self {
            w: self.w.clone(),
            delta_free: self.delta_free.clone(),
            mu: self.mu.clone(),
            unknowns: self.unknowns.clone(),
            reactions: self.reactions.clone(),
            predicted: self.predicted,
            unfinished: self.unfinished,
            status: self.status.clone(),
            ill_posed: self.ill_posed,
            rigid_time: self.rigid_time,
            deform_time: self.deform_time,
            rigid: Vec::new(),
            elastic: elastic::Scratch::default(),
            elastic_rows: self.elastic_rows.clone(),
            held: self.held.clone(),
            serial: self.serial,
        }
    }
}

/// Rigid part of one contact: `J S` of either side with the slot of its body.
#[derive(Debug, Clone, Copy)]
struct RigidRows {
    a: (u32, Mat3x6),
    b: (u32, Mat3x6),
}

impl ContactProblem {
    /// `delta_free` (m) and unknowns (N) of the problem that is left when viscous drag is treated as a load: a plain Coulomb problem
    /// with the same `W` and `mu`, and the same displacements. For export; without drag these are those of the step.
    pub fn coulomb_part(&self) -> (Vec<Vec3>, Vec<Vec3>) {
        let (mut delta_free, mut unknowns) = (self.delta_free.clone(), self.unknowns.clone());
        let dragged = |i: &usize| self.w.diagonal_block(*i).drag() > 0.0;
        for j in (0..self.len()).filter(dragged) {
            let delta = self.w.displacement(j) + self.delta_free[j];
            unknowns[j] = self.w.diagonal_block(j).without_drag(&self.unknowns[j], &delta);
            let drag = self.unknowns[j] - unknowns[j];
            for (i, free) in delta_free.iter_mut().enumerate() {
                *free += self.w.block(i, j) * drag;
            }
        }
        (delta_free, unknowns)
    }

    /// Takes over the solution, for contacts in the order of the problem. `residual`:
    /// what the solver left if it did not get to its tolerance, else 0.
    pub(crate) fn take_solution(&mut self, contacts: &[Contact], residual: Real) {
        self.unfinished = residual;
        self.reactions.clear();
        self.reactions.extend(contacts.iter().zip(&self.unknowns).map(|(contact, f)| Vec3::new(f.x, f.y, f.z * contact.friction_ratio)));
    }

    /// The elastic rows of a pair, if it touched in this step.
    pub(crate) fn elastic_rows(&self, pair: &Pair) -> Option<&ElasticRows> {
        let found = self.elastic_rows.binary_search_by_key(&(pair.a, pair.b), |rows| rows.origin.colliders).ok()?;
        Some(&self.elastic_rows[found])
    }

    /// Slip of contact `i` over the step, m: the tangential displacement of the two
    /// material points against each other. Exactly 0 where it sticks.
    pub fn slip(&self, i: usize, contact: &Contact) -> Real {
        if self.status[i] == ContactStatus::Stick {
            return 0.0;
        }
        let delta = self.w.displacement(i) + self.delta_free[i];
        delta.y.hypot(delta.z / contact.friction_ratio)
    }

    /// Takes out the contacts for which `keep` is false; what is known of the others stays the same bits.
    pub(crate) fn retain(&mut self, keep: impl Fn(usize) -> bool) {
        for list in [&mut self.delta_free, &mut self.unknowns, &mut self.reactions] {
            retain_by_index(list, &keep);
        }
        retain_by_index(&mut self.mu, &keep);
        retain_by_index(&mut self.status, &keep);
        self.w.retain(&keep);
        // The operator holds other rows than those that were filled for it.
        self.held.clear();
    }

    /// Forgets the elastic rows of a collider that is gone: the next one in its slot is another.
    pub(crate) fn forget_collider(&mut self, gone: u32) {
        self.elastic_rows.retain(|rows| rows.origin.colliders.0 != gone && rows.origin.colliders.1 != gone);
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
pub(crate) fn contact_problem(
    out: &mut ContactProblem,
    contacts: &mut Vec<Contact>,
    pairs: &[Pair],
    objects: &Objects,
    free: &[FreeMotion],
    dt: Real,
) {
    out.ill_posed = 0;
    loop {
        fill(out, contacts, pairs, objects, free, dt);
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
                // The operator holds rows of contacts that are gone.
                out.held.clear();
            }
        }
    }
}

fn fill(out: &mut ContactProblem, contacts: &[Contact], pairs: &[Pair], objects: &Objects, free: &[FreeMotion], dt: Real) {
    let hold = refresh_elastic_rows(out, contacts, pairs, objects, dt);
    if hold {
        out.w.clear_rigid(objects.bodies.slot_count());
    } else {
        out.w.clear(objects.bodies.slot_count());
    }
    out.delta_free.clear();
    out.mu.clear();
    out.unknowns.clear();
    out.reactions.clear();
    out.predicted = false;
    out.unfinished = 0.0;
    out.status.clear();
    out.status.resize(contacts.len(), ContactStatus::Open);
    out.rigid_time = Duration::ZERO;
    let mut first = 0;
    for patch in contacts.chunk_by(|c, d| c.pair == d.pair) {
        let start = Instant::now();
        let pair = &pairs[patch[0].pair as usize];
        let [side_a, side_b] = pair.sides(objects);
        if let (Some(skin_a), Some(_)) = (side_a.active_skin(), side_b.active_skin()) {
            out.rigid.clear();
            for contact in patch {
                let [axes, acts_along] = [&contact.frame, &contact.acts_along].map(|frame| friction_axes(frame, contact));
                out.delta_free.push(free_gap::delta_free(contact, [&axes, &acts_along], pair, objects, free, dt));
                out.mu.push(coefficient(contact, pair, [side_a, side_b]));
                let control_point = contact.control_point as usize;
                let predicted = pair.reactions.predict(control_point);
                out.predicted |= predicted != pair.reactions.last[control_point];
                out.unknowns.push(Vec3::new(predicted.x, predicted.y, predicted.z / contact.friction_ratio));
                out.rigid.push(RigidRows {
                    a: rigid_rows(contact, &acts_along, side_a, free, 1.0),
                    b: rigid_rows(contact, &acts_along, side_b, free, -1.0),
                });
            }
            let elastic_axes = side_a.axes().transpose();
            let prepared = Instant::now();
            out.rigid_time += prepared - start;
            // c A v as a force per displacement over the step.
            let drag = pair.friction.viscous_coefficient() / dt;
            let rows = out.elastic_rows.binary_search_by_key(&(pair.a, pair.b), |rows| rows.origin.colliders).ok();
            for (i, (contact, RigidRows { a, b })) in patch.iter().zip(&out.rigid).enumerate() {
                out.w.push_contact(a.0, &a.1, b.0, &b.1, &(elastic_axes * friction_axes(&contact.frame, contact)));
                if drag > 0.0 {
                    out.w.set_drag(drag * contact.area);
                }
                out.w.set_normal(&skin_a.surface.control.normals[contact.control_point as usize]);
                if let Some(rows) = rows.filter(|_| !hold) {
                    out.elastic_rows[rows].push_row(&mut out.w, i, first);
                }
            }
            out.deform_time += prepared.elapsed();
        }
        first += patch.len();
    }
}

/// `mu` of one contact, at the slip speed that it had at the end of the last step.
fn coefficient(contact: &Contact, pair: &Pair, sides: [Side<'_>; 2]) -> Real {
    pair.friction.constant().unwrap_or_else(|| {
        let speed = pair.slip_speed.get(contact.control_point as usize).copied().unwrap_or(0.0);
        let [rotation_a, rotation_b] = sides.map(|side| side.axes());
        pair.friction.coefficient(&contact.frame, speed, [&rotation_a, &rotation_b])
    })
}

/// Brings the elastic rows of every pair in touch up to date. Returns whether the operator of the last step holds these very rows.
fn refresh_elastic_rows(out: &mut ContactProblem, contacts: &[Contact], pairs: &[Pair], objects: &Objects, dt: Real) -> bool {
    let start = Instant::now();
    let kept = &mut out.elastic_rows;
    kept.iter_mut().for_each(|rows| rows.in_touch = false);
    let (mut same, mut patches) = (true, 0);
    for patch in contacts.chunk_by(|c, d| c.pair == d.pair) {
        let pair = &pairs[patch[0].pair as usize];
        let [side_a, side_b] = pair.sides(objects);
        let (Some(skin_a), Some(skin_b)) = (side_a.active_skin(), side_b.active_skin()) else { continue };
        let skins = [skin_a, skin_b];
        let axes_b = side_b.axes();
        let rotation_ab = side_a.axes().transpose() * axes_b;
        let sides = SideOperator::of(skins, dt);
        let shares = sides.map(|side| side.share());
        let origin = Origin { colliders: (pair.a, pair.b), revisions: skins.map(|skin| skin.compliance_revision), rigid_b: pair.rigid_b };
        let place = kept.binary_search_by_key(&origin.colliders, |rows| rows.origin.colliders).unwrap_or_else(|place| {
            kept.insert(place, ElasticRows::of(origin));
            place
        });
        let rows = &mut kept[place];
        rows.in_touch = true;
        if !rows.hold_for(&origin, patch, &rotation_ab, shares) {
            out.serial += 1;
            let keeps_a = rows.start(origin, patch, &rotation_ab, shares, out.serial);
            out.elastic.fill_rows(rows, keeps_a, patch, &sides, &rotation_ab, &axes_b.transpose());
        }
        let serial = rows.serial();
        if let Some(held) = out.held.get_mut(patches) {
            same &= std::mem::replace(held, serial) == serial;
        } else {
            out.held.push(serial);
            same = false;
        }
        patches += 1;
    }
    same &= out.held.len() == patches && patches > 0;
    out.held.truncate(patches);
    // Rows of a pair that has lost touch are not those of the contacts that it may
    // find later; their memory is kept for as long as the pair is.
    kept.retain_mut(|rows| {
        if !rows.in_touch {
            rows.forget();
        }
        rows.in_touch || pairs.binary_search_by_key(&rows.origin.colliders, |pair| (pair.a, pair.b)).is_ok()
    });
    out.deform_time = start.elapsed();
    same
}

/// Keeps the elements whose index `keep` accepts.
pub(crate) fn retain_by_index<T>(list: &mut Vec<T>, keep: impl Fn(usize) -> bool) {
    let mut index = 0;
    list.retain(|_| {
        index += 1;
        keep(index - 1)
    });
}

/// `frame D` of a frame of a contact, `D = diag(1, 1, mu_2/mu_1)`: the axes in which friction is a circle of `mu_1`, whatever its directions. With
/// unknowns `D^-1 f` and displacements `D delta` the work of a force is what it was, and the solver knows one coefficient
/// for each contact: see `docs/friction.md`. The contact frame itself where friction is isotropic.
fn friction_axes(frame: &Mat3, contact: &Contact) -> Mat3 {
    let mut axes = *frame;
    axes.column_mut(2).scale_mut(contact.friction_ratio);
    axes
}

/// `J S` of one body where a contact acts, in its friction axes there: its part of `W_rigid` is `(J S)(J S)^T`
/// as `A^-1 = S S^T`. The sign makes relative displacement a - b.
fn rigid_rows(contact: &Contact, axes: &Mat3, side: Side<'_>, free: &[FreeMotion], sign: Real) -> (u32, Mat3x6) {
    let body = side.collider.body;
    let free = &free[body as usize];
    if free.dof == 0 {
        return (NO_BODY, Mat3x6::zeros());
    }
    let jacobian = side.point_jacobian(&contact.acts_at);
    (body, axes.transpose() * jacobian * free.inverse_root * sign)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::body::{Amount, MassProperties, Motion, RigidBody};
    use crate::collider::{ComplianceModel, Material};
    use crate::math::Pose;
    use crate::surface::{ComplianceMatrix, Surface, shapes};
    use crate::{Parameters, World};
    use std::sync::Arc;

    #[test]
    fn contacts_where_nothing_moves_and_nothing_deforms_are_left_out_all_at_once() {
        let size = Vec3::repeat(0.02);
        let cube = Surface::build(shapes::sample_box(size, 1_200).unwrap(), Some(150)).unwrap();
        // Every other control point deforms, the rest do not.
        let deforms = |i: usize| i.is_multiple_of(2);
        let n = 3 * cube.control.len();
        let matrix = nalgebra::DMatrix::from_fn(n, n, |i, j| if i == j && deforms(i / 3) { 1e-4 } else { 0.0 });
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
        let World { workspace: ws, pairs, objects, params, .. } = &mut world;
        let (contacts, filled) = (&mut ws.collision.contacts, ws.problem.serial);
        contact_problem(&mut ws.problem, contacts, pairs, objects, &held, params.dt);
        let left: Vec<u32> = contacts.iter().map(|contact| contact.control_point).collect();
        assert_eq!(left, all.iter().copied().filter(|&c| deforms(c as usize)).collect::<Vec<_>>());
        assert_eq!((ws.problem.ill_posed, ws.problem.len()), (all.len() - left.len(), left.len()));
        assert!(ws.problem.serial - filled <= 2, "elastic rows were filled {} times", ws.problem.serial - filled);
    }
}

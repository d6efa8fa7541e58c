//! Elastic displacement after the solve: `u = alpha u_previous + C f` at the control points, then at every surface point they reach.

use crate::collider::Collider;
use crate::contact_problem::{ContactProblem, ElasticRows, Node, SideOperator};
use crate::math::{Mat3, Real, Rot, Vec3};
use crate::objects::Objects;
use crate::pair::{Contact, Pair, PatchSide, Unloaded, patches};
use crate::params::Parameters;
use crate::slots::Slots;
use crate::surface::{Compliance, LocalCompliance};

/// Displacements below this are set to zero, m: far below rounding of any position, so nothing is lost but work.
const FORGOTTEN: Real = 1e-20;

/// Forces that differ by less than this share of the largest are the same to unloaded
/// control points: with a millimetre of displacement it is 1e-12 m off.
const SAME_FORCE: Real = 1e-9;

/// Scratch: forces on the control points of one side.
#[derive(Debug, Default)]
pub(super) struct Scratch {
    loaded: Vec<u32>,
    force: Vec<Vec3>,
    /// Area that each loaded control point stands for, m^2.
    area: Vec<Real>,
    is_loaded: Vec<bool>,
    /// Force on each contact of a patch, axes of the link of `a`.
    pushes: Vec<Vec3>,
    /// Control points whose displacement is found exactly, by the operator that the solver saw.
    held: Vec<u32>,
    is_held: Vec<bool>,
    /// New displacement at every foot.
    feet: Vec<Vec3>,
}

/// Updates the elastic displacement of every pair from the solved reactions. Poses must
/// still be those of the start of the step: reactions and frames are.
pub(super) fn remember(
    scratch: &mut Scratch,
    pairs: &mut [Pair],
    objects: &Objects,
    contacts: &[Contact],
    problem: &ContactProblem,
    params: &Parameters,
) {
    let reactions = &problem.reactions;
    let count = pairs.len();
    for (pair, patch) in pairs.iter_mut().zip(patches(contacts, count)) {
        if patch.is_empty() && pair.is_idle() {
            continue;
        }
        let (patch, forces) = (&contacts[patch.clone()], &reactions[patch]);
        let sides = pair.sides(objects);
        let to_links = sides.map(|side| side.pose().rotation.inverse());
        let [a, b] = SideOperator::of(sides.map(|side| &side.collider.skin), params.dt);
        scratch.load(&a, patch, forces, &to_links[0]);
        displace_a(pair, problem.elastic_rows(pair), &a, scratch, patch);
        if !pair.rigid_b {
            scratch.load(&b, patch, forces, &to_links[1]);
            displace_b(pair, problem.elastic_rows(pair), &b, scratch, patch, forces, &to_links[1]);
        }
    }
}

/// Side `a`: `H` is the identity, so that rows of tensors are the compliance between the loaded control points.
fn displace_a(pair: &mut Pair, rows: Option<&ElasticRows>, a: &SideOperator<'_>, scratch: &mut Scratch, patch: &[Contact]) {
    if let Compliance::Local(local) = &a.skin.compliance {
        displace_local(&mut pair.side_a, a, local, scratch);
        return;
    }
    decay(&mut pair.side_a, a.alpha);
    scratch.pushes.clear();
    scratch.pushes.extend(patch.iter().map(|contact| contact.control_point as usize).map(|c| scratch.force[c]));
    for (i, contact) in patch.iter().enumerate() {
        let Some(row) = rows.and_then(|rows| rows.tensor_row(0, i)) else { continue };
        let moved = product(row, &scratch.pushes);
        let c = contact.control_point as usize;
        pair.side_a.touch(c);
        pair.side_a.displacement[c] += moved;
    }
    scratch.hold(a, patch);
    displace_unloaded(&mut pair.side_a, a, scratch);
}

/// Side `b`. `to_link_b`: rotation from the world to its link.
fn displace_b(
    pair: &mut Pair,
    rows: Option<&ElasticRows>,
    b: &SideOperator<'_>,
    scratch: &mut Scratch,
    patch: &[Contact],
    forces: &[Vec3],
    to_link_b: &Rot,
) {
    if let Compliance::GreensFunction(_) = &b.skin.compliance {
        displace_feet(pair, rows, b, scratch, patch, forces, to_link_b);
        return;
    }
    // Left from when it was a half-space or a layer.
    decay(&mut pair.fine_b, b.alpha);
    forget_small(&mut pair.fine_b);
    match &b.skin.compliance {
        Compliance::Local(local) => displace_local(&mut pair.side_b, b, local, scratch),
        Compliance::GreensFunction(_) => {}
        Compliance::Matrix(matrix) => {
            decay(&mut pair.side_b, b.alpha);
            // The control points under the contacts make up the operator: they are exact.
            scratch.hold(b, patch);
            for &k in &scratch.held {
                pair.side_b.touch(k as usize);
                pair.side_b.displacement[k as usize] += matrix.displacement(k as usize, &scratch.loaded, &scratch.force) * b.share();
            }
            displace_unloaded(&mut pair.side_b, b, scratch);
        }
    }
}

/// An elastic continuum on side `b`: `u <- alpha u + C f` at the feet of the contacts by the rows that the solver
/// saw; and at the control points of `b`, which show the deformation and keep it where feet move.
fn displace_feet(
    pair: &mut Pair,
    rows: Option<&ElasticRows>,
    b: &SideOperator<'_>,
    scratch: &mut Scratch,
    patch: &[Contact],
    forces: &[Vec3],
    to_link_b: &Rot,
) {
    let rotation_ab = rows.map_or_else(Mat3::identity, |rows| *rows.rotation_ab());
    let to_link_b = to_link_b.to_rotation_matrix().into_inner();
    scratch.pushes.clear();
    scratch.pushes.extend(patch.iter().zip(forces).map(|(contact, f)| rotation_ab * (to_link_b * b.force(contact, f))));
    scratch.feet.clear();
    for (i, contact) in patch.iter().enumerate() {
        let before = pair.displacement_of_b(contact.control_point as usize, &contact.weights_b);
        let row = rows.and_then(|rows| rows.tensor_row(1, i));
        let moved = row.map_or_else(Vec3::zeros, |row| rotation_ab.tr_mul(&product(row, &scratch.pushes)));
        scratch.feet.push(before * b.alpha + moved);
    }
    decay(&mut pair.side_b, b.alpha);
    scratch.hold(b, &[]);
    displace_unloaded(&mut pair.side_b, b, scratch);
    pair.fine_b.clear();
    for (contact, u) in patch.iter().zip(&scratch.feet) {
        let c = contact.control_point as usize;
        let beyond = u - pair.displacement_of_b(c, &contact.weights_b);
        if beyond != Vec3::zeros() {
            pair.fine_b.touch(c);
            pair.fine_b.displacement[c] = beyond;
        }
    }
}

/// A row of tensors times the forces (N) of the contacts, m.
fn product(row: &[Mat3], forces: &[Vec3]) -> Vec3 {
    // Two independent sums: one alone would wait for its own last addition.
    let mut sums = [Vec3::zeros(); 2];
    for (k, (block, force)) in row.iter().zip(forces).enumerate() {
        sums[k % 2] += block.column(0) * force.x + block.column(1) * force.y + block.column(2) * force.z;
    }
    sums[0] + sums[1]
}

impl Scratch {
    /// Marks the nodes of the contacts of a patch: their displacement is found exactly.
    fn hold(&mut self, side: &SideOperator<'_>, patch: &[Contact]) {
        for &c in &self.held {
            self.is_held[c as usize] = false;
        }
        self.held.clear();
        let control_points = side.skin.surface.control.len();
        if self.is_held.len() < control_points {
            self.is_held.resize(control_points, false);
        }
        for c in patch.iter().flat_map(|contact| side.nodes(contact)).map(|node| node.control_point) {
            if !self.is_held[c] {
                self.is_held[c] = true;
                self.held.push(c as u32);
            }
        }
    }

    /// `H^T f`: sums the forces on each node, axes of the link.
    fn load(&mut self, side: &SideOperator<'_>, patch: &[Contact], reactions: &[Vec3], to_link: &Rot) {
        for &c in &self.loaded {
            (self.force[c as usize], self.is_loaded[c as usize]) = (Vec3::zeros(), false);
        }
        self.loaded.clear();
        let control_points = side.skin.surface.control.len();
        if self.force.len() < control_points {
            self.force.resize(control_points, Vec3::zeros());
            self.area.resize(control_points, 0.0);
            self.is_loaded.resize(control_points, false);
        }
        for (contact, reaction) in patch.iter().zip(reactions) {
            let force = to_link * side.force(contact, reaction);
            if force == Vec3::zeros() {
                continue;
            }
            for Node { control_point: c, weight, area } in side.nodes(contact) {
                if !self.is_loaded[c] {
                    self.is_loaded[c] = true;
                    self.loaded.push(c as u32);
                    self.area[c] = area;
                }
                self.force[c] += force * weight;
            }
        }
    }
}

/// `u <- alpha u`.
fn decay(side: &mut PatchSide, alpha: Real) {
    for &c in &side.active {
        side.displacement[c as usize] *= alpha;
    }
}

/// `u <- alpha u + C f` at every control point that a loaded one reaches.
fn displace_local(side: &mut PatchSide, operator: &SideOperator<'_>, local: &LocalCompliance, scratch: &Scratch) {
    decay(side, operator.alpha);
    let normals = &operator.skin.surface.control.normals;
    for &j in &scratch.loaded {
        let j = j as usize;
        let force = scratch.force[j] * operator.share();
        if local.is_isotropic() {
            operator.local_row(local, j, scratch.area[j], |i, value| {
                side.touch(i);
                side.displacement[i] += force * value.normal;
            });
            continue;
        }
        let along = normals[j].dot(&force);
        let across = force - normals[j] * along;
        operator.local_row(local, j, scratch.area[j], |i, value| {
            side.touch(i);
            let moved = across * value.tangential;
            side.displacement[i] += moved + normals[i] * (along * value.normal - normals[i].dot(&moved));
        });
    }
    forget_small(side);
}

/// Adds `C f` to the displacement of the control points that are not held by the
/// scratch: those that loaded ones reach, and whatever is displaced.
fn displace_unloaded(side: &mut PatchSide, operator: &SideOperator<'_>, scratch: &Scratch) {
    let SideOperator { skin, .. } = operator;
    if side.unloaded.renew(scratch) {
        for &j in &scratch.loaded {
            match &skin.compliance {
                Compliance::Matrix(matrix) => {
                    (0..matrix.control_points()).filter(|&i| matrix.reaches(i, j as usize)).for_each(|i| side.touch(i));
                }
                // A half-space reaches everywhere, a layer far; displaced are the loaded control points and their
                // neighbours, and whatever was.
                _ => std::iter::once(&j).chain(skin.surface.leaf_neighbours.row(j as usize)).for_each(|&i| side.touch(i as usize)),
            }
        }
    }
    for &i in side.active.iter().filter(|&&i| !scratch.is_held[i as usize]) {
        let (i, unloaded) = (i as usize, &mut side.unloaded);
        if unloaded.found_at[i] != unloaded.revision {
            unloaded.found_at[i] = unloaded.revision;
            unloaded.static_displacement[i] = match &skin.compliance {
                Compliance::Local(_) => Vec3::zeros(),
                Compliance::GreensFunction(greens_function) => {
                    let moved = |&j: &u32| greens_function.block(&skin.surface.control, i, j as usize) * scratch.force[j as usize];
                    scratch.loaded.iter().map(moved).sum()
                }
                Compliance::Matrix(matrix) => matrix.displacement(i, &scratch.loaded, &scratch.force),
            };
        }
        side.displacement[i] += unloaded.static_displacement[i] * operator.share();
    }
    forget_small(side);
}

fn forget_small(side: &mut PatchSide) {
    let (displacement, is_active) = (&mut side.displacement, &mut side.is_active);
    side.active.retain(|&c| {
        let keep = displacement[c as usize].norm_squared() > FORGOTTEN * FORGOTTEN;
        if !keep {
            displacement[c as usize] = Vec3::zeros();
            is_active[c as usize] = false;
        }
        keep
    });
}

impl Unloaded {
    /// Takes note of the forces. Returns whether they have changed by more than the last digits.
    fn renew(&mut self, scratch: &Scratch) -> bool {
        let now = || scratch.loaded.iter().map(|&c| (c, scratch.force[c as usize]));
        let largest = now().map(|(_, f)| f.amax()).fold(0.0, Real::max);
        let close = |((c, f), (d, g)): ((u32, Vec3), &(u32, Vec3))| c == *d && (f - g).amax() <= SAME_FORCE * largest;
        if self.forces.len() == scratch.loaded.len() && now().zip(&self.forces).all(close) {
            return false;
        }
        self.forces.clear();
        self.forces.extend(now());
        self.revision += 1;
        true
    }
}

/// Sums the patches of every collider.
pub(super) fn deform_skins(colliders: &mut Slots<Collider>, pairs: &[Pair], params: &Parameters) {
    for (_, collider) in colliders.iter_mut() {
        collider.skin.clear_displacement();
    }
    for pair in pairs {
        for (collider, side) in [(pair.a, &pair.side_a), (pair.b, &pair.side_b)] {
            let skin = &mut colliders[collider].skin;
            for &c in &side.active {
                skin.add_displacement(c, &side.displacement[c as usize]);
            }
        }
    }
    for (_, collider) in colliders.iter_mut() {
        collider.skin.deform(params.deformation_threshold);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::body::{Amount, MassProperties, Motion, RigidBody};
    use crate::collider::{ComplianceModel, Material};
    use crate::contact_problem::contact_problem;
    use crate::delassus::Delassus;
    use crate::free_motion::FreeMotion;
    use crate::math::Pose;
    use crate::surface::{ComplianceMatrix, GreensFunction, Surface, shapes};
    use crate::{Parameters, World};
    use std::sync::Arc;

    /// A free ball pressed a third of a millimetre into a fixed plate, both rotated arbitrarily, after some steps.
    fn ball_on_plate(surfaces: &[Arc<Surface>; 2], materials: [Material; 2]) -> World {
        let [ball, plate] = surfaces;
        let [of_ball, of_plate] = materials;
        let mut world = World::new(Parameters::default()).unwrap();
        let place = Pose::new(Vec3::new(0.1, 0.2, 0.3), Vec3::new(0.4, -0.7, 1.1));
        world.add_body(RigidBody::fixed("plate", place).unwrap(), Some((plate.clone(), of_plate))).unwrap();
        let mass = MassProperties::sphere(0.01, Amount::Mass(0.1)).unwrap();
        let above = place * Pose::new(Vec3::new(0.0, 0.0, 0.01 - 0.35e-3), Vec3::new(-1.3, 0.2, 0.6));
        world.add_body(RigidBody::free("ball", mass, Motion::Inertial, above).unwrap(), Some((ball.clone(), of_ball))).unwrap();
        (0..3).for_each(|_| drop(world.step()));
        world
    }

    /// Elastic displacement of both sides at a contact, world axes, m.
    fn displacements(world: &World, contact: &Contact) -> [Vec3; 2] {
        let pair = &world.pairs[contact.pair as usize];
        let [rotation_a, rotation_b] = pair.sides(&world.objects).map(|side| side.pose().rotation);
        let c = contact.control_point as usize;
        [rotation_a * pair.side_a.displacement[c], rotation_b * pair.displacement_of_b(c, &contact.weights_b)]
    }

    /// Largest `|H (u_after - alpha u_before) - W_deform f|` over the contacts for arbitrary reactions, over the largest displacement.
    fn disagreement(world: &mut World) -> Real {
        // Nothing moves as a whole: W is W_deform.
        let held = vec![FreeMotion::none(); world.objects.bodies.slot_count()];
        let dt = world.params.dt;
        let World { workspace: ws, pairs, objects, params, .. } = world;
        let count = ws.collision.contacts.len();
        contact_problem(&mut ws.problem, &mut ws.collision.contacts, pairs, objects, &held, dt);
        assert!(ws.problem.len() == count && count >= 8, "{} of {count} contacts are left", ws.problem.len());
        for (i, f) in ws.problem.unknowns.iter_mut().enumerate() {
            *f = Vec3::from_fn(|k, _| 0.1 * (2.3 * i as Real + 1.7 * k as Real).sin());
        }
        ws.problem.take_solution(&ws.collision.contacts, 0.0);
        ws.problem.w.set_reactions(&ws.problem.unknowns);
        let (contacts, params) = (ws.collision.contacts.clone(), params.clone());
        let alpha = world.pairs[0].sides(&world.objects).map(|side| side.collider.skin.memory(dt));
        let before: Vec<[Vec3; 2]> = contacts.iter().map(|contact| displacements(world, contact)).collect();
        let World { workspace: ws, pairs, objects, .. } = &mut *world;
        remember(&mut Scratch::default(), pairs, objects, &contacts, &ws.problem, &params);
        let (mut worst, mut largest): (Real, Real) = (0.0, 0.0);
        for (i, (contact, before)) in contacts.iter().zip(&before).enumerate() {
            let after = displacements(world, contact);
            let [by_a, by_b] = [0, 1].map(|side| after[side] - before[side] * alpha[side]);
            let mut delta = contact.frame.transpose() * (by_a - by_b);
            delta.z *= contact.friction_ratio;
            worst = worst.max((delta - world.workspace.problem.w.displacement(i)).amax());
            largest = largest.max(after.iter().chain(before).map(|u| u.amax()).fold(0.0, Real::max));
        }
        worst / largest
    }

    #[test]
    fn displacement_at_contacts_is_what_the_solver_saw_whatever_the_compliances() {
        let surface = |points, count| Arc::new(Surface::build(points, Some(count)).unwrap());
        let ball = surface(shapes::sample_sphere(0.01, 4_000).unwrap(), 600);
        let plate = surface(shapes::sample_half_space(0.02, 1_600).unwrap(), 150);
        let surfaces = [ball, plate];
        let pulp = Material::preset("fingertip_pulp").unwrap();
        let models = |surface: &Surface| {
            let dense = Compliance::GreensFunction(GreensFunction::half_space(2e5, 0.3)).assembled(&surface.control);
            let matrix = ComplianceModel::Matrix(Arc::new(ComplianceMatrix::new(&dense).unwrap()));
            [pulp.model.clone(), ComplianceModel::HalfSpace, matrix].map(|model| pulp.clone().with_model(model).unwrap())
        };
        let [of_ball, of_plate] = [0, 1].map(|k| models(&surfaces[k]));
        let steel = Material::preset("steel").unwrap();
        for a in &of_ball {
            for b in of_plate.iter().chain([&steel]) {
                let mut world = ball_on_plate(&surfaces, [a.clone(), b.clone()]);
                let name = |material: &Material| if *material == steel { "rigid".to_string() } else { format!("{:?}", material.model) };
                let names = format!("{} on {}", name(a), name(b));
                assert_eq!(world.pairs[0].rigid_b, *b == steel, "{names}");
                let plain = disagreement(&mut world);
                // Every other contact stands for three control points, and friction has a direction.
                for contact in &mut world.workspace.collision.contacts {
                    contact.friction_ratio = 0.6;
                    contact.area *= if contact.control_point.is_multiple_of(2) { 3.0 } else { 1.0 };
                }
                let with_areas = disagreement(&mut world);
                println!("{names}: {plain:.1e}, with areas of nodes and directed friction {with_areas:.1e}");
                assert!(
                    plain.max(with_areas) < 4e-15,
                    "{names}: {plain:e} of the displacement, areas of nodes and directed friction: {with_areas:e}"
                );
            }
        }
    }
}

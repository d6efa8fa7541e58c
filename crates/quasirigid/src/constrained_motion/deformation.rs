//! Elastic displacement after the solve: `u = alpha u_previous + C f` at the control points, then at every surface point they reach.

use crate::body::{BodyEntry, Skin};
use crate::collision::{Afar, Contact, Pair, PatchSide};
use crate::contact_problem::ContactProblem;
use crate::math::{Mat3, Real, Vec3};
use crate::params::Parameters;
use crate::surface::{Compliance, LocalCompliance};

/// Displacements below this are set to zero, m: far below rounding of any position, so nothing is lost but work.
const FORGOTTEN: Real = 1e-20;

/// Forces that differ by less than this share of the largest are the same to what follows from afar: with a millimetre of displacement it is 1e-12 m off.
const SAME_FORCE: Real = 1e-9;

/// A patch whose reactions changed by less than this share in a step is taken to be at rest.
const LEAST_TREND: Real = 1e-6;

/// Reactions have to change by this many times what the solver left unfinished, or they are not foretold.
const SURE: Real = 10.0;

/// Scratch: forces on the control points of one side.
#[derive(Debug, Default)]
pub(super) struct Scratch {
    /// Control points that were loaded before.
    before: Vec<u32>,
    loaded: Vec<u32>,
    force: Vec<Vec3>,
    is_loaded: Vec<bool>,
    /// Force on each contact of a patch, axes of the link of `a`.
    pushes: Vec<Vec3>,
    /// Control points whose displacement is found exactly, by the operator that the solver saw.
    held: Vec<u32>,
    is_held: Vec<bool>,
    /// New displacement at every foot.
    feet: Vec<Vec3>,
}

/// Updates the memory of every pair from the solved reactions. Poses must still be those of the start of the step: reactions and frames are.
pub(super) fn remember(
    scratch: &mut Scratch,
    pairs: &mut [Pair],
    bodies: &[BodyEntry],
    contacts: &[Contact],
    problem: &ContactProblem,
    params: &Parameters,
) {
    let reactions = &problem.reactions;
    // What a solver that was cut short is still wrong by is no motion: carried on from step to step it would grow.
    let least_trend = LEAST_TREND.max(SURE * problem.unfinished);
    let mut first = 0;
    for (index, pair) in pairs.iter_mut().enumerate() {
        let count = contacts[first..].iter().take_while(|c| c.pair as usize == index).count();
        let (patch, forces) = (&contacts[first..first + count], &reactions[first..first + count]);
        first += count;
        if count == 0 && pair.is_idle() {
            continue;
        }
        // Meanwhile the trend holds the last reactions.
        for &c in &pair.loaded {
            pair.trend[c as usize] = std::mem::take(&mut pair.reaction[c as usize]);
        }
        std::mem::swap(&mut scratch.before, &mut pair.loaded);
        pair.loaded.clear();
        let (mut force, mut change) = (0.0, 0.0);
        for (contact, f) in patch.iter().zip(forces) {
            let c = contact.control_point as usize;
            let before = std::mem::take(&mut pair.trend[c]);
            if *f != Vec3::zeros() {
                pair.reaction[c] = *f;
                pair.loaded.push(contact.control_point);
                if before != Vec3::zeros() {
                    // Along a parabola through the last three, where there are three: smooth motion then starts the solver fifty times nearer than along a line.
                    let last = std::mem::replace(&mut pair.change[c], f - before);
                    pair.trend[c] = if last == Vec3::zeros() { pair.change[c] } else { pair.change[c] * 2.0 - last };
                    force += f.norm_squared();
                    change += pair.change[c].norm_squared();
                    continue;
                }
            }
            pair.change[c] = Vec3::zeros();
        }
        for c in scratch.before.drain(..).filter(|&c| pair.reaction[c as usize] == Vec3::zeros()) {
            (pair.trend[c as usize], pair.change[c as usize]) = (Vec3::zeros(), Vec3::zeros());
        }
        // What is left at rest is the solver's last digits: to carry them on would only make work.
        if change < least_trend * least_trend * force {
            for &c in &pair.loaded {
                (pair.trend[c as usize], pair.change[c as usize]) = (Vec3::zeros(), Vec3::zeros());
            }
        }
        let (entry_a, entry_b) = (&bodies[pair.a as usize], &bodies[pair.b as usize]);
        if let Some(skin) = &entry_a.skin {
            let to_link = entry_a.body.link_pose(entry_a.skin_link).rotation.inverse();
            scratch.load(
                skin.surface.control.len(),
                patch.iter().zip(forces).map(|(c, f)| (c.control_point as usize, to_link * (c.frame * f))),
            );
            match &skin.compliance {
                Compliance::Local(local) => {
                    displace_local(&mut pair.side_a, local, skin.memory(params.dt), scratch);
                    // A coarse contact gives with the area of its node: the change of its own diagonal.
                    let control = &skin.surface.control;
                    for contact in patch.iter().filter(|c| c.area != control.areas[c.control_point as usize]) {
                        let c = contact.control_point as usize;
                        let change = local.change_for_area(control, c, contact.area) * (1.0 - skin.memory(params.dt));
                        pair.side_a.displacement[c] += scratch.force[c] * change;
                    }
                }
                _ => displace_contacts(pair, skin, scratch, patch, params.dt),
            }
        }
        if let Some(skin) = &entry_b.skin {
            let to_link = entry_b.body.link_pose(entry_b.skin_link).rotation.inverse();
            let pushes = patch.iter().zip(forces).flat_map(|(c, f)| {
                let force = -(to_link * (c.frame * f));
                c.weights_b.iter().map(move |(k, weight)| (k, force * weight))
            });
            scratch.load(skin.surface.control.len(), pushes);
            if pair.rigid_b {
                continue;
            }
            let alpha = skin.memory(params.dt);
            if !matches!(skin.compliance, Compliance::HalfSpace(_)) {
                // Left from when it was one.
                decay(&mut pair.beyond, alpha);
                forget_small(&mut pair.beyond);
            }
            match &skin.compliance {
                Compliance::Local(local) => displace_local(&mut pair.side_b, local, alpha, scratch),
                Compliance::HalfSpace(_) => {
                    displace_feet(scratch, pair, skin, patch, forces, &to_link.to_rotation_matrix().into_inner(), alpha)
                }
                Compliance::Matrix(matrix) => {
                    decay(&mut pair.side_b, alpha);
                    // The control points under the contacts make up the operator: they are exact.
                    scratch.hold(skin.surface.control.len(), patch.iter().flat_map(|contact| contact.weights_b.iter().map(|(k, _)| k)));
                    for &k in &scratch.held {
                        pair.side_b.touch(k as usize);
                        pair.side_b.displacement[k as usize] +=
                            matrix.displacement(k as usize, &scratch.loaded, &scratch.force) * (1.0 - alpha);
                    }
                    follow(&mut pair.side_b, skin, scratch, alpha);
                }
            }
        }
    }
}

/// Side `a` where it is no local model: `u <- alpha u + C f` at every contact by the rows that the solver saw, and at what follows from afar.
fn displace_contacts(pair: &mut Pair, skin: &Skin, scratch: &mut Scratch, patch: &[Contact], dt: Real) {
    let alpha = skin.memory(dt);
    decay(&mut pair.side_a, alpha);
    scratch.pushes.clear();
    scratch.pushes.extend(patch.iter().map(|contact| contact.control_point as usize).map(|c| scratch.force[c]));
    for (i, contact) in patch.iter().enumerate() {
        let Some(row) = pair.elastic.tensor_row(0, i) else { continue };
        let moved = product(row, &scratch.pushes);
        let c = contact.control_point as usize;
        pair.side_a.touch(c);
        pair.side_a.displacement[c] += moved;
    }
    scratch.hold(skin.surface.control.len(), patch.iter().map(|contact| contact.control_point as usize));
    follow(&mut pair.side_a, skin, scratch, alpha);
}

/// A half-space on side `b`: `u <- alpha u + C f` at the feet of the contacts by the rows that the solver saw; and at the control points of `b`,
/// which show the deformation and carry it along where feet move.
fn displace_feet(scratch: &mut Scratch, pair: &mut Pair, skin_b: &Skin, patch: &[Contact], forces: &[Vec3], to_link_b: &Mat3, alpha: Real) {
    let turn = *pair.elastic.turn();
    scratch.pushes.clear();
    scratch.pushes.extend(patch.iter().zip(forces).map(|(contact, f)| -(turn * (to_link_b * (contact.frame * f)))));
    scratch.feet.clear();
    for (i, contact) in patch.iter().enumerate() {
        let before = pair.displacement_of_b(contact.control_point as usize, &contact.weights_b);
        let moved = pair.elastic.tensor_row(1, i).map_or_else(Vec3::zeros, |row| turn.tr_mul(&product(row, &scratch.pushes)));
        scratch.feet.push(before * alpha + moved);
    }
    decay(&mut pair.side_b, alpha);
    scratch.hold(skin_b.surface.control.len(), std::iter::empty());
    follow(&mut pair.side_b, skin_b, scratch, alpha);
    pair.beyond.clear();
    for (contact, u) in patch.iter().zip(&scratch.feet) {
        let c = contact.control_point as usize;
        let beyond = u - pair.displacement_of_b(c, &contact.weights_b);
        if beyond != Vec3::zeros() {
            pair.beyond.touch(c);
            pair.beyond.displacement[c] = beyond;
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
    /// Notes which control points are not to be followed from afar.
    fn hold(&mut self, control_points: usize, held: impl Iterator<Item = usize>) {
        for &c in &self.held {
            self.is_held[c as usize] = false;
        }
        self.held.clear();
        if self.is_held.len() < control_points {
            self.is_held.resize(control_points, false);
        }
        for c in held {
            if !self.is_held[c] {
                self.is_held[c] = true;
                self.held.push(c as u32);
            }
        }
    }

    /// Sums the forces on each control point.
    fn load(&mut self, control_points: usize, pushes: impl Iterator<Item = (usize, Vec3)>) {
        for &c in &self.loaded {
            (self.force[c as usize], self.is_loaded[c as usize]) = (Vec3::zeros(), false);
        }
        self.loaded.clear();
        if self.force.len() < control_points {
            self.force.resize(control_points, Vec3::zeros());
            self.is_loaded.resize(control_points, false);
        }
        for (c, f) in pushes {
            if f == Vec3::zeros() {
                continue;
            }
            if !self.is_loaded[c] {
                self.is_loaded[c] = true;
                self.loaded.push(c as u32);
            }
            self.force[c] += f;
        }
    }
}

/// `u <- alpha u`.
fn decay(side: &mut PatchSide, alpha: Real) {
    for &c in &side.active {
        side.displacement[c as usize] *= alpha;
    }
}

/// `u <- alpha u + (1 - alpha) K^-1 f` at every control point that a loaded one reaches.
fn displace_local(side: &mut PatchSide, local: &LocalCompliance, alpha: Real, scratch: &Scratch) {
    decay(side, alpha);
    for &j in &scratch.loaded {
        let force = scratch.force[j as usize] * (1.0 - alpha);
        // G is symmetric: the row of j lists whom j reaches.
        for e in local.neighbours.range(j as usize) {
            let i = local.neighbours.index[e] as usize;
            side.touch(i);
            side.displacement[i] += force * local.values[e];
        }
    }
    forget_small(side);
}

/// Adds `(1 - alpha) K^-1 f` to the displacement of the control points that are not held by the scratch: those that loaded ones reach, and whatever is displaced.
fn follow(side: &mut PatchSide, skin: &Skin, scratch: &Scratch, alpha: Real) {
    if side.afar.renew(scratch) {
        for &j in &scratch.loaded {
            match &skin.compliance {
                Compliance::Matrix(matrix) => {
                    (0..matrix.control_points()).filter(|&i| matrix.reaches(i, j as usize)).for_each(|i| side.touch(i));
                }
                // A half-space reaches everywhere; followed are the loaded control points and their neighbours, and whatever was.
                _ => std::iter::once(&j).chain(skin.surface.leaf_neighbours.row(j as usize)).for_each(|&i| side.touch(i as usize)),
            }
        }
    }
    for &i in side.active.iter().filter(|&&i| !scratch.is_held[i as usize]) {
        let (i, afar) = (i as usize, &mut side.afar);
        if afar.found[i] != afar.count {
            afar.found[i] = afar.count;
            afar.settled[i] = match &skin.compliance {
                Compliance::Local(_) => Vec3::zeros(),
                Compliance::HalfSpace(half_space) => {
                    let moved = |&j: &u32| half_space.block(&skin.surface.control, i, j as usize) * scratch.force[j as usize];
                    scratch.loaded.iter().map(moved).sum()
                }
                Compliance::Matrix(matrix) => matrix.displacement(i, &scratch.loaded, &scratch.force),
            };
        }
        side.displacement[i] += afar.settled[i] * (1.0 - alpha);
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

impl Afar {
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
        self.count += 1;
        true
    }
}

/// Sums the patches of every skin.
pub(super) fn deform_skins(bodies: &mut [BodyEntry], pairs: &[Pair], params: &Parameters) {
    for entry in bodies.iter_mut() {
        if let Some(skin) = &mut entry.skin {
            skin.clear_displacement();
        }
    }
    for pair in pairs {
        for (body, side) in [(pair.a, &pair.side_a), (pair.b, &pair.side_b)] {
            if let Some(skin) = &mut bodies[body as usize].skin {
                for &c in &side.active {
                    skin.add_displacement(c, &side.displacement[c as usize]);
                }
            }
        }
    }
    for entry in bodies.iter_mut() {
        if let Some(skin) = &mut entry.skin {
            skin.deform(params);
        }
    }
}

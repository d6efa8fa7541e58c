//! Elastic displacement after the solve: `u = alpha u_previous + C f` at the control points, then at every surface point they reach.

use crate::body::{BodyEntry, Skin};
use crate::collision::{Contact, Pair, PatchSide};
use crate::math::{Mat3, Real, Vec3};
use crate::params::Parameters;
use crate::surface::{Compliance, HalfSpaceCompliance, Loaded};

/// Displacements below this are set to zero, m: far below rounding of any position, so nothing is lost but work.
const FORGOTTEN: Real = 1e-20;

/// A patch whose reactions changed by less than this share in a step is taken to be at rest.
const LEAST_TREND: Real = 1e-6;

/// Scratch: forces on the control points of one side.
#[derive(Debug, Default)]
pub(super) struct Scratch {
    /// Control points that were loaded before.
    before: Vec<u32>,
    loaded: Vec<u32>,
    force: Vec<Vec3>,
    is_loaded: Vec<bool>,
    /// Loaded feet on a half-space `b`: place in the patch, foot, force on it, frame of the link of `b`.
    pushes: Vec<(usize, Loaded, Vec3)>,
    /// New displacement at every foot.
    feet: Vec<Vec3>,
}

/// Updates the memory of every pair from the solved reactions. Poses must still be those of the start of the step: reactions and frames are.
pub(super) fn remember(
    scratch: &mut Scratch,
    pairs: &mut [Pair],
    bodies: &[BodyEntry],
    contacts: &[Contact],
    reactions: &[Vec3],
    params: &Parameters,
) {
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
        if change < LEAST_TREND * LEAST_TREND * force {
            for &c in &pair.loaded {
                (pair.trend[c as usize], pair.change[c as usize]) = (Vec3::zeros(), Vec3::zeros());
            }
        }
        let (entry_a, entry_b) = (&bodies[pair.a as usize], &bodies[pair.b as usize]);
        if let Some(skin) = &entry_a.skin {
            let to_link = entry_a.body.link_pose(entry_a.skin_link).rotation.inverse();
            let pushes = patch.iter().zip(forces).map(|(c, f)| (c.control_point as usize, to_link * (c.frame * f), c.area));
            scratch.load(skin.surface.control.len(), pushes.map(|(c, f, _)| (c, f)));
            displace(&mut pair.side_a, skin, scratch, params.dt);
            // A coarse contact gives with the area of its node: the change of its own diagonal.
            for (contact, f) in patch.iter().zip(forces).filter(|(c, _)| c.area != skin.surface.control.areas[c.control_point as usize]) {
                let change = self_change(skin, contact) * (1.0 - skin.memory(params.dt));
                pair.side_a.displacement[contact.control_point as usize] += change * (to_link * (contact.frame * f));
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
            if let (Compliance::HalfSpace(half_space), Some(skin_a)) = (&skin.compliance, &entry_a.skin) {
                displace_feet(
                    scratch,
                    pair,
                    half_space,
                    [skin_a, skin],
                    patch,
                    forces,
                    &to_link.to_rotation_matrix().into_inner(),
                    params.dt,
                );
            } else {
                displace(&mut pair.side_b, skin, scratch, params.dt);
            }
        }
    }
}

/// What the contact's own compliance changes by, link axes, m/N: the same change that its row of W was given.
fn self_change(skin: &Skin, contact: &Contact) -> Mat3 {
    let (control, i) = (&skin.surface.control, contact.control_point as usize);
    match &skin.compliance {
        Compliance::Local(local) => Mat3::identity() * local.change_for_area(control, i, contact.area),
        Compliance::HalfSpace(half_space) => {
            half_space.self_block(&control.normals[i], contact.inverse_distance(skin) - control.inverse_distances[i])
        }
    }
}

/// A half-space on side `b`: `u <- alpha u + (1 - alpha) K^-1 f` at the feet of the contacts, the operator of `contact_problem`; and at the control points of `b`,
/// which show the deformation and carry it along where feet move.
#[allow(clippy::too_many_arguments)]
fn displace_feet(
    scratch: &mut Scratch,
    pair: &mut Pair,
    half_space: &HalfSpaceCompliance,
    [skin_a, skin_b]: [&Skin; 2],
    patch: &[Contact],
    forces: &[Vec3],
    to_link_b: &Mat3,
    dt: Real,
) {
    let alpha = skin_b.memory(dt);
    scratch.pushes.clear();
    for (i, (contact, f)) in patch.iter().zip(forces).enumerate().filter(|(_, (_, f))| **f != Vec3::zeros()) {
        scratch.pushes.push((i, contact.foot_on_b(to_link_b), -(to_link_b * (contact.frame * f))));
    }
    scratch.feet.clear();
    for (i, contact) in patch.iter().enumerate() {
        let foot = contact.foot_on_b(to_link_b);
        let moved = |(j, other, force): &(usize, Loaded, Vec3)| {
            let own = i == *j;
            let block = if own {
                half_space.self_block(&foot.normal, contact.inverse_distance(skin_a))
            } else {
                half_space.block_between(&foot, other)
            };
            block * force
        };
        let before = pair.displacement_of_b(contact.control_point as usize, &contact.weights_b);
        scratch.feet.push(before * alpha + scratch.pushes.iter().map(moved).sum::<Vec3>() * (1.0 - alpha));
    }
    displace(&mut pair.side_b, skin_b, scratch, dt);
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

impl Scratch {
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

/// `u <- alpha u + (1 - alpha) K^-1 f` at every control point that a loaded one reaches.
fn displace(side: &mut PatchSide, skin: &Skin, scratch: &Scratch, dt: Real) {
    let alpha = skin.memory(dt);
    for &c in &side.active {
        side.displacement[c as usize] *= alpha;
    }
    match &skin.compliance {
        Compliance::Local(local) => {
            for &j in &scratch.loaded {
                let force = scratch.force[j as usize] * (1.0 - alpha);
                // G is symmetric: the row of j lists whom j reaches.
                for e in local.neighbours.range(j as usize) {
                    let i = local.neighbours.index[e] as usize;
                    side.touch(i);
                    side.displacement[i] += force * local.values[e];
                }
            }
        }
        Compliance::HalfSpace(half_space) => {
            // A half-space reaches everywhere; followed are the loaded control points and their neighbours, and whatever was.
            for &j in &scratch.loaded {
                side.touch(j as usize);
                for &i in skin.surface.leaf_neighbours.row(j as usize) {
                    side.touch(i as usize);
                }
            }
            for t in 0..side.active.len() {
                let i = side.active[t] as usize;
                let moved: Vec3 = scratch
                    .loaded
                    .iter()
                    .map(|&j| half_space.block(&skin.surface.control, i, j as usize) * scratch.force[j as usize])
                    .sum();
                side.displacement[i] += moved * (1.0 - alpha);
            }
        }
    }
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

/// Sums the patches of every skin, moves its points and refits its spheres.
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

//! A snapshot from what was stored. The bytes may come from anywhere: whatever a step takes for granted is checked
//! here, every index, length and cross-reference, so that a world that can be made of them can be stepped.

use super::Snapshot;
use super::numbers::check_numbers;
use super::record::{Record, State, StoredBody, StoredCollider};
use crate::body::{Body, BodyEntry, Finger, Motion, RigidBody};
use crate::collider::skin::compliance_of;
use crate::collider::{Collider, ComplianceModel, Material, Skin};
use crate::contact_problem::ContactProblem;
use crate::math::{MAX_DOF, Real};
use crate::objects::Objects;
use crate::pair::{Contact, Pair, check_indices, friction_between};
use crate::surface::sampling::memory::check_bytes;
use crate::surface::{Compliance, LocalCompliance, Surface};
use crate::world::Hand;
use std::borrow::Cow;
use std::sync::Arc;

type Checked<T> = Result<T, String>;

fn message(error: crate::Error) -> String {
    error.to_string()
}

/// The snapshot, or why there is none.
pub(super) fn snapshot_of(record: Record) -> Checked<Snapshot> {
    let Record { surfaces, materials, state } = record;
    check_numbers(&state)?;
    check_numbers(&materials)?;
    let State { params, bodies, colliders, excluded, pairs, caches, friction, hands, steps, start_time, start_steps, contacts, problem } =
        state;
    params.check().map_err(message)?;
    if start_steps > steps {
        return Err(format!("a time step that was set after {start_steps} of {steps} steps"));
    }
    let surfaces: Vec<Arc<Surface>> =
        surfaces.into_iter().map(|source| source.build().map(Arc::new).map_err(message)).collect::<Checked<_>>()?;
    let materials: Vec<Material> = materials.into_iter().map(Cow::into_owned).collect();
    let mut parts = Parts { surfaces, materials, made: Vec::new(), bytes: 0 };
    let bodies = bodies.read(body)?;
    let colliders = colliders.read(|stored| parts.collider(stored))?;
    let objects = Objects { bodies, colliders, excluded: excluded.into_owned() };
    let links = |body: u32| objects.bodies.get(body).map_or(0, |entry| entry.body.link_count());
    if objects.colliders.iter().any(|(_, collider)| collider.link >= links(collider.body)) {
        return Err("a collider on a link that is not there".into());
    }
    objects.excluded.check(|slot| objects.colliders.get(slot).is_some())?;
    let (friction, contacts) = (friction.into_owned(), contacts.into_owned());
    let hands = list_of_hands(hands)?;
    let (mut pairs, caches) = (pairs.into_owned(), caches.into_owned());
    friction.check(|slot| objects.bodies.get(slot).is_some())?;
    for (index, hand) in hands.iter().enumerate() {
        let Some(hand) = hand else { continue };
        if hand.fingers.len() != hand.model.fingers().len() {
            return Err(format!("a hand with {} fingers of {}", hand.fingers.len(), hand.model.fingers().len()));
        }
        for (finger, model) in hand.fingers.iter().zip(hand.model.fingers()) {
            let entry = finger.find_in(&objects.bodies).ok_or("a hand with a finger that is not there")?;
            let of_hand = matches!(&entry.body, Body::Finger(finger) if finger.model() == model);
            if !of_hand || entry.hand != Some(index as u32) {
                return Err("a hand with a finger that is not its own".into());
            }
        }
    }
    let fingers: usize = hands.iter().flatten().map(|hand| hand.fingers.len()).sum();
    if objects.bodies.iter().filter(|(_, entry)| entry.hand.is_some()).count() != fingers {
        return Err("a finger of no hand".into());
    }
    if caches.len() != pairs.len() || !pairs.is_sorted_by(|p, q| (p.a, p.b) < (q.a, q.b)) {
        return Err("pairs that are out of order, or without what was found of them".into());
    }
    for (pair, cache) in pairs.iter_mut().zip(&caches) {
        let [a, b] = skins(&objects, pair)?;
        pair.check([a.surface.control.len(), b.surface.control.len()])?;
        cache.check(&a.surface, &b.surface)?;
        pair.set_friction(friction_between(&friction, [pair.a, pair.b], &objects, params.friction_rule));
    }
    if !contacts.is_sorted_by_key(|contact| contact.pair) {
        return Err("contacts out of order".into());
    }
    contacts.iter().try_for_each(|contact| check_contact(contact, &pairs, &objects))?;
    let is_pair = |colliders: (u32, u32)| pairs.binary_search_by_key(&colliders, |pair| (pair.a, pair.b)).is_ok();
    let problem = ContactProblem::of_stored(problem, contacts.len(), is_pair)?;
    Ok(Snapshot { params: params.into_owned(), objects, pairs, caches, friction, hands, steps, start_time, start_steps, contacts, problem })
}

/// More hands than this no world has had.
const MOST_HANDS: u32 = 1 << 20;

/// The hands, each at its place in the list.
fn list_of_hands((count, there): (u32, Vec<(u32, Cow<Hand>)>)) -> Checked<Vec<Option<Hand>>> {
    if count > MOST_HANDS {
        return Err(format!("{count} hands"));
    }
    let mut hands = vec![None; count as usize];
    for (index, hand) in there {
        let place = hands.get_mut(index as usize).ok_or("a hand beyond the last one")?;
        if place.replace(hand.into_owned()).is_some() {
            return Err("two hands in one place".into());
        }
    }
    Ok(hands)
}

/// The skins of a pair.
fn skins<'a>(objects: &'a Objects, pair: &Pair) -> Checked<[&'a Skin; 2]> {
    match [pair.a, pair.b].map(|collider| objects.colliders.get(collider)) {
        [Some(a), Some(b)] if a.body != b.body => Ok([&a.skin, &b.skin]),
        _ => Err(format!("a pair of colliders {} and {}, of which one is not there", pair.a, pair.b)),
    }
}

fn check_contact(contact: &Contact, pairs: &[Pair], objects: &Objects) -> Checked<()> {
    let pair = pairs.get(contact.pair as usize).ok_or("a contact of a pair that is not there")?;
    let [a, b] = skins(objects, pair)?.map(|skin| skin.surface.control.len());
    let [side_a, side_b] = pair.sides(objects);
    if (contact.collider_a, contact.collider_b) != (pair.a, pair.b)
        || (contact.body_a, contact.body_b) != (side_a.collider.body, side_b.collider.body)
        || (contact.link_a as usize, contact.link_b as usize) != (side_a.collider.link, side_b.collider.link)
    {
        return Err("a contact of other bodies than those of its pair".into());
    }
    check_indices([contact.control_point], a)?;
    check_indices(contact.weights_b.iter().map(|(c, _)| c as u32), b)
}

fn body(stored: StoredBody) -> Checked<BodyEntry> {
    let StoredBody { body, hand, quarantined } = stored;
    let mut body = body.into_owned();
    match &mut body {
        Body::Rigid(rigid) => check_rigid(rigid)?,
        Body::Finger(finger) => check_finger(finger)?,
    }
    if matches!(body, Body::Finger(_)) != hand.is_some() {
        return Err("a hand that a rigid body is of, or a finger of none".into());
    }
    Ok(BodyEntry { body, hand, quarantined })
}

/// Surfaces and materials that colliders are made of, and the compliances that were made of them.
struct Parts {
    surfaces: Vec<Arc<Surface>>,
    materials: Vec<Material>,
    made: Vec<([u64; 2], Compliance)>,
    /// That these compliances take.
    bytes: u64,
}

impl Parts {
    fn collider(&mut self, stored: StoredCollider) -> Checked<Collider> {
        let StoredCollider { body, link, surface, material, skin, filter } = stored;
        let found = (self.surfaces.get(surface as usize), self.materials.get(material as usize));
        let (Some(of_surface), Some(of_material)) = found else { return Err("a surface or a material that is not there".into()) };
        let compliance = match self.made.iter().find(|(key, _)| *key == [surface, material]) {
            Some((_, compliance)) => compliance.clone(),
            None => {
                self.bytes = self.bytes.saturating_add(bytes_of_compliance(of_surface, of_material));
                check_bytes("compliance of the bodies of a snapshot", self.bytes).map_err(message)?;
                let compliance = compliance_of(of_surface, of_material).map_err(message)?;
                self.made.push(([surface, material], compliance.clone()));
                compliance
            }
        };
        let skin = Skin::of_stored(of_surface.clone(), of_material.clone(), compliance, skin)?;
        Ok(Collider { body, link, skin, filter })
    }
}

/// About how much memory the compliance takes: that of a local one grows with the square of its reach.
fn bytes_of_compliance(surface: &Surface, material: &Material) -> u64 {
    let control = &surface.control;
    let reach = match material.model {
        ComplianceModel::Gaussian { width, .. } => LocalCompliance::gaussian_reach(width),
        ComplianceModel::Local => LocalCompliance::layer_reach(control, material.layer_thickness),
        _ => return 0,
    };
    let near = 2.0 * std::f64::consts::PI * (reach / control.spacing).powi(2) + 1.0;
    let count = control.len() as Real;
    (20.0 * count * near.min(count)) as u64
}

fn check_rigid(body: &RigidBody) -> Checked<()> {
    use crate::body::Mobility::{Fixed, Free};
    let [linear, angular] = body.viscosity();
    let viscous = match body.mobility() {
        Free(Motion::QuasiStatic) => linear > 0.0 && angular > 0.0,
        Free(Motion::Inertial) | Fixed => linear >= 0.0 && angular >= 0.0,
    };
    let driven = match body.mobility() {
        Fixed => body.drive().is_none(),
        Free(_) => body.target_pose().is_none(),
    };
    if !(viscous && driven) {
        return Err(format!("body {:?} with a viscosity or a drive that it cannot have", body.name()));
    }
    body.drive().map_or(Ok(()), |drive| drive.check().map_err(message))
}

/// Checks a finger and finds its link poses, which are not stored.
fn check_finger(finger: &mut Finger) -> Checked<()> {
    let (state, dof) = (finger.state(), finger.model().dof());
    let joints = finger.model().joints();
    let (targets, velocities) = finger.controller_targets();
    let vectors = [&state.positions, &state.velocities, &state.motor_torques, &state.contact_torques, targets, velocities];
    let beyond = vectors.iter().any(|v| (dof..MAX_DOF).any(|j| v[j] != 0.0));
    let within = joints.iter().zip(state.positions.iter()).all(|(joint, q)| (joint.lower..=joint.upper).contains(q));
    let viscous = finger.motion() != Motion::QuasiStatic || joints.iter().all(|joint| joint.viscosity > 0.0);
    if beyond || !within || !viscous {
        return Err(format!("finger {:?} with joints that it does not have, or beyond their limits", finger.model().name()));
    }
    finger.restore(&state);
    Ok(())
}

//! Hands of a world: fingers, which are bodies, on a base that is moved.

use super::handles::{BodyHandle, HandHandle};
use crate::body::pose::check_pose;
use crate::body::{Body, BodyEntry, Finger, HandModel, Motion};
use crate::collider::{ComplianceModel, Filter, Material, Skin};
use crate::error::{Error, Result};
use crate::math::Pose;
use crate::surface::{PointSurface, Surface};
use crate::world::World;
use serde::{Deserialize, Serialize};
use std::sync::Arc;

/// A hand: fingers on a common base.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Hand {
    /// What it was built from.
    pub model: HandModel,
    /// Its fingers, in the model's order.
    pub fingers: Vec<BodyHandle>,
    /// Pose of the hand frame in the world at the end of the last step: where the fingers are that were not quarantined.
    pub base: Pose,
    target: Option<Pose>,
}

impl Hand {
    /// Target of the base at the end of the next step, if one was set.
    pub(super) fn target(&self) -> Option<&Pose> {
        self.target.as_ref()
    }

    /// The same hand in another world.
    pub(super) fn of_world(&self, world: u32) -> Self {
        let fingers = self.fingers.iter().map(|finger| finger.of_world(world)).collect();
        Self { model: self.model.clone(), fingers, base: self.base, target: self.target }
    }
}

impl World {
    /// Adds a hand with its base at `base`; every fingertip gets the pad `surface` (pad frame) of `material`.
    ///
    /// # Errors
    /// [`Error::InvalidValue`] for a pose that is not finite or a material out of range; whatever the finger's constructor refuses.
    pub fn add_hand(
        &mut self,
        model: &HandModel,
        base: Pose,
        motion: Motion,
        surface: &PointSurface,
        control_points: Option<usize>,
        material: &Material,
    ) -> Result<HandHandle> {
        check_pose("base pose", &base)?;
        material.check()?;
        if matches!(material.model, ComplianceModel::Matrix(_)) {
            return Err(Error::value(
                "material of a hand",
                "local or half-space compliance",
                "a compliance matrix",
                "a matrix is for one surface, a hand has a pad on every finger: add pads as bodies of their own",
            ));
        }
        let handle = self.hand_handle(self.hands.len());
        // All are made before the first is added: what is refused leaves nothing behind.
        let mut entries = Vec::with_capacity(model.fingers().len());
        for (finger, tip) in model.instantiate(base, motion)?.into_iter().zip(model.tips()) {
            let link = finger.model().dof() - 1;
            let pad = Arc::new(Surface::build(surface.clone().transformed(&tip.pose)?, control_points)?);
            let skin = Skin::new(pad, material.clone())?;
            entries.push((BodyEntry { body: Body::Finger(finger), hand: Some(handle.index), quarantined: false }, link, skin));
        }
        let mut fingers = Vec::with_capacity(entries.len());
        for (entry, link, skin) in entries {
            let finger = self.objects.bodies.insert(entry);
            self.insert_collider(finger, link, skin, Filter::default());
            fingers.push(self.body_at(finger));
        }
        self.hands.push(Some(Hand { model: model.clone(), fingers, base, target: None }));
        Ok(handle)
    }

    /// Takes a hand out, with its fingers.
    ///
    /// # Errors
    /// [`Error::InvalidHandle`] if it is gone already.
    pub fn remove_hand(&mut self, handle: HandHandle) -> Result<()> {
        let fingers = self.hand(handle)?.fingers.clone();
        for finger in fingers {
            self.remove_entry(finger)?;
        }
        self.hands[handle.index as usize] = None;
        Ok(())
    }

    /// A hand.
    ///
    /// # Errors
    /// [`Error::InvalidHandle`] if it was removed.
    pub fn hand(&self, handle: HandHandle) -> Result<&Hand> {
        let hand = self.hands.get(handle.index as usize).filter(|_| handle.world == self.number).and_then(Option::as_ref);
        hand.ok_or_else(|| {
            Error::handle("hand", "a hand of this world", format!("{handle:?}"), "it was removed, or belongs to another world")
        })
    }

    /// Finger `index` of a hand.
    ///
    /// # Errors
    /// [`Error::InvalidHandle`] for a hand that was removed, [`Error::InvalidValue`] for a finger that it does not have.
    pub fn finger(&self, handle: HandHandle, index: usize) -> Result<&Finger> {
        let body = self.finger_handle(handle, index)?;
        match &self.entry(body)?.body {
            Body::Finger(finger) => Ok(finger),
            Body::Rigid(_) => Err(Error::handle("finger", "a finger", "a rigid body", "use body()")),
        }
    }

    /// Finger `index` of a hand, to set its targets.
    ///
    /// # Errors
    /// As [`World::finger`].
    pub fn finger_mut(&mut self, handle: HandHandle, index: usize) -> Result<&mut Finger> {
        let body = self.finger_handle(handle, index)?;
        let slot = self.slot(body)?;
        match &mut self.objects.bodies[slot].body {
            Body::Finger(finger) => Ok(finger),
            Body::Rigid(_) => Err(Error::handle("finger", "a finger", "a rigid body", "use body_mut()")),
        }
    }

    /// The hand that a body is a finger of, and which one; `None` for others.
    ///
    /// # Errors
    /// [`Error::InvalidHandle`] for a body that was removed.
    pub fn hand_of(&self, body: BodyHandle) -> Result<Option<(HandHandle, usize)>> {
        let Some(index) = self.entry(body)?.hand else { return Ok(None) };
        let hand = self.hand_handle(index as usize);
        let finger = self.hand(hand)?.fingers.iter().position(|finger| *finger == body);
        Ok(finger.map(|finger| (hand, finger)))
    }

    /// Handle of the body that is finger `index` of a hand.
    ///
    /// # Errors
    /// As [`World::finger`].
    pub fn finger_handle(&self, handle: HandHandle, index: usize) -> Result<BodyHandle> {
        let fingers = &self.hand(handle)?.fingers;
        fingers
            .get(index)
            .copied()
            .ok_or_else(|| Error::value("finger", format!("an index below {}", fingers.len()), index, "fingers are counted from 0"))
    }

    /// Moves the base of a hand to `target` during the next step. What it holds moves with it by friction alone.
    ///
    /// # Errors
    /// [`Error::InvalidHandle`] for a hand that was removed, [`Error::InvalidValue`] for a pose that is not finite.
    pub fn move_hand_to(&mut self, handle: HandHandle, target: Pose) -> Result<()> {
        check_pose("target pose", &target)?;
        let fingers = self.hand(handle)?.fingers.clone();
        for index in 0..fingers.len() {
            self.finger_mut(handle, index)?.move_base_to(target)?;
        }
        if let Some(hand) = &mut self.hands[handle.index as usize] {
            hand.target = Some(target);
        }
        Ok(())
    }

    pub(crate) fn hand_handle(&self, index: usize) -> HandHandle {
        HandHandle { world: self.number, index: index as u32 }
    }

    pub(crate) fn update_hand_poses(&mut self) {
        for index in 0..self.hands.len() {
            let Some(target) = self.hands[index].as_mut().and_then(|hand| hand.target.take()) else { continue };
            // A finger that was quarantined stays behind; a hand of nothing else has not moved.
            let goes = |finger: &BodyHandle| self.entry(*finger).is_ok_and(|entry| !entry.quarantined);
            let moved = self.hands[index].as_ref().is_some_and(|hand| hand.fingers.iter().any(goes));
            if let Some(hand) = self.hands[index].as_mut().filter(|_| moved) {
                hand.base = target;
            }
        }
    }
}

//! Colliders of a world: what touches, on the links of its bodies.

use crate::collider::{Collider, Filter, Material, Skin};
use crate::collision::retain_pairs;
use crate::contact_problem::retain_by_index;
use crate::error::{Error, Result};
use crate::objects::Side;
use crate::pair::{Pair, counts_as_rigid};
use crate::surface::Surface;
use crate::world::{BodyHandle, ColliderHandle, World};
use std::sync::Arc;

impl World {
    /// Adds a surface (frame of the link) of `material` to a link of a body, which may have others: a link carries any number
    /// of colliders, and those of one body never touch each other. Mass and inertia stay those of the body.
    ///
    /// # Errors
    /// [`Error::InvalidHandle`] for a body that was removed; [`Error::InvalidValue`] for a
    /// link that it does not have; what [`Material::check_for`] refuses.
    pub fn add_collider(
        &mut self,
        body: BodyHandle,
        link: usize,
        surface: Arc<Surface>,
        material: Material,
        filter: Filter,
    ) -> Result<ColliderHandle> {
        let slot = self.slot(body)?;
        let body = &self.objects.bodies[slot].body;
        let links = body.link_count();
        if link >= links {
            let expected = format!("a link below {links}: '{}' has {links}", body.name());
            return Err(Error::value("link", expected, link, "links are counted from 0; a rigid body has one"));
        }
        let skin = Skin::new(surface, material)?;
        let collider = self.insert_collider(slot, link, skin, filter);
        Ok(self.collider_at(collider))
    }

    /// Takes a collider off its body, with what touched it. Nothing else changes; the body stays, with or without other colliders.
    ///
    /// # Errors
    /// [`Error::InvalidHandle`] if it is gone already.
    pub fn remove_collider(&mut self, handle: ColliderHandle) -> Result<()> {
        let slot = self.collider_slot(handle)?;
        self.remove_collider_at(slot);
        Ok(())
    }

    /// A collider as it is now.
    ///
    /// # Errors
    /// [`Error::InvalidHandle`] if it was removed.
    pub fn collider(&self, handle: ColliderHandle) -> Result<&Collider> {
        Ok(self.side(handle)?.collider)
    }

    /// A collider as it is now, and the body that carries it.
    ///
    /// # Errors
    /// [`Error::InvalidHandle`] if it was removed.
    pub fn side(&self, handle: ColliderHandle) -> Result<Side<'_>> {
        Ok(self.objects.side(self.collider_slot(handle)?))
    }

    /// Handles of all colliders, in the order in which they were added.
    pub fn colliders(&self) -> Vec<ColliderHandle> {
        self.objects.colliders.order().iter().map(|&slot| self.collider_at(slot)).collect()
    }

    /// Handles of the colliders of a body, in the order in which they were added.
    ///
    /// # Errors
    /// [`Error::InvalidHandle`] for a body that was removed.
    pub fn colliders_of(&self, body: BodyHandle) -> Result<Vec<ColliderHandle>> {
        let slots = self.collider_slots(self.slot(body)?);
        Ok(slots.into_iter().map(|slot| self.collider_at(slot)).collect())
    }

    /// Handle of the body that carries a collider.
    ///
    /// # Errors
    /// [`Error::InvalidHandle`] if the collider was removed.
    pub fn body_of(&self, handle: ColliderHandle) -> Result<BodyHandle> {
        self.collider(handle).map(|collider| self.body_at(collider.body))
    }

    /// Surface and displacement of the first collider of a body; `None` if it has none.
    ///
    /// # Errors
    /// [`Error::InvalidHandle`] for a body that was removed.
    pub fn skin(&self, body: BodyHandle) -> Result<Option<&Skin>> {
        let slot = self.slot(body)?;
        Ok(self.objects.colliders.in_order().find(|collider| collider.body == slot).map(|collider| &collider.skin))
    }

    /// Makes a collider of another material, from the next step on. Its elastic displacement stays what it is.
    ///
    /// # Errors
    /// [`Error::InvalidHandle`] if it was removed, [`Error::InvalidValue`] for a material out of range.
    pub fn set_collider_material(&mut self, handle: ColliderHandle, material: &Material) -> Result<()> {
        let slot = self.collider_slot(handle)?;
        let elastic_changed = self.objects.colliders[slot].skin.set_material(material.clone())?;
        self.renew_friction();
        if !elastic_changed {
            return Ok(());
        }
        let with_caches = self.pairs.iter_mut().zip(&mut self.workspace.collision.caches);
        for (pair, cache) in with_caches.filter(|(pair, _)| of_collider(pair, slot)) {
            let [a, b] = pair.sides(&self.objects).map(|side| &side.collider.skin);
            if pair.compliance_changed(counts_as_rigid(a, b, &self.params)) {
                cache.invalidate();
            }
        }
        Ok(())
    }

    /// Sets what a collider may touch, from the next step on. Where it may no longer touch what it is in contact with, the contact
    /// ends there, as if the two had been separated: its reactions are forgotten, and its elastic displacement relaxes.
    ///
    /// # Errors
    /// [`Error::InvalidHandle`] if it was removed.
    pub fn set_filter(&mut self, handle: ColliderHandle, filter: Filter) -> Result<()> {
        let slot = self.collider_slot(handle)?;
        self.objects.colliders[slot].filter = filter;
        Ok(())
    }

    /// From the next step on two colliders never touch, whatever their filters say, until
    /// [`World::include_pair`]. What touches now ends as with [`World::set_filter`].
    ///
    /// # Errors
    /// [`Error::InvalidHandle`] if one was removed; [`Error::InvalidValue`] for one collider twice.
    pub fn exclude_pair(&mut self, a: ColliderHandle, b: ColliderHandle) -> Result<()> {
        self.set_excluded(a, b, true)
    }

    /// Takes back [`World::exclude_pair`].
    ///
    /// # Errors
    /// As [`World::exclude_pair`].
    pub fn include_pair(&mut self, a: ColliderHandle, b: ColliderHandle) -> Result<()> {
        self.set_excluded(a, b, false)
    }

    fn set_excluded(&mut self, a: ColliderHandle, b: ColliderHandle, excluded: bool) -> Result<()> {
        let (a, b) = (self.collider_slot(a)?, self.collider_slot(b)?);
        if a == b {
            return Err(Error::value("pair", "two colliders", "one collider twice", "name the collider that it is not to touch"));
        }
        self.objects.excluded.set(a, b, excluded);
        Ok(())
    }

    pub(crate) fn insert_collider(&mut self, body: u32, link: usize, skin: Skin, filter: Filter) -> u32 {
        self.objects.colliders.insert(Collider { body, link, skin, filter })
    }

    /// Slots of the colliders of a body, in the order in which they were added.
    pub(super) fn collider_slots(&self, body: u32) -> Vec<u32> {
        let colliders = &self.objects.colliders;
        colliders.order().iter().copied().filter(|&slot| colliders[slot].body == body).collect()
    }

    /// Takes a collider out, with its pairs and all that is known of them; what others know stays the same bits.
    pub(super) fn remove_collider_at(&mut self, gone: u32) {
        let is_kept: Vec<bool> = self.pairs.iter().map(|pair| !of_collider(pair, gone)).collect();
        let partners: Vec<u32> =
            self.pairs.iter().filter(|pair| of_collider(pair, gone)).map(|pair| if pair.a == gone { pair.b } else { pair.a }).collect();
        let contacts = &mut self.workspace.collision.contacts;
        if contacts.iter().any(|contact| !is_kept[contact.pair as usize]) {
            let keeps: Vec<bool> = contacts.iter().map(|contact| is_kept[contact.pair as usize]).collect();
            self.workspace.problem.retain(|contact| keeps[contact]);
            retain_by_index(contacts, |contact| keeps[contact]);
        }
        for contact in contacts {
            contact.pair = is_kept[..contact.pair as usize].iter().filter(|kept| **kept).count() as u32;
        }
        retain_pairs(&mut self.pairs, &mut self.workspace.collision.caches, |pair| !of_collider(pair, gone));
        self.workspace.problem.forget_collider(gone);
        for partner in partners {
            self.sum_displacement(partner);
        }
        self.objects.excluded.remove(gone);
        self.objects.colliders.remove(gone);
    }

    /// Sums the elastic displacement of a collider over the pairs that are left.
    fn sum_displacement(&mut self, collider: u32) {
        let skin = &mut self.objects.colliders[collider].skin;
        skin.clear_displacement();
        for pair in &self.pairs {
            for (_, side) in [(pair.a, &pair.side_a), (pair.b, &pair.side_b)].into_iter().filter(|(slot, _)| *slot == collider) {
                side.active.iter().for_each(|&c| skin.add_displacement(c, &side.displacement[c as usize]));
            }
        }
    }
}

/// Whether a collider is one side of a pair.
fn of_collider(pair: &Pair, collider: u32) -> bool {
    pair.a == collider || pair.b == collider
}

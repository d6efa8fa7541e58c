//! The friction of pairs: combined from two materials by a rule, or set in a table.

use crate::collider::friction_table::FrictionKey;
use crate::collider::{Friction, Material};
use crate::error::{Error, Result};
use crate::pair::friction_between;
use crate::world::{BodyHandle, World};
use std::collections::BTreeSet;

/// One side of an entry in the friction table of a world.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum FrictionSide {
    /// All bodies of a material that has this name; also those added later. Any name will do: whoever has the material cannot mistype it.
    Material(String),
    /// The same by a name that must be known, so that a mistyped one is found: a preset, the material of a body in the world, or one
    /// that is in the table already.
    Name(String),
    /// One body.
    Body(BodyHandle),
}

impl From<&Material> for FrictionSide {
    fn from(material: &Material) -> Self {
        Self::Material(material.name.clone())
    }
}

impl From<&str> for FrictionSide {
    fn from(name: &str) -> Self {
        Self::Name(name.into())
    }
}

impl From<BodyHandle> for FrictionSide {
    fn from(body: BodyHandle) -> Self {
        Self::Body(body)
    }
}

impl World {
    /// Sets the friction between `a` and `b`, instead of combining it from two materials
    /// ([`crate::Parameters::friction_rule`]); holds from the next step on.
    /// `None` removes the entry of this pair.
    ///
    /// An entry about two bodies goes before one about a body and a material, and that before one
    /// about two materials; of equals the last one set holds. A direction lies in the frame of the
    /// side named first (of the body added first, if both sides are one material).
    ///
    /// # Errors
    /// [`Error::UnknownName`] for a [`FrictionSide::Name`] that is not known; [`Error::InvalidHandle`] for a body that was
    /// removed; [`Error::InvalidValue`] for one body against itself, or a friction that [`Friction::check`] refuses.
    pub fn set_friction(&mut self, a: impl Into<FrictionSide>, b: impl Into<FrictionSide>, friction: Option<Friction>) -> Result<()> {
        if let Some(friction) = &friction {
            friction.check()?;
        }
        let (a, b) = (self.key(a.into())?, self.key(b.into())?);
        if a == b && matches!(a, FrictionKey::Body(_)) {
            return Err(Error::value("friction of a pair", "two bodies", "one body twice", "name the body that it touches"));
        }
        self.friction.set(a, b, friction);
        self.renew_friction();
        Ok(())
    }

    /// Looks up the friction of all pairs again, after the table or the rule has changed.
    pub(crate) fn renew_friction(&mut self) {
        let Self { pairs, friction, objects, params, .. } = self;
        for pair in pairs {
            pair.set_friction(friction_between(friction, [pair.a, pair.b], objects, params.friction_rule));
        }
    }

    fn key(&self, side: FrictionSide) -> Result<FrictionKey> {
        Ok(match side {
            FrictionSide::Material(name) => FrictionKey::Material(name),
            FrictionSide::Name(name) => FrictionKey::Material(self.known_material(name)?),
            FrictionSide::Body(body) => FrictionKey::Body(self.slot(body)?),
        })
    }

    /// `name`, if a material may have it as far as this world knows.
    fn known_material(&self, name: String) -> Result<String> {
        let in_use = self.objects.colliders.iter().map(|(_, collider)| collider.skin.material.name.as_str());
        let presets = Material::preset_names().map(|name| -> &str { name });
        let known: BTreeSet<&str> = in_use.chain(self.friction.materials()).chain(presets).collect();
        if known.contains(name.as_str()) {
            return Ok(name);
        }
        let expected = format!("one of {}", known.into_iter().collect::<Vec<_>>().join(", "));
        let hint = "pick a name from the list, add the bodies of a material of your own first, or give the material itself";
        Err(Error::unknown("material", expected, format!("'{name}'"), hint))
    }
}

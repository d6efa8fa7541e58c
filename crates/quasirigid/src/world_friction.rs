//! The friction of pairs: what a world combines by rule, and what it is told.

use crate::body::friction_table::Party;
use crate::body::{Friction, Material};
use crate::error::{Error, Result};
use crate::world::{BodyHandle, World};

/// One side of an entry in the friction table of a world.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum FrictionSide {
    /// All bodies of a material, known by its name; also those added later.
    Material(String),
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
        Self::Material(name.into())
    }
}

impl From<BodyHandle> for FrictionSide {
    fn from(body: BodyHandle) -> Self {
        Self::Body(body)
    }
}

impl World {
    /// Says what friction is between `a` and `b`, instead of combining it from two materials ([`crate::Parameters::friction_rule`]); holds from the next step on.
    /// `None` takes back what was said of this pair.
    ///
    /// An entry about two bodies goes before one about a body and a material, and that before one about two materials; of equals the last one set holds.
    /// A grain lies in the frame of the side named first (of the body added first, if both sides are one material).
    ///
    /// # Errors
    /// [`Error::InvalidHandle`] for a body that was removed; [`Error::InvalidValue`] for one body against itself, or a friction that [`Friction::check`] refuses.
    pub fn set_friction(&mut self, a: impl Into<FrictionSide>, b: impl Into<FrictionSide>, friction: Option<Friction>) -> Result<()> {
        if let Some(friction) = &friction {
            friction.check()?;
        }
        let (a, b) = (self.party(a.into())?, self.party(b.into())?);
        if a == b && matches!(a, Party::Body(_)) {
            return Err(Error::value("friction of a pair", "two bodies", "one body twice", "name the body that it touches"));
        }
        self.friction.set(a, b, friction);
        self.renew_friction();
        Ok(())
    }

    /// Looks up the friction of all pairs anew, after the table or the rule has changed.
    pub(crate) fn renew_friction(&mut self) {
        let Self { pairs, friction, bodies, params, .. } = self;
        for pair in pairs {
            if let Some(friction) = friction.pair(bodies, pair.a, pair.b, params.friction_rule) {
                pair.set_friction(friction);
            }
        }
    }

    fn party(&self, side: FrictionSide) -> Result<Party> {
        Ok(match side {
            FrictionSide::Material(name) => Party::Material(name),
            FrictionSide::Body(body) => Party::Body(self.dense(body)? as u32),
        })
    }
}

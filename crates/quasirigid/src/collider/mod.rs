//! What touches: colliders, each a surface on a link of a body; the material that it is made of, friction, and which of them may meet.

pub mod filter;
pub mod friction;
pub mod friction_table;
pub mod material;
pub mod skin;

pub use filter::Filter;
pub use friction::{Anisotropy, Friction};
pub use friction_table::{FrictionRule, PairFriction};
pub use material::{ComplianceModel, Material};
pub use skin::{Skin, Sphere};

/// A surface on a link of a body. A link carries any number of them; those of one body never touch each other.
#[derive(Debug, Clone)]
pub struct Collider {
    /// Slot of the body that carries it.
    pub body: u32,
    /// The link that it is fixed to; 0 for a rigid body.
    pub link: usize,
    /// Surface, material and elastic displacement, frame of the link.
    pub skin: Skin,
    /// What it may touch.
    pub filter: Filter,
}

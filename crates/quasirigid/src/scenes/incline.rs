//! A block on a plane that is tilted by turning gravity.

use crate::body::{Amount, MassProperties, Motion, RigidBody};
use crate::collider::{Friction, Material};
use crate::error::Result;
use crate::math::{Pose, Real, Vec3};
use crate::params::Parameters;
use crate::surface::{Surface, shapes};
use crate::world::{BodyHandle, World};
use std::sync::Arc;

/// The incline.
#[derive(Debug)]
pub struct Incline {
    /// The world.
    pub world: World,
    /// The plane z = 0.
    pub plane: BodyHandle,
    /// The block; its lower face starts on the plane z = 0.
    pub block: BodyHandle,
}

impl Incline {
    /// A block of 40 x 40 x 20 mm and 100 g on a fixed plane of 200 mm, `friction` on both, resting on level ground.
    ///
    /// # Errors
    /// Whatever the constructors refuse.
    pub fn new(params: Parameters, material: &Material, friction: impl Into<Friction>, motion: Motion) -> Result<Self> {
        let mut world = World::new(params)?;
        let material = material.clone().with_friction(friction)?;
        let size = Vec3::new(0.04, 0.04, 0.02);
        let plane = Surface::build(shapes::sample_half_space(0.2, 10_000)?, Some(1_000))?;
        let plane_body = RigidBody::fixed("plane", Pose::identity())?;
        let plane = world.add_body(plane_body, Some((Arc::new(plane), material.clone())))?;
        let mass = MassProperties::cuboid(size, Amount::Mass(0.1))?;
        let surface = Surface::build(shapes::sample_box(size, 3_000)?, Some(400))?;
        let body = RigidBody::free("block", mass, motion, Pose::translation(0.0, 0.0, 0.5 * size.z))?;
        let block = world.add_body(body, Some((Arc::new(surface), material)))?;
        Ok(Self { world, plane, block })
    }

    /// Turns gravity so that the plane falls off by `angle` (rad) towards `heading` (rad, from +x towards +y).
    ///
    /// # Errors
    /// [`crate::error::Error::InvalidValue`] if the angle is not finite.
    pub fn tilt(&mut self, angle: Real, heading: Real) -> Result<()> {
        let g = self.world.parameters().gravity.norm();
        let downhill = Vec3::new(heading.cos(), heading.sin(), 0.0);
        let gravity = (downhill * angle.sin() - Vec3::z() * angle.cos()) * g;
        let params = Parameters { gravity, ..self.world.parameters().clone() };
        self.world.set_parameters(params)
    }

    /// Steps for `duration` seconds.
    pub fn run(&mut self, duration: Real) {
        for _ in 0..(duration / self.world.parameters().dt).round() as usize {
            self.world.step();
        }
    }
}

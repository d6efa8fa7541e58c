//! What may be changed about a world between two steps: gravity, materials, masses; and the list of what is in it.

use crate::body::{Body, MassProperties};
use crate::collider::Material;
use crate::error::{Error, Result};
use crate::math::Vec3;
use crate::params::Parameters;
use crate::world::{BodyHandle, HandHandle, World};

impl World {
    /// Sets gravity, m/s^2, from the next step on.
    ///
    /// # Errors
    /// [`Error::InvalidValue`] for a vector that is not finite.
    pub fn set_gravity(&mut self, gravity: Vec3) -> Result<()> {
        self.set_parameters(Parameters { gravity, ..self.params.clone() })
    }

    /// Makes the surface of a body, or of a finger, of another material, from the next step on. Its elastic
    /// displacement stays what it is. Of several colliders it is the first, see [`World::set_collider_material`].
    ///
    /// # Errors
    /// [`Error::InvalidHandle`] for a body that was removed, [`Error::InvalidValue`] for a material out of range or a body without surface.
    pub fn set_material(&mut self, handle: BodyHandle, material: &Material) -> Result<()> {
        material.check()?;
        let Some(first) = self.colliders_of(handle)?.first().copied() else {
            return Err(Error::value(
                "body",
                "a body with a surface",
                "one without",
                "give it a surface when it is added, or add a collider",
            ));
        };
        self.set_collider_material(first, material)
    }

    /// Gives a free body another mass, centre of mass and inertia; it keeps its pose and its velocities.
    ///
    /// # Errors
    /// As [`World::body`]; [`Error::InvalidValue`] for a fixed body.
    pub fn set_mass(&mut self, handle: BodyHandle, mass: MassProperties) -> Result<()> {
        self.body_mut(handle)?.set_mass_properties(mass)
    }

    /// Handles of the rigid bodies, in the order in which contacts count them.
    pub fn rigid_bodies(&self) -> Vec<BodyHandle> {
        let rigid = |slot: &&u32| matches!(self.objects.bodies[**slot].body, Body::Rigid(_));
        self.objects.bodies.order().iter().filter(rigid).map(|&slot| self.body_at(slot)).collect()
    }

    /// Handles of the hands, in the order in which they were added.
    pub fn hand_handles(&self) -> Vec<HandHandle> {
        let there = self.hands.iter().enumerate().filter(|(_, hand)| hand.is_some());
        there.map(|(index, _)| self.hand_handle(index)).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::body::{Amount, Motion, RigidBody};
    use crate::math::{Pose, Real};
    use crate::surface::{Surface, shapes};
    use std::sync::Arc;

    /// A box on a table, at rest, and the two handles.
    fn resting() -> (World, BodyHandle, BodyHandle) {
        let mut world = World::new(Parameters::default()).unwrap();
        let material = Material::preset("rubber").unwrap();
        let table = Arc::new(Surface::build(shapes::sample_half_space(0.1, 1000).unwrap(), None).unwrap());
        let cube = Arc::new(Surface::build(shapes::sample_box(Vec3::repeat(0.03), 1000).unwrap(), None).unwrap());
        let table = world.add_body(RigidBody::fixed("table", Pose::identity()).unwrap(), Some((table, material.clone()))).unwrap();
        let mass = MassProperties::cuboid(Vec3::repeat(0.03), Amount::Mass(0.1)).unwrap();
        let body = RigidBody::free("cube", mass, Motion::Inertial, Pose::translation(0.0, 0.0, 0.015)).unwrap();
        let cube = world.add_body(body, Some((cube, material))).unwrap();
        for _ in 0..300 {
            world.step();
        }
        (world, table, cube)
    }

    #[test]
    fn the_table_carries_the_new_weight() {
        let (mut world, _, cube) = resting();
        let settled = |world: &mut World| {
            for _ in 0..300 {
                world.step();
            }
            world.contact_force_on(cube).unwrap().z
        };
        let g = 9.81;
        assert!((settled(&mut world) - 0.1 * g).abs() < 1e-3, "{}", settled(&mut world));
        let heavier = MassProperties::cuboid(Vec3::repeat(0.03), Amount::Mass(0.3)).unwrap();
        world.set_mass(cube, heavier).unwrap();
        assert!((settled(&mut world) - 0.3 * g).abs() < 3e-3, "{}", settled(&mut world));
        world.set_gravity(Vec3::new(0.0, 0.0, -1.62)).unwrap();
        assert!((settled(&mut world) - 0.3 * 1.62).abs() < 3e-3, "{}", settled(&mut world));
        assert!(world.set_gravity(Vec3::new(0.0, Real::NAN, 0.0)).is_err());
    }

    #[test]
    fn a_softer_material_sinks_in_further_and_less_friction_slides() {
        let (mut world, table, cube) = resting();
        let height = |world: &World| world.body(cube).unwrap().pose().translation.z;
        let stiff = height(&world);
        let soft = Material::preset("rubber").unwrap();
        let soft = soft.clone().with_elasticity(0.1 * soft.young_modulus, soft.poisson_ratio, soft.layer_thickness).unwrap();
        for handle in [table, cube] {
            world.set_material(handle, &soft).unwrap();
        }
        for _ in 0..500 {
            world.step();
        }
        // At rest on springs in series: ten times softer, ten times as deep.
        let ratio = (height(&world) - 0.015) / (stiff - 0.015);
        assert!((ratio - 10.0).abs() < 0.5, "{ratio}");

        let pull = Vec3::new(0.3, 0.0, 0.0);
        world.body_mut(cube).unwrap().set_external_wrench(pull, Vec3::zeros()).unwrap();
        for _ in 0..100 {
            world.step();
        }
        assert!(world.body(cube).unwrap().linear_velocity().norm() < 1e-4, "{:?}", world.body(cube).unwrap().linear_velocity());
        for handle in [table, cube] {
            world.set_material(handle, &soft.clone().with_friction(0.1).unwrap()).unwrap();
        }
        for _ in 0..100 {
            world.step();
        }
        // m a = pull - mu m g, for 0.1 s.
        let expected = (0.3 - 0.1 * 0.1 * 9.81) / 0.1 * 0.1;
        let found = world.body(cube).unwrap().linear_velocity().x;
        assert!((found - expected).abs() < 0.05 * expected, "{found} {expected}");
    }

    #[test]
    fn bodies_are_listed_and_removed_ones_are_not() {
        let (mut world, table, cube) = resting();
        assert_eq!(world.rigid_bodies(), [table, cube]);
        world.remove_body(table).unwrap();
        assert_eq!(world.rigid_bodies(), [cube]);
        assert!(world.hand_handles().is_empty());
        assert!(world.set_material(table, &Material::preset("rubber").unwrap()).is_err());
    }
}

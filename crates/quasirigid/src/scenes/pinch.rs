//! A box between two soft pads that face each other along x: the smallest grasp there is.

use crate::body::{Amount, MassProperties, Motion, RigidBody};
use crate::collider::Material;
use crate::error::Result;
use crate::math::{Pose, Real, Vec3};
use crate::params::Parameters;
use crate::surface::{Surface, shapes};
use crate::world::{BodyHandle, World};
use nalgebra::UnitQuaternion;
use std::sync::Arc;

/// What to pinch, and with what.
#[derive(Debug, Clone)]
pub struct PinchOptions {
    /// Parameters of the world. Gravity is off until [`Pinch::set_gravity`].
    pub params: Parameters,
    /// Edges of the box, m.
    pub size: Vec3,
    /// Mass of the box, kg.
    pub mass: Real,
    /// Whether the box has inertia.
    pub motion: Motion,
    /// Material of the box.
    pub box_material: Material,
    /// Material of the pads.
    pub pad_material: Material,
    /// Semi-axes of the ellipsoid of a pad, m; the last along its outward direction.
    pub pad: Vec3,
    /// Points and control points of the box.
    pub box_points: (usize, usize),
    /// Points and control points of each pad.
    pub pad_points: (usize, usize),
}

impl PinchOptions {
    /// A 200 g wooden box of 50 mm between two fingertips, friction `mu` everywhere.
    ///
    /// # Errors
    /// [`crate::error::Error::InvalidValue`] for a friction coefficient that is not one.
    pub fn fingertips(mu: Real) -> Result<Self> {
        Ok(Self {
            params: Parameters::default(),
            size: Vec3::new(0.05, 0.05, 0.05),
            mass: 0.2,
            motion: Motion::Inertial,
            box_material: Material::preset("wood")?.with_friction(mu)?,
            pad_material: Material::preset("fingertip_pulp")?.with_friction(mu)?,
            pad: Vec3::new(0.009, 0.009, 0.008),
            box_points: (12_000, 1_600),
            pad_points: (1_200, 160),
        })
    }
}

/// The pinch: a world, the box, and the two pads, fixed bodies that are moved along x.
#[derive(Debug)]
pub struct Pinch {
    /// The world.
    pub world: World,
    /// The box, centred at the origin.
    pub object: BodyHandle,
    /// The pads at -x and +x.
    pub pads: [BodyHandle; 2],
}

impl Pinch {
    /// The scene before contact: pads 0.1 mm off the box, no gravity.
    ///
    /// # Errors
    /// Whatever the constructors refuse.
    pub fn new(options: &PinchOptions) -> Result<Self> {
        let mut world = World::new(Parameters { gravity: Vec3::zeros(), ..options.params.clone() })?;
        let mass = MassProperties::cuboid(options.size, Amount::Mass(options.mass))?;
        let surface = Surface::build(shapes::sample_box(options.size, options.box_points.0)?, Some(options.box_points.1))?;
        let body = RigidBody::free("box", mass, options.motion, Pose::identity())?;
        let object = world.add_body(body, Some((Arc::new(surface), options.box_material.clone())))?;
        let pad = Arc::new(Surface::build(shapes::sample_fingertip(options.pad, options.pad_points.0)?, Some(options.pad_points.1))?);
        let mut add = |name: &str, side: Real| -> Result<BodyHandle> {
            // The pad's +z turns to point at the box.
            let rotation = UnitQuaternion::from_axis_angle(&Vec3::y_axis(), -side * std::f64::consts::FRAC_PI_2);
            let x = side * (0.5 * options.size.x + options.pad.z + 1e-4);
            let body = RigidBody::fixed(name, Pose::from_parts(Vec3::new(x, 0.0, 0.0).into(), rotation))?;
            world.add_body(body, Some((pad.clone(), options.pad_material.clone())))
        };
        let pads = [add("pad -x", -1.0)?, add("pad +x", 1.0)?];
        Ok(Self { world, object, pads })
    }

    /// Normal force with which each pad presses, N.
    ///
    /// # Errors
    /// [`crate::error::Error::InvalidHandle`] if a pad was removed.
    pub fn normal_forces(&self) -> Result<[Real; 2]> {
        Ok([-self.world.contact_force_on(self.pads[0])?.x, self.world.contact_force_on(self.pads[1])?.x])
    }

    /// Moves both pads inwards until each presses with `force` (N) within 0.01 %, and then lets the box settle.
    ///
    /// # Errors
    /// [`crate::error::Error::InvalidHandle`] if a pad was removed.
    pub fn squeeze(&mut self, force: Real) -> Result<()> {
        let dt = self.world.parameters().dt;
        for _ in 0..(4.0 / dt) as usize {
            let pressed = self.normal_forces()?;
            if pressed.iter().all(|f| (f - force).abs() < 1e-4 * force) {
                break;
            }
            for (pad, side) in [(0, -1.0), (1, 1.0)] {
                let speed = (0.02 * (force - pressed[pad])).clamp(-0.02, 0.02);
                self.shift_pad(pad, Vec3::new(-side * speed * dt, 0.0, 0.0))?;
            }
            self.world.step();
        }
        self.run(0.3);
        Ok(())
    }

    /// Moves a pad by `shift` (m, world) during the next step.
    ///
    /// # Errors
    /// [`crate::error::Error::InvalidHandle`] if the pad was removed.
    pub fn shift_pad(&mut self, pad: usize, shift: Vec3) -> Result<()> {
        let body = self.world.body_mut(self.pads[pad])?;
        let mut target = *body.pose();
        target.translation.vector += shift;
        body.move_to(target)
    }

    /// Switches gravity on (m/s^2, world).
    ///
    /// # Errors
    /// [`crate::error::Error::InvalidValue`] if it is not finite.
    pub fn set_gravity(&mut self, gravity: Vec3) -> Result<()> {
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

//! The paper's scene (design section 6): a box of 36,000 points on a support, three fingers of 4 joints with tips of 2,400 points above it.

use crate::body::{Amount, HandModel, MassProperties, Motion, RigidBody};
use crate::collider::Material;
use crate::control::grip::{Grip, GripState, PadPath};
use crate::error::Result;
use crate::math::{Pose, Real, Vec3};
use crate::params::Parameters;
use crate::surface::{Surface, shapes};
use crate::world::{BodyHandle, HandHandle, Pads, World};
use std::sync::Arc;

/// What is grasped, and how.
#[derive(Debug, Clone)]
pub struct GraspOptions {
    /// Parameters of the world.
    pub params: Parameters,
    /// Edges of the box, m.
    pub size: Vec3,
    /// Mass of the box, kg.
    pub mass: Real,
    /// Whether the box has inertia.
    pub object_motion: Motion,
    /// Material of the box.
    pub object_material: Material,
    /// Material of the fingertips.
    pub pad_material: Material,
    /// Squeeze of the thumb, N; each finger presses with half of it.
    pub squeeze: Real,
    /// Points and control points of the box.
    pub object_points: (usize, usize),
    /// Points and control points of each fingertip.
    pub pad_points: (usize, usize),
}

impl Default for GraspOptions {
    /// The benchmark: 0.2 kg, friction 0.8, 4 N.
    fn default() -> Self {
        // Presets exist by their names; a test of the materials sees to it.
        let material = |name: &str| Material::preset(name).and_then(|m| m.with_friction(0.8)).unwrap_or_else(|_| unreachable!());
        Self {
            params: Parameters::default(),
            size: Vec3::new(0.06, 0.06, 0.06),
            mass: 0.2,
            object_motion: Motion::Inertial,
            object_material: material("wood"),
            pad_material: material("fingertip_pulp"),
            squeeze: 4.0,
            object_points: (36_000, 4_800),
            pad_points: (Pads::POINTS, Pads::CONTROL_POINTS),
        }
    }
}

/// The scene.
#[derive(Debug)]
pub struct GraspScene {
    /// The world.
    pub world: World,
    /// The box; its lower face starts at z = 0.
    pub object: BodyHandle,
    /// The pedestal below it, until [`GraspScene::remove_support`].
    pub support: Option<BodyHandle>,
    /// The hand.
    pub hand: HandHandle,
    /// The controller that closes it.
    pub grip: Grip,
}

/// Depth of the pads' centres below the palm, m: in the middle of the hand's reach.
const PAD_DEPTH: Real = 0.085;
/// Distance of the pads from the box before they close, m.
const CLEARANCE: Real = 0.008;
/// Edge of the pedestal, m, and its thickness of rubber.
const SUPPORT: Vec3 = Vec3::new(0.03, 0.03, 0.01);

impl GraspScene {
    /// The scene before the fingers close.
    ///
    /// # Errors
    /// Whatever the constructors refuse: a box too wide for the hand, say.
    pub fn new(options: &GraspOptions) -> Result<Self> {
        let mut world = World::new(options.params.clone())?;
        let size = options.size;
        let mass = MassProperties::cuboid(size, Amount::Mass(options.mass))?;
        let surface = Surface::build(shapes::sample_box(size, options.object_points.0)?, Some(options.object_points.1))?;
        let body = RigidBody::free("box", mass, options.object_motion, Pose::translation(0.0, 0.0, 0.5 * size.z))?;
        let object = world.add_body(body, Some((Arc::new(surface), options.object_material.clone())))?;
        let support = Surface::build(shapes::sample_box(SUPPORT, 2_000)?, Some(260))?;
        let body = RigidBody::fixed("support", Pose::translation(0.0, 0.0, -0.5 * SUPPORT.z))?;
        let support = Some(world.add_body(body, Some((Arc::new(support), Material::preset("rubber")?)))?);

        let model = HandModel::three_finger()?;
        let base = Pose::translation(0.0, 0.0, 0.5 * size.z + PAD_DEPTH);
        let (points, control_points) = options.pad_points;
        let pads = Pads { points, control_points, material: options.pad_material.clone() };
        let hand = world.add_hand_with_pads(&model, base, Motion::Inertial, &pads)?;
        let paths: Vec<PadPath> = model
            .knuckles()
            .map(|knuckle| {
                let side = knuckle.x.signum();
                let start = Vec3::new(side * (0.5 * size.x + CLEARANCE), knuckle.y, -PAD_DEPTH);
                PadPath { start, direction: Vec3::x() * -side, share: if side < 0.0 { 1.0 } else { 0.5 } }
            })
            .collect();
        let grip = Grip::new(&mut world, hand, &paths, options.squeeze)?;
        Ok(Self { world, object, support, hand, grip })
    }

    /// One step of controller and world.
    ///
    /// # Errors
    /// [`crate::error::Error::InvalidHandle`] if the hand was removed.
    pub fn step(&mut self) -> Result<crate::StepReport> {
        self.grip.update(&mut self.world)?;
        Ok(self.world.step())
    }

    /// Closes and squeezes until the controller holds; at most `limit` seconds. Returns whether it holds.
    ///
    /// # Errors
    /// As [`GraspScene::step`].
    pub fn close(&mut self, limit: Real) -> Result<bool> {
        for _ in 0..(limit / self.world.parameters().dt) as usize {
            if self.grip.state() == GripState::Holding {
                return Ok(true);
            }
            self.step()?;
        }
        Ok(false)
    }

    /// Takes the pedestal away.
    ///
    /// # Errors
    /// [`crate::error::Error::InvalidHandle`] if it was removed by hand.
    pub fn remove_support(&mut self) -> Result<()> {
        match self.support.take() {
            Some(support) => self.world.remove_body(support),
            None => Ok(()),
        }
    }

    /// Steps for `duration` seconds.
    ///
    /// # Errors
    /// As [`GraspScene::step`].
    pub fn run(&mut self, duration: Real) -> Result<()> {
        for _ in 0..(duration / self.world.parameters().dt).round() as usize {
            self.step()?;
        }
        Ok(())
    }
}

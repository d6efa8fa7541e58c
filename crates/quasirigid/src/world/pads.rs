//! The pads of a hand where a user does not bring their own.

use super::World;
use super::handles::HandHandle;
use crate::body::{HandModel, Motion};
use crate::collider::Material;
use crate::error::Result;
use crate::math::Pose;
use crate::surface::shapes;

/// The pads of a hand: half ellipsoids as its model has them.
#[derive(Debug, Clone)]
pub struct Pads {
    /// Surface points of each.
    pub points: usize,
    /// Control points of each.
    pub control_points: usize,
    /// What they are made of.
    pub material: Material,
}

impl Pads {
    /// Surface points of the usual pad, as in the paper.
    pub const POINTS: usize = 2_400;
    /// Control points of the usual pad: 7.5 surface points to each, as in the paper.
    pub const CONTROL_POINTS: usize = 320;

    /// Pads of the usual sampling, of fingertip pulp.
    ///
    /// # Errors
    /// None in practice: the preset exists.
    pub fn usual() -> Result<Self> {
        Ok(Self { points: Self::POINTS, control_points: Self::CONTROL_POINTS, material: Material::preset("fingertip_pulp")? })
    }
}

impl World {
    /// Adds a hand with its base at `base`; every fingertip gets a pad of the size that the model's first tip has.
    ///
    /// # Errors
    /// Too few points; as [`World::add_hand`].
    pub fn add_hand_with_pads(&mut self, model: &HandModel, base: Pose, motion: Motion, pads: &Pads) -> Result<HandHandle> {
        let pad = shapes::sample_fingertip(model.tips()[0].pad_semi_axes, pads.points)?;
        self.add_hand(model, base, motion, &pad, Some(pads.control_points), &pads.material)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Parameters;

    #[test]
    fn every_finger_gets_the_pad_of_its_tip() {
        let model = HandModel::three_finger().unwrap();
        let mut world = World::new(Parameters::default()).unwrap();
        let pads = Pads { points: 300, control_points: 40, ..Pads::usual().unwrap() };
        let hand = world.add_hand_with_pads(&model, Pose::identity(), Motion::Inertial, &pads).unwrap();
        assert_eq!(world.hand(hand).unwrap().fingers.len(), 3);
        let fingers = world.hand(hand).unwrap().fingers.clone();
        for (finger, tip) in fingers.into_iter().zip(model.tips()) {
            let skin = world.skin(finger).unwrap().unwrap();
            assert_eq!((skin.surface.points.len(), skin.surface.control.len()), (300, 40));
            assert_eq!(skin.material.name, "fingertip_pulp");
            // The middle of the palmar surface is where the model says that the pad touches.
            let apex = tip.apex().translation.vector;
            let nearest = skin.surface.points.iter().map(|p| (p - apex).norm()).fold(f64::INFINITY, f64::min);
            assert!(nearest < skin.surface.spacing, "the nearest point is {nearest:e} m from the apex");
        }
        assert!(world.add_hand_with_pads(&model, Pose::identity(), Motion::Inertial, &Pads { points: 0, ..pads }).is_err());
    }
}

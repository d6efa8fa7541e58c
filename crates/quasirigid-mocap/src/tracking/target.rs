//! What tracking gives: where palm and fingertips of a hand should be.

use crate::{Pose, Vec3};

/// How a target stands.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum TargetState {
    /// Seen.
    Live,
    /// Not seen, weight still up.
    Held,
    /// Not seen, weight going down.
    Fading,
    /// Not seen for long: weight 0.
    Lost,
}

/// Where a palm or fingertip should be.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Target {
    /// In the world.
    pub pose: Pose,
    /// m/s, world.
    pub linear_velocity: Vec3,
    /// rad/s, world.
    pub angular_velocity: Vec3,
    /// 0 to 1: how much to believe it. Continuous in time.
    pub weight: f64,
    /// m; 0 for the palm.
    pub pad_radius: f64,
    /// Seen or not.
    pub state: TargetState,
}

impl Target {
    /// Middle of the pad's palmar surface (m, world), and the unit vector out of it: the pad faces -z of the tip frame.
    pub fn pad_place(&self) -> (Vec3, Vec3) {
        // Minus the third column of the rotation matrix.
        let q = self.pose.rotation;
        let (w, x, y, z) = (q.w, q.i, q.j, q.k);
        let outwards = Vec3::new(-2.0 * (x * z + w * y), -2.0 * (y * z - w * x), 2.0 * (x * x + y * y) - 1.0);
        (self.pose.translation.vector + outwards * self.pad_radius, outwards)
    }
}

/// A hand at the moment it was asked for.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct HandTargets {
    /// The palm; None if it was never seen.
    pub palm: Option<Target>,
    /// By [`crate::Finger`]; None for those never seen.
    pub fingers: [Option<Target>; 5],
    /// How far in the past the hand is shown, s.
    pub delay: f64,
    /// Time on the tracker's clock that is shown, s.
    pub time: f64,
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Rot;

    #[test]
    fn the_middle_of_a_pad_lies_a_radius_along_minus_z_of_the_tip() {
        for theta in [Vec3::zeros(), Vec3::new(0.4, -1.1, 2.0), Vec3::new(-2.0, 0.3, 0.1)] {
            let pose = Pose::from_parts(Vec3::new(0.1, -0.2, 0.3).into(), Rot::from_scaled_axis(theta));
            let target = Target {
                pose,
                linear_velocity: Vec3::zeros(),
                angular_velocity: Vec3::zeros(),
                weight: 1.0,
                pad_radius: 0.008,
                state: TargetState::Live,
            };
            let (place, outwards) = target.pad_place();
            let off = [place - (pose * nalgebra::Point3::new(0.0, 0.0, -0.008)).coords, outwards - pose.rotation * -Vec3::z()];
            assert!(off.iter().all(|off| off.amax() < 1e-15), "{off:?}");
        }
    }
}

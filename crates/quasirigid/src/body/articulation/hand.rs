//! Hands: fingers on one base, each with a soft pad at its tip. The built-in hand has a thumb and two fingers.

use super::Finger;
use super::model::{FingerModel, JointModel};
use crate::body::Motion;
use crate::body::mass_properties::{Amount, MassProperties};
use crate::body::pose::check_pose;
use crate::error::{Error, Result, check_positive};
use crate::math::{Pose, Real, Rot, Vec3};
use serde::{Deserialize, Serialize};
use std::f64::consts::{FRAC_PI_2, PI};

/// The soft pad at the end of a finger: an ellipsoid.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct FingerTip {
    /// Pad frame in the frame of the last link. Origin: centre of the ellipsoid. z: palmar, out of the pad; x: towards the end
    /// of the finger, along the pad; y: sideways.
    pub pose: Pose,
    /// Semi-axes of the pad along x, y, z of the pad frame (m).
    pub pad_semi_axes: Vec3,
}

impl FingerTip {
    /// The same frame moved to the middle of the pad's palmar surface: the point that touches a flat that faces the pad.
    pub fn apex(&self) -> Pose {
        self.pose * Pose::translation(0.0, 0.0, self.pad_semi_axes.z)
    }

    fn check(&self) -> Result<()> {
        check_pose("pad frame", &self.pose)?;
        self.pad_semi_axes.iter().try_for_each(|axis| check_positive("pad semi-axis", *axis, "m"))
    }
}

/// A hand: fingers in one hand frame, and their pads.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "Unchecked")]
pub struct HandModel {
    name: String,
    fingers: Vec<FingerModel>,
    tips: Vec<FingerTip>,
}

/// What is read where a hand is expected, before it is checked.
#[derive(Deserialize)]
struct Unchecked {
    name: String,
    fingers: Vec<FingerModel>,
    tips: Vec<FingerTip>,
}

impl TryFrom<Unchecked> for HandModel {
    type Error = Error;

    fn try_from(read: Unchecked) -> Result<Self> {
        Self::new(read.name, read.fingers, read.tips)
    }
}

// Sizes of the built-in hand (m).
// Joint to joint as in the index finger of a hand 185 to 190 mm long: B. Buchholz, T. J. Armstrong, S. A. Goldstein,
// Anthropometric data for describing the kinematics of the human hand, Ergonomics 35 (1992); the distal one is measured to the
// end of the finger. The thumb is a third finger of the same make.
const PROXIMAL: Real = 0.045;
const MIDDLE: Real = 0.028;
const DISTAL: Real = 0.022;
/// Radii of the phalanges, half of a finger's breadth at each.
const RADII: [Real; 3] = [0.009, 0.008, 0.007];
/// Knuckles beside the middle of the palm: things of 10 to 80 mm are all in reach of facing pads.
const KNUCKLE_SIDE: Real = 0.040;
/// Knuckles below the palm: puts objects at a depth of 70 to 95 mm within reach of bent fingers.
const KNUCKLE_DEPTH: Real = 0.017;
/// Half the distance between the two fingers' centres, as of neighbouring human fingers.
const FINGER_SPREAD: Real = 0.012;
/// Soft tissue and bone together (kg/m^3).
const FINGER_DENSITY: Real = 1100.0;

/// Semi-axes of a pad: a fingertip 17 mm broad and 14 mm deep, its pulp 24 mm long.
const PAD_SEMI_AXES: [Real; 3] = [0.012, 0.0085, 0.007];
/// Centre of the pad beyond the last joint.
const PAD_CENTER: Real = 0.012;
/// The pad looks palmar and forwards by this angle: people press a surface with the pulp at 30 to 45 degrees to the bone
/// (D. T. V. Pawluk, R. D. Howe, J. Biomech. Eng. 121, 1999, load it at 20 to 40 degrees; B. M. Dzidek, M. J. Adams,
/// J. W. Andrews, Z. Zhang, S. A. Johnson, J. R. Soc. Interface 14, 2017, at 30 and 45).
const PAD_TILT: Real = PI / 4.0;

/// One joint of the built-in finger. Limits in degrees.
struct Row {
    name: &'static str,
    limits: [Real; 2],
    stiffness: Real,
    damping: Real,
    torque_limit: Real,
}

// Flexion limits are human. Extension limits (-60 at the knuckle, -45 at the last joint) go beyond what a person moves actively
// (about -45 and -10): with them the pads stay parallel at all widths and depths, where a person would tilt them.
//
// Gains: the pad should yield to a force across it by 1 to 3 kN/m. With lever arms of about 70, 40 and 12 mm from the three
// flexion joints, 1 / (sum l^2 / K) = 1.6 kN/m; sideways the knuckle alone gives K / l^2 = 2.4 kN/m. Damping: critical,
// D = 2 sqrt(K I), I the inertia of the finger beyond the joint (about 6e-5, 9e-6 and 1e-6 kg m^2) plus the armature.
// Torque limits: more than 25 N at the pad, above what grasping hand-sized things takes.
const ROWS: [Row; 4] = [
    Row { name: "abduction", limits: [-20.0, 20.0], stiffness: 12.0, damping: 0.07, torque_limit: 3.0 },
    Row { name: "proximal", limits: [-60.0, 90.0], stiffness: 12.0, damping: 0.07, torque_limit: 3.0 },
    Row { name: "middle", limits: [0.0, 110.0], stiffness: 8.0, damping: 0.045, torque_limit: 2.0 },
    Row { name: "distal", limits: [-45.0, 90.0], stiffness: 4.0, damping: 0.03, torque_limit: 1.0 },
];
/// Inertia of a small geared motor at the joint (kg m^2); a modelling choice of the size of the finger's own.
const ARMATURE: Real = 5e-5;
/// Passive joint viscosity (N m s/rad); a modelling choice, a fifth of the controller's damping or less.
const VISCOSITY: Real = 0.005;

impl HandModel {
    /// A hand of 1 or more fingers, one tip per finger.
    ///
    /// # Errors
    /// No finger, another number of tips than fingers, bad tip frames or semi-axes.
    pub fn new(name: impl Into<String>, fingers: Vec<FingerModel>, tips: Vec<FingerTip>) -> Result<Self> {
        if fingers.is_empty() {
            return Err(Error::shape("fingers of a hand", "at least one", 0, "add a finger"));
        }
        if tips.len() != fingers.len() {
            return Err(Error::shape(
                "tips of a hand",
                format!("{}, one per finger", fingers.len()),
                tips.len(),
                "give one tip per finger",
            ));
        }
        tips.iter().try_for_each(FingerTip::check)?;
        Ok(Self { name: name.into(), fingers, tips })
    }

    /// The built-in hand: a thumb and two fingers that oppose it, 4 joints each (abduction, proximal, middle, distal).
    ///
    /// Hand frame: origin in the palm. Fingers point along -z when straight (q = 0). The thumb (finger 0) stands at x = -40 mm,
    /// y = 0 and faces +x; the fingers 1 and 2 at x = +40 mm, y = +12 and -12 mm, face -x. Knuckles 17 mm below the palm.
    /// Positive flexion moves a pad towards the other side.
    ///
    /// # Errors
    /// None in practice: the figures are constants.
    pub fn three_finger() -> Result<Self> {
        let base = |x: Real, y: Real, angle: Real| {
            Pose::from_parts(Vec3::new(x, y, -KNUCKLE_DEPTH).into(), Rot::from_axis_angle(&Vec3::z_axis(), angle))
        };
        let fingers = vec![
            built_in_finger("thumb", base(-KNUCKLE_SIDE, 0.0, 0.0))?,
            built_in_finger("first_finger", base(KNUCKLE_SIDE, FINGER_SPREAD, PI))?,
            built_in_finger("second_finger", base(KNUCKLE_SIDE, -FINGER_SPREAD, PI))?,
        ];
        Self::new("three_finger", fingers, vec![built_in_tip(); 3])
    }

    /// The same hand with the stiffness and the damping of all position controllers multiplied by these factors.
    ///
    /// # Errors
    /// See [`FingerModel::with_gains`].
    pub fn with_gains(&self, stiffness: Real, damping: Real) -> Result<Self> {
        let fingers = self.fingers.iter().map(|finger| finger.with_gains(stiffness, damping)).collect::<Result<_>>()?;
        Self::new(self.name.clone(), fingers, self.tips.clone())
    }

    /// Radii of the proximal, middle and distal phalanx of the built-in hand, m.
    pub const THREE_FINGER_LINK_RADII: [Real; 3] = RADII;

    /// Where the first joint of each finger is, hand frame, m.
    pub fn knuckles(&self) -> impl Iterator<Item = Vec3> + '_ {
        self.fingers.iter().map(|finger| finger.base().translation.vector)
    }

    /// What the hand is called.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// The fingers.
    pub fn fingers(&self) -> &[FingerModel] {
        &self.fingers
    }

    /// The pads, one per finger.
    pub fn tips(&self) -> &[FingerTip] {
        &self.tips
    }

    /// The fingers as bodies at rest, straight as far as their limits allow, the hand frame at `pose` in the world. In a
    /// world they are moved together, by [`crate::World::move_hand_to`].
    ///
    /// # Errors
    /// A pose that is not finite; see [`Finger::new`].
    pub fn instantiate(&self, pose: Pose, motion: Motion) -> Result<Vec<Finger>> {
        self.fingers
            .iter()
            .map(|model| {
                let straight: Vec<Real> = model.joints().iter().map(|joint| 0.0_f64.clamp(joint.lower, joint.upper)).collect();
                Finger::new(model.clone(), motion, pose, &straight)
            })
            .collect()
    }
}

/// Finger frame: the finger hangs along -z, its palmar side looks along +x, y to the side. A turn about -y takes -z to +x: flexion.
fn built_in_finger(name: &str, base: Pose) -> Result<FingerModel> {
    let flexion = -Vec3::y();
    // The carrier between the two axes of the knuckle: the soft tissue around it.
    let knuckle = MassProperties::sphere(RADII[0], Amount::Density(FINGER_DENSITY))?;
    let links = [knuckle, phalanx(PROXIMAL, RADII[0])?, phalanx(MIDDLE, RADII[1])?, phalanx(DISTAL, RADII[2])?];
    let parents = [0.0, 0.0, PROXIMAL, MIDDLE];
    let axes = [Vec3::x(), flexion, flexion, flexion];
    let joints = ROWS.iter().zip(links).zip(parents).zip(axes).map(|(((row, link), parent), axis)| JointModel {
        name: row.name.into(),
        origin: Pose::translation(0.0, 0.0, -parent),
        axis,
        lower: row.limits[0].to_radians(),
        upper: row.limits[1].to_radians(),
        viscosity: VISCOSITY,
        armature: ARMATURE,
        stiffness: row.stiffness,
        damping: row.damping,
        torque_limit: row.torque_limit,
        link,
    });
    FingerModel::new(name, base, joints.collect())
}

/// A capsule that hangs from the joint along -z. `length`: from joint to joint.
fn phalanx(length: Real, radius: Real) -> Result<MassProperties> {
    // Each cap reaches half a radius into the neighbouring phalanx: rounded ends without gaps between them.
    MassProperties::capsule(radius, length - radius, Amount::Density(FINGER_DENSITY))?.transformed(&Pose::translation(
        0.0,
        0.0,
        -0.5 * length,
    ))
}

fn built_in_tip() -> FingerTip {
    // In the link frame the palmar direction is +x and the finger ends towards -z. A turn of pi/2 about y brings z to +x and x to
    // -z; a further one by the tilt turns the pad's z forwards, towards the end of the finger.
    let rotation = Rot::from_axis_angle(&Vec3::y_axis(), FRAC_PI_2 + PAD_TILT);
    FingerTip { pose: Pose::from_parts(Vec3::new(0.0, 0.0, -PAD_CENTER).into(), rotation), pad_semi_axes: PAD_SEMI_AXES.into() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::body::Body;
    use crate::constrained_motion::advance;
    use crate::control::inverse_kinematics::{IkOptions, TipGoal, inverse_kinematics};
    use crate::free_motion::{StepContext, free_motion};
    use crate::math::Vec6;

    #[test]
    fn straight_fingers_hang_and_flexion_closes_them() {
        let hand = HandModel::three_finger().unwrap();
        for (model, tip) in hand.fingers().iter().zip(hand.tips()) {
            let side = model.base().translation.x.signum();
            let pad = |q: [Real; 4]| model.last_link_pose(&Pose::identity(), &q).unwrap() * tip.pose;
            let straight = pad([0.0; 4]);
            let expected = -KNUCKLE_DEPTH - PROXIMAL - MIDDLE - PAD_CENTER;
            assert!((straight.translation.z - expected).abs() < 1e-12, "{}", straight.translation.z);
            let normal = straight.rotation * Vec3::z();
            assert!((normal - Vec3::new(-side * PAD_TILT.cos(), 0.0, -PAD_TILT.sin())).norm() < 1e-12, "{normal}");
            for joint in 1..4 {
                let mut q = [0.0; 4];
                q[joint] = 0.1;
                assert!((pad(q).translation.x - straight.translation.x) * side < 0.0, "{} joint {joint} opens", model.name());
            }
        }
        let knuckles: Vec<Vec3> = hand.knuckles().collect();
        assert!((22e-3..=28e-3).contains(&(knuckles[1] - knuckles[2]).norm()));
    }

    #[test]
    fn gains_are_multiplied_and_nothing_else_changes() {
        let hand = HandModel::three_finger().unwrap();
        let stiffer = hand.with_gains(2.0, 0.5).unwrap();
        let pairs = hand.fingers().iter().zip(stiffer.fingers()).flat_map(|(a, b)| a.joints().iter().zip(b.joints()));
        for (before, after) in pairs {
            let expected = JointModel { stiffness: 2.0 * before.stiffness, damping: 0.5 * before.damping, ..before.clone() };
            assert_eq!(*after, expected);
        }
        assert_eq!(hand.with_gains(1.0, 1.0).unwrap(), hand);
        for wrong in [-1.0, Real::NAN, Real::INFINITY] {
            assert!(hand.with_gains(wrong, 1.0).is_err() && hand.with_gains(1.0, wrong).is_err());
        }
    }

    #[test]
    fn pads_face_each_other_at_all_widths_and_depths() {
        let hand = HandModel::three_finger().unwrap();
        for width in (10..=80).step_by(5) {
            for depth in (70..=95).step_by(5) {
                for (model, tip) in hand.fingers().iter().zip(hand.tips()) {
                    let knuckle = model.base().translation.vector;
                    let side = knuckle.x.signum();
                    let position = Vec3::new(side * 0.5e-3 * width as Real, knuckle.y, -1e-3 * depth as Real);
                    let goal = TipGoal::facing(position, Vec3::x() * -side).unwrap();
                    let found = inverse_kinematics(model, &tip.apex(), &goal, &[0.0, 0.2, 0.4, 0.2], &IkOptions::default()).unwrap();
                    assert!(
                        found.converged && found.position_error < 1e-4 && found.angle_error < 1e-3,
                        "{} width {width} mm, depth {depth} mm: {found:?}",
                        model.name()
                    );
                }
            }
        }
    }

    #[test]
    fn tip_yields_by_one_to_three_newton_per_millimetre() {
        let hand = HandModel::three_finger().unwrap();
        let (model, tip) = (&hand.fingers()[1], hand.tips()[1].apex());
        for width in [20e-3, 50e-3, 80e-3] {
            let goal = TipGoal::facing(Vec3::new(0.5 * width, FINGER_SPREAD, -0.085), -Vec3::x()).unwrap();
            let q = inverse_kinematics(model, &tip, &goal, &[0.0, 0.2, 0.4, 0.2], &IkOptions::default()).unwrap().positions;
            for direction in [Vec3::x(), Vec3::y()] {
                let mut body = Body::Finger(Finger::new(model.clone(), Motion::Inertial, Pose::identity(), &q[..4]).unwrap());
                let context = StepContext::new(1e-3, Vec3::zeros()).unwrap();
                let point = |body: &Body| (body.link_pose(3) * tip).translation.vector;
                let start = point(&body);
                for _ in 0..500 {
                    let torques = body.point_jacobian(3, &point(&body)).tr_mul(&direction);
                    let free = free_motion(&body, &context);
                    advance(&mut body, &free, &(free.displacement + free.response(&torques)), &torques, &context);
                }
                let stiffness = 1.0 / direction.dot(&(point(&body) - start));
                assert!((1e3..=3e3).contains(&stiffness), "width {width}, {direction}: {stiffness:.0} N/m");
            }
        }
    }

    /// Pushed aside by a force f that is small enough for the posture to stay as it is, a finger presses back with -f.
    #[test]
    fn a_finger_that_is_pushed_aside_presses_back_with_its_blocked_force() {
        let hand = HandModel::three_finger().unwrap();
        let (model, tip) = (&hand.fingers()[1], hand.tips()[1].apex());
        let q = [0.05, 0.3, 0.6, 0.4];
        let context = StepContext::new(1e-2, Vec3::zeros()).unwrap();
        for force in [Vec3::x(), Vec3::y(), Vec3::z(), Vec3::new(0.3, -0.5, 0.8)].map(|way| way * 1e-3) {
            let mut body = Body::Finger(Finger::new(model.clone(), Motion::Inertial, Pose::identity(), &q).unwrap());
            let point = |body: &Body| (body.link_pose(3) * tip).translation.vector;
            for _ in 0..500 {
                let torques = body.point_jacobian(3, &point(&body)).tr_mul(&force);
                let free = free_motion(&body, &context);
                advance(&mut body, &free, &(free.displacement + free.response(&torques)), &torques, &context);
            }
            let Body::Finger(finger) = &body else { unreachable!() };
            let wrong = (finger.blocked_force(3, &point(&body), &q).unwrap() + force).norm() / force.norm();
            assert!(wrong < 0.02, "{force}: {:.1} % off", 100.0 * wrong);
        }
    }

    #[test]
    fn controllers_reach_their_targets_with_small_and_large_steps() {
        for motion in [Motion::Inertial, Motion::QuasiStatic] {
            for dt in [1e-3, 1e-2] {
                let mut finger = HandModel::three_finger().unwrap().instantiate(Pose::identity(), motion).unwrap().remove(1);
                let target = [0.1, 0.5, 0.6, 0.3];
                finger.set_joint_targets(&target).unwrap();
                let mut body = Body::Finger(finger);
                let context = StepContext::new(dt, Vec3::zeros()).unwrap();
                let mut overshoot: Real = 0.0;
                for _ in 0..(0.3 / dt) as usize {
                    let free = free_motion(&body, &context);
                    advance(&mut body, &free, &free.displacement, &Vec6::zeros(), &context);
                    let Body::Finger(finger) = &body else { unreachable!() };
                    for ((q, t), torque) in finger.joint_positions().iter().zip(target).zip(finger.motor_torques()) {
                        overshoot = overshoot.max(q - t);
                        assert!(torque.abs() <= 3.0 + 1e-9, "torque {torque}");
                    }
                }
                let Body::Finger(finger) = &body else { unreachable!() };
                let error = finger.joint_positions().iter().zip(target).map(|(q, t)| (q - t).abs()).fold(0.0, Real::max);
                assert!(error < 1e-6, "{motion:?} dt {dt}: error {error:e}");
                assert!(overshoot < 0.1, "{motion:?} dt {dt}: overshoot {overshoot}");
            }
        }
    }

    #[test]
    fn bad_hands_are_refused() {
        let hand = HandModel::three_finger().unwrap();
        assert!(HandModel::new("none", vec![], vec![]).is_err());
        assert!(HandModel::new("short", hand.fingers().to_vec(), vec![built_in_tip()]).is_err());
        let mut tip = built_in_tip();
        tip.pad_semi_axes.x = Real::NAN;
        assert!(HandModel::new("nan", hand.fingers()[..1].to_vec(), vec![tip]).is_err());
        assert!(hand.instantiate(Pose::translation(Real::NAN, 0.0, 0.0), Motion::Inertial).is_err());
    }
}

//! A controller that closes a hand: every pad travels along its closing direction until it touches, then presses with its share
//! of the squeeze; then the joint targets are frozen, and the object is held by stiffness and friction alone.

use super::inverse_kinematics::{IkOptions, TipGoal, inverse_kinematics};
use crate::error::{Error, Result, check_finite, check_positive};
use crate::math::{Real, Vec3};
use crate::world::{HandHandle, World};
use serde::{Deserialize, Serialize};

/// Speed of a pad before it touches, m/s.
const CLOSING_SPEED: Real = 0.05;
/// Most speed of a pad while it presses, m/s.
const PRESSING_SPEED: Real = 0.02;
/// How fast a pad moves per newton that is missing, m/(s N): with 0.2 to 2 kN/m
/// of pad and finger in series the force settles in 20 to 250 ms.
const GAIN: Real = 0.02;
/// A pad that presses with this much has touched, N.
const TOUCH: Real = 0.02;
/// The squeeze is reached when every force stays within this share of its goal ...
const SETTLED: Real = 0.01;
/// ... for this long, s.
const SETTLE_TIME: Real = 0.1;
/// Motors within this share of their limit are at it.
const AT_LIMIT: Real = 1e-6;
/// A finger that cannot bring its pad nearer than this to where it shall be is at the end of its reach, m.
const OUT_OF_REACH: Real = 1e-3;
/// A pad that travelled this far without touching has missed, m.
const LONGEST_TRAVEL: Real = 0.06;

/// What the controller is doing.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub enum GripState {
    /// Pads travel until all have touched.
    Closing,
    /// Forces are being brought to the squeeze.
    Squeezing,
    /// Joint targets are frozen.
    Holding,
    /// Joint targets are frozen, though not every pad presses with its share: a
    /// motor is at its limit, or the finger is at the end of its reach.
    Weak,
    /// Pads travel back.
    Opening,
    /// Pads are back where they started.
    Open,
    /// A pad travelled all the way without touching.
    Missed,
}

/// Where a pad starts and which way it closes, hand frame.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct PadPath {
    /// Middle of the pad's palmar surface at the start, m.
    pub start: Vec3,
    /// Closing direction; also where the pad faces.
    pub direction: Vec3,
    /// Share of the squeeze that this pad presses with: 1 for a thumb, 1/2 for each of two fingers that oppose it.
    pub share: Real,
}

impl PadPath {
    /// One path for each finger, from as many starts (m), closing directions and shares. Without shares pads
    /// that close the same way, at less than a right angle to each other, share the squeeze evenly.
    ///
    /// # Errors
    /// [`Error::InvalidShape`] if the three are not of one length.
    pub fn of_fingers(starts: &[Vec3], directions: &[Vec3], shares: Option<&[Real]>) -> Result<Vec<Self>> {
        let even: Vec<Real>;
        let shares = match shares {
            Some(shares) => shares,
            None => {
                let same_way = |a: &Vec3| directions.iter().filter(|b| a.dot(b) > 0.0).count().max(1) as Real;
                even = directions.iter().map(|direction| 1.0 / same_way(direction)).collect();
                &even
            }
        };
        if directions.len() != starts.len() || shares.len() != starts.len() {
            let got = format!("{} starts, {} directions, {} shares", starts.len(), directions.len(), shares.len());
            return Err(Error::shape("paths of the pads", "as many of each", got, "give one of each per finger"));
        }
        let paths = starts.iter().zip(directions).zip(shares);
        Ok(paths.map(|((&start, &direction), &share)| Self { start, direction, share }).collect())
    }
}

#[derive(Debug, Clone, Serialize, Deserialize)]
struct Pad {
    path: PadPath,
    travel: Real,
    targets: Vec<Real>,
    /// How far the targets are off the path, m.
    error: Real,
}

/// The controller. Call [`Grip::update`] once before every [`World::step`].
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Grip {
    hand: HandHandle,
    squeeze: Real,
    state: GripState,
    pads: Vec<Pad>,
    settled_for: Real,
}

impl Grip {
    /// Takes over a hand and puts its joints at once where the pads are at the start of their paths.
    ///
    /// `squeeze`: force (N) of the side with share 1.
    ///
    /// # Errors
    /// [`Error::InvalidShape`] if there is not one path for each finger, [`Error::InvalidValue`] for numbers out of range
    /// and for a start that a finger does not reach, [`Error::InvalidHandle`] for a hand that was removed.
    pub fn new(world: &mut World, hand: HandHandle, paths: &[PadPath], squeeze: Real) -> Result<Self> {
        check_positive("squeeze", squeeze, "N")?;
        let fingers = world.hand(hand)?.fingers.len();
        if paths.len() != fingers {
            return Err(Error::shape(
                "paths of the pads",
                format!("{fingers}, one for each finger"),
                paths.len(),
                "give one path for each finger",
            ));
        }
        let mut pads = Vec::with_capacity(fingers);
        for (finger, path) in paths.iter().enumerate() {
            check_finite("start of a pad", path.start.iter())?;
            check_positive("length of a closing direction", path.direction.norm(), "-")?;
            check_positive("share of the squeeze", path.share, "-")?;
            let path = PadPath { direction: path.direction.normalize(), ..*path };
            let start = [0.0, 0.3, 0.5, 0.2].iter().copied().chain(std::iter::repeat(0.0)).take(world.finger(hand, finger)?.model().dof());
            let mut pad = Pad { path, travel: 0.0, targets: start.collect(), error: 0.0 };
            pad.solve(world, hand, finger, &IkOptions::default())?;
            if pad.error > OUT_OF_REACH {
                return Err(Error::value(
                    format!("start of pad {finger}"),
                    "a place within reach of the finger",
                    format!("{:?} m, missed by {:.1} mm", path.start.as_slice(), pad.error * 1e3),
                    "start nearer to the palm, or turn the hand",
                ));
            }
            pads.push(pad);
        }
        for (finger, pad) in pads.iter().enumerate() {
            let body = world.finger_mut(hand, finger)?;
            body.set_joint_positions(&pad.targets)?;
            body.set_joint_targets(&pad.targets)?;
        }
        Ok(Self { hand, squeeze, state: GripState::Closing, pads, settled_for: 0.0 })
    }

    /// What the controller is doing.
    pub fn state(&self) -> GripState {
        self.state
    }

    /// The hand that it moves.
    pub fn hand(&self) -> HandHandle {
        self.hand
    }

    /// The same controller for the hand of another world, which is a copy of the one that
    /// it was made in; or its state at another time, for the same world.
    ///
    /// # Errors
    /// [`Error::InvalidHandle`] if `world` has no such hand, or one with other fingers;
    /// [`Error::InvalidValue`] for a controller that was read and holds what none does.
    pub fn for_copy(&self, world: &World) -> Result<Self> {
        let hand = world.own_hand(self.hand)?;
        let joints = |finger: usize| world.finger(hand, finger).map(|finger| finger.model().dof());
        if world.hand(hand)?.fingers.len() != self.pads.len() {
            return Err(Error::handle("grip", "a hand with a finger for each pad", "another hand", "give it a copy of its own world"));
        }
        check_positive("squeeze", self.squeeze, "N")?;
        check_finite("time since the forces settled", &[self.settled_for])?;
        for (finger, pad) in self.pads.iter().enumerate() {
            if pad.targets.len() != joints(finger)? {
                return Err(Error::handle("grip", "a hand with as many joints", "another hand", "give it a copy of its own world"));
            }
            check_finite("targets of a pad", pad.targets.iter().chain([&pad.travel, &pad.error]))?;
            check_finite("path of a pad", pad.path.start.iter().chain(&pad.path.direction).chain([&pad.path.share]))?;
        }
        Ok(Self { hand, ..self.clone() })
    }

    /// The squeeze, N.
    pub fn squeeze(&self) -> Real {
        self.squeeze
    }

    /// Asks for another squeeze (N); a held object is squeezed again.
    ///
    /// # Errors
    /// [`Error::InvalidValue`] if it is not finite and positive.
    pub fn set_squeeze(&mut self, squeeze: Real) -> Result<()> {
        check_positive("squeeze", squeeze, "N")?;
        self.squeeze = squeeze;
        if matches!(self.state, GripState::Holding | GripState::Weak) {
            (self.state, self.settled_for) = (GripState::Squeezing, 0.0);
        }
        Ok(())
    }

    /// Freezes the joint targets as they are.
    pub fn hold(&mut self) {
        self.state = GripState::Holding;
    }

    /// Lets go: the pads travel back to their start.
    pub fn open(&mut self) {
        self.state = GripState::Opening;
    }

    /// Closes again; pads that have missed start again from the start of their paths.
    pub fn close(&mut self) {
        if self.state == GripState::Missed {
            self.pads.iter_mut().for_each(|pad| pad.travel = 0.0);
        }
        (self.state, self.settled_for) = (GripState::Closing, 0.0);
    }

    /// Force with which each pad pressed along its closing direction in the last step, N.
    ///
    /// # Errors
    /// [`Error::InvalidHandle`] if the hand was removed.
    pub fn forces(&self, world: &World) -> Result<Vec<Real>> {
        let hand = world.hand(self.hand)?;
        let pads = self.pads.iter().zip(&hand.fingers);
        pads.map(|(pad, &finger)| Ok(-world.contact_force_on(finger)?.dot(&(hand.base.rotation * pad.path.direction)))).collect()
    }

    /// Moves the joint targets by one time step of the world.
    ///
    /// # Errors
    /// [`Error::InvalidHandle`] if the hand was removed.
    pub fn update(&mut self, world: &mut World) -> Result<()> {
        let dt = world.parameters().dt;
        let forces = self.forces(world)?;
        match self.state {
            GripState::Closing => {
                for (pad, force) in self.pads.iter_mut().zip(&forces) {
                    // A pad that has touched presses lightly until the others have touched.
                    let speed = if *force < TOUCH { CLOSING_SPEED } else { (GAIN * (2.0 * TOUCH - force)).clamp(-PRESSING_SPEED, 0.0) };
                    pad.travel += speed * dt;
                }
                if self.pads.iter().any(|pad| pad.travel > LONGEST_TRAVEL) {
                    self.state = GripState::Missed;
                } else if forces.iter().all(|&force| force >= TOUCH) {
                    self.state = GripState::Squeezing;
                }
            }
            GripState::Squeezing => {
                let shares: Vec<Real> = self.pads.iter().map(|pad| self.squeeze * pad.path.share).collect();
                let is_short = |finger: usize| shares[finger] - forces[finger] > SETTLED * shares[finger];
                let mut weak = false;
                for (finger, pad) in self.pads.iter().enumerate().filter(|(finger, _)| is_short(*finger)) {
                    weak |= pad.error > OUT_OF_REACH || motors_at_limit(world, self.hand, finger)?;
                }
                let mut settled = true;
                for (finger, pad) in self.pads.iter_mut().enumerate() {
                    // Where the motors behind one pad are at their limit, no other presses further against it: what
                    // it travelled would only have to be undone before it lets go.
                    if weak && is_short(finger) {
                        continue;
                    }
                    let missing = shares[finger] - forces[finger];
                    pad.travel += (GAIN * missing).clamp(-PRESSING_SPEED, PRESSING_SPEED) * dt;
                    settled &= missing.abs() < SETTLED * shares[finger];
                }
                self.settled_for = if settled { self.settled_for + dt } else { 0.0 };
                if self.settled_for >= SETTLE_TIME {
                    self.state = if weak { GripState::Weak } else { GripState::Holding };
                }
            }
            GripState::Opening => {
                self.pads.iter_mut().for_each(|pad| pad.travel = (pad.travel - CLOSING_SPEED * dt).max(0.0));
                if self.pads.iter().all(|pad| pad.travel == 0.0) {
                    self.state = GripState::Open;
                }
            }
            GripState::Holding | GripState::Weak | GripState::Open | GripState::Missed => return Ok(()),
        }
        // From step to step the pads move by micrometres: a few iterations from where they were.
        let options = IkOptions { max_iterations: 10, restarts: 0, ..IkOptions::default() };
        for (finger, pad) in self.pads.iter_mut().enumerate() {
            pad.solve(world, self.hand, finger, &options)?;
            world.finger_mut(self.hand, finger)?.set_joint_targets(&pad.targets)?;
        }
        Ok(())
    }
}

impl Pad {
    /// Joint targets for where the pad is on its path, and how far off they are.
    fn solve(&mut self, world: &World, hand: HandHandle, finger: usize, options: &IkOptions) -> Result<()> {
        let tip = world.hand(hand)?.model.tips()[finger].apex();
        let goal = TipGoal::facing(self.path.start + self.path.direction * self.travel, self.path.direction)?;
        let model = world.finger(hand, finger)?.model();
        let found = inverse_kinematics(model, &tip, &goal, &self.targets, options)?;
        let joints = self.targets.len();
        self.targets.copy_from_slice(&found.positions[..joints]);
        self.error = found.position_error;
        Ok(())
    }
}

/// Whether a motor of the finger was at its limit in the last step.
fn motors_at_limit(world: &World, hand: HandHandle, finger: usize) -> Result<bool> {
    let finger = world.finger(hand, finger)?;
    let motors = finger.motor_torques().iter().zip(finger.model().joints());
    Ok(motors.into_iter().any(|(torque, joint)| torque.abs() >= (1.0 - AT_LIMIT) * joint.torque_limit))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::Pose;
    use crate::scenes::{GraspOptions, GraspScene};

    fn scene() -> GraspScene {
        GraspScene::new(&GraspOptions { object_points: (1_500, 200), pad_points: (450, 60), ..GraspOptions::default() }).unwrap()
    }

    #[test]
    fn pads_that_close_the_same_way_share_the_squeeze() {
        let starts = [Vec3::zeros(); 3];
        let ways = [Vec3::x(), -Vec3::x(), Vec3::new(-0.8, 0.6, 0.0)];
        let shares =
            |given| PadPath::of_fingers(&starts, &ways, given).map(|paths| paths.iter().map(|path| path.share).collect::<Vec<_>>());
        assert_eq!(shares(None).unwrap(), [1.0, 0.5, 0.5]);
        assert_eq!(shares(Some(&[1.0, 0.3, 0.7])).unwrap(), [1.0, 0.3, 0.7]);
        let message = shares(Some(&[1.0])).unwrap_err().to_string();
        assert!(message.contains("3 starts, 3 directions, 1 shares"), "{message}");
        assert!(PadPath::of_fingers(&starts[..2], &ways, None).is_err());
    }

    /// Steps until the controller is in this state, and returns for how many.
    fn steps_until(scene: &mut GraspScene, state: GripState) -> usize {
        for step in 0..3_000 {
            if scene.grip.state() == state {
                return step;
            }
            scene.step().unwrap();
        }
        panic!("{:?}, not {state:?}", scene.grip.state());
    }

    #[test]
    fn a_squeeze_that_the_motors_cannot_give_ends_as_weak_and_lets_go_at_once() {
        let mut scene = scene();
        scene.grip.set_squeeze(500.0).unwrap();
        steps_until(&mut scene, GripState::Weak);
        let forces = scene.grip.forces(&scene.world).unwrap();
        scene.grip.open();
        let mut steps = 0;
        while scene.grip.forces(&scene.world).unwrap().iter().any(|force| *force > TOUCH) {
            scene.step().unwrap();
            steps += 1;
            assert!(steps < 1_000, "still pressing after a second");
        }
        println!("{forces:?} N, let go after {steps} steps");
        // With the deflection of fingers and pads under that force the targets are some 15 mm inside.
        assert!(steps < 700, "let go after {steps} steps");
        scene.grip.set_squeeze(4.0).unwrap();
        scene.grip.close();
        steps_until(&mut scene, GripState::Holding);
    }

    #[test]
    fn a_grip_that_has_missed_closes_again() {
        let mut scene = scene();
        let object = scene.object;
        let aside = Pose::translation(0.0, 0.5, 0.0) * scene.world.body(object).unwrap().pose();
        scene.world.body_mut(object).unwrap().set_pose(aside).unwrap();
        let first = steps_until(&mut scene, GripState::Missed);
        scene.grip.close();
        scene.step().unwrap();
        assert_eq!(scene.grip.state(), GripState::Closing);
        let again = steps_until(&mut scene, GripState::Missed);
        assert!(again > first / 2, "missed again after {again} steps, {first} at first");
    }
}

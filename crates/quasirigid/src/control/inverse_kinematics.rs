//! Joint positions that bring a fingertip where it should be: damped least squares within the joint limits.

use crate::body::articulation::dynamics::{Kinematics, forward_kinematics};
use crate::body::articulation::model::FingerModel;
use crate::body::pose::check_pose;
use crate::error::{Error, Result, check_finite, check_non_negative, check_positive};
use crate::math::{MAX_DOF, Mat6, Pose, Real, Rot, Vec3, Vec6};

/// What is asked of the tip's orientation.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum TipOrientation {
    /// Nothing.
    Free,
    /// The z axis of the tip frame along this direction (hand frame).
    Normal(Vec3),
    /// The whole rotation of the tip frame (hand frame).
    Rotation(Rot),
}

/// Where a tip frame should be, in the hand frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TipGoal {
    /// Position of its origin (m).
    pub position: Vec3,
    /// Its orientation.
    pub orientation: TipOrientation,
}

impl TipGoal {
    /// A position with the tip's z axis along `normal` (any length but zero), both in the hand frame.
    ///
    /// # Errors
    /// Non-finite numbers, a zero normal.
    pub fn facing(position: Vec3, normal: Vec3) -> Result<Self> {
        check_finite("tip position", position.iter())?;
        check_finite("tip normal", normal.iter())?;
        check_positive("length of the tip normal", normal.norm(), "-")?;
        Ok(Self { position, orientation: TipOrientation::Normal(normal.normalize()) })
    }

    /// A position only (hand frame).
    ///
    /// # Errors
    /// Non-finite numbers.
    pub fn at(position: Vec3) -> Result<Self> {
        check_finite("tip position", position.iter())?;
        Ok(Self { position, orientation: TipOrientation::Free })
    }

    /// A whole pose in the hand frame. A finger of less than six joints reaches few of them.
    ///
    /// # Errors
    /// A pose that is not finite.
    pub fn pose(pose: &Pose) -> Result<Self> {
        check_pose("tip pose", pose)?;
        Ok(Self { position: pose.translation.vector, orientation: TipOrientation::Rotation(pose.rotation) })
    }
}

/// How to search.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct IkOptions {
    /// How many metres of position error weigh as much as one radian (m/rad). Greater: orientation first. Default 0.02, about
    /// the length of the last phalanx.
    pub angle_weight: Real,
    /// Converged below this position error (m). Default 1e-5.
    pub position_tolerance: Real,
    /// Converged below this angle error (rad). Default 1e-4.
    pub angle_tolerance: Real,
    /// A search that gets no further ends: when a step moves no joint by more than this (rad). Default 1e-12, as
    /// small as a double can resolve. A goal that moves from step to step needs no more than it moves by.
    pub step_tolerance: Real,
    /// Damped steps per start. Default 100.
    pub max_iterations: usize,
    /// Further starts, spread evenly over the joint range, if the given one does not converge. Default 16.
    pub restarts: usize,
}

impl Default for IkOptions {
    fn default() -> Self {
        Self {
            angle_weight: 0.02,
            position_tolerance: 1e-5,
            angle_tolerance: 1e-4,
            step_tolerance: 1e-12,
            max_iterations: 100,
            restarts: 16,
        }
    }
}

/// What was found: the best joint positions seen, converged or not.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct IkSolution {
    /// Joint positions (rad), within the limits; zero beyond the joints.
    pub positions: [Real; MAX_DOF],
    /// Distance of the tip from the goal (m).
    pub position_error: Real,
    /// Angle between the tip and the goal orientation (rad); zero where none was asked for.
    pub angle_error: Real,
    /// Whether both errors are within their tolerance.
    pub converged: bool,
}

/// Joint positions at which the frame `tip` (in the frame of the last link) meets `goal` (in the hand frame), searched from
/// `start` (rad; taken to the nearest position within the limits).
///
/// Levenberg and Marquardt on the weighted errors r (position, then angle_weight times the rotation vector), J their Jacobian:
///
/// ```text
///     (J^T J + lambda diag(J^T J) + tiny) dq = -J^T r
/// ```
///
/// with the joints that stand at a limit and would leave it taken out, and the step cut at the limits (C. Wampler, IEEE Trans.
/// Systems, Man, Cybernetics 16, 1986, for the damping; J. J. More, 1978, for its scaling and control).
///
/// # Errors
/// Wrong number of joints, non-finite numbers, tolerances <= 0.
pub fn inverse_kinematics(model: &FingerModel, tip: &Pose, goal: &TipGoal, start: &[Real], options: &IkOptions) -> Result<IkSolution> {
    check_pose("tip frame", tip)?;
    check_finite("tip position", goal.position.iter())?;
    if let TipOrientation::Normal(normal) = &goal.orientation
        && (normal.norm() - 1.0).abs() > 1e-6
    {
        return Err(Error::value("tip normal", "a unit vector", format!("length {}", normal.norm()), "make the goal with TipGoal::facing"));
    }
    check_non_negative("angle weight", options.angle_weight, "m/rad")?;
    check_positive("position tolerance", options.position_tolerance, "m")?;
    check_positive("angle tolerance", options.angle_tolerance, "rad")?;
    check_non_negative("step tolerance", options.step_tolerance, "rad")?;
    let start = model.joint_vector("start of the search", start)?;

    let search = Search { model, tip, goal, options };
    let mut best = search.from(start);
    for restart in 1..=options.restarts {
        if best.converged {
            break;
        }
        let found = search.from(search.spread_start(restart));
        if search.cost_of(&found) < search.cost_of(&best) {
            best = found;
        }
    }
    Ok(best)
}

struct Search<'a> {
    model: &'a FingerModel,
    tip: &'a Pose,
    goal: &'a TipGoal,
    options: &'a IkOptions,
}

impl Search<'_> {
    /// Errors (m) in the hand frame, weighted, and their Jacobian, at joint positions `q`.
    fn errors(&self, q: &Vec6) -> (Vec6, Mat6) {
        let mut kinematics = Kinematics::default();
        forward_kinematics(self.model, &Pose::identity(), q, &mut kinematics);
        let last = self.model.dof() - 1;
        let frame = kinematics.links[last] * self.tip;
        let position = frame.translation.vector;
        let (weight, angular) = (self.options.angle_weight, kinematics.rotation_jacobian(last));
        let (mut errors, mut jacobian) = (Vec6::zeros(), Mat6::zeros());
        errors.fixed_rows_mut::<3>(0).copy_from(&(position - self.goal.position));
        jacobian.fixed_view_mut::<3, 6>(0, 0).copy_from(&kinematics.point_jacobian(last, &position));
        match &self.goal.orientation {
            TipOrientation::Free => {}
            TipOrientation::Normal(normal) => {
                // Rotation vector from the goal to the tip's z; it has no part along the goal, so turning about the normal is free.
                let rotation = rotation_between(normal, &(frame.rotation * Vec3::z()));
                errors.fixed_rows_mut::<3>(3).copy_from(&(rotation * weight));
                let across = angular - normal * (normal.transpose() * angular);
                jacobian.fixed_view_mut::<3, 6>(3, 0).copy_from(&(across * weight));
            }
            TipOrientation::Rotation(goal) => {
                let rotation = (frame.rotation * goal.inverse()).scaled_axis();
                errors.fixed_rows_mut::<3>(3).copy_from(&(rotation * weight));
                jacobian.fixed_view_mut::<3, 6>(3, 0).copy_from(&(angular * weight));
            }
        }
        (errors, jacobian)
    }

    fn clamp(&self, q: &Vec6) -> Vec6 {
        let joints = self.model.joints();
        Vec6::from_fn(|j, _| joints.get(j).map_or(0.0, |joint| q[j].clamp(joint.lower, joint.upper)))
    }

    fn from(&self, start: Vec6) -> IkSolution {
        let joints = self.model.joints();
        let mut q = self.clamp(&start);
        let (mut errors, mut jacobian) = self.errors(&q);
        let mut lambda = 1e-3;
        for _ in 0..self.options.max_iterations {
            let gradient = jacobian.tr_mul(&errors);
            let mut normal = jacobian.tr_mul(&jacobian);
            let mut descent = -gradient;
            for j in 0..MAX_DOF {
                let leaving = joints
                    .get(j)
                    .is_none_or(|joint| (q[j] >= joint.upper && descent[j] > 0.0) || (q[j] <= joint.lower && descent[j] < 0.0));
                if leaving {
                    normal.row_mut(j).fill(0.0);
                    normal.column_mut(j).fill(0.0);
                    normal[(j, j)] = 1.0;
                    descent[j] = 0.0;
                } else {
                    // The tiny part keeps a joint without effect on the errors where it is.
                    normal[(j, j)] += lambda * normal[(j, j)] + 1e-12;
                }
            }
            let Some(factor) = normal.cholesky() else { break };
            let trial = self.clamp(&(q + factor.solve(&descent)));
            let (trial_errors, trial_jacobian) = self.errors(&trial);
            if trial_errors.norm_squared() < errors.norm_squared() {
                let moved = (trial - q).amax();
                (q, errors, jacobian) = (trial, trial_errors, trial_jacobian);
                lambda = (lambda * 0.2).max(1e-12);
                if moved < self.options.step_tolerance {
                    break;
                }
            } else {
                lambda *= 8.0;
                if lambda > 1e9 {
                    break;
                }
            }
        }
        self.solution(&q)
    }

    fn solution(&self, q: &Vec6) -> IkSolution {
        let mut kinematics = Kinematics::default();
        forward_kinematics(self.model, &Pose::identity(), q, &mut kinematics);
        let frame = kinematics.links[self.model.dof() - 1] * self.tip;
        let position_error = (frame.translation.vector - self.goal.position).norm();
        let angle_error = match &self.goal.orientation {
            TipOrientation::Free => 0.0,
            TipOrientation::Normal(normal) => rotation_between(normal, &(frame.rotation * Vec3::z())).norm(),
            TipOrientation::Rotation(goal) => (frame.rotation * goal.inverse()).angle(),
        };
        let converged = position_error <= self.options.position_tolerance && angle_error <= self.options.angle_tolerance;
        IkSolution { positions: (*q).into(), position_error, angle_error, converged }
    }

    /// Weighted sum of squares of the errors (m^2).
    fn cost_of(&self, solution: &IkSolution) -> Real {
        solution.position_error.powi(2) + (self.options.angle_weight * solution.angle_error).powi(2)
    }

    /// Start number `index` >= 1: a Halton sequence over the joint range, one prime base per joint.
    fn spread_start(&self, index: usize) -> Vec6 {
        const BASES: [usize; MAX_DOF] = [2, 3, 5, 7, 11, 13];
        let joints = self.model.joints();
        Vec6::from_fn(|j, _| {
            let Some(joint) = joints.get(j) else { return 0.0 };
            let (mut fraction, mut value, mut rest) = (1.0, 0.0, index);
            while rest > 0 {
                fraction /= BASES[j] as Real;
                value += fraction * (rest % BASES[j]) as Real;
                rest /= BASES[j];
            }
            joint.lower + value * (joint.upper - joint.lower)
        })
    }
}

/// Shortest rotation vector that takes the unit vector `from` to the unit vector `to` (rad).
fn rotation_between(from: &Vec3, to: &Vec3) -> Vec3 {
    let (axis, cosine) = (from.cross(to), from.dot(to));
    let sine = axis.norm();
    if sine > 1e-12 {
        axis * (sine.atan2(cosine) / sine)
    } else if cosine > 0.0 {
        Vec3::zeros()
    } else {
        crate::math::any_perpendicular(from) * std::f64::consts::PI
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::body::HandModel;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn round_trip_within_the_limits(shares in prop::array::uniform4(0.0..1.0f64), finger in 0..3usize) {
            let hand = HandModel::three_finger().unwrap();
            let (model, tip) = (&hand.fingers()[finger], hand.tips()[finger].apex());
            let q: Vec<Real> = model.joints().iter().zip(shares).map(|(j, s)| j.lower + s * (j.upper - j.lower)).collect();
            let pose = model.last_link_pose(&Pose::identity(), &q).unwrap() * tip;
            let goals = [
                TipGoal::at(pose.translation.vector).unwrap(),
                TipGoal::facing(pose.translation.vector, pose.rotation * Vec3::z()).unwrap(),
                TipGoal::pose(&pose).unwrap(),
            ];
            for goal in goals {
                let found = inverse_kinematics(model, &tip, &goal, &[0.0, 0.2, 0.4, 0.2], &IkOptions::default()).unwrap();
                prop_assert!(found.converged, "{goal:?} from {q:?}: {found:?}");
                for (joint, position) in model.joints().iter().zip(found.positions) {
                    prop_assert!((joint.lower..=joint.upper).contains(&position));
                }
            }
        }
    }

    #[test]
    fn out_of_reach_is_said() {
        let hand = HandModel::three_finger().unwrap();
        let goal = TipGoal::at(Vec3::new(0.0, 0.0, -1.0)).unwrap();
        let found = inverse_kinematics(&hand.fingers()[0], &hand.tips()[0].apex(), &goal, &[0.0; 4], &IkOptions::default()).unwrap();
        assert!(!found.converged && found.position_error > 0.8, "{found:?}");
    }

    #[test]
    fn bad_input_is_refused() {
        let hand = HandModel::three_finger().unwrap();
        let (model, tip) = (&hand.fingers()[0], hand.tips()[0].apex());
        let solve = |goal: TipGoal, start: &[Real], options| inverse_kinematics(model, &tip, &goal, start, &options);
        let goal = TipGoal::at(Vec3::zeros()).unwrap();
        assert!(solve(goal, &[0.0; 3], IkOptions::default()).is_err());
        assert!(solve(goal, &[Real::NAN; 4], IkOptions::default()).is_err());
        assert!(solve(goal, &[0.0; 4], IkOptions { position_tolerance: 0.0, ..IkOptions::default() }).is_err());
        assert!(TipGoal::at(Vec3::repeat(Real::NAN)).is_err());
        assert!(TipGoal::facing(Vec3::zeros(), Vec3::zeros()).is_err());
    }
}

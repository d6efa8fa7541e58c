//! Kinematics and dynamics of a finger: link poses, Jacobians, mass matrix, bias torques.

use super::model::FingerModel;
use crate::error::Result;
use crate::math::{MAX_DOF, Mat3, Mat3x6, Mat6, Pose, Real, Rot, Vec3, Vec6};
use nalgebra::Unit;

/// Link poses and joint axes of a finger in the world. Entries beyond the joints are identity and zero.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Kinematics {
    /// Poses of the link frames; the origin of link `i` lies on the axis of joint `i`.
    pub links: [Pose; MAX_DOF],
    /// Unit axes of the joints.
    pub axes: [Vec3; MAX_DOF],
}

impl Default for Kinematics {
    fn default() -> Self {
        Self { links: [Pose::identity(); MAX_DOF], axes: [Vec3::zeros(); MAX_DOF] }
    }
}

impl Kinematics {
    /// Origin of joint `j` (m, world).
    pub fn origin(&self, j: usize) -> Vec3 {
        self.links[j].translation.vector
    }

    /// Jacobian of the point of `link` at `point` (m, world): `dp = sum_j z_j x (p - o_j) dq_j`, j up to `link`.
    pub fn point_jacobian(&self, link: usize, point: &Vec3) -> Mat3x6 {
        let mut jacobian = Mat3x6::zeros();
        for j in 0..=link.min(MAX_DOF - 1) {
            jacobian.set_column(j, &self.axes[j].cross(&(point - self.origin(j))));
        }
        jacobian
    }

    /// Jacobian of the rotation of `link` (world): `dtheta = sum_j z_j dq_j`, j up to `link`.
    pub fn rotation_jacobian(&self, link: usize) -> Mat3x6 {
        let mut jacobian = Mat3x6::zeros();
        for j in 0..=link.min(MAX_DOF - 1) {
            jacobian.set_column(j, &self.axes[j]);
        }
        jacobian
    }
}

/// Link poses and joint axes for joint positions `q` (rad), the hand frame having the pose `hand`.
pub fn forward_kinematics(model: &FingerModel, hand: &Pose, q: &Vec6, out: &mut Kinematics) {
    let mut parent = hand * model.base();
    for (j, joint) in model.joints().iter().enumerate() {
        let frame = parent * joint.origin;
        out.axes[j] = frame.rotation * joint.axis;
        out.links[j] = frame * Rot::from_axis_angle(&Unit::new_unchecked(joint.axis), q[j]);
        parent = out.links[j];
    }
}

impl FingerModel {
    /// Pose of the last link for joint positions `q` (rad), the hand frame having the pose `hand`.
    ///
    /// # Errors
    /// Wrong number of joint positions, or non-finite ones.
    pub fn last_link_pose(&self, hand: &Pose, q: &[Real]) -> Result<Pose> {
        let positions = self.joint_vector("joint positions", q)?;
        let mut kinematics = Kinematics::default();
        forward_kinematics(self, hand, &positions, &mut kinematics);
        Ok(kinematics.links[self.dof() - 1])
    }
}

/// Centre of mass (m) and inertia about it (kg m^2) of link `i`, world.
fn link_inertia(model: &FingerModel, kinematics: &Kinematics, i: usize) -> (Vec3, Mat3) {
    let (pose, link) = (&kinematics.links[i], &model.joints()[i].link);
    let rotation = pose.rotation.to_rotation_matrix().into_inner();
    (rotation * link.center_of_mass() + pose.translation.vector, rotation * link.inertia() * rotation.transpose())
}

/// Mass matrix (kg m^2), rows and columns beyond the joints zero:
///
/// ```text
///     M = sum_i m_i Jv_i^T Jv_i + Jw_i^T I_i Jw_i + diag(armature)      Jv_i: of the centre of link i, Jw_i: of its rotation
/// ```
pub fn mass_matrix(model: &FingerModel, kinematics: &Kinematics) -> Mat6 {
    let mut matrix = Mat6::zeros();
    for (i, joint) in model.joints().iter().enumerate() {
        let (center, inertia) = link_inertia(model, kinematics, i);
        let (jv, jw) = (kinematics.point_jacobian(i, &center), kinematics.rotation_jacobian(i));
        matrix += jv.transpose() * jv * joint.link.mass() + jw.transpose() * inertia * jw;
        matrix[(i, i)] += joint.armature;
    }
    matrix
}

/// Motion of the hand frame at the start of a step, and its mean acceleration over the step (world axes).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BaseMotion {
    /// Angular velocity (rad/s).
    pub angular_velocity: Vec3,
    /// Acceleration of the origin (m/s^2).
    pub linear_acceleration: Vec3,
    /// Angular acceleration (rad/s^2).
    pub angular_acceleration: Vec3,
}

impl BaseMotion {
    /// A base at rest.
    pub fn at_rest() -> Self {
        Self { angular_velocity: Vec3::zeros(), linear_acceleration: Vec3::zeros(), angular_acceleration: Vec3::zeros() }
    }
}

/// Bias torques h (N m) in `M qddot + h = torques`: weight, velocity products, motion of the base. Zero beyond the joints.
///
/// Newton-Euler (Luh, Walker, Paul 1980; Featherstone, *Rigid Body Dynamics Algorithms*, 2008, section 5.3) with qddot = 0,
/// world axes. Outwards, o: origin, a: its acceleration, w: angular velocity, al: angular acceleration, r: from one origin to
/// the next, d: from the origin to the centre of the link, z: joint axis, qd: joint velocity:
///
/// ```text
///     a  <- a + al x r + w x (w x r)
///     al <- al + w x z qd,     w <- w + z qd
///     F_i = m (a + al x d + w x (w x d) - gravity),     N_i = I al + w x I w
/// ```
///
/// Inwards: h_j = z_j . sum over links i >= j of (N_i + (c_i - o_j) x F_i).
pub fn bias_torques(
    model: &FingerModel,
    kinematics: &Kinematics,
    hand_origin: &Vec3,
    velocities: &Vec6,
    base: &BaseMotion,
    gravity: &Vec3,
) -> Vec6 {
    let dof = model.dof();
    let (mut a, mut al, mut w) = (base.linear_acceleration, base.angular_acceleration, base.angular_velocity);
    let mut previous = *hand_origin;
    let (mut forces, mut moments) = ([Vec3::zeros(); MAX_DOF], [Vec3::zeros(); MAX_DOF]);
    for i in 0..dof {
        let origin = kinematics.origin(i);
        let r = origin - previous;
        a += al.cross(&r) + w.cross(&w.cross(&r));
        let spin = kinematics.axes[i] * velocities[i];
        al += w.cross(&spin);
        w += spin;
        let (center, inertia) = link_inertia(model, kinematics, i);
        let d = center - origin;
        let force = (a + al.cross(&d) + w.cross(&w.cross(&d)) - gravity) * model.joints()[i].link.mass();
        forces[i] = force;
        // Moment about the joint's own origin; shifted to the inner joints below.
        moments[i] = inertia * al + w.cross(&(inertia * w)) + d.cross(&force);
        previous = origin;
    }
    let mut bias = Vec6::zeros();
    let (mut force, mut moment) = (Vec3::zeros(), Vec3::zeros());
    for j in (0..dof).rev() {
        if j + 1 < dof {
            moment += (kinematics.origin(j + 1) - kinematics.origin(j)).cross(&force);
        }
        force += forces[j];
        moment += moments[j];
        bias[j] = kinematics.axes[j].dot(&moment);
    }
    bias
}

/// Position of the point of `link` given in the link frame (m, world).
pub fn link_point(kinematics: &Kinematics, link: usize, local: &Vec3) -> Vec3 {
    kinematics.links[link].transform_point(&nalgebra::Point3::from(*local)).coords
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::body::{HandModel, JointModel};
    use crate::math::Real;
    use proptest::prelude::*;

    fn model() -> FingerModel {
        HandModel::three_finger().unwrap().fingers()[1].clone()
    }

    fn at(model: &FingerModel, hand: &Pose, q: &Vec6) -> Kinematics {
        let mut kinematics = Kinematics::default();
        forward_kinematics(model, hand, q, &mut kinematics);
        kinematics
    }

    fn joints(values: [Real; 4]) -> Vec6 {
        Vec6::from_fn(|i, _| values.get(i).copied().unwrap_or(0.0))
    }

    /// Centre of mass (m) of every link in the world.
    fn centers(model: &FingerModel, kinematics: &Kinematics) -> Vec<Vec3> {
        (0..model.dof()).map(|i| link_inertia(model, kinematics, i).0).collect()
    }

    proptest! {
        #[test]
        fn jacobian_is_the_derivative_of_the_point(q in prop::array::uniform4(-0.5..1.0f64), p in prop::array::uniform3(-0.02..0.02f64)) {
            let (model, hand, local) = (model(), Pose::translation(0.1, 0.2, 0.3), Vec3::from(p));
            let q = joints(q);
            let jacobian = at(&model, &hand, &q).point_jacobian(3, &link_point(&at(&model, &hand, &q), 3, &local));
            let h = 1e-6;
            for j in 0..4 {
                let step = Vec6::ith(j, h);
                let moved = |q: Vec6| link_point(&at(&model, &hand, &q), 3, &local);
                let difference = (moved(q + step) - moved(q - step)) / (2.0 * h);
                prop_assert!((difference - jacobian.column(j)).norm() < 1e-9, "column {j}: {}", difference - jacobian.column(j));
            }
        }

        /// Bias torques against Lagrange: h = Mdot qd - 1/2 d(qd^T M qd)/dq + dV/dq, by differences of M and V.
        #[test]
        fn bias_is_that_of_lagrange(q in prop::array::uniform4(-0.5..1.0f64), v in prop::array::uniform4(-5.0..5.0f64)) {
            let (model, hand) = (model(), Pose::translation(0.1, 0.2, 0.3));
            let (q, v, gravity) = (joints(q), joints(v), Vec3::new(1.0, -2.0, -9.81));
            let mass = |q: &Vec6| mass_matrix(&model, &at(&model, &hand, q));
            let potential = |q: &Vec6| -> Real {
                centers(&model, &at(&model, &hand, q)).iter().zip(model.joints()).map(|(c, j)| -j.link.mass() * gravity.dot(c)).sum()
            };
            let h = 1e-5;
            let mut expected = (mass(&(q + v * h)) - mass(&(q - v * h))) / (2.0 * h) * v;
            for j in 0..4 {
                let step = Vec6::ith(j, h);
                let kinetic = |q: Vec6| 0.5 * v.dot(&(mass(&q) * v));
                expected[j] -= (kinetic(q + step) - kinetic(q - step)) / (2.0 * h);
                expected[j] += (potential(&(q + step)) - potential(&(q - step))) / (2.0 * h);
            }
            let kinematics = at(&model, &hand, &q);
            let bias = bias_torques(&model, &kinematics, &hand.translation.vector, &v, &BaseMotion::at_rest(), &gravity);
            prop_assert!((bias - expected).norm() < 1e-7 * (1.0 + expected.norm()), "{bias} against {expected}");
        }
    }

    #[test]
    fn accelerated_base_is_felt_as_gravity() {
        let (model, hand) = (model(), Pose::identity());
        let kinematics = at(&model, &hand, &joints([0.1, 0.5, 0.4, 0.3]));
        let pull = Vec3::new(3.0, -2.0, 1.0);
        let moving = BaseMotion { linear_acceleration: pull, ..BaseMotion::at_rest() };
        let origin = Vec3::zeros();
        let by_base = bias_torques(&model, &kinematics, &origin, &Vec6::zeros(), &moving, &Vec3::zeros());
        let by_gravity = bias_torques(&model, &kinematics, &origin, &Vec6::zeros(), &BaseMotion::at_rest(), &-pull);
        assert!((by_base - by_gravity).norm() < 1e-15, "{}", by_base - by_gravity);
    }

    #[test]
    fn spinning_base_throws_a_link_outwards() {
        // One joint about y at distance R from the axis z of the base's spin, a link hanging down by l: h = -m w^2 (R + 0) l.
        let mut joint: JointModel = model().joints()[1].clone();
        joint.origin = Pose::translation(0.2, 0.0, 0.0);
        joint.axis = Vec3::y();
        joint.link = crate::body::MassProperties::new(2.0, Vec3::new(0.0, 0.0, -0.1), Mat3::identity() * 1e-3).unwrap();
        let model = FingerModel::new("pendulum", Pose::identity(), vec![joint]).unwrap();
        let kinematics = at(&model, &Pose::identity(), &Vec6::zeros());
        let base = BaseMotion { angular_velocity: Vec3::z() * 3.0, ..BaseMotion::at_rest() };
        let bias = bias_torques(&model, &kinematics, &Vec3::zeros(), &Vec6::zeros(), &base, &Vec3::zeros());
        // F = m a = -m w^2 R x; moment about y of F at -l z: (-l z) x (-m w^2 R x) = l m w^2 R y.
        let expected = 2.0 * 9.0 * 0.2 * 0.1;
        assert!((bias[0] - expected).abs() < 1e-12, "{} against {expected}", bias[0]);
    }
}

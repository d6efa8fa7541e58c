//! One rigid body: free (inertial or quasi-static) or fixed and moved from outside.

use crate::body::mass_properties::MassProperties;
use crate::body::pose::{check_pose, displacement_between};
use crate::body::{Motion, PoseDrive};
use crate::error::{Error, Result, check_finite, check_non_negative, check_positive};
use crate::math::{Mat3, Mat3x6, Pose, Real, Vec3, Vec6, pose_is_finite, skew};
use nalgebra::Point3;
use serde::{Deserialize, Serialize};

/// Time in which a quasi-static body of default viscosity follows a change of load (s). It sets `b = m / tau`: large enough
/// that a body does not jump under solver noise, small enough that it follows a hand.
pub const DEFAULT_VISCOUS_TIME: Real = 0.05;

/// Whether contacts and loads can move a rigid body.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub enum Mobility {
    /// Six degrees of freedom.
    Free(Motion),
    /// None: it stays, or its motion is prescribed.
    Fixed,
}

/// What changes from step to step; copied to roll a body back.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct RigidState {
    /// Body frame in the world.
    pub pose: Pose,
    /// Velocity of the centre of mass (m/s, world).
    pub linear_velocity: Vec3,
    /// Angular momentum about the centre of mass (kg m^2/s, world).
    pub angular_momentum: Vec3,
    /// Angular velocity over the last step (rad/s, world); the velocity of a body without momentum, fixed or quasi-static.
    pub angular_velocity: Vec3,
}

/// A rigid body. Its generalised displacement is (translation of the centre of mass, rotation vector), world axes.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct RigidBody {
    name: String,
    mass: MassProperties,
    mobility: Mobility,
    state: RigidState,
    viscosity: [Real; 2],
    /// Whether the viscosity is the default for the mass, and follows it.
    viscosity_of_mass: bool,
    external_force: Vec3,
    external_torque: Vec3,
    drive: Option<PoseDrive>,
    target_pose: Option<Pose>,
}

impl RigidBody {
    /// A free body at rest. `pose`: body frame in the world. Viscosity: none for an inertial body; for a quasi-static one
    /// `m / 0.05 s` and the same with its mean moment of inertia.
    ///
    /// # Errors
    /// A pose that is not finite.
    pub fn free(name: impl Into<String>, mass: MassProperties, motion: Motion, pose: Pose) -> Result<Self> {
        let mut body = Self::new(name, mass, Mobility::Free(motion), pose)?;
        if motion == Motion::QuasiStatic {
            (body.viscosity, body.viscosity_of_mass) = (default_viscosity(&mass), true);
        }
        Ok(body)
    }

    /// A fixed body. Contacts do not move it; [`RigidBody::move_to`] does.
    ///
    /// # Errors
    /// A pose that is not finite.
    pub fn fixed(name: impl Into<String>, pose: Pose) -> Result<Self> {
        // A fixed body has no use for its mass; one kilogram keeps every accessor total.
        let mass = MassProperties::new(1.0, Vec3::zeros(), Mat3::identity())?;
        Self::new(name, mass, Mobility::Fixed, pose)
    }

    fn new(name: impl Into<String>, mass: MassProperties, mobility: Mobility, pose: Pose) -> Result<Self> {
        check_pose("pose of the body", &pose)?;
        let state = RigidState { pose, linear_velocity: Vec3::zeros(), angular_momentum: Vec3::zeros(), angular_velocity: Vec3::zeros() };
        Ok(Self {
            name: name.into(),
            mass,
            mobility,
            state,
            viscosity: [0.0, 0.0],
            viscosity_of_mass: false,
            external_force: Vec3::zeros(),
            external_torque: Vec3::zeros(),
            drive: None,
            target_pose: None,
        })
    }

    /// What the body is called.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Whether and how it moves.
    pub fn mobility(&self) -> Mobility {
        self.mobility
    }

    /// Mass, centre of mass, inertia. Those of a fixed body have no meaning.
    pub fn mass_properties(&self) -> &MassProperties {
        &self.mass
    }

    /// Gives the body another mass, centre of mass and inertia; pose and motion stay: the velocity is that
    /// of the new centre. A default viscosity follows the mass, one that was chosen stays.
    ///
    /// # Errors
    /// A fixed body, which has no mass.
    pub fn set_mass_properties(&mut self, mass: MassProperties) -> Result<()> {
        self.refuse_fixed("mass", "a fixed body has none")?;
        let (angular, center) = (self.angular_velocity(), self.center_of_mass());
        self.mass = mass;
        if self.viscosity_of_mass {
            self.viscosity = default_viscosity(&mass);
        }
        self.state.linear_velocity += angular.cross(&(self.center_of_mass() - center));
        self.state.angular_momentum = self.world_inertia() * angular;
        Ok(())
    }

    /// Degrees of freedom: 6 or 0.
    pub fn dof(&self) -> usize {
        if self.mobility == Mobility::Fixed { 0 } else { 6 }
    }

    /// Body frame in the world.
    pub fn pose(&self) -> &Pose {
        &self.state.pose
    }

    /// Centre of mass (m, world). The origin of the body frame for a fixed body.
    pub fn center_of_mass(&self) -> Vec3 {
        self.state.pose.transform_point(&Point3::from(*self.mass.center_of_mass())).coords
    }

    /// Inertia about the centre of mass (kg m^2, world axes).
    pub fn world_inertia(&self) -> Mat3 {
        let rotation = self.state.pose.rotation.to_rotation_matrix().into_inner();
        rotation * self.mass.inertia() * rotation.transpose()
    }

    /// Velocity of the centre of mass (m/s, world). Of a fixed body: of its origin in the last step.
    pub fn linear_velocity(&self) -> &Vec3 {
        &self.state.linear_velocity
    }

    /// Angular velocity (rad/s, world). Of an inertial body: from its momentum; of others: over the last step.
    pub fn angular_velocity(&self) -> Vec3 {
        if self.mobility != Mobility::Free(Motion::Inertial) {
            return self.state.angular_velocity;
        }
        // I_w^-1 L; the inertia is positive definite by construction.
        self.world_inertia().cholesky().map_or_else(Vec3::zeros, |inertia| inertia.solve(&self.state.angular_momentum))
    }

    /// Angular momentum about the centre of mass (kg m^2/s, world).
    pub fn angular_momentum(&self) -> &Vec3 {
        &self.state.angular_momentum
    }

    /// Kinetic energy (J).
    pub fn kinetic_energy(&self) -> Real {
        0.5 * self.mass.mass() * self.state.linear_velocity.norm_squared() + 0.5 * self.state.angular_momentum.dot(&self.angular_velocity())
    }

    /// Viscosity against the world: translation (N s/m), rotation (N m s/rad).
    pub fn viscosity(&self) -> [Real; 2] {
        self.viscosity
    }

    /// External force at the centre of mass (N) and torque (N m), world axes.
    pub fn external_wrench(&self) -> (&Vec3, &Vec3) {
        (&self.external_force, &self.external_torque)
    }

    /// The spring that pulls the body, if there is one.
    pub fn drive(&self) -> Option<&PoseDrive> {
        self.drive.as_ref()
    }

    /// Where a fixed body will be after the next step, if a target was set.
    pub fn target_pose(&self) -> Option<&Pose> {
        self.target_pose.as_ref()
    }

    /// Puts the body elsewhere at once: no displacement in a step, no friction with what it
    /// touches. A free body keeps its velocities, world axes; a fixed one is at rest and loses
    /// its target. To carry things along, use [`RigidBody::move_to`].
    ///
    /// # Errors
    /// A pose that is not finite.
    pub fn set_pose(&mut self, pose: Pose) -> Result<()> {
        check_pose("pose of the body", &pose)?;
        let angular = self.angular_velocity();
        self.state.pose = pose;
        if self.mobility == Mobility::Fixed {
            self.target_pose = None;
            (self.state.linear_velocity, self.state.angular_velocity) = (Vec3::zeros(), Vec3::zeros());
        } else {
            self.state.angular_momentum = self.world_inertia() * angular;
        }
        Ok(())
    }

    /// Sets the velocity of a free body: of the centre of mass (m/s) and angular (rad/s), world axes.
    ///
    /// # Errors
    /// Non-finite numbers, or a fixed body.
    pub fn set_velocity(&mut self, linear: Vec3, angular: Vec3) -> Result<()> {
        self.refuse_fixed("velocity", "move a fixed body by its target pose")?;
        check_finite("linear velocity", linear.iter())?;
        check_finite("angular velocity", angular.iter())?;
        self.state.linear_velocity = linear;
        self.state.angular_velocity = angular;
        self.state.angular_momentum = self.world_inertia() * angular;
        Ok(())
    }

    /// Sets the viscosity against the world: translation (N s/m), rotation (N m s/rad). A quasi-static body needs both > 0.
    ///
    /// # Errors
    /// Non-finite or negative numbers; zero for a quasi-static body; a fixed body.
    pub fn set_viscosity(&mut self, linear: Real, angular: Real) -> Result<()> {
        self.refuse_fixed("viscosity", "the motion of a fixed body is prescribed")?;
        let check = if self.mobility == Mobility::Free(Motion::QuasiStatic) { check_positive } else { check_non_negative };
        check("linear viscosity", linear, "N s/m")?;
        check("angular viscosity", angular, "N m s/rad")?;
        (self.viscosity, self.viscosity_of_mass) = ([linear, angular], false);
        Ok(())
    }

    /// Sets the external force at the centre of mass (N) and torque (N m), world axes; held until it is set again.
    ///
    /// # Errors
    /// Non-finite numbers, or a fixed body.
    pub fn set_external_wrench(&mut self, force: Vec3, torque: Vec3) -> Result<()> {
        self.refuse_fixed("external wrench", "a fixed body takes any load")?;
        check_finite("external force", force.iter())?;
        check_finite("external torque", torque.iter())?;
        (self.external_force, self.external_torque) = (force, torque);
        Ok(())
    }

    /// Couples the body to a moving target by a damped spring, or frees it (`None`).
    ///
    /// # Errors
    /// See [`PoseDrive::check`]; a fixed body.
    pub fn set_drive(&mut self, drive: Option<PoseDrive>) -> Result<()> {
        if let Some(drive) = &drive {
            self.refuse_fixed("drive", "move a fixed body by its target pose")?;
            drive.check()?;
        }
        self.drive = drive;
        Ok(())
    }

    /// Moves a fixed body to `target` during the next step, carrying along what rests on it.
    ///
    /// # Errors
    /// A pose that is not finite, or a free body.
    pub fn move_to(&mut self, target: Pose) -> Result<()> {
        if self.mobility != Mobility::Fixed {
            return Err(Error::value("target pose", "a fixed body", "a free body", "pull a free body with a drive"));
        }
        check_pose("target pose", &target)?;
        self.target_pose = Some(target);
        Ok(())
    }

    /// The state, to keep.
    pub fn state(&self) -> RigidState {
        self.state
    }

    /// Back to a state kept earlier.
    pub fn restore(&mut self, state: &RigidState) {
        self.state = *state;
    }

    /// Whether every number of the state is finite.
    pub fn is_finite(&self) -> bool {
        let s = &self.state;
        let vectors = [s.linear_velocity, s.angular_momentum, s.angular_velocity];
        pose_is_finite(&s.pose) && vectors.iter().flat_map(|v| v.iter()).all(|x| x.is_finite())
    }

    /// Jacobian of a material point at `point` (m, world): `dp = dc + theta x (p - c) = [1, -[p - c]x] dx`. Zero when fixed.
    pub(crate) fn point_jacobian(&self, point: &Vec3) -> Mat3x6 {
        let mut jacobian = Mat3x6::zeros();
        if self.mobility != Mobility::Fixed {
            jacobian.fixed_view_mut::<3, 3>(0, 0).copy_from(&Mat3::identity());
            jacobian.fixed_view_mut::<3, 3>(0, 3).copy_from(&-skew(&(point - self.center_of_mass())));
        }
        jacobian
    }

    /// Displacement over the step to the target pose: translation of the origin, rotation vector (world). Zero without one.
    pub(crate) fn prescribed_motion(&self) -> (Vec3, Vec3) {
        match &self.target_pose {
            Some(target) => displacement_between(&self.state.pose, target),
            None => (Vec3::zeros(), Vec3::zeros()),
        }
    }

    /// Integrates one step; the caller is `constrained_motion`.
    ///
    /// Poses on SE(3): the centre moves by dx_lin, the body turns about it by exp(theta). Velocity v = dx_lin/dt, and momentum
    /// L = I_w theta/dt with the inertia at the start of the step, the same that A held: so without torque L stays as it is.
    pub(crate) fn integrate(&mut self, dx: &Vec6, dt: Real) {
        if self.mobility == Mobility::Fixed {
            let (linear, angular) = self.prescribed_motion();
            self.state.linear_velocity = linear / dt;
            self.state.angular_velocity = angular / dt;
            if let Some(target) = self.target_pose.take() {
                self.state.pose = target;
            }
            return;
        }
        let (translation, theta): (Vec3, Vec3) = (dx.fixed_rows::<3>(0).into(), dx.fixed_rows::<3>(3).into());
        let center = self.center_of_mass() + translation;
        self.state.linear_velocity = translation / dt;
        self.state.angular_velocity = theta / dt;
        self.state.angular_momentum = self.world_inertia() * theta / dt;
        let mut rotation = crate::math::Rot::from_scaled_axis(theta) * self.state.pose.rotation;
        rotation.renormalize();
        self.state.pose = Pose::from_parts((center - rotation * self.mass.center_of_mass()).into(), rotation);
    }

    fn refuse_fixed(&self, what: &str, hint: &str) -> Result<()> {
        if self.mobility == Mobility::Fixed { Err(Error::value(what, "a free body", "a fixed body", hint)) } else { Ok(()) }
    }
}

/// `m / 0.05 s`, and the same with the mean moment of inertia.
fn default_viscosity(mass: &MassProperties) -> [Real; 2] {
    [mass.mass() / DEFAULT_VISCOUS_TIME, mass.inertia().trace() / 3.0 / DEFAULT_VISCOUS_TIME]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::body::Amount;

    fn cuboid(mass: Real) -> MassProperties {
        MassProperties::cuboid(Vec3::new(0.02, 0.04, 0.08), Amount::Mass(mass)).unwrap()
    }

    #[test]
    fn another_mass_changes_no_motion_and_a_viscosity_only_if_nobody_chose_it() {
        let mut body = RigidBody::free("body", cuboid(0.2), Motion::QuasiStatic, Pose::identity()).unwrap();
        body.set_mass_properties(cuboid(2.0)).unwrap();
        let made = RigidBody::free("body", cuboid(2.0), Motion::QuasiStatic, Pose::identity()).unwrap();
        assert_eq!(body.viscosity(), made.viscosity());
        body.set_viscosity(1.0, 2.0).unwrap();
        body.set_mass_properties(cuboid(0.2)).unwrap();
        assert_eq!(body.viscosity(), [1.0, 2.0]);

        // The velocity of a point of the body: that of the centre and the spin about it.
        let mut body = RigidBody::free("body", cuboid(0.2), Motion::Inertial, Pose::identity()).unwrap();
        body.set_velocity(Vec3::x(), Vec3::new(3.0, 1.0, 2.0)).unwrap();
        let at_origin = |body: &RigidBody| body.linear_velocity() - body.angular_velocity().cross(&body.center_of_mass());
        let before = at_origin(&body);
        let aside = cuboid(0.3).transformed(&Pose::translation(0.01, 0.02, -0.03)).unwrap();
        body.set_mass_properties(aside).unwrap();
        assert!((at_origin(&body) - before).norm() < 1e-15, "{:?} against {before:?}", at_origin(&body));
    }

    #[test]
    fn a_body_that_is_put_elsewhere_goes_nowhere_else() {
        let mut fixed = RigidBody::fixed("fixed", Pose::identity()).unwrap();
        fixed.move_to(Pose::translation(0.1, 0.0, 0.0)).unwrap();
        fixed.set_pose(Pose::translation(0.0, 0.2, 0.0)).unwrap();
        assert_eq!(fixed.prescribed_motion(), (Vec3::zeros(), Vec3::zeros()));

        let mut free = RigidBody::free("free", cuboid(0.2), Motion::Inertial, Pose::identity()).unwrap();
        free.set_velocity(Vec3::x(), Vec3::z()).unwrap();
        free.set_pose(Pose::rotation(Vec3::new(1.0, 0.5, 0.0))).unwrap();
        assert!(
            (free.angular_velocity() - Vec3::z()).norm() < 1e-12 && *free.linear_velocity() == Vec3::x(),
            "{:?}",
            free.angular_velocity()
        );
    }
}

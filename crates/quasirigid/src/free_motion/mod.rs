//! Stage 1: what the step would do without contact forces, and how each body answers to them.
//!
//! Linearised implicit Euler in displacements over the step, for every body:
//!
//! ```text
//!     A dx = g + J^T f,      A = M/dt^2 + B/dt + K_s + D_s/dt
//! ```
//!
//! with dx the generalised displacement, M inertia, B viscosity, K_s and D_s stiffness and damping of what drives the body, g
//! everything known at the start of the step, f the contact forces. A, g and J are taken at the start of the step.

mod articulation;
mod at_point;
mod expected;
mod rigid;

pub(crate) use at_point::{free_displacement, unexpected_displacement};
pub use expected::Expected;

use crate::body::{Body, BodyEntry, JointStop};
use crate::error::{Result, check_finite, check_positive};
use crate::math::{MAX_DOF, Mat6, Real, Vec3, Vec6};
use crate::params::{ABSURD_DISPLACEMENT, Parameters};
use crate::slots::Slots;

/// What all bodies of a step share.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StepContext {
    /// Time step (s).
    pub dt: Real,
    /// Gravity (m/s^2, world).
    pub gravity: Vec3,
}

impl StepContext {
    /// That of a world with these parameters.
    pub fn of(params: &Parameters) -> Self {
        Self { dt: params.dt, gravity: params.gravity }
    }

    /// A context, checked.
    ///
    /// # Errors
    /// A time step that is not finite and > 0, gravity that is not finite.
    pub fn new(dt: Real, gravity: Vec3) -> Result<Self> {
        check_positive("time step", dt, "s")?;
        check_finite("gravity", gravity.iter())?;
        Ok(Self { dt, gravity })
    }
}

/// The step of one body without contacts, and its response to them. Entries beyond the degrees of freedom are zero.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FreeMotion {
    /// Degrees of freedom.
    pub dof: usize,
    /// A, joints at a stop included.
    pub matrix: Mat6,
    /// S with `A^-1 = S S^T`; rows and columns of joints at a stop are zero: contacts do not move them.
    pub inverse_root: Mat6,
    /// dx without contact forces.
    pub displacement: Vec6,
    /// g.
    pub generalized_force: Vec6,
    /// Motor torque of each joint for dx = 0 (N m); part of g. Zero for rigid bodies.
    pub motor_torque: Vec6,
    /// By how much the motor torque falls per displacement (N m/rad); part of A. Zero where the motor is at its limit.
    pub motor_slope: Vec6,
    /// Joints held at a stop in this step.
    pub stops: [JointStop; MAX_DOF],
    /// Displacements of the joints that are expected in this step, rad, see
    /// [`Expected::joints`]; zero for rigid bodies. Set by [`free_motions`].
    pub expected_joints: Vec6,
    /// The body was quarantined in this step: its motion would be non-finite or absurd.
    pub quarantined: bool,
}

impl FreeMotion {
    /// Of a body without degrees of freedom.
    pub fn none() -> Self {
        Self {
            dof: 0,
            matrix: Mat6::zeros(),
            inverse_root: Mat6::zeros(),
            displacement: Vec6::zeros(),
            generalized_force: Vec6::zeros(),
            motor_torque: Vec6::zeros(),
            motor_slope: Vec6::zeros(),
            stops: [JointStop::None; MAX_DOF],
            expected_joints: Vec6::zeros(),
            quarantined: false,
        }
    }

    /// Displacement that a generalised contact force `J^T f` adds: `S S^T J^T f`.
    pub fn response(&self, generalized_contact_force: &Vec6) -> Vec6 {
        self.inverse_root * self.inverse_root.tr_mul(generalized_contact_force)
    }
}

/// The free motion of all bodies over a step, by slot; quarantined ones do not move. A body whose motion is not finite, or
/// absurd, is quarantined here: in the contact problem it would make the motion of all that it touches wrong.
pub fn free_motions(bodies: &mut Slots<BodyEntry>, context: &StepContext, out: &mut Vec<FreeMotion>) {
    out.clear();
    out.extend(bodies.all_slots_mut().map(|entry| {
        let Some(entry) = entry.filter(|entry| !entry.quarantined) else { return FreeMotion::none() };
        let mut free = free_motion(&entry.body, context);
        let prescribed = entry.body.prescribed_displacement(&entry.body.link_pose(entry.body.link_count() - 1).translation.vector);
        if !(is_sound(&free.displacement) && prescribed.amax() <= ABSURD_DISPLACEMENT) {
            entry.quarantined = true;
            return FreeMotion { quarantined: true, ..FreeMotion::none() };
        }
        free.expected_joints = expected::joints(&entry.body, context.dt);
        free
    }));
}

/// Whether a generalised displacement (m, rad) is finite and not absurd.
pub(crate) fn is_sound(displacement: &Vec6) -> bool {
    displacement.iter().all(|x| x.abs() <= ABSURD_DISPLACEMENT)
}

/// The free motion of one body over a step.
pub fn free_motion(body: &Body, context: &StepContext) -> FreeMotion {
    match body {
        Body::Rigid(body) => rigid::free_motion(body, context),
        Body::Finger(finger) => articulation::free_motion(finger, context),
    }
}

/// `S = L^-T` with `A = L L^T` over the rows and columns in `active`, zero elsewhere.
///
/// The other rows and columns are replaced by those of the identity: the factor of the active block does not see them. A
/// matrix that is not positive definite (only from non-finite numbers: every constructor sees to the rest) gives NaN, which
/// `constrained_motion` finds and isolates.
fn inverse_root(matrix: &Mat6, active: &[bool; MAX_DOF]) -> Mat6 {
    let padded = Mat6::from_fn(|i, j| match (active[i] && active[j], i == j) {
        (true, _) => matrix[(i, j)],
        (false, true) => 1.0,
        (false, false) => 0.0,
    });
    let Some(inverse) = padded.cholesky().and_then(|factor| factor.l_dirty().solve_lower_triangular(&Mat6::identity())) else {
        return Mat6::repeat(Real::NAN);
    };
    Mat6::from_fn(|i, j| if active[i] && active[j] { inverse[(j, i)] } else { 0.0 })
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn inverse_root_squares_to_the_inverse_of_the_active_block(
            entries in prop::collection::vec(-1.0..1.0f64, 36),
            active in prop::array::uniform6(any::<bool>()),
        ) {
            let root = Mat6::from_column_slice(&entries);
            let matrix = root * root.transpose() + Mat6::identity() * 0.1;
            let s = inverse_root(&matrix, &active);
            let product = s * s.transpose() * matrix;
            for i in 0..6 {
                for j in 0..6 {
                    if active[i] && active[j] {
                        let expected = if i == j { 1.0 } else { 0.0 };
                        prop_assert!((product[(i, j)] - expected).abs() < 1e-10, "({i}, {j}): {}", product[(i, j)]);
                    } else {
                        prop_assert_eq!(s[(i, j)], 0.0);
                    }
                }
            }
        }
    }

    #[test]
    fn bad_contexts_are_refused() {
        assert!(StepContext::new(1e-3, Vec3::z()).is_ok());
        assert!(StepContext::new(0.0, Vec3::z()).is_err());
        assert!(StepContext::new(Real::NAN, Vec3::z()).is_err());
        assert!(StepContext::new(1e-3, Vec3::repeat(Real::INFINITY)).is_err());
    }
}

//! Free motion of a rigid body.

use super::{FreeMotion, StepContext, inverse_root};
use crate::body::drive::DrivenBody;
use crate::body::{Mobility, Motion, RigidBody};
use crate::math::{MAX_DOF, Mat3, Mat6, Vec3, Vec6};

/// `A dx = g` of a rigid body, dx = (translation of the centre of mass, rotation vector theta), world axes.
///
/// Inertial (m: mass, I_w: inertia about the centre in world axes, v: velocity of the centre, L: angular momentum, b: viscosity,
/// F, T: external force and torque, G: gravity):
///
/// ```text
///     A = diag(m 1, I_w)/dt^2 + diag(b_lin 1, b_rot 1)/dt          g = (m v/dt + m G + F,  L/dt + T)
/// ```
///
/// It is Newton and Euler with v_new = dx_lin/dt and L_new = I_w theta/dt: m (v_new - v)/dt = m G + F + contacts and
/// (L_new - L)/dt = T + contacts. So without load both momenta stay as they are, exactly. The orientation is a forward Euler step
/// with the right angular velocity, theta = dt I_w^-1 L, so the orientation, and with it the energy 1/2 L . I_w^-1 L, is right to
/// first order in dt. There is no gyroscopic term: it is the momentum, not the velocity, that is carried from step to step.
///
/// Quasi-static (equation 15): A = B/dt, g = (m G + F, T). So dx/dt = F/b: terminal velocity is exact, and there at once.
pub(super) fn free_motion(body: &RigidBody, context: &StepContext) -> FreeMotion {
    let Mobility::Free(motion) = body.mobility() else { return FreeMotion::none() };
    let dt = context.dt;
    let mass = body.mass_properties().mass();
    let (force, torque) = body.external_wrench();
    let [b_linear, b_angular] = body.viscosity();

    let mut linear = Mat3::identity() * (b_linear / dt);
    let mut angular = Mat3::identity() * (b_angular / dt);
    let mut g_linear: Vec3 = context.gravity * mass + force;
    let mut g_angular: Vec3 = *torque;
    if motion == Motion::Inertial {
        linear += Mat3::identity() * (mass / (dt * dt));
        angular += body.world_inertia() / (dt * dt);
        g_linear += body.linear_velocity() * (mass / dt);
        g_angular += body.angular_momentum() / dt;
    }
    let (mut matrix, mut g) = (Mat6::zeros(), Vec6::zeros());
    matrix.fixed_view_mut::<3, 3>(0, 0).copy_from(&linear);
    matrix.fixed_view_mut::<3, 3>(3, 3).copy_from(&angular);
    g.fixed_rows_mut::<3>(0).copy_from(&g_linear);
    g.fixed_rows_mut::<3>(3).copy_from(&g_angular);
    if let Some(drive) = body.drive() {
        let driven = DrivenBody {
            pose: *body.pose(),
            center_of_mass: *body.mass_properties().center_of_mass(),
            linear_velocity: *body.linear_velocity(),
            angular_velocity: body.angular_velocity(),
        };
        drive.add_to(&driven, dt, &mut matrix, &mut g);
    }

    let root = inverse_root(&matrix, &[true; MAX_DOF]);
    let mut free = FreeMotion { dof: 6, matrix, inverse_root: root, generalized_force: g, ..FreeMotion::none() };
    free.displacement = free.response(&g);
    free
}

//! The motion that two bodies are expected to make in a step, with its full
//! rotation: the linear equations hold only the deviations from it.
//!
//! A body that rotates by `theta` in a step moves its points by `theta x r` to first order, but along an arc. Taken
//! to first order about a place of its own, such as the palm of a hand, each of two bodies that rotate together
//! would end `theta^2 r / 2` from where the equations have it, each by another `r`; tangential rows are increments,
//! so nothing corrects it, and what is held would leave the hand in every step. So the displacement of the two
//! against each other is linearised about the motion that they are expected to make.

use crate::free_motion::Expected;
use crate::math::{Mat3, Pose, Real, Vec3, skew};
use crate::objects::Side;
use serde::{Deserialize, Serialize};

/// A relative motion (m, rad) of more than this in a step was a jump: one of the two was given another pose.
const LARGEST_CONTINUOUS: Real = 0.05;

/// What the two of a pair, `a` and `b`, are expected to do in a step, seen from each other.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct RelativeMotion {
    /// The centre of mass of the body that follows at the start of the step, world, m: what the affine fields below are about.
    at: Vec3,
    /// Displacement of `a` against `b`, in full: `shift + gradient (p - at)`, in the axes that the one that leads has at the start of the step, m.
    shift: Vec3,
    /// Displacement gradient, -.
    gradient: Mat3,
    /// What of it the free motions of the two have, too, to first order: `shared_shift + shared_theta x (p - at)`, m and rad.
    shared_shift: Vec3,
    shared_theta: Vec3,
    /// From a point to where it will be, seen from where the lighter body will be: `lever_shift + lever_gradient (p - at)`, m.
    lever_shift: Vec3,
    lever_gradient: Mat3,
    /// Rotation of `b` in the step, less the identity.
    rotation_b: Mat3,
    /// Pose of `b` in the frame of `a` at the start of the last step in which they were near.
    last: Option<Pose>,
    /// rho and phi of the step before that, in the frame of the one that leads.
    before: Option<[Vec3; 2]>,
}

impl RelativeMotion {
    /// Of two bodies that were not near before.
    pub(crate) fn none() -> Self {
        let (zero, none) = (Vec3::zeros(), Mat3::zeros());
        Self {
            at: zero,
            shift: zero,
            gradient: none,
            shared_shift: zero,
            shared_theta: zero,
            lever_shift: zero,
            lever_gradient: none,
            rotation_b: none,
            last: None,
            before: None,
        }
    }

    /// The two were not near in this step.
    pub(crate) fn forget(&mut self) {
        (self.last, self.before) = (None, None);
    }

    /// Expected displacement of `a` against `b` at a point (world, m), in full, as the one that leads sees it, with the axes that it has at the start of the step.
    pub fn displacement(&self, point: &Vec3) -> Vec3 {
        self.shift + self.gradient * (point - self.at)
    }

    /// What [`crate::free_motion::unexpected_displacement`] of the two, `a - b`, still has of it at a
    /// point (world, m): that of free bodies is all of their displacement.
    pub(crate) fn shared_displacement(&self, point: &Vec3) -> Vec3 {
        self.shared_shift + self.shared_theta.cross(&(point - self.at))
    }

    /// Where a reaction at a point of `a` (world, m) acts.
    ///
    /// Reactions are those of the end of the step, so their levers are those of the end of the step: `x + d_a - (c + dc)`, with
    /// `d_a` the displacement of the point and c the centre of mass. It acts on both bodies at one place, so that angular
    /// momentum is kept: `x + d_a - dc`, with the poses of the start of the step, dc being that of the lighter body
    /// (of two free ones the mean, the lighter counting for as much more as the other is heavier).
    pub(crate) fn acts_at(&self, point: &Vec3) -> Vec3 {
        point + self.lever_shift + self.lever_gradient * (point - self.at)
    }

    /// A direction that is fixed in `b` (world axes), at the end of the step.
    pub(crate) fn with_b(&self, frame: &Mat3) -> Mat3 {
        frame + self.rotation_b * frame
    }

    /// Finds it for the step under way, of `dt` (s).
    ///
    /// Let `l` be the body that leads and `f` the other, `P` the motion that `l` is expected to make (`P(p) = p + s + (R - 1)(p - o)`,
    /// R the rotation by theta), c the centre of mass of `f`, and `w(p) = rho + (exp(phi) - 1) (p - c)` the displacement of `f`
    /// against `l`, in the axes that `l` has at the start of the step; rho and phi are taken to go on as in the last two steps. Then
    /// `f` is expected to move by
    ///
    /// ```text
    ///     dc = P(c) - c + R rho          theta_f = theta + H phi          H = R^(1/2), as exp(theta + H phi) = R exp(phi) + O(phi^2)
    /// ```
    ///
    /// and their relative displacement is, with x the free motion of each and x_e what was expected of it,
    ///
    /// ```text
    ///     d_l - d_f = R [-w(p)] + J_l (x_l - x_e,l) - J_f (x_f - x_e,f)
    /// ```
    ///
    /// [`Self::displacement`] is `-w`, [`Self::shared_displacement`] `J_f x_e,f`, less `J_l x_e,l` if `l` is free itself
    /// (o: its centre, s = 0). If both lead, each has its own P.
    ///
    /// Elastic displacements are remembered in the axes of their body. Had the axes of `f` been taken for `w`, a box that swings
    /// between two pads would be `phi x w` off after each step: 2 nm after a turn of a hand.
    pub(crate) fn renew(&mut self, sides: [Side<'_>; 2], dt: Real) {
        let [pose_a, pose_b] = sides.map(|side| side.pose());
        let now = pose_a.inverse() * pose_b;
        let last = self.last.replace(now).unwrap_or(now);
        let [of_a, of_b] = &sides.map(|side| Expected::of(side, dt));
        *self = Self { last: self.last, before: self.before, ..Self::none() };
        self.rotation_b = rotation_less_identity(&of_b.theta, 1.0);
        if of_a.leads && of_b.leads {
            let (gradient_a, gradient_b) = (rotation_less_identity(&of_a.theta, 1.0), self.rotation_b);
            self.gradient = gradient_a - gradient_b;
            self.shift = of_a.shift - gradient_a * of_a.origin - (of_b.shift - gradient_b * of_b.origin);
            return;
        }
        if of_a.leads || !of_b.leads {
            let theta_b = self.follow(of_a, &pose_a, of_b, &last, &now, true);
            self.rotation_b = rotation_less_identity(&theta_b, 1.0);
        } else {
            self.follow(of_b, &pose_b, of_a, &last.inverse(), &now.inverse(), false);
            (self.shift, self.gradient) = (-self.shift, -self.gradient);
            (self.shared_shift, self.shared_theta) = (-self.shared_shift, -self.shared_theta);
        }
    }

    /// `lead` against `free`; returns `theta_f`. `pose`: of the leading body; `last` and `now`: of the free one in its
    /// frame; `leader_is_a`: whether the points of contact are those of the leading body.
    fn follow(&mut self, lead: &Expected, pose: &Pose, free: &Expected, last: &Pose, now: &Pose, leader_is_a: bool) -> Vec3 {
        let center = now.inverse_transform_point(&pose.inverse_transform_point(&free.origin.into()));
        let relative = [now * center - last * center, (now.rotation * last.rotation.inverse()).scaled_axis()];
        // Linear extrapolation of the last two steps.
        let before = self.before.replace(relative).unwrap_or(relative);
        let known = [relative, before].iter().flatten().all(|v| v.amax() < LARGEST_CONTINUOUS);
        let [rho, phi] = [0, 1].map(|k| if known { pose.rotation * (relative[k] * 2.0 - before[k]) } else { Vec3::zeros() });
        let (rotation, arc) = (rotation_less_identity(&lead.theta, 1.0), rotation_less_identity(&phi, 1.0));
        let turned = |m: Mat3| m + rotation * m;
        let turned_rho = rho + rotation * rho;
        let lever = free.origin - lead.origin;
        let dc = lead.shift + rotation * lever + turned_rho;
        let theta_f = lead.theta + phi + rotation_less_identity(&lead.theta, 0.5) * phi;
        self.at = free.origin;
        (self.shift, self.gradient) = (-rho, -arc);
        (self.shared_shift, self.shared_theta) = (dc, theta_f);
        if !lead.leads {
            self.shared_shift -= lead.theta.cross(&lever);
            self.shared_theta -= lead.theta;
        }
        // d(p) - dc of the leading body, `(R - 1)(p - c) - R rho`, or of the other, `(R - 1)(p - c) + R (exp(phi) - 1)(p - c)`.
        (self.lever_shift, self.lever_gradient) =
            if leader_is_a { (-turned_rho, rotation) } else { (Vec3::zeros(), rotation + turned(arc)) };
        if !lead.leads {
            // dc of the one less that of the other, which is expected to stay where it is: its translation is that of both.
            self.lever_shift += dc * (free.mass / (free.mass + lead.mass));
        }
        theta_f
    }
}

/// `R - 1`, R the rotation by `share` of a rotation vector (Rodrigues): exactly zero for none, without cancellation for a small one.
fn rotation_less_identity(theta: &Vec3, share: Real) -> Mat3 {
    let axis = skew(&(theta * share));
    let angle = theta.norm() * share;
    // sin(x)/x is 1 to rounding where x^2 is less than that.
    let over = |x: Real| if x < 1e-9 { 1.0 } else { x.sin() / x };
    axis * over(angle) + axis * axis * (0.5 * over(0.5 * angle).powi(2))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::body::{Body, BodyEntry, MassProperties, Motion, RigidBody};
    use crate::collider::{Filter, Material, Skin};
    use crate::free_motion::{FreeMotion, StepContext, free_motions, unexpected_displacement};
    use crate::math::{Rot, Vec6};
    use crate::surface::{Surface, shapes};
    use crate::{Parameters, World};
    use proptest::prelude::*;
    use std::sync::{Arc, LazyLock};

    /// Any shape: surfaces do not matter here.
    static SURFACE: LazyLock<Arc<Surface>> =
        LazyLock::new(|| Arc::new(Surface::build(shapes::sample_sphere(0.01, 200).unwrap(), Some(20)).unwrap()));

    /// Rounding of places of some metres, m.
    const ROUNDING: Real = 2e-14;

    fn vector(largest: Real) -> impl Strategy<Value = Vec3> {
        prop::array::uniform3(-1.0..1.0f64).prop_map(move |v| Vec3::from(v) * (largest / 3.0_f64.sqrt()))
    }

    fn pose() -> impl Strategy<Value = Pose> {
        (vector(1.0), vector(3.0)).prop_map(|(shift, theta)| Pose::new(shift, theta))
    }

    fn weightless() -> World {
        World::new(Parameters { gravity: Vec3::zeros(), ..Parameters::default() }).unwrap()
    }

    fn skin() -> (Arc<Surface>, Material) {
        (SURFACE.clone(), Material::preset("steel").unwrap())
    }

    /// The colliders of the two bodies.
    fn sides(world: &World) -> [Side<'_>; 2] {
        [0, 1].map(|slot| world.objects.side(slot))
    }

    fn expected(world: &World) -> [Expected; 2] {
        sides(world).map(|side| Expected::of(side, world.params.dt))
    }

    fn fixed(at: Pose) -> RigidBody {
        RigidBody::fixed("fixed", at).unwrap()
    }

    fn free(at: Pose) -> RigidBody {
        let mass = MassProperties::new(0.3, Vec3::new(0.01, -0.02, 0.03), Mat3::identity() * 1e-4).unwrap();
        RigidBody::free("free", mass, Motion::Inertial, at).unwrap()
    }

    /// All of the displacement that is not in the free motions.
    fn in_step(relative: &RelativeMotion, point: &Vec3) -> Vec3 {
        relative.displacement(point) + relative.shared_displacement(point)
    }

    /// The free motions of a step; bodies 0 and 1 are the pair.
    fn free_motions_of(world: &mut World) -> Vec<FreeMotion> {
        let mut motions = Vec::new();
        free_motions(&mut world.objects.bodies, &StepContext::of(&world.params), &mut motions);
        motions
    }

    /// Largest displacement of body 0 against body 1 at `points`, less `expected`, m, with the two in either order.
    fn largest_against(
        world: &World,
        motions: &[FreeMotion],
        relative: &mut RelativeMotion,
        points: &[Vec3],
        expected: impl Fn(&Vec3) -> Vec3,
    ) -> Real {
        let ([a, b], dt) = (sides(world), world.params.dt);
        let mut mirrored = *relative;
        // In the order (1, 0) the last pose is the other one's.
        mirrored.last = relative.last.map(|last| last.inverse());
        relative.renew([a, b], dt);
        mirrored.renew([b, a], dt);
        let own = |k: usize, p: &Vec3| unexpected_displacement([a, b][k], &motions[k], p);
        let off = |p: &Vec3| {
            let delta = own(0, p) - own(1, p) + in_step(relative, p) - expected(p);
            let other = own(1, p) - own(0, p) + in_step(&mirrored, p) + expected(p);
            delta.amax().max(other.amax())
        };
        points.iter().map(off).fold(0.0, Real::max)
    }

    proptest! {
        /// Both are moved by the same rotation, however large, about any place.
        #[test]
        fn two_bodies_that_are_moved_as_one_do_not_slip(
            a in pose(), b in pose(), together in pose(), points in prop::collection::vec(vector(1.0), 3),
        ) {
            let mut world = weightless();
            for at in [a, b] {
                let body = world.add_body(fixed(at), Some(skin())).unwrap();
                world.body_mut(body).unwrap().move_to(together * at).unwrap();
            }
            let motions = free_motions_of(&mut world);
            let slip = largest_against(&world, &motions, &mut RelativeMotion::none(), &points, |_| Vec3::zeros());
            prop_assert!(slip < ROUNDING, "slip {slip:e} m");
        }

        /// The one is moved, the other is free and flies along: `x = (P(c) - c, theta)`.
        #[test]
        fn a_free_body_that_goes_along_with_a_moved_one_does_not_slip(
            a in pose(), b in pose(), shift in vector(0.1), theta in vector(1.5), points in prop::collection::vec(vector(1.0), 3),
        ) {
            let mut world = weightless();
            let lead = world.add_body(fixed(a), Some(skin())).unwrap();
            world.add_body(free(b), Some(skin())).unwrap();
            let together = Pose::new(shift, theta);
            world.body_mut(lead).unwrap().move_to(together * a).unwrap();
            let mut motions = free_motions_of(&mut world);
            let center = sides(&world)[1].pose() * nalgebra::Point3::new(0.01, -0.02, 0.03);
            let along = (together * center) - center;
            motions[1].displacement = Vec6::new(along.x, along.y, along.z, theta.x, theta.y, theta.z);
            let slip = largest_against(&world, &motions, &mut RelativeMotion::none(), &points, |_| Vec3::zeros());
            prop_assert!(slip < ROUNDING, "slip {slip:e} m");
        }

        /// Both are free and rotate about a common place as they did in the last step.
        #[test]
        fn two_free_bodies_that_rotate_as_one_do_not_slip(
            a in pose(), b in pose(), shift in vector(0.1), theta in vector(0.99), points in prop::collection::vec(vector(1.0), 3),
        ) {
            let mut world = weightless();
            let dt = world.params.dt;
            for at in [a, b] {
                let mut body = free(at);
                body.set_velocity(Vec3::zeros(), theta / dt).unwrap();
                world.add_body(body, Some(skin())).unwrap();
            }
            let mut motions = free_motions_of(&mut world);
            let rotation = Rot::from_scaled_axis(theta);
            let [of_a, of_b] = expected(&world);
            let lever = of_b.origin - of_a.origin;
            let shifts = [shift, shift + rotation * lever - lever];
            for (motion, along) in motions.iter_mut().zip(shifts) {
                motion.displacement = Vec6::new(along.x, along.y, along.z, theta.x, theta.y, theta.z);
            }
            // Which of the two leads is a matter of order: what the one is free to do, to first order, the other does in full.
            let mut relative = RelativeMotion::none();
            relative.renew(sides(&world), dt);
            let own = |k: usize, p: &Vec3| unexpected_displacement(sides(&world)[k], &motions[k], p);
            let slip = points.iter().map(|p| (own(0, p) - own(1, p) + in_step(&relative, p)).amax()).fold(0.0, Real::max);
            // The angular velocity went through the inertia.
            prop_assert!(slip < 100.0 * ROUNDING, "slip {slip:e} m");
        }

        /// A free body goes on against a moved one as in the last two steps: what is left
        /// is just that, `w(p) = rho + (exp(phi) - 1)(p - c)`, on the arc.
        #[test]
        fn a_body_that_goes_on_rolling_slips_by_what_it_rolls(
            a in pose(), b in pose(), shift in vector(0.05), theta in vector(1.0), rho in vector(0.02), phi in vector(0.04),
            points in prop::collection::vec(vector(1.0), 3),
        ) {
            let mut world = weightless();
            let together = Pose::new(shift, theta);
            let lead = world.add_body(fixed(a), Some(skin())).unwrap();
            let follow = world.add_body(free(b), Some(skin())).unwrap();
            let local = nalgebra::Point3::new(0.01, -0.02, 0.03);
            // Step by step in the frame of the one that leads: the centre goes on by rho, the body rotates by phi about it.
            let (mut at, mut relative) = (a.inverse() * b, RelativeMotion::none());
            for step in 0..3 {
                let base = *world.body(lead).unwrap().pose();
                world.body_mut(lead).unwrap().move_to(together * base).unwrap();
                world.body_mut(follow).unwrap().set_pose(base * at).unwrap();
                let mut motions = free_motions_of(&mut world);
                let center = base * at * local;
                // Axes of the world.
                let (by, rotated) = (base.rotation * rho, base.rotation * phi);
                let along = (together * (center + by)) - center;
                let half = Rot::from_scaled_axis(theta * 0.5);
                let rotation = theta + half * rotated;
                motions[1].displacement = Vec6::new(along.x, along.y, along.z, rotation.x, rotation.y, rotation.z);
                let w = |p: &Vec3| by + Rot::from_scaled_axis(rotated) * (p - center.coords) - (p - center.coords);
                relative.renew(sides(&world), world.params.dt);
                if step == 2 {
                    let slip = |p: &Vec3| in_step(&relative, p) - unexpected_displacement(sides(&world)[1], &motions[1], p);
                    let off = points.iter().map(|p| (slip(p) + w(p)).amax()).fold(0.0, Real::max);
                    prop_assert!(off < 10.0 * ROUNDING, "off by {off:e} m");
                }
                let place = at * local;
                let about_the_origin = Rot::from_scaled_axis(phi) * nalgebra::Translation3::from(-place.coords);
                let next = nalgebra::Translation3::from(place.coords + rho) * about_the_origin;
                at = next * at;
                world.body_mut(lead).unwrap().set_pose(together * base).unwrap();
            }
        }
    }

    /// A hand that rotates and closes at once, with what it holds.
    #[test]
    fn what_a_closing_finger_takes_along_does_not_slip() {
        let model = crate::body::HandModel::three_finger().unwrap();
        let base = Pose::new(Vec3::new(0.1, 0.2, 0.3), Vec3::new(0.3, -0.5, 0.7));
        for mut finger in model.instantiate(base, Motion::Inertial).unwrap() {
            let joints = finger.model().joints().len();
            let mut state = finger.state();
            (0..joints).for_each(|k| state.velocities[k] = 40.0 - 25.0 * k as Real);
            finger.restore(&state);
            finger.move_base_to(Pose::new(Vec3::new(0.01, 0.0, -0.02), Vec3::new(0.2, 0.4, -0.3)) * base).unwrap();
            let mut world = weightless();
            world.add_body(free(Pose::new(Vec3::new(0.15, 0.1, 0.25), Vec3::new(1.0, 2.0, -0.5))), Some(skin())).unwrap();
            let slot = world.objects.bodies.insert(BodyEntry { body: Body::Finger(finger), hand: None, quarantined: false });
            let (surface, material) = skin();
            world.insert_collider(slot, joints - 1, Skin::new(surface, material).unwrap(), Filter::default());
            let mut motions = free_motions_of(&mut world);
            // The joints do what they were expected to do.
            motions[1].displacement = motions[1].expected_joints;
            let [Expected { origin: center, .. }, finger] = expected(&world);
            let Expected { origin, shift, theta, joints, .. } = finger;
            assert!(joints.amax() > 0.01 && theta.norm() > 0.1, "{finger:?}");
            let along = shift + Rot::from_scaled_axis(theta) * (center - origin) - (center - origin);
            motions[0].displacement = Vec6::new(along.x, along.y, along.z, theta.x, theta.y, theta.z);
            let points = [Vec3::zeros(), center, Vec3::new(0.2, 0.3, 0.1)];
            let slip = largest_against(&world, &motions, &mut RelativeMotion::none(), &points, |_| Vec3::zeros());
            assert!(slip < ROUNDING, "slip {slip:e} m");
        }
    }
}

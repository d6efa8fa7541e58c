//! What two bodies do together in a step, in full: the linear equations are about what they do apart.
//!
//! A body that turns by `theta` in a step moves its points by `theta x r` to first order, but goes on the arc. Taken to first order about a place of its own, such as
//! the palm of a hand, each of two bodies that turn together would end `theta^2 r / 2` from where the equations have it, each by another `r`; tangential rows are
//! increments, so nothing undoes it, and what is held would leave the hand in every step. So the displacement of the two against each other is linearised about the
//! motion that they are expected to make.

use crate::body::BodyEntry;
use crate::free_motion::{Expected, FreeMotion};
use crate::math::{Mat3, Pose, Real, Vec3, skew};

/// A motion against each other (m, rad) that is more than this in a step was no motion: one of the two was put elsewhere.
const MOST_APART: Real = 0.05;

/// Displacement of `a` against `b` in a step, but for what the equations of motion of the two say: `shift + turn (p - at)`, world axes, m.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Carried {
    at: Vec3,
    shift: Vec3,
    turn: Mat3,
    /// Pose of `b` in the frame of `a` at the start of the last step in which they were near.
    last: Option<Pose>,
    /// rho and phi of the step before that, in the frame of the one that leads.
    before: Option<[Vec3; 2]>,
}

impl Carried {
    /// Of two bodies that were not near before.
    pub(super) fn none() -> Self {
        Self { at: Vec3::zeros(), shift: Vec3::zeros(), turn: Mat3::zeros(), last: None, before: None }
    }

    /// The two were apart.
    pub(super) fn forget(&mut self) {
        (self.last, self.before) = (None, None);
    }

    /// At a point (world, m).
    pub fn displacement(&self, point: &Vec3) -> Vec3 {
        self.shift + self.turn * (point - self.at)
    }

    /// Finds it for the step under way.
    ///
    /// Be `l` the body that leads and `f` the other, `P` the motion that `l` is expected to make (`P(p) = p + s + (R - 1)(p - o)`, R the rotation by theta), c the centre of
    /// mass of `f`, and `w(p) = rho + (exp(phi) - 1) (p - c)` the displacement of `f` against `l`, in the axes that `l` has at the start of the step; rho and phi are taken to go
    /// on as in the last two steps. Then `f` is expected to move by
    ///
    /// ```text
    ///     dc = P(c) - c + R rho          theta_f = theta + H phi          H = R^(1/2), as exp(theta + H phi) = R exp(phi) + O(phi^2)
    /// ```
    ///
    /// and what the two do is, with x the free motion of each, x_e what was expected of it, and J taken at the start of the step:
    ///
    /// ```text
    ///     d_l - d_f = -w(p) + J_l (x_l - x_e,l) - J_f (x_f - x_e,f)
    ///               = J_l (x_l - x_e,l) - J_f x_f + P(c) - c + (R - 1) rho
    ///                 + (theta + H phi) x (p - c) - (exp(phi) - 1) (p - c)
    /// ```
    ///
    /// If `l` is free itself (o: its centre) then J_l x_e,l takes `s + theta x (p - o)` off again. If both lead, each has its own P. A rotation that is not expected changes nothing.
    pub(super) fn renew(&mut self, [a, b]: [&BodyEntry; 2], [free_a, free_b]: [&FreeMotion; 2]) {
        let [pose_a, pose_b] = [a, b].map(|entry| entry.body.link_pose(entry.skin_link));
        let now = pose_a.inverse() * pose_b;
        let last = self.last.replace(now).unwrap_or(now);
        let (of_a, of_b) = (&free_a.expected, &free_b.expected);
        self.at = Vec3::zeros();
        if of_a.leads && of_b.leads {
            let (turn_a, turn_b) = (less_one(&of_a.theta, 1.0), less_one(&of_b.theta, 1.0));
            self.turn = turn_a - turn_b;
            self.shift = of_a.shift - turn_a * of_a.origin - (of_b.shift - turn_b * of_b.origin);
            return;
        }
        if of_a.leads || !of_b.leads {
            self.follow(of_a, &pose_a, of_b, &last, &now);
        } else {
            self.follow(of_b, &pose_b, of_a, &last.inverse(), &now.inverse());
            (self.shift, self.turn) = (-self.shift, -self.turn);
        }
    }

    /// `lead` against `free`. `pose`: of the leading body; `last` and `now`: of the free one in its frame.
    fn follow(&mut self, lead: &Expected, pose: &Pose, free: &Expected, last: &Pose, now: &Pose) {
        (self.at, self.shift, self.turn) = (free.origin, lead.shift, Mat3::zeros());
        if !lead.turns() {
            self.before = None;
            return;
        }
        let center = now.inverse_transform_point(&pose.inverse_transform_point(&free.origin.into()));
        let apart = [now * center - last * center, (now.rotation * last.rotation.inverse()).scaled_axis()];
        // On a line through the last two steps.
        let before = self.before.replace(apart).unwrap_or(apart);
        let known = [apart, before].iter().flatten().all(|v| v.amax() < MOST_APART);
        let [rho, phi] = [0, 1].map(|k| if known { pose.rotation * (apart[k] * 2.0 - before[k]) } else { Vec3::zeros() });
        let lever = free.origin - lead.origin;
        self.shift += less_one(&lead.theta, 1.0) * (lever + rho);
        let mut theta = less_one(&lead.theta, 0.5) * phi;
        if lead.leads {
            theta += lead.theta;
        } else {
            self.shift -= lead.theta.cross(&lever);
        }
        // Of w what phi x (p - c) is not: what turns on the spot against the other leaves it where it is.
        self.turn = skew(&theta) + skew(&phi) - less_one(&phi, 1.0);
    }
}

/// `R - 1`, R the rotation by `share` of a rotation vector (Rodrigues): exactly zero for none, without a difference of near equals for a small one.
fn less_one(theta: &Vec3, share: Real) -> Mat3 {
    let axis = skew(&(theta * share));
    let angle = theta.norm() * share;
    // sin(x)/x is 1 to rounding where x^2 is less than that.
    let over = |x: Real| if x < 1e-9 { 1.0 } else { x.sin() / x };
    axis * over(angle) + axis * axis * (0.5 * over(0.5 * angle).powi(2))
}

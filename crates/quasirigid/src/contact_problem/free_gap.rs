//! `delta_free`: where the contact would be at the end of the step if nothing pressed.

use crate::body::BodyEntry;
use crate::collision::{Contact, Pair};
use crate::free_motion::FreeMotion;
use crate::math::{Real, Vec3};

/// Gap and slip of one contact after the free motion, contact frame, m.
///
/// Design 3.3, with everything seen from the start of the step (`d_a - d_b`: displacement of the two material points against each other by free and told motion, [`Pair::free_displacement`];
/// `u`: elastic displacement, of which `alpha u` is left after the step without force; `e` = contact frame):
///
/// ```text
/// delta_free = gap n + e^T [ d_a - d_b + (alpha_a - 1) u_a - (alpha_b - 1) u_b ]
/// ```
///
/// `gap` is cut where it is an overlap: see [`Contact::solved_gap`]. It already holds `u_a - u_b`: so the normal row is absolute, the tangential rows are increments of the step.
pub(super) fn delta_free(contact: &Contact, pair: &Pair, bodies: &[BodyEntry], free: &[FreeMotion], dt: Real) -> Vec3 {
    let (a, b) = (&bodies[pair.a as usize], &bodies[pair.b as usize]);
    let apart = pair.free_displacement(bodies, free, &contact.point);
    let relaxed = |entry: &BodyEntry, u: Vec3| -> Vec3 {
        let alpha = entry.skin.as_ref().map_or(0.0, |skin| skin.memory(dt));
        entry.body.link_pose(entry.skin_link).rotation * (u * (alpha - 1.0))
    };
    let u_a = pair.side_a.displacement[contact.control_point as usize];
    let u_b = pair.displacement_of_b(contact.control_point as usize, &contact.weights_b);
    let mut delta = contact.frame.transpose() * (apart + relaxed(a, u_a) - relaxed(b, u_b));
    delta.x += contact.solved_gap;
    delta
}

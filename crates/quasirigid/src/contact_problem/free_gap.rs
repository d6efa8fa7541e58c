//! `delta_free`: gap and slip of a contact at the end of the step without reactions.

use crate::free_motion::FreeMotion;
use crate::math::{Mat3, Real, Vec3};
use crate::objects::{Objects, Side};
use crate::pair::{Contact, Pair};

/// Gap and slip of one contact after the free motion, in its friction axes, m: `frames` at the start of the step and where it acts.
///
/// Design 3.3, with everything seen from the start of the step (`r`: expected displacement of the two
/// material points against each other, in full, as the one that leads sees it; `d_a - d_b`: what their free motions differ from that, to first order
/// about the end of the step, [`Pair::unexpected_displacement`]; `u`: elastic displacement, of which `alpha u` is left after the
/// step without force; `e` = the contact's friction axes, [`super::friction_axes`], `e'` as they are at the end of the step):
///
/// ```text
/// delta_free = gap n + e'^T [ d_a - d_b ] + e^T [ r + (alpha_a - 1) u_a - (alpha_b - 1) u_b ]
/// ```
///
/// `gap` is cut where it is an overlap: see [`Contact::solved_gap`]. It already holds `u_a - u_b`:
/// so the normal row is absolute, the tangential rows are increments of the step.
pub(super) fn delta_free(contact: &Contact, frames: [&Mat3; 2], pair: &Pair, objects: &Objects, free: &[FreeMotion], dt: Real) -> Vec3 {
    let [a, b] = pair.sides(objects);
    let [axes, acts_along] = frames;
    let (expected, moved) =
        (pair.relative_motion.displacement(&contact.point), pair.unexpected_displacement(objects, free, &contact.acts_at));
    let relaxed = |side: Side<'_>, u: Vec3| -> Vec3 { side.pose().rotation * (u * (side.collider.skin.memory(dt) - 1.0)) };
    let u_a = pair.side_a.displacement[contact.control_point as usize];
    let u_b = pair.displacement_of_b(contact.control_point as usize, &contact.weights_b);
    let mut delta = acts_along.tr_mul(&moved) + axes.tr_mul(&(expected + relaxed(a, u_a) - relaxed(b, u_b)));
    delta.x += contact.solved_gap;
    delta
}

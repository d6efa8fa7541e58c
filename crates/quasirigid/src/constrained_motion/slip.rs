//! Slip speeds, where friction is velocity-weakening: the next step takes its coefficients from them.

use crate::contact_problem::ContactProblem;
use crate::math::Real;
use crate::pair::{Contact, Pair};

/// Remembers the slip speed of every contact of the pairs whose friction is velocity-weakening. A contact that is near but open
/// counts too: so a control point that comes to bear under a sliding body has the coefficient of its neighbours at once.
pub(super) fn remember(pairs: &mut [Pair], contacts: &[Contact], problem: &ContactProblem, dt: Real) {
    if pairs.iter().all(|pair| pair.slip_speed.is_empty()) {
        return;
    }
    for pair in pairs.iter_mut() {
        pair.slip_speed.fill(0.0);
    }
    for (i, contact) in contacts.iter().enumerate() {
        if let Some(speed) = pairs[contact.pair as usize].slip_speed.get_mut(contact.control_point as usize) {
            // `max` replaces NaN by 0: at rest.
            *speed = (problem.slip(i, contact) / dt).max(0.0);
        }
    }
}

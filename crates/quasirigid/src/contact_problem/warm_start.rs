//! What the solver starts from: the reactions of the last steps, continued.

use super::ContactProblem;
use crate::math::{Real, Vec3};
use crate::pair::{Contact, Pair, ReactionHistory, patches};

/// A patch whose reactions changed by less than this share in a step is taken to be at rest.
const LEAST_TREND: Real = 1e-6;

/// Reactions have to change by this many times what the solver left unfinished, or they are not predicted.
const SURE: Real = 10.0;

impl ReactionHistory {
    /// The reaction that a control point would have if it changed as in the last steps, contact frame, N.
    pub(super) fn predict(&self, control_point: usize) -> Vec3 {
        let (last, trend) = (self.last[control_point], self.trend[control_point]);
        if last.x + trend.x > 0.0 { last + trend } else { last }
    }

    /// Takes in the reactions that were found for the contacts of a patch. `loaded_before` is
    /// scratch; `least_trend`: relative change below which the patch is at rest.
    fn remember(&mut self, loaded_before: &mut Vec<u32>, patch: &[Contact], reactions: &[Vec3], least_trend: Real) {
        let Self { last, trend, change, loaded } = self;
        // Meanwhile the trend holds the last reactions.
        for &c in loaded.iter() {
            trend[c as usize] = std::mem::take(&mut last[c as usize]);
        }
        std::mem::swap(loaded_before, loaded);
        loaded.clear();
        let (mut sum_force, mut sum_change) = (0.0, 0.0);
        for (contact, f) in patch.iter().zip(reactions) {
            let c = contact.control_point as usize;
            let before = std::mem::take(&mut trend[c]);
            if *f != Vec3::zeros() {
                last[c] = *f;
                loaded.push(contact.control_point);
                if before != Vec3::zeros() {
                    // Along a parabola through the last three, where there are three: smooth motion
                    // then starts the solver fifty times nearer than along a line.
                    let change_before = std::mem::replace(&mut change[c], f - before);
                    trend[c] = if change_before == Vec3::zeros() { change[c] } else { change[c] * 2.0 - change_before };
                    sum_force += f.norm_squared();
                    sum_change += change[c].norm_squared();
                    continue;
                }
            }
            change[c] = Vec3::zeros();
        }
        for c in loaded_before.drain(..).filter(|&c| last[c as usize] == Vec3::zeros()) {
            (trend[c as usize], change[c as usize]) = (Vec3::zeros(), Vec3::zeros());
        }
        // At rest the changes are the solver's last digits: to extrapolate them would only cost sweeps.
        if sum_change < least_trend * least_trend * sum_force {
            for &c in loaded.iter() {
                (trend[c as usize], change[c as usize]) = (Vec3::zeros(), Vec3::zeros());
            }
        }
    }
}

/// Remembers the reactions of all pairs, for the warm start of the next step.
pub(crate) fn remember(loaded_before: &mut Vec<u32>, pairs: &mut [Pair], contacts: &[Contact], problem: &ContactProblem) {
    // The error of a solve that was cut short is no motion: extrapolated from step to step it would grow.
    let least_trend = LEAST_TREND.max(SURE * problem.unfinished);
    let count = pairs.len();
    for (pair, patch) in pairs.iter_mut().zip(patches(contacts, count)) {
        if !(patch.is_empty() && pair.reactions.loaded.is_empty()) {
            pair.reactions.remember(loaded_before, &contacts[patch.clone()], &problem.reactions[patch], least_trend);
        }
    }
}

//! One part of a hand (palm or fingertip): what is known of it, and how what is shown differs from that.

use super::options::TrackingOptions;
use super::track::Track;
use crate::{Pose, Rot, Vec3};

/// With which a part goes to where it is seen again, at most, m/s and rad/s: no faster than a hand.
pub(super) const FASTEST: (f64, f64) = (0.5, 3.0);
/// After a longer time without being seen, s, a part does not go straight from where it was to where it is.
const BRIDGED: f64 = 0.12;
/// What is farther than this, m, from what it was seen together with does not go with it: it is no part of this hand.
const HAND: f64 = 0.25;
/// For the noise of measured poses: a jump is judged as if it had taken so long at least, s.
const SHORTEST: f64 = 8e-3;

/// A part, as known and as shown.
#[derive(Debug, Clone)]
pub(super) struct Part {
    pub track: Track,
    /// In the newest frame.
    pub seen: bool,
    /// Time of the first frame without it after its newest pose, s on the tracker's clock.
    pub missing: Option<f64>,
    /// What it was last seen together with, and its pose in that thing's frame.
    pub carrier: Option<(usize, Pose)>,
    /// The same for the first pose of its track, if it was seen elsewhere before.
    pub entry: Option<(usize, Pose)>,
    /// Difference of what is shown to what is known: added to the position, and turned after the rotation.
    pub offset: (Vec3, Rot),
    pub weight: f64,
    /// As measured, and as shown, m.
    pub pad_radius: (f64, f64),
}

impl Default for Part {
    fn default() -> Self {
        Self {
            track: Track::default(),
            seen: false,
            missing: None,
            carrier: None,
            entry: None,
            offset: (Vec3::zeros(), Rot::identity()),
            weight: 0.0,
            pad_radius: (0.0, 0.0),
        }
    }
}

impl Part {
    /// A frame saw it. `carrier`: what it was seen together with.
    pub fn see(&mut self, time: f64, pose: Pose, carrier: Option<(usize, Pose)>) {
        self.track.insert(time, pose);
        if let Some(missing) = self.missing.filter(|&missing| missing < time) {
            self.missing = None;
            if self.track.split(missing, plausible) {
                self.entry = carrier.filter(|(_, relative)| relative.translation.vector.norm() < HAND);
            }
        }
    }

    /// It moved fast: `suspects` were not believed until now, and its frames counted as without it.
    pub fn confirm(&mut self, suspects: &Track) {
        self.missing = self.missing.filter(|&missing| suspects.oldest().is_some_and(|first| missing < first));
        self.track.add(suspects);
    }

    /// It is elsewhere since the first of `suspects`. What is shown glides there.
    pub fn relocate(&mut self, suspects: &Track) {
        self.track.restart_with(suspects);
        (self.missing, self.entry) = (None, None);
    }

    /// The newest radius of its pad, m. What is shown glides to it, as a place does.
    pub fn measure_pad(&mut self, radius: f64) {
        self.pad_radius = (radius, if self.weight > 0.0 { self.pad_radius.1 } else { radius });
    }

    /// A frame did not see it.
    pub fn lack(&mut self, time: f64) {
        match self.track.newest() {
            Some(newest) if time > newest => self.missing = Some(self.missing.map_or(time, |first| first.min(time))),
            // A frame that was overtaken by one in which it is seen again.
            Some(_) if self.track.split(time, plausible) => self.entry = None,
            _ => {}
        }
    }

    /// The tracker starts anew with a frame of this time. If that does not see it, it is held where it was.
    pub fn start_anew(&mut self, time: f64, seen: bool) {
        let held = self.track.last().filter(|_| !seen);
        self.track.clear();
        (self.entry, self.missing) = (None, held.map(|_| time));
        if let Some(pose) = held {
            self.track.insert(time, pose);
        }
    }

    /// Sets the offset so that `before` is shown where `known` is known.
    pub fn absorb(&mut self, before: Option<&Pose>, known: Option<&Pose>) {
        self.offset = match (before, known) {
            // Without weight nobody is pulled: straight to the new place.
            (Some(before), Some(known)) if self.weight > 0.0 => {
                (before.translation.vector - known.translation.vector, before.rotation * known.rotation.inverse())
            }
            _ => (Vec3::zeros(), Rot::identity()),
        };
    }

    /// Lets the offset fade for `dt`, s.
    pub fn fade(&mut self, dt: f64, catch: f64) {
        let (shift, turn) = &mut self.offset;
        *shift *= kept(shift.norm(), dt, catch, FASTEST.0);
        let axis = turn.scaled_axis();
        *turn = Rot::from_scaled_axis(axis * kept(axis.norm(), dt, catch, FASTEST.1));
        let (measured, shown) = &mut self.pad_radius;
        let off = *shown - *measured;
        *shown = *measured + off * kept(off.abs(), dt, catch, FASTEST.0);
    }

    /// With which the offset fades, m/s and rad/s.
    pub fn fading(&self, catch: f64) -> (Vec3, Vec3) {
        let (shift, axis) = (self.offset.0, self.offset.1.scaled_axis());
        (-shift * share_per_second(shift.norm(), catch, FASTEST.0), -axis * share_per_second(axis.norm(), catch, FASTEST.1))
    }

    /// What is shown where `known` is known.
    pub fn shown(&self, known: &Pose) -> Pose {
        let (shift, turn) = &self.offset;
        Pose::from_parts((known.translation.vector + shift).into(), turn * known.rotation)
    }

    /// Weight that it may have at `now` (s on the tracker's clock), if a stream that is silent for `silence` s still counts as one.
    pub fn allowed_weight(&self, now: f64, silence: f64, options: &TrackingOptions) -> f64 {
        let Some(newest) = self.track.newest() else { return 0.0 };
        let since = if self.seen { newest + silence } else { self.missing.unwrap_or(newest) };
        let over = now - since - options.hold;
        if over <= 0.0 {
            1.0
        } else if over >= options.fade {
            0.0
        } else {
            1.0 - over / options.fade
        }
    }

    /// Lets the weight rise for `dt` s if it is seen, and keeps it within what is allowed.
    pub fn weigh(&mut self, dt: f64, allowed: f64, catch: f64) {
        let rise = if self.seen { dt / catch } else { 0.0 };
        self.weight = (self.weight + rise).min(allowed);
    }
}

/// Whether a part that was unseen for `gap` s, at `predicted` if it had gone on as before, may have gone straight to `found`: it is then
/// shown within half of [`FASTEST`] of how it moved, and the other half is left for what fades.
fn plausible(gap: f64, predicted: &Pose, found: &Pose) -> bool {
    let most = 0.5 * gap.max(SHORTEST);
    let apart = (found.translation.vector - predicted.translation.vector).norm();
    gap <= BRIDGED && apart <= most * FASTEST.0 && found.rotation.angle_to(&predicted.rotation) <= most * FASTEST.1
}

/// How much of a difference is taken away per second: 1 / `catch`, or less if that would be more than `fastest`.
fn share_per_second(size: f64, catch: f64, fastest: f64) -> f64 {
    (1.0 / catch).min(fastest / size.max(1e-12))
}

/// What is left after `dt` of a difference that fades as [`share_per_second`] says: straight down to `fastest * catch`, and then
/// exponentially.
fn kept(size: f64, dt: f64, catch: f64, fastest: f64) -> f64 {
    let straight = ((size - fastest * catch) / fastest).max(0.0).min(dt);
    (1.0 - fastest * straight / size.max(1e-12)) * (-(dt - straight) / catch).exp()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn a_difference_fades_as_its_rate_says_and_never_faster(size in 1e-6..2.0f64, catch in 0.01..1.0f64) {
            let (mut small, mut fastest) = (size, 0.0f64);
            for _ in 0..1000 {
                let before = small;
                small *= kept(small, 1e-3, catch, 0.5);
                fastest = fastest.max((before - small) / 1e-3);
                let rate = before * share_per_second(before, catch, 0.5);
                prop_assert!(((before - small) / 1e-3 - rate).abs() <= rate * 1e-3 / catch, "{} and {rate}", (before - small) / 1e-3);
            }
            prop_assert!(fastest <= 0.5 * (1.0 + 1e-9), "{fastest} m/s");
            let at_once = size * kept(size, 1.0, catch, 0.5);
            prop_assert!((small - at_once).abs() < 1e-9 * size, "{small} in steps, {at_once} at once");
        }
    }

    #[test]
    fn frames_without_the_part_part_its_track_in_any_order() {
        let at = |x: f64| Pose::translation(x, 0.0, 0.0);
        let samples = [(0.0, Some(0.0)), (0.02, Some(0.01)), (0.04, None), (0.06, Some(0.33)), (0.08, Some(0.34))];
        // In order; the frame without it last; the old place after the new one.
        for order in [[0, 1, 2, 3, 4], [0, 1, 3, 4, 2], [0, 2, 3, 1, 4]] {
            let mut part = Part::default();
            for (time, x) in order.map(|k: usize| samples[k]) {
                match x {
                    Some(x) => part.see(time, at(x), None),
                    None => part.lack(time),
                }
            }
            let x = |time: f64| part.track.at(time, 0.05).unwrap().pose.translation.x;
            assert_eq!((x(0.0), x(0.06), x(0.08)), (0.33, 0.33, 0.34), "{order:?}");
        }
        // One that goes on as before is not parted.
        let mut part = Part::default();
        part.see(0.0, at(0.0), None);
        part.see(0.02, at(0.01), None);
        part.lack(0.04);
        part.see(0.06, at(0.032), None);
        assert_eq!(part.track.at(0.0, 0.05).unwrap().pose, at(0.0));
    }
}

//! One tracked thing (palm or fingertip): its latest poses, and where it was at any moment.

use crate::{Pose, Rot, Vec3};
use std::collections::VecDeque;

/// Poses that are kept: two seconds at 500 Hz, enough for the longest delay.
const KEPT: usize = 1024;
/// Half width of the window in which velocities are fitted, s. Noise of 0.3 mm at 500 Hz would else be 0.2 m/s.
const HALF_WINDOW: f64 = 0.04;
/// A motion that was not seen for longer, s, says no more where a part should be: a finger takes another one's place within it.
const REMEMBERED_MOTION: f64 = 0.07;

/// A pose and how it moves.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Motion {
    pub pose: Pose,
    /// m/s.
    pub linear: Vec3,
    /// rad/s, in the outer frame.
    pub angular: Vec3,
}

impl Motion {
    /// The motion of a point fixed to this body: `pose12` is its pose in the body's frame.
    pub fn carry(&self, pose12: &Pose) -> Self {
        let pose = self.pose * pose12;
        let arm = pose.translation.vector - self.pose.translation.vector;
        Self { pose, linear: self.linear + self.angular.cross(&arm), angular: self.angular }
    }
}

/// Timed poses in order of their times.
#[derive(Debug, Clone)]
pub(super) struct Track {
    samples: VecDeque<(f64, Pose)>,
    /// How many are kept.
    kept: usize,
    /// What is older than this, s, belongs to another place.
    since: f64,
}

impl Default for Track {
    fn default() -> Self {
        Self::with_room_for(KEPT)
    }
}

impl Track {
    /// A track that keeps the newest `kept` poses.
    pub fn with_room_for(kept: usize) -> Self {
        Self { samples: VecDeque::with_capacity(kept + 1), kept, since: f64::NEG_INFINITY }
    }

    /// Puts a pose in its place in time. Duplicates and what is older than all that is kept are dropped. Whether it was new.
    pub fn insert(&mut self, time: f64, pose: Pose) -> bool {
        if time < self.since {
            return false;
        }
        let place = self.samples.partition_point(|&(t, _)| t < time);
        let twin = |k: usize| self.samples.get(k).is_some_and(|&(t, _)| (t - time).abs() < 1e-7);
        if twin(place) || (place > 0 && twin(place - 1)) || (place == 0 && self.samples.len() == self.kept) {
            return false;
        }
        self.samples.insert(place, (time, pose));
        if self.samples.len() > self.kept {
            self.samples.pop_front();
        }
        true
    }

    /// Goes on with the poses of another track alone; what is older belongs to another place.
    pub fn restart_with(&mut self, other: &Self) {
        self.samples.clear();
        self.since = other.oldest().unwrap_or(f64::NEG_INFINITY);
        self.add(other);
    }

    /// Takes in the poses of another track.
    pub fn add(&mut self, other: &Self) {
        for &(time, pose) in &other.samples {
            self.insert(time, pose);
        }
    }

    pub fn clear(&mut self) {
        self.samples.clear();
        self.since = f64::NEG_INFINITY;
    }

    /// Forgets what was before `time` unless the motion may have gone on over it: `plausible` is told the time between the poses on both
    /// sides, where the first would have gone, and the second. Whether it forgot.
    pub fn split(&mut self, time: f64, plausible: impl Fn(f64, &Pose, &Pose) -> bool) -> bool {
        let place = self.samples.partition_point(|&(t, _)| t < time);
        if place == 0 || place == self.samples.len() {
            return false;
        }
        let ((t0, before), (t1, after)) = (self.samples[place - 1], self.samples[place]);
        let start = self.samples.partition_point(|&(t, _)| t < t0 - HALF_WINDOW);
        let (linear, angular) = self.slope(start.min(place.saturating_sub(2)), place);
        let position = before.translation.vector + linear * (t1 - t0);
        let predicted = Pose::from_parts(position.into(), Rot::from_scaled_axis(angular * (t1 - t0)) * before.rotation);
        let parted = !plausible(t1 - t0, &predicted, &after);
        if parted {
            self.samples.drain(..place);
            self.since = time;
        }
        parted
    }

    /// How many poses there are.
    pub fn len(&self) -> usize {
        self.samples.len()
    }

    /// Times of all poses, in order.
    pub fn times(&self) -> impl Iterator<Item = f64> {
        self.samples.iter().map(|&(time, _)| time)
    }

    /// The newest pose and its time.
    pub fn end(&self) -> Option<(f64, Pose)> {
        self.samples.back().copied()
    }

    /// Velocity at the newest pose, m/s, fitted to the poses of the last [`HALF_WINDOW`] and two at least; zero of a single one.
    pub fn end_velocity(&self) -> Vec3 {
        let count = self.samples.len();
        let Some((newest, _)) = self.end().filter(|_| count > 1) else { return Vec3::zeros() };
        let start = self.samples.partition_point(|&(t, _)| t < newest - HALF_WINDOW);
        self.slope(start.min(count - 2), count).0
    }

    /// Where it should be at `time` if it goes on as it was, for [`REMEMBERED_MOTION`] at most. None later, or before the newest pose.
    pub fn expected(&self, time: f64) -> Option<Pose> {
        let (newest, pose) = self.end()?;
        let ahead = time - newest;
        let position = pose.translation.vector + self.end_velocity() * ahead;
        (ahead > 0.0 && ahead <= REMEMBERED_MOTION).then(|| Pose::from_parts(position.into(), pose.rotation))
    }

    /// The oldest two poses, in order.
    pub fn first_two(&self) -> [Option<(f64, Pose)>; 2] {
        [self.samples.front().copied(), self.samples.get(1).copied()]
    }

    /// The newest two poses, in order.
    pub fn last_two(&self) -> [Option<(f64, Pose)>; 2] {
        let count = self.samples.len();
        [count.checked_sub(2).and_then(|k| self.samples.get(k).copied()), self.samples.back().copied()]
    }

    /// The poses at or before `time`, and after it.
    pub fn around(&self, time: f64) -> [Option<(f64, Pose)>; 2] {
        let after = self.samples.partition_point(|&(t, _)| t <= time);
        [after.checked_sub(1).and_then(|k| self.samples.get(k).copied()), self.samples.get(after).copied()]
    }

    /// The newest pose.
    pub fn last(&self) -> Option<Pose> {
        self.samples.back().map(|&(_, pose)| pose)
    }

    /// Time of the oldest pose that is kept.
    pub fn oldest(&self) -> Option<f64> {
        self.samples.front().map(|&(time, _)| time)
    }

    /// Time of the newest pose.
    pub fn newest(&self) -> Option<f64> {
        self.samples.back().map(|&(time, _)| time)
    }

    /// Where it was at `time`: between two poses by interpolation; after the newest one it runs on and comes to rest, with the time
    /// constant `run_on` (s).
    pub fn at(&self, time: f64, run_on: f64) -> Option<Motion> {
        let (&(first, earliest), &(last, latest)) = (self.samples.front()?, self.samples.back()?);
        if time >= last {
            let (linear, angular) = self.velocity(last);
            // x + v T (1 - exp(-s/T)): continuous in position and velocity, never farther than v T.
            let fading = (-(time - last) / run_on).exp();
            let ahead = run_on * (1.0 - fading);
            let position = latest.translation.vector + linear * ahead;
            let rotation = Rot::from_scaled_axis(angular * ahead) * latest.rotation;
            return Some(Motion { pose: Pose::from_parts(position.into(), rotation), linear: linear * fading, angular: angular * fading });
        }
        if time <= first {
            return Some(Motion { pose: earliest, linear: Vec3::zeros(), angular: Vec3::zeros() });
        }
        let after = self.samples.partition_point(|&(t, _)| t <= time);
        let ((t0, a), (t1, b)) = (self.samples[after - 1], self.samples[after]);
        let (linear, angular) = self.velocity(time);
        Some(Motion { pose: between(&a, &b, (time - t0) / (t1 - t0)), linear, angular })
    }

    /// Least-squares slope of the positions, and the mean turn, within a window about `time`; of the two nearest poses if there are no
    /// more.
    fn velocity(&self, time: f64) -> (Vec3, Vec3) {
        let count = self.samples.len();
        if count < 2 {
            return (Vec3::zeros(), Vec3::zeros());
        }
        let mut from = self.samples.partition_point(|&(t, _)| t < time - HALF_WINDOW);
        let mut to = self.samples.partition_point(|&(t, _)| t <= time + HALF_WINDOW);
        if to - from < 2 {
            let after = self.samples.partition_point(|&(t, _)| t <= time).clamp(1, count - 1);
            (from, to) = (after - 1, after + 1);
        }
        self.slope(from, to)
    }

    /// Least-squares slope of the positions `from..to`, and the mean turn from the first to the last of them; zero for a single one.
    fn slope(&self, from: usize, to: usize) -> (Vec3, Vec3) {
        let window = || self.samples.range(from..to);
        let (n, time) = ((to - from) as f64, self.samples[from].0);
        let middle = window().map(|&(t, _)| t - time).sum::<f64>() / n;
        let mean = window().map(|(_, pose)| pose.translation.vector).sum::<Vec3>() / n;
        let (mut slope, mut spread) = (Vec3::zeros(), 0.0);
        for (t, pose) in window() {
            let s = t - time - middle;
            slope += (pose.translation.vector - mean) * s;
            spread += s * s;
        }
        let ((t0, a), (t1, b)) = (self.samples[from], self.samples[to - 1]);
        let turn = (b.rotation * a.rotation.inverse()).scaled_axis();
        if spread > 0.0 { (slope / spread, turn / (t1 - t0)) } else { (Vec3::zeros(), Vec3::zeros()) }
    }
}

/// `share` 0 is `a`, 1 is `b`.
fn between(a: &Pose, b: &Pose, share: f64) -> Pose {
    let position = a.translation.vector.lerp(&b.translation.vector, share);
    let turn = (b.rotation * a.rotation.inverse()).scaled_axis();
    Pose::from_parts(position.into(), Rot::from_scaled_axis(turn * share) * a.rotation)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn pose(x: f64) -> Pose {
        Pose::from_parts(Vec3::new(x, 0.0, 0.0).into(), Rot::from_euler_angles(0.0, 0.0, x))
    }

    proptest! {
        #[test]
        fn order_of_arrival_does_not_matter(order in Just((0..40usize).collect::<Vec<_>>()).prop_shuffle(), at in 0.0..0.5f64) {
            let (mut sorted, mut shuffled) = (Track::default(), Track::default());
            for k in 0..40 {
                sorted.insert(0.01 * k as f64, pose((0.1 * k as f64).sin()));
            }
            for k in order {
                for _ in 0..2 {
                    shuffled.insert(0.01 * k as f64, pose((0.1 * k as f64).sin()));
                }
            }
            prop_assert_eq!(sorted.at(at, 0.05), shuffled.at(at, 0.05));
        }

        #[test]
        fn uniform_motion_is_reproduced(speed in -2.0..2.0f64, at in 0.0..0.2f64) {
            let mut track = Track::default();
            for k in 0..=20 {
                track.insert(0.01 * k as f64, pose(speed * 0.01 * k as f64));
            }
            let motion = track.at(at, 0.05).unwrap();
            prop_assert!((motion.pose.translation.x - speed * at).abs() < 1e-12);
            prop_assert!((motion.linear.x - speed).abs() < 1e-9 && (motion.angular.z - speed).abs() < 1e-9 || at == 0.0);
        }
    }

    #[test]
    fn after_the_newest_pose_it_runs_on_and_comes_to_rest() {
        let mut track = Track::default();
        assert_eq!(track.at(0.0, 0.05), None);
        for k in 0..=10 {
            track.insert(0.01 * k as f64, pose(0.01 * k as f64));
        }
        let x = |t: f64| track.at(t, 0.05).unwrap().pose.translation.x;
        assert!((x(0.1 + 1e-6) - 0.1).abs() < 2e-6, "continuous");
        assert!((x(0.11) - 0.11).abs() < 1.2e-3, "close to uniform motion at first");
        assert!((x(5.0) - 0.15).abs() < 1e-9, "and ends one time constant ahead");
        let carried = track.at(0.05, 0.05).unwrap().carry(&Pose::translation(0.0, 1.0, 0.0));
        assert!(
            (carried.linear - Vec3::new(1.0, 0.0, 0.0) - Vec3::z().cross(&(carried.pose.translation.vector - Vec3::new(0.05, 0.0, 0.0))))
                .norm()
                < 1e-9
        );
    }
}

//! From frames that come as they come to poses for every step: [`HandTracker`].
//!
//! **Time.** Frames are put in the order of their own times, so late ones, duplicates and jitter do no harm. The hand is shown a little in the past
//! ([`Delay`]): by default one period of the tracker plus the lateness of 95 of 100 packets, at most 0.1 s. There, poses are interpolated. Where the next
//! frame is missing, the motion runs on and comes to rest. When it comes after all, the difference is not jumped but fades away
//! ([`TrackingOptions::catch`]). The result is continuous for any sequence of frames.
//!
//! **Loss.** What is not seen any more keeps its place relative to the palm if that is seen, else to another finger that is, else in the room.
//! Its weight stays 1 for [`TrackingOptions::hold`] and then goes to 0 within [`TrackingOptions::fade`]. When it is seen again, the pose glides to it and
//! the weight rises. A spring to a target should be scaled by the weight.

mod clock;
mod track;

pub use clock::ClockSync;

use crate::error::{Error, Result, check_within};
use crate::hand_frame::ReferenceFrame;
use crate::{HandFrame, Pose, Rot, Side, Vec3};
use track::{Motion, Track};

/// Index of the palm behind the five fingers.
const PALM: usize = 5;
/// Frames that may wait between two samples; older ones are dropped.
const WAITING: usize = 256;
/// Longest automatic delay, s: more than this makes a hand hard to control.
const LONGEST_DELAY: f64 = 0.1;
/// A clock that is this far from where it should be (s) was set, not drifting.
const CLOCK_SET: f64 = 0.5;
/// How much faster or slower than time the hand may be shown to correct the delay.
const SLEW: f64 = 0.1;

/// How far in the past the hand is shown.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Delay {
    /// One period of the tracker plus the lateness of 95 of 100 packets, at most 0.1 s.
    Auto,
    /// So many seconds. 0 predicts: the least latency, and overshoots when the hand turns back.
    Fixed(f64),
}

/// What can be chosen about [`HandTracker`]; times in s.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TrackingOptions {
    /// How far in the past the hand is shown.
    pub delay: Delay,
    /// How long something that is not seen keeps its full weight. Longer bridges longer losses, shorter lets go sooner.
    pub hold: f64,
    /// How long the weight then takes to 0.
    pub fade: f64,
    /// Time constant with which a pose glides to where it should be, and the time that the weight takes to 1. Shorter catches up sooner and jerks more.
    pub catch: f64,
}

impl Default for TrackingOptions {
    fn default() -> Self {
        Self { delay: Delay::Auto, hold: 0.5, fade: 0.5, catch: 0.1 }
    }
}

impl TrackingOptions {
    /// # Errors
    /// [`Error::InvalidValue`] for times that are not finite, negative, or of no use: more than a minute, a delay over 1 s, `catch` under 1 ms.
    pub fn check(&self) -> Result<()> {
        if let Delay::Fixed(delay) = self.delay {
            check_within("delay", delay, 0.0, 1.0, "s")?;
        }
        check_within("hold", self.hold, 0.0, 60.0, "s")?;
        check_within("fade", self.fade, 0.0, 60.0, "s")?;
        check_within("catch", self.catch, 1e-3, 60.0, "s")
    }
}

/// How a target stands.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum TargetState {
    /// Seen.
    Live,
    /// Not seen, weight still up.
    Held,
    /// Not seen, weight going down.
    Fading,
    /// Not seen for long: weight 0.
    Lost,
}

/// Where a palm or fingertip should be.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Target {
    /// In the world.
    pub pose: Pose,
    /// m/s, world.
    pub linear_velocity: Vec3,
    /// rad/s, world.
    pub angular_velocity: Vec3,
    /// 0 to 1: how much to believe it. Continuous in time.
    pub weight: f64,
    /// m; 0 for the palm.
    pub pad_radius: f64,
    /// Seen or not.
    pub state: TargetState,
}

/// A hand at the moment it was asked for.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct HandTargets {
    /// The palm; None if it was never seen.
    pub palm: Option<Target>,
    /// By [`crate::Finger`]; None for those never seen.
    pub fingers: [Option<Target>; 5],
    /// How far in the past the hand is shown, s.
    pub delay: f64,
    /// Time on the tracker's clock that is shown, s.
    pub time: f64,
}

#[derive(Debug, Clone)]
struct Tracked {
    track: Track,
    /// In the newest frame.
    seen: bool,
    pad_radius: f64,
    /// What it was last seen together with, and its pose in that thing's frame.
    carrier: Option<(usize, Pose)>,
    /// Difference of what is shown to what is known: added to the position, and turned after the rotation.
    offset: (Vec3, Rot),
    weight: f64,
}

/// One hand: takes frames when they come, gives targets when they are needed. Allocates nothing once made.
#[derive(Debug, Clone)]
pub struct HandTracker {
    side: Side,
    options: TrackingOptions,
    world_from_tracker: Pose,
    tracked: [Tracked; 6],
    clock: ClockSync,
    waiting: Vec<HandFrame>,
    newest: f64,
    /// Tracker time that is shown, and own time when it was.
    shown: Option<(f64, f64)>,
}

impl HandTracker {
    /// A tracker for one hand; frames in the tracker's room are moved by `world_from_tracker`.
    ///
    /// # Errors
    /// [`Error::InvalidValue`] as [`TrackingOptions::check`].
    pub fn new(side: Side, world_from_tracker: Pose, options: TrackingOptions) -> Result<Self> {
        options.check()?;
        let nothing = || Tracked {
            track: Track::default(),
            seen: false,
            pad_radius: 0.0,
            carrier: None,
            offset: (Vec3::zeros(), Rot::identity()),
            weight: 0.0,
        };
        let tracked = std::array::from_fn(|_| nothing());
        let waiting = Vec::with_capacity(WAITING);
        Ok(Self {
            side,
            options,
            world_from_tracker,
            tracked,
            clock: ClockSync::default(),
            waiting,
            newest: f64::NEG_INFINITY,
            shown: None,
        })
    }

    /// Left or right.
    pub fn side(&self) -> Side {
        self.side
    }

    /// Takes a frame; it counts from the next [`HandTracker::sample`] on.
    ///
    /// # Errors
    /// [`Error::InvalidValue`] for a frame of the other hand or with numbers that are not finite. Such a frame changes nothing.
    pub fn push(&mut self, frame: &HandFrame) -> Result<()> {
        if frame.side != self.side {
            return Err(Error::value("side", self.side.name(), frame.side.name(), "use one tracker for each hand"));
        }
        check_finite(frame)?;
        let frame = if frame.frame == ReferenceFrame::Tracker { frame.transformed(&self.world_from_tracker) } else { *frame };
        if self.waiting.len() == WAITING {
            self.waiting.remove(0);
        }
        self.waiting.push(frame);
        Ok(())
    }

    /// The hand at the own time `now`, s, on the clock of the arrivals. To be asked with times that do not fall back; None before the first frame.
    pub fn sample(&mut self, now: f64) -> Option<HandTargets> {
        let (last_shown, last_now) = self.shown.map_or((None, now), |(shown, at)| (Some(shown), at));
        let dt = if now.is_finite() { (now - last_now).max(0.0) } else { 0.0 };
        let now = last_now + dt;
        let news = !self.waiting.is_empty();
        let before = last_shown.map(|shown| self.poses(shown + dt));
        let restarted = self.take_waiting();
        if !self.clock.is_running() {
            return None;
        }
        let delay = self.delay();
        let wanted = self.clock.tracker_time(now) - delay;
        let shown = match last_shown {
            Some(shown) if !restarted && (wanted - shown - dt).abs() < CLOCK_SET => {
                shown + dt + (wanted - shown - dt).clamp(-SLEW * dt, SLEW * dt)
            }
            _ => wanted,
        };
        let jumped = last_shown.is_some_and(|last| (shown - last - dt).abs() > SLEW * dt + 1e-9);
        if let Some(before) = before.filter(|_| news || jumped) {
            // What the news change is not shown at once. At the time that would be shown without the news, or at the new one after a jump.
            let at = if jumped { shown } else { last_shown.unwrap_or(shown) + dt };
            self.absorb(&before, at);
        }
        self.shown = Some((shown, now));
        self.fade(dt, self.clock.tracker_time(now));
        let target = |k: usize| self.target(k, shown);
        Some(HandTargets { palm: target(PALM), fingers: std::array::from_fn(target), delay, time: shown })
    }

    /// How far in the past the hand is shown now, s.
    pub fn delay(&self) -> f64 {
        match self.options.delay {
            Delay::Fixed(delay) => delay,
            Delay::Auto => (self.clock.period() + self.clock.jitter()).min(LONGEST_DELAY),
        }
    }

    /// The clock: period and jitter of the stream.
    pub fn clock(&self) -> &ClockSync {
        &self.clock
    }

    /// Puts waiting frames in their places. Whether the tracker started anew.
    fn take_waiting(&mut self) -> bool {
        let mut restarted = false;
        // Taken out and put back, to keep its memory.
        let mut waiting = std::mem::take(&mut self.waiting);
        for frame in waiting.drain(..) {
            if frame.time < self.newest - 2.0 * CLOCK_SET || frame.time > self.newest + 3600.0 {
                self.clock = ClockSync::default();
                self.start_anew(&frame);
                restarted = true;
                self.newest = f64::NEG_INFINITY;
            }
            self.clock.add(frame.time, frame.arrival);
            self.insert(&frame);
        }
        self.waiting = waiting;
        restarted
    }

    /// Forgets all poses but the last of parts that the frame lacks: these are held, and fade if they stay away.
    fn start_anew(&mut self, frame: &HandFrame) {
        for (k, tracked) in self.tracked.iter_mut().enumerate() {
            let seen =
                if k == PALM { frame.palm.is_some_and(|palm| palm.tracked) } else { frame.fingers[k].is_some_and(|tip| tip.tracked) };
            let last = tracked.track.last();
            tracked.track.clear();
            if let Some(pose) = last.filter(|_| !seen) {
                tracked.track.insert(frame.time, pose);
            }
        }
    }

    fn insert(&mut self, frame: &HandFrame) {
        let fingers = frame.fingers.map(|finger| finger.map(|f| (f.tip, f.tracked, f.pad_radius)));
        let palm = frame.palm.map(|p| (p.pose, p.tracked, 0.0));
        let parts: [Option<(Pose, bool, f64)>; 6] = std::array::from_fn(|k| if k == PALM { palm } else { fingers[k] });
        let seen = parts.map(|part| part.filter(|&(_, tracked, _)| tracked).map(|(pose, ..)| pose));
        let is_newest = frame.time > self.newest;
        for (k, tracked) in self.tracked.iter_mut().enumerate() {
            if let Some((.., radius)) = parts[k] {
                tracked.pad_radius = radius;
            }
            if let Some(pose) = seen[k] {
                tracked.track.insert(frame.time, pose);
            }
            if is_newest {
                tracked.seen = seen[k].is_some();
                if let Some(pose) = seen[k].filter(|_| k != PALM) {
                    // The palm if it is there, else the first other finger.
                    let other = [PALM, 0, 1, 2, 3, 4].into_iter().find(|&other| other != k && seen[other].is_some());
                    tracked.carrier = other.and_then(|other| Some((other, seen[other]?.inv_mul(&pose))));
                }
            }
        }
        if is_newest {
            self.newest = frame.time;
        }
    }

    /// What is known of a part at a tracker's time.
    fn motion(&self, k: usize, time: f64) -> Option<Motion> {
        let tracked = &self.tracked[k];
        let run_on = (1.5 * self.clock.period()).clamp(0.03, 0.1);
        let alone = tracked.track.at(time, run_on);
        let newest = tracked.track.newest()?;
        // Until it was last seen there are poses; after that it goes where its carrier goes.
        let carrier = tracked.carrier.filter(|&(other, _)| !tracked.seen && time > newest && self.tracked[other].seen);
        match carrier {
            Some((other, relative)) => self.tracked[other].track.at(time, run_on).map(|motion| motion.carry(&relative)).or(alone),
            None => alone,
        }
    }

    /// What is shown of all parts if `time` is shown.
    fn poses(&self, time: f64) -> [Option<Pose>; 6] {
        std::array::from_fn(|k| {
            let pose = self.motion(k, time)?.pose;
            let (shift, turn) = &self.tracked[k].offset;
            Some(Pose::from_parts((pose.translation.vector + shift).into(), turn * pose.rotation))
        })
    }

    /// Sets the offsets so that at `time` everything is shown where it was before the news.
    fn absorb(&mut self, before: &[Option<Pose>; 6], time: f64) {
        for (k, before) in before.iter().enumerate() {
            let known = self.motion(k, time);
            let tracked = &mut self.tracked[k];
            tracked.offset = match (before, known) {
                // Without weight nobody is pulled: straight to the new place.
                (Some(before), Some(known)) if tracked.weight > 0.0 => {
                    (before.translation.vector - known.pose.translation.vector, before.rotation * known.pose.rotation.inverse())
                }
                _ => (Vec3::zeros(), Rot::identity()),
            };
        }
    }

    /// Lets offsets fade and moves weights; `tracker_now` without the delay.
    fn fade(&mut self, dt: f64, tracker_now: f64) {
        let keep = (-dt / self.options.catch).exp();
        for tracked in &mut self.tracked {
            let (shift, turn) = &mut tracked.offset;
            *shift *= keep;
            *turn = Rot::from_scaled_axis(turn.scaled_axis() * keep);
            let allowed = tracked.track.newest().map_or(0.0, |newest| allowed_weight(tracker_now - newest, &self.options));
            let rise = if tracked.seen { dt / self.options.catch } else { 0.0 };
            tracked.weight = (tracked.weight + rise).min(allowed);
        }
    }

    fn target(&self, k: usize, time: f64) -> Option<Target> {
        let motion = self.motion(k, time)?;
        let Tracked { offset: (shift, turn), weight, pad_radius, seen, ref track, .. } = self.tracked[k];
        let now = self.shown.map_or(time, |(_, at)| self.clock.tracker_time(at));
        let allowed = allowed_weight(now - track.newest()?, &self.options);
        let state = match allowed {
            1.0 if seen => TargetState::Live,
            1.0 => TargetState::Held,
            w if w > 0.0 => TargetState::Fading,
            _ => TargetState::Lost,
        };
        let catch = self.options.catch;
        Some(Target {
            pose: Pose::from_parts((motion.pose.translation.vector + shift).into(), turn * motion.pose.rotation),
            linear_velocity: motion.linear - shift / catch,
            angular_velocity: motion.angular - turn.scaled_axis() / catch,
            weight,
            pad_radius,
            state,
        })
    }
}

/// Weight that something may have that was not seen for so long, s.
fn allowed_weight(unseen: f64, options: &TrackingOptions) -> f64 {
    let over = unseen - options.hold;
    if over <= 0.0 {
        1.0
    } else if over >= options.fade {
        0.0
    } else {
        1.0 - over / options.fade
    }
}

fn check_finite(frame: &HandFrame) -> Result<()> {
    let palm = frame.palm.iter().filter(|palm| palm.tracked).map(|palm| &palm.pose);
    let tips = frame.tracked_fingers().map(|(_, finger)| &finger.tip);
    let numbers = |pose: &Pose| [pose.translation.vector.sum(), pose.rotation.coords.sum()];
    let radii = frame.fingers.iter().flatten().map(|finger| finger.pad_radius);
    let all = palm.chain(tips).flat_map(numbers).chain(radii).chain([frame.time, frame.arrival]);
    for x in all {
        if !x.is_finite() {
            return Err(Error::value("hand frame", "finite numbers", x, "leave out what is not tracked"));
        }
    }
    Ok(())
}

//! From frames that come as they come to poses for every step: [`HandTracker`].
//!
//! **Time.** Frames are put in the order of their own times, so late ones, duplicates and jitter do no harm. The hand is shown a little in
//! the past ([`Delay`]): by default one period of the tracker plus the lateness of 95 of 100 packets, at most 0.1 s. There, poses are
//! interpolated. Where the next frame is missing, the motion runs on and comes to rest. When it comes after all, the difference is not
//! jumped but fades away ([`TrackingOptions::catch`]), by 0.5 m/s and 3 rad/s at most. The result is continuous for any sequence of frames,
//! also after a time in which nobody asked for it.
//!
//! **Loss.** What is not seen any more keeps its place relative to the palm if that is seen, else to another finger that is, else in the
//! room. Its weight stays 1 for [`TrackingOptions::hold`] and then goes to 0 within [`TrackingOptions::fade`]. When it is seen again, the
//! pose glides to it and the weight rises. A spring to a target should be scaled by the weight. What was away for a frame or some, and has
//! gone on meanwhile as before, is shown as if it had been seen; elsewhere than that it glides, as after a longer loss. A frame that never
//! came says nothing about what was seen.
//!
//! **Bad frames.** A pose that no hand can have come to since the last one is dropped, as are those of fingers that were taken for each
//! other and of one whose nail is where the pad was (the module `gate` has the rules). The part is then not seen in that frame.
//! [`HandTracker::dropped`] counts them. If it lasts, it is believed, and glided to as after a loss.

mod clock;
mod dropped;
mod gate;
mod options;
mod part;
mod target;
mod track;

pub use clock::ClockSync;
pub use dropped::Dropped;
pub use options::{Delay, TrackingOptions};
pub use target::{HandTargets, Target, TargetState};

use crate::error::{Error, Result, check_within};
use crate::hand_frame::ReferenceFrame;
use crate::{HandFrame, Pose, Side};
use dropped::DroppedMeter;
use gate::{Gate, TopSpeed, Verdict, are_exchanged};
use part::Part;
use track::Motion;

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
/// Who asks more seldom than this, s, was stopped: what is shown goes on from where it was, and moves by no more than in this time.
const LONGEST_STEP: f64 = 0.1;
/// A silence is no loss before this, s, however slow the tracker.
const LONGEST_SILENCE: f64 = 0.2;
/// A frame that is overtaken, and so much later (s) than the moment shown, is of no use any more.
const TOO_LATE: f64 = 0.1;
/// So many frames in a row that are older than the newest, for so long (s): the tracker's clock was set back.
const SET_BACK: (u32, f64) = (4, 0.1);

/// Time and arrival of the newest frame before the first.
const NOTHING: (f64, f64) = (f64::NEG_INFINITY, f64::NEG_INFINITY);

/// Times beyond this, s, are refused: a double cannot tell milliseconds apart there.
const LATEST: f64 = 1e12;

/// One hand: takes frames when they come, gives targets when they are needed. Allocates nothing once made.
#[derive(Debug, Clone)]
pub struct HandTracker {
    side: Side,
    options: TrackingOptions,
    world_from_tracker: Pose,
    parts: [Part; 6],
    gates: [Gate; 6],
    dropped: DroppedMeter,
    /// Time of the first pose of the palm after its last relocation, s on the tracker's clock.
    relocated_since: f64,
    clock: ClockSync,
    waiting: Vec<HandFrame>,
    /// Time and arrival of the newest frame.
    newest: (f64, f64),
    /// How many frames older than that came in a row, in the order of their times, and the time of the last of them.
    stale: (u32, f64),
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
        Ok(Self {
            side,
            options,
            world_from_tracker,
            parts: Default::default(),
            gates: std::array::from_fn(|k| Gate::new(if k == PALM { TopSpeed::PALM } else { TopSpeed::FINGERTIP })),
            dropped: DroppedMeter::default(),
            relocated_since: f64::NEG_INFINITY,
            clock: ClockSync::default(),
            waiting: Vec::with_capacity(WAITING),
            newest: NOTHING,
            stale: (0, f64::NEG_INFINITY),
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
    /// [`Error::InvalidValue`] for a frame of the other hand, or with numbers that are not finite, a pad radius over 0.1 m or a time beyond
    /// 1e12 s. Such a frame changes nothing.
    pub fn push(&mut self, frame: &HandFrame) -> Result<()> {
        if frame.side != self.side {
            return Err(Error::value("side", self.side.name(), frame.side.name(), "use one tracker for each hand"));
        }
        check_frame(frame)?;
        let frame = if frame.frame == ReferenceFrame::Tracker { frame.transformed(&self.world_from_tracker) } else { *frame };
        if self.waiting.len() == WAITING {
            self.waiting.remove(0);
        }
        self.waiting.push(frame);
        Ok(())
    }

    /// The hand at the own time `now`, s, on the clock of the arrivals. To be asked with times that do not fall back, at 10 Hz or more:
    /// from one sample to the next no more is made up for than in 0.1 s. None before the first frame.
    pub fn sample(&mut self, now: f64) -> Option<HandTargets> {
        let (last_shown, last_now) = self.shown.map_or((None, now), |(shown, at)| (Some(shown), at));
        let dt = if now.is_finite() { (now - last_now).max(0.0) } else { 0.0 };
        let now = last_now + dt;
        let news = !self.waiting.is_empty();
        let step = dt.min(LONGEST_STEP);
        // What is old fades first: what the news change is shown in full in this sample, and fades from the next one on.
        self.parts.iter_mut().for_each(|part| part.fade(step, self.options.catch));
        let before = last_shown.map(|shown| self.poses(shown + step));
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
        let jumped = dt > step || last_shown.is_some_and(|last| (shown - last - dt).abs() > SLEW * dt + 1e-9);
        if let Some(before) = before.filter(|_| news || jumped) {
            // What the news change is not shown at once. At the time that would be shown without the news, or at the new one after a jump.
            let at = if jumped { shown } else { last_shown.unwrap_or(shown) + dt };
            let known: [Option<Motion>; 6] = std::array::from_fn(|k| self.motion(k, at));
            for ((part, before), known) in self.parts.iter_mut().zip(&before).zip(&known) {
                part.absorb(before.as_ref(), known.as_ref().map(|motion| &motion.pose));
            }
        }
        self.shown = Some((shown, now));
        let allowed = self.allowed_weights();
        for (part, allowed) in self.parts.iter_mut().zip(allowed) {
            part.weigh(step, allowed, self.options.catch);
        }
        let target = |k: usize| self.target(k, shown, allowed[k]);
        Some(HandTargets { palm: target(PALM), fingers: std::array::from_fn(target), delay, time: shown })
    }

    /// How far in the past the hand is shown now, s.
    pub fn delay(&self) -> f64 {
        match self.options.delay {
            Delay::Fixed(delay) => delay,
            Delay::Auto => (self.clock.period() + self.clock.jitter()).min(LONGEST_DELAY),
        }
    }

    /// What was not believed so far.
    pub fn dropped(&self) -> Dropped {
        self.dropped.counts()
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
            if frame.time < self.newest.0 - 2.0 * CLOCK_SET || frame.time > self.newest.0 + 3600.0 || self.is_set_back(&frame) {
                self.clock = ClockSync::default();
                self.start_anew(&frame);
                restarted = true;
            } else if frame.time < self.newest.0 && self.clock.tracker_time(frame.arrival) - frame.time > self.delay() + TOO_LATE {
                continue;
            }
            self.clock.add(frame.time, frame.arrival);
            self.insert(&frame);
        }
        self.waiting = waiting;
        restarted
    }

    /// Counts frames that are older than the newest one. Whether there are so many, for so long, that none of the tracker's clock as it was
    /// can be expected.
    fn is_set_back(&mut self, frame: &HandFrame) -> bool {
        let (count, last) = &mut self.stale;
        if frame.time > self.newest.0 {
            *count = 0;
            return false;
        }
        // The same frame over and over is a duplicate.
        *count = if *count == 0 || frame.time > *last { *count + 1 } else { *count };
        *last = frame.time;
        *count >= SET_BACK.0 && frame.arrival - self.newest.1 > SET_BACK.1 + 3.0 * self.clock.period()
    }

    /// Forgets all poses but the last of parts that the frame lacks: these are held, and fade if they stay away.
    fn start_anew(&mut self, frame: &HandFrame) {
        for (part, seen) in self.parts.iter_mut().zip(seen_parts(frame)) {
            part.start_anew(frame.time, seen.is_some());
        }
        self.gates.iter_mut().for_each(Gate::clear);
        self.relocated_since = f64::NEG_INFINITY;
        self.dropped.start_anew();
        (self.newest, self.stale) = (NOTHING, (0, f64::NEG_INFINITY));
    }

    /// What of a frame is believed. What is not is counted, and suspects that turn out to be right are put in their places.
    fn believed_parts(&mut self, frame: &HandFrame) -> [Option<Pose>; 6] {
        let mut seen = seen_parts(frame);
        // The palm first: fingers are expected to move with it.
        self.judge(PALM, frame.time, &mut seen, false);
        let exchanged = self.exchanged(frame.time, &seen);
        for (finger, exchanged) in exchanged.into_iter().enumerate() {
            self.judge(finger, frame.time, &mut seen, exchanged);
        }
        seen
    }

    /// Judges one part of a frame, and takes it out if it is not believed.
    fn judge(&mut self, k: usize, time: f64, seen: &mut [Option<Pose>; 6], exchanged: bool) {
        let Some(measured) = seen[k] else { return };
        let with_hand = self.with_hand(k, seen);
        let (part, gate) = (&mut self.parts[k], &mut self.gates[k]);
        let verdict = match gate.judge(&part.track, time, &measured, with_hand.as_ref(), exchanged) {
            // A finger is relocated with the palm: what was before is another place for it, too.
            Verdict::Believe | Verdict::Confirm
                if time >= self.relocated_since && part.track.newest().is_some_and(|newest| newest < self.relocated_since) =>
            {
                Verdict::Relocate
            }
            verdict => verdict,
        };
        match verdict {
            Verdict::Believe => {}
            Verdict::Drop(fault) => {
                self.dropped.add(time, k, fault);
                seen[k] = None;
            }
            verdict => {
                self.dropped.take_off(gate.suspects.times(), k);
                if verdict == Verdict::Relocate {
                    self.dropped.relocate(time);
                    if k == PALM {
                        self.relocated_since = gate.suspects.oldest().unwrap_or(time);
                    }
                    part.relocate(&gate.suspects);
                } else {
                    part.confirm(&gate.suspects);
                }
                gate.clear();
            }
        }
    }

    /// Where a part would be if it had moved as one body with what it was last seen together with, if that is seen.
    fn with_hand(&self, k: usize, seen: &[Option<Pose>; 6]) -> Option<Pose> {
        self.parts[k].carrier.and_then(|(other, relative)| Some(seen[other]? * relative))
    }

    /// Which fingers of a frame are at each other's place.
    fn exchanged(&self, time: f64, seen: &[Option<Pose>; 6]) -> [bool; PALM] {
        let mut exchanged = [false; PALM];
        let expected: [Option<Pose>; PALM] =
            std::array::from_fn(|k| seen[k].and_then(|_| self.parts[k].track.expected(time).or_else(|| self.with_hand(k, seen))));
        for i in 0..PALM {
            for j in i + 1..PALM {
                if let (Some(a), Some(b), Some(p), Some(q)) = (&expected[i], &expected[j], &seen[i], &seen[j])
                    && are_exchanged([a, b], [p, q])
                {
                    (exchanged[i], exchanged[j]) = (true, true);
                }
            }
        }
        exchanged
    }

    fn insert(&mut self, frame: &HandFrame) {
        let seen = self.believed_parts(frame);
        let is_newest = frame.time > self.newest.0;
        for (k, part) in self.parts.iter_mut().enumerate() {
            let Some(pose) = seen[k] else {
                part.lack(frame.time);
                part.seen &= !is_newest;
                continue;
            };
            // The palm if it is there, else the first other finger.
            let other = [PALM, 0, 1, 2, 3, 4].into_iter().find(|&other| k != PALM && other != k && seen[other].is_some());
            let carrier = other.and_then(|other| Some((other, seen[other]?.inv_mul(&pose))));
            part.see(frame.time, pose, carrier);
            if is_newest {
                (part.seen, part.carrier) = (true, carrier);
                part.measure_pad(frame.fingers.get(k).and_then(Option::as_ref).map_or(0.0, |finger| finger.pad_radius));
            }
        }
        if is_newest {
            self.newest = (frame.time, frame.arrival);
        }
    }

    /// What is known of a part at a tracker's time.
    fn motion(&self, k: usize, time: f64) -> Option<Motion> {
        let part = &self.parts[k];
        let run_on = (1.5 * self.clock.period()).clamp(0.03, 0.1);
        let alone = part.track.at(time, run_on);
        let (oldest, newest) = (part.track.oldest()?, part.track.newest()?);
        // While it is seen there are poses; after that, and until it was seen again twice, it goes where its carrier goes.
        let carrier = if part.entry.is_some() && (time < oldest || newest <= oldest) {
            part.entry
        } else {
            part.carrier.filter(|&(other, _)| !part.seen && time > newest && self.parts[other].seen)
        };
        match carrier {
            Some((other, relative)) => self.parts[other].track.at(time, run_on).map(|motion| motion.carry(&relative)).or(alone),
            None => alone,
        }
    }

    /// What is shown of all parts if `time` is shown.
    fn poses(&self, time: f64) -> [Option<Pose>; 6] {
        std::array::from_fn(|k| Some(self.parts[k].shown(&self.motion(k, time)?.pose)))
    }

    /// What the weights may be now.
    fn allowed_weights(&self) -> [f64; 6] {
        let now = self.shown.map_or(f64::INFINITY, |(_, at)| self.clock.tracker_time(at));
        // The next frame is not missing before it is due, and one that was lost is nothing to let go for.
        let silence = (2.0 * self.clock.period() + self.clock.jitter()).min(LONGEST_SILENCE);
        std::array::from_fn(|k| self.parts[k].allowed_weight(now, silence, &self.options))
    }

    fn target(&self, k: usize, time: f64, allowed: f64) -> Option<Target> {
        let motion = self.motion(k, time)?;
        let part = &self.parts[k];
        let state = match allowed {
            1.0 if part.seen => TargetState::Live,
            1.0 => TargetState::Held,
            w if w > 0.0 => TargetState::Fading,
            _ => TargetState::Lost,
        };
        let (linear, angular) = part.fading(self.options.catch);
        Some(Target {
            pose: part.shown(&motion.pose),
            linear_velocity: motion.linear + linear,
            angular_velocity: motion.angular + angular,
            weight: part.weight,
            pad_radius: part.pad_radius.1,
            state,
        })
    }
}

/// Poses of what a frame sees: five fingers, and the palm.
fn seen_parts(frame: &HandFrame) -> [Option<Pose>; 6] {
    let palm = frame.palm.filter(|palm| palm.tracked).map(|palm| palm.pose);
    std::array::from_fn(|k| if k == PALM { palm } else { frame.fingers[k].filter(|finger| finger.tracked).map(|finger| finger.tip) })
}

fn check_frame(frame: &HandFrame) -> Result<()> {
    for x in seen_parts(frame).iter().flatten().flat_map(|pose| [pose.translation.vector.sum(), pose.rotation.coords.sum()]) {
        if !x.is_finite() {
            return Err(Error::value("hand frame", "finite numbers", x, "leave out what is not tracked"));
        }
    }
    for finger in frame.fingers.iter().flatten() {
        check_within("pad_radius", finger.pad_radius, 0.0, 0.1, "m")?;
    }
    check_within("time", frame.time, -LATEST, LATEST, "s")?;
    check_within("arrival", frame.arrival, -LATEST, LATEST, "s")
}

//! Which measured poses are believed: [`Gate`], one for each part of a hand.
//!
//! A pose is **plausible** if the part can have come there since it was last seen: within the top speed of a hand, and within what its
//! acceleration can change on a motion that went on, or stopped, as it was. A pose that is not is a **suspect** and is not shown. What
//! comes of suspects:
//!
//! - The next pose is plausible again, and nearer to the motion before than to the suspects: they were bad frames, and are dropped.
//! - Two suspects in a row move as a hand does that was quicker than expected (the mean of the speeds before and after explains the way
//!   between): they were a fast motion, and count from now on.
//! - Four of them or more agree with each other for a tenth of a second: the part really is elsewhere (the tracker was started again, a
//!   room was recentred). The motion before is forgotten, and what is shown glides there. Fingers that are exchanged, or have their nail
//!   where the pad was, are what trackers get wrong and hands cannot do: they are believed after half a second only.
//!
//! A suspect that agrees with those before it is judged with them, and not by the time since the part was last believed: with that time the
//! reach of a hand grows, and three bad frames in a row would let the third one in.
//!
//! **How fast hands are.** A point-to-point motion of minimum jerk over D in T has a peak speed of 15/8 D/T and a peak acceleration of 5.77
//! D/T^2 (Flash and Hogan 1985): reaching 0.6 m in 0.25 s, as fast as people do, is 4.5 m/s and 55 m/s^2; a pinch of 50 mm in 0.1 s (the
//! fastest of Darling, Cole and Abbs 1988) 0.9 m/s and 29 m/s^2. A finger that is snapped turns at 136 rad/s (Acharya et al. 2021) and is
//! not followed by these limits.

use super::track::Track;
use crate::{Pose, Vec3};

/// Added to every reach for the noise of measured poses, m and rad.
const NOISE: (f64, f64) = (5e-3, 0.2);
/// Acceleration (m/s^2) that is expected of a hand: a pose within its reach is believed at once.
const EXPECTED_ACCELERATION: f64 = 40.0;
/// Acceleration (m/s^2) of the quickest hands: within its reach a pose is believed when the next one confirms it.
const LARGEST_ACCELERATION: f64 = 100.0;
/// By so much a fitted velocity lags behind the newest pose, s: half of the window that it is fitted in.
const VELOCITY_LAG: f64 = 0.02;
/// After a longer time without being seen, s, the reach of a hand grows no more.
const LONGEST_REACH: f64 = 0.1;
/// Farther than this, rad, no part is believed to have turned from one pose to the next.
const LARGEST_TURN: f64 = 2.6;
/// From this angle on, rad, a part that stayed in its place was flipped: the nail is where the pad was.
const FLIPPED_FROM: f64 = 2.4;
/// What a difference of orientation counts against one of position, m/rad, where it is asked which motion a pose belongs to.
const TURN_WEIGHT: f64 = 0.05;
/// So many suspects that agree are needed before a jump is believed ...
const AGREEING: u32 = 4;
/// ... for so long, s: a jump, and fingers that are exchanged or flipped.
const BELIEVED_AFTER: (f64, f64) = (0.1, 0.5);
/// Suspects that are kept: half a second at 1000 Hz.
pub(super) const SUSPECTS_KEPT: usize = 512;

/// Top speeds of a part of the hand: m/s and rad/s.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct TopSpeed {
    pub linear: f64,
    pub angular: f64,
}

impl TopSpeed {
    /// Of the back of the hand.
    pub const PALM: Self = Self { linear: 5.0, angular: 30.0 };
    /// Of a fingertip: that of the hand, and that of the finger against it.
    pub const FINGERTIP: Self = Self { linear: 8.0, angular: 60.0 };
}

/// Why a pose was not believed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Fault {
    /// No hand comes there so soon.
    Jump,
    /// Two fingers are where the other one should be: the tracker has taken their markers for each other.
    Exchanged,
    /// In its place, but turned by about half a turn: the nail is where the pad was.
    Flipped,
}

/// What is to be done with a pose.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Verdict {
    /// It counts. Suspects before it stay dropped.
    Believe,
    /// Not shown for now, or never.
    Drop(Fault),
    /// It counts, and the suspects before it too: they were a fast motion.
    Confirm,
    /// It counts, and the suspects before it: the part is elsewhere. What was before is forgotten.
    Relocate,
}

/// How a pose stands to a motion.
#[derive(Debug, Clone, Copy)]
struct Misfit {
    /// Off the motion, m with [`TURN_WEIGHT`].
    size: f64,
    /// Whether a hand can have come there.
    plausible: bool,
    /// Whether it is only turned, and by about half a turn.
    flipped: bool,
}

/// Judges the poses of one part.
#[derive(Debug, Clone)]
pub(super) struct Gate {
    top: TopSpeed,
    /// Poses that are not believed, and agree with each other.
    pub suspects: Track,
    /// Time of the first of them, how many there were, and what is wrong with them.
    first: f64,
    count: u32,
    fault: Fault,
}

impl Misfit {
    /// The better one.
    fn or(self, other: Self) -> Self {
        let plausible = self.plausible || other.plausible;
        Self { size: self.size.min(other.size), plausible, flipped: !plausible && (self.flipped || other.flipped) }
    }
}

impl Gate {
    pub fn new(top: TopSpeed) -> Self {
        Self { top, suspects: Track::with_room_for(SUSPECTS_KEPT), first: 0.0, count: 0, fault: Fault::Jump }
    }

    /// Forgets the suspects.
    pub fn clear(&mut self) {
        self.suspects.clear();
        self.count = 0;
    }

    /// Judges a pose of the time `time`, s, against the poses that were believed.
    ///
    /// `with_hand`: where it would be if it had moved as one body with the part that it was last seen together with, if that part is
    /// believed. Fingers that were lost for long are expected there, too. `exchanged`: the pose was found to be that of another finger.
    pub fn judge(&mut self, believed: &Track, time: f64, pose: &Pose, with_hand: Option<&Pose>, exchanged: bool) -> Verdict {
        let Some(newest) = believed.newest() else { return Verdict::Believe };
        if time <= newest {
            return if self.fits_between(believed, time, pose) { Verdict::Believe } else { Verdict::Drop(Fault::Jump) };
        }
        let velocity = believed.end_velocity();
        let off = self.misfit(believed, velocity, time, pose);
        let off = with_hand.map_or(off, |expected| off.or(self.apart(expected, time - newest, pose)));
        let plausible = off.plausible && !exchanged;
        if self.count > 0 {
            let own = if self.count > 1 { self.suspects.end_velocity() } else { velocity };
            let agrees = self.agreement(own, time, pose);
            let overtaken = self.suspects.newest().is_some_and(|newest| time < newest);
            if agrees.plausible {
                if self.suspects.insert(time, *pose) {
                    self.count += 1;
                }
                if self.fault == Fault::Jump && self.is_fast_motion(believed) {
                    return Verdict::Confirm;
                }
                let verdict = self.relocated();
                if verdict == Verdict::Relocate || !plausible || agrees.size < off.size {
                    return verdict;
                }
            }
            if overtaken {
                // It says nothing against the suspects that came before it and are newer.
                return if plausible { Verdict::Believe } else { Verdict::Drop(Fault::Jump) };
            }
            self.clear();
        }
        if plausible {
            return Verdict::Believe;
        }
        self.suspects.insert(time, *pose);
        (self.first, self.count) = (time, 1);
        self.fault = if exchanged {
            Fault::Exchanged
        } else if off.flipped {
            Fault::Flipped
        } else {
            Fault::Jump
        };
        Verdict::Drop(self.fault)
    }

    /// Whether the suspects have agreed for long enough.
    fn relocated(&self) -> Verdict {
        let after = if self.fault == Fault::Jump { BELIEVED_AFTER.0 } else { BELIEVED_AFTER.1 };
        let lasted = self.suspects.newest().map_or(0.0, |newest| newest - self.first);
        if self.count >= AGREEING && lasted >= after - 1e-6 { Verdict::Relocate } else { Verdict::Drop(self.fault) }
    }

    /// How `pose` stands to the end of a motion of the velocity `velocity`, m/s, that may go on as it was, or stop on the way.
    fn misfit(&self, motion: &Track, velocity: Vec3, time: f64, pose: &Pose) -> Misfit {
        let Some((last, from)) = motion.end() else { return Misfit { size: 0.0, plausible: true, flipped: false } };
        let dt = (time - last).clamp(0.0, LONGEST_REACH);
        let way = pose.translation.vector - from.translation.vector;
        let whole = velocity * (time - last).clamp(0.0, 2.0 * LONGEST_REACH);
        let off = (way - whole * share_along(&way, &whole)).norm();
        let turn = pose.rotation.angle_to(&from.rotation);
        // v dt from standing still, and a dt (dt/2 + lag) beside the motion; a single pose says nothing of the motion.
        let reach = if motion.len() > 1 { expected_reach(dt) } else { f64::INFINITY };
        let in_reach = way.norm() <= NOISE.0 + self.top.linear * dt && off <= NOISE.0 + reach;
        let turned = turn <= (NOISE.1 + self.top.angular * dt).min(LARGEST_TURN);
        Misfit { size: off + TURN_WEIGHT * turn, plausible: in_reach && turned, flipped: in_reach && turn > FLIPPED_FROM }
    }

    /// How `pose` stands to one from which the part can have gone away for `dt` s.
    fn apart(&self, from: &Pose, dt: f64, pose: &Pose) -> Misfit {
        let dt = dt.min(LONGEST_REACH);
        let (off, turn) = ((pose.translation.vector - from.translation.vector).norm(), pose.rotation.angle_to(&from.rotation));
        let in_reach = off <= NOISE.0 + expected_reach(dt);
        let turned = turn <= (NOISE.1 + self.top.angular * dt).min(LARGEST_TURN);
        Misfit { size: off + TURN_WEIGHT * turn, plausible: in_reach && turned, flipped: in_reach && turn > FLIPPED_FROM }
    }

    /// How `pose` stands to the suspects.
    fn agreement(&self, velocity: Vec3, time: f64, pose: &Pose) -> Misfit {
        match self.suspects.around(time) {
            // Overtaken by some of them.
            [Some(_), Some(_)] => Misfit { size: 0.0, plausible: self.fits_between(&self.suspects, time, pose), flipped: false },
            // By all of them, or by the same pose: the motion before it is that after it, run backwards.
            [None, Some((first, to))] => {
                let from = Pose::from_parts((to.translation.vector - velocity * (first - time)).into(), to.rotation);
                self.apart(&from, first - time, pose)
            }
            _ => self.misfit(&self.suspects, velocity, time, pose),
        }
    }

    /// Whether a pose that was overtaken lies between those before and after it: of a motion of acceleration a, no farther than a h^2/8
    /// from the chord.
    fn fits_between(&self, motion: &Track, time: f64, pose: &Pose) -> bool {
        // Older than all: it is for the track to say whether it is of use. After the newest: the same pose again.
        let [Some((t0, a)), Some((t1, b))] = motion.around(time) else { return true };
        let span = (t1 - t0).min(LONGEST_REACH);
        let share = (time - t0) / (t1 - t0).max(1e-9);
        let off = (pose.translation.vector - a.translation.vector.lerp(&b.translation.vector, share)).norm();
        let turn = pose.rotation.angle_to(&a.rotation).min(pose.rotation.angle_to(&b.rotation));
        off <= NOISE.0 + LARGEST_ACCELERATION * span * span / 8.0 && turn <= (NOISE.1 + self.top.angular * span).min(LARGEST_TURN)
    }

    /// Whether the first two suspects go on from the last two poses that were believed: with the speeds u before and w after a step of dt,
    /// a hand of constant acceleration has come by (u + w)/2 dt, and one whose acceleration changes by a at most, by a dt^2/4 more or less.
    fn is_fast_motion(&self, believed: &Track) -> bool {
        let ([Some((s0, q0)), Some((s1, q1))], [Some((t0, p0)), Some((t1, p1))]) = (self.suspects.first_two(), believed.last_two()) else {
            return false;
        };
        let dt = s0 - t1;
        let place = |pose: &Pose| pose.translation.vector;
        let (before, after) = ((place(&p1) - place(&p0)) / (t1 - t0), (place(&q1) - place(&q0)) / (s1 - s0));
        let way = place(&q0) - place(&p1);
        dt <= LONGEST_REACH
            && before.norm().max(after.norm()) <= self.top.linear
            && way.norm() <= NOISE.0 + self.top.linear * dt
            && (way - (before + after) * (0.5 * dt)).norm() <= NOISE.0 + LARGEST_ACCELERATION * dt * dt / 4.0
            && q0.rotation.angle_to(&p1.rotation) <= (NOISE.1 + self.top.angular * dt).min(LARGEST_TURN)
    }
}

/// How far beside its motion a part can be after `dt` s, m.
fn expected_reach(dt: f64) -> f64 {
    EXPECTED_ACCELERATION * dt * (0.5 * dt + VELOCITY_LAG)
}

/// m, with [`TURN_WEIGHT`].
fn difference(a: &Pose, b: &Pose) -> f64 {
    (a.translation.vector - b.translation.vector).norm() + TURN_WEIGHT * a.rotation.angle_to(&b.rotation)
}

/// Share (0 to 1) of the way `whole` at which it comes nearest to `way`.
fn share_along(way: &Vec3, whole: &Vec3) -> f64 {
    let square = whole.norm_squared();
    if square > 0.0 { (way.dot(whole) / square).clamp(0.0, 1.0) } else { 0.0 }
}

/// Whether two fingers are at each other's place: `expected` and `measured` of both. That they are a quarter as far from there as from
/// their own, and far from their own by more than noise, tells exchanged markers even of fingers that are close together.
pub(super) fn are_exchanged(expected: [&Pose; 2], measured: [&Pose; 2]) -> bool {
    /// Nearer than this, m, fingers cannot be told apart.
    const APART: f64 = 0.012;
    /// So much better the other finger's place must fit.
    const BETTER: f64 = 0.25;
    let off = |k: usize, l: usize| difference(expected[k], measured[l]);
    let between = (expected[0].translation.vector - expected[1].translation.vector).norm();
    between > APART && off(0, 1) + off(1, 0) < BETTER * (off(0, 0) + off(1, 1))
}

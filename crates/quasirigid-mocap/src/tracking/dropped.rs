//! Counts of poses that were not believed.

use super::gate::Fault;

/// Frames that are remembered, so that one is counted once and can be taken off again: half a second at 1000 Hz.
const REMEMBERED: usize = 512;

/// What a [`super::HandTracker`] did not believe so far: fast motion that was confirmed, and jumps that were believed at last, are not in
/// it.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Dropped {
    /// Frames of which at least one pose was dropped.
    pub frames: u64,
    /// Poses that were dropped, by [`crate::Finger`] and the palm last.
    pub poses: [u64; 6],
    /// Those that no hand can have come to.
    pub jumps: u64,
    /// Those of fingers that were taken for each other.
    pub exchanged: u64,
    /// Those with the nail where the pad was.
    pub flipped: u64,
    /// Times that the hand, or a part of it, was believed to be elsewhere after all.
    pub relocations: u64,
}

impl Dropped {
    fn of(&mut self, fault: Fault) -> &mut u64 {
        match fault {
            Fault::Jump => &mut self.jumps,
            Fault::Exchanged => &mut self.exchanged,
            Fault::Flipped => &mut self.flipped,
        }
    }
}

/// A frame of which something was dropped: its time, and for each part what was wrong.
#[derive(Debug, Clone, Copy)]
struct Spoilt {
    time: f64,
    faults: [Option<Fault>; 6],
}

/// Keeps [`Dropped`]. Allocates nothing once made.
#[derive(Debug, Clone)]
pub(super) struct DroppedMeter {
    counts: Dropped,
    recent: Vec<Spoilt>,
    /// Where the next one goes.
    next: usize,
    relocated_at: f64,
}

impl Default for DroppedMeter {
    fn default() -> Self {
        Self { counts: Dropped::default(), recent: Vec::with_capacity(REMEMBERED), next: 0, relocated_at: f64::NEG_INFINITY }
    }
}

impl DroppedMeter {
    pub fn counts(&self) -> Dropped {
        self.counts
    }

    /// The pose of `part` in the frame of this time, s, is dropped. Once, however often that frame comes.
    pub fn add(&mut self, time: f64, part: usize, fault: Fault) {
        let known = self.recent.iter().position(|spoilt| spoilt.time == time).unwrap_or_else(|| {
            let spoilt = Spoilt { time, faults: [None; 6] };
            let place = self.next;
            if self.recent.len() < REMEMBERED {
                self.recent.push(spoilt);
            } else {
                self.recent[place] = spoilt;
            }
            self.next = (self.next + 1) % REMEMBERED;
            place
        });
        let faults = &mut self.recent[known].faults;
        if faults[part].is_some() {
            return;
        }
        self.counts.frames += u64::from(faults.iter().all(Option::is_none));
        faults[part] = Some(fault);
        self.counts.poses[part] += 1;
        *self.counts.of(fault) += 1;
    }

    /// The poses of `part` in the frames of these times, s, count after all.
    pub fn take_off(&mut self, times: impl Iterator<Item = f64>, part: usize) {
        for time in times {
            let Some(spoilt) = self.recent.iter_mut().find(|spoilt| spoilt.time == time) else { continue };
            let Some(fault) = spoilt.faults[part].take() else { continue };
            self.counts.frames -= u64::from(spoilt.faults.iter().all(Option::is_none));
            self.counts.poses[part] -= 1;
            *self.counts.of(fault) -= 1;
        }
    }

    /// A part is believed to be elsewhere since the frame of this time, s; other parts may be so in the same frame.
    pub fn relocate(&mut self, time: f64) {
        self.counts.relocations += u64::from(time != self.relocated_at);
        self.relocated_at = time;
    }

    /// Frames of the tracker's new clock are others, though they may have times that were there before.
    pub fn start_anew(&mut self) {
        self.recent.clear();
        self.next = 0;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_frame_is_counted_once_and_can_be_taken_off_again() {
        let mut meter = DroppedMeter::default();
        for (time, part) in [(1.0, 0), (1.0, 1), (1.0, 1), (2.0, 1)] {
            meter.add(time, part, Fault::Exchanged);
        }
        meter.add(3.0, 5, Fault::Jump);
        let counts = meter.counts();
        assert_eq!((counts.frames, counts.poses, counts.exchanged, counts.jumps), (3, [1, 2, 0, 0, 0, 1], 3, 1));
        meter.take_off([1.0, 2.0, 9.0].into_iter(), 1);
        let counts = meter.counts();
        assert_eq!((counts.frames, counts.poses, counts.exchanged), (2, [1, 0, 0, 0, 0, 1], 1));
        meter.take_off([1.0, 3.0].into_iter(), 0);
        meter.take_off([3.0].into_iter(), 5);
        assert_eq!(meter.counts(), Dropped::default());
        (0..2000).for_each(|k| meter.add(f64::from(k), 2, Fault::Flipped));
        assert_eq!((meter.counts().frames, meter.counts().flipped), (2000, 2000));
        meter.relocate(5.0);
        meter.relocate(5.0);
        meter.relocate(6.0);
        assert_eq!(meter.counts().relocations, 2);
    }
}

//! What is known of a stream: rates, lateness, what was lost, doubled, overtaken and refused.

use crate::dtrack::{Packet, PacketError};
use crate::hands::TrackerClock;
use crate::tracking::ClockSync;

/// Frame counters that are remembered to tell duplicates.
const REMEMBERED: usize = 256;
/// A counter that falls back so long (s) after the newest frame was set anew,
const PAUSE: f64 = 0.5;
/// and one that so many packets in a row rise with from below the newest frame, for so long (s).
const SET_BACK: (u32, f64) = (4, 0.2);
/// A counter that leaps by more than this, either way, is believed only when the next packet goes on from there: a damaged or forged
/// datagram may bear any number. Upwards it may be `PACE` times what the tracker counts in the time since the newest frame, and downwards
/// anything after a `PAUSE`.
const LEAP: i64 = 1000;
const PACE: f64 = 2.0;
/// Arrivals from which rate and jitter are taken.
const RECENT: usize = 64;

/// Where a packet stands among those before it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Order {
    /// Newer than all before.
    New,
    /// Overtaken by a newer one, or a stray: its counter leaps, and those after it do not follow.
    Late,
    /// Came before.
    Duplicate,
    /// The counter was set back: the tracker started anew.
    Restart,
}

/// Figures of a stream so far.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Statistics {
    /// All datagrams that came, refused ones too.
    pub datagrams: u64,
    /// Their bytes.
    pub bytes: u64,
    /// Packets that could be read, duplicates too.
    pub packets: u64,
    /// Frames that never came, from gaps in the counter. What comes late is taken off again.
    pub lost: u64,
    /// Packets that a newer one had overtaken, and strays.
    pub late: u64,
    /// Packets that came more than once.
    pub duplicates: u64,
    /// Times that the counter was set back.
    pub restarts: u64,
    /// Refused: no packet of the format.
    pub malformed: u64,
    /// Refused: larger than allowed.
    pub oversize: u64,
    /// Refused: nothing in it.
    pub empty: u64,
    /// Refused: from another host than asked for.
    pub foreign: u64,
    /// Packets that nobody took in time.
    pub overrun: u64,
    /// Why the last malformed packet was refused.
    pub last_refusal: Option<PacketError>,
    /// Packets that came per second lately, Hz; 0 while there are none.
    pub rate: f64,
    /// Frames that the tracker measures per second, Hz; 0 while unknown.
    pub tracker_rate: f64,
    /// Standard deviation of the time between arrivals, s.
    pub jitter: f64,
    /// How late, compared to the fastest, 95 of 100 packets come at most, s.
    pub lateness: f64,
    /// From the cameras' flash to the sending, as the tracker says (`ts2`), s.
    pub tracker_latency: Option<f64>,
    /// From arrival to being taken by the program, s: mean and largest.
    pub pick_up: (f64, f64),
}

/// Keeps [`Statistics`].
#[derive(Debug, Clone, Default)]
pub struct StreamMeter {
    figures: Statistics,
    counter: FrameCounter,
    time: TrackerClock,
    clock: ClockSync,
    arrivals: Vec<f64>,
    picked_up: u64,
    pick_up_sum: f64,
}

impl StreamMeter {
    /// A packet came. Returns where it stands.
    pub fn add(&mut self, packet: &Packet, arrival: f64) -> Order {
        let order = self.counter.add(packet.frame, arrival);
        let figures = &mut self.figures;
        figures.packets += 1;
        match order {
            Order::New => {}
            Order::Late => figures.late += 1,
            Order::Duplicate => figures.duplicates += 1,
            Order::Restart => figures.restarts += 1,
        }
        if order == Order::Restart {
            self.clock = ClockSync::default();
        }
        if order != Order::Duplicate {
            self.clock.add(self.time.seconds(packet, arrival), arrival);
        }
        if self.arrivals.len() == RECENT {
            self.arrivals.remove(0);
        }
        self.arrivals.push(arrival);
        if let Some(unix) = packet.unix_time {
            figures.tracker_latency = Some(1e-6 * f64::from(unix.latency));
        }
        order
    }

    /// The figures that only count.
    pub fn counts(&mut self) -> &mut Statistics {
        &mut self.figures
    }

    /// A packet was taken so long after its arrival, s.
    pub fn pick_up(&mut self, after: f64) {
        self.picked_up += 1;
        self.pick_up_sum += after;
        self.figures.pick_up = (self.pick_up_sum / self.picked_up as f64, self.figures.pick_up.1.max(after));
    }

    /// All figures at the time `now`, s.
    pub fn figures(&self, now: f64) -> Statistics {
        let mut figures = self.figures.clone();
        figures.lost = self.counter.lost();
        figures.tracker_rate = if self.clock.period() > 0.0 { 1.0 / self.clock.period() } else { 0.0 };
        figures.lateness = self.clock.jitter();
        if let (Some(&first), Some(&last)) = (self.arrivals.first(), self.arrivals.last()) {
            let steps = (self.arrivals.len() - 1) as f64;
            // A stream that has ended slows down with every moment of silence.
            let span = (last - first).max(now - first - if steps > 0.0 { 2.0 * (last - first) / steps } else { 0.0 });
            if steps > 0.0 && span > 0.0 {
                figures.rate = steps / span;
                let mean = (last - first) / steps;
                let square: f64 = self.arrivals.windows(2).map(|pair| (pair[1] - pair[0] - mean).powi(2)).sum();
                figures.jitter = (square / steps).sqrt();
            }
        }
        figures
    }
}

/// A row of frames with rising counters that are not newer than the newest.
#[derive(Debug, Clone, Copy, Default)]
struct Behind {
    count: u32,
    last: u32,
    /// How many of them were taken for late ones, and the smallest step before these.
    late: i64,
    step: i64,
}

/// Counts frames that never came. The counter may go up by more than one from frame to frame (a controller may send every d-th only).
#[derive(Debug, Clone, Default)]
struct FrameCounter {
    remembered: Vec<u32>,
    newest: Option<u32>,
    /// When the newest came, and when the first since the last restart, s.
    arrival: f64,
    began: f64,
    /// One that leapt ahead, until the next packet says whether that is where the counter is now.
    leapt: Option<u32>,
    /// Those that are not newer and came since, in rising order.
    behind: Behind,
    /// Smallest step seen.
    step: i64,
    /// Sum of all steps since the last restart, and how many frames came.
    span: i64,
    came: i64,
    /// Lost before the last restart.
    lost_before: u64,
}

impl FrameCounter {
    fn add(&mut self, frame: u32, arrival: f64) -> Order {
        let Some(newest) = self.newest else {
            self.start(frame, arrival);
            return Order::New;
        };
        // Over the end of 32 bits it goes on at 0.
        let step = i64::from(frame.wrapping_sub(newest) as i32);
        let known = self.remembered.contains(&frame);
        if let Some(order) = self.leap(frame, step, arrival) {
            return order;
        }
        if !known && step > 0 {
            self.step = if self.step == 0 { step } else { self.step.min(step) };
            self.span += step;
            self.came += 1;
            (self.newest, self.arrival, self.behind) = (Some(frame), arrival, Behind::default());
            self.remember(frame);
            return Order::New;
        }
        // What is sent twice does not rise.
        if self.behind.count == 0 || frame.wrapping_sub(self.behind.last) as i32 <= 0 {
            self.behind = Behind { step: self.step, ..Behind::default() };
        }
        self.behind = Behind { count: self.behind.count + 1, last: frame, ..self.behind };
        let silence = arrival - self.arrival;
        if silence > PAUSE || (self.behind.count >= SET_BACK.0 && silence > SET_BACK.1) {
            // Those that seemed late were the first of the new ones.
            (self.came, self.step) = (self.came - self.behind.late, self.behind.step);
            self.lost_before = self.lost();
            self.start(frame, arrival);
            return Order::Restart;
        }
        if known {
            return Order::Duplicate;
        }
        // As the newest, and yet not remembered: it tells no step.
        self.step = if step == 0 { self.step } else { self.step.min(-step) };
        self.came += 1;
        self.behind.late += 1;
        self.remember(frame);
        Order::Late
    }

    /// What to make of a packet whose counter leaps far ahead, or that follows one which did; None for all others.
    fn leap(&mut self, frame: u32, step: i64, arrival: f64) -> Option<Order> {
        let follows = |leapt: u32| (1..=LEAP).contains(&i64::from(frame.wrapping_sub(leapt) as i32));
        if self.leapt.take().is_some_and(follows) {
            // The counter was set elsewhere. What that skipped was never sent.
            self.lost_before = self.lost();
            self.start(frame, arrival);
            return Some(Order::Restart);
        }
        let counted = self.arrival - self.began;
        let rate = if counted > 0.0 { self.span as f64 / counted } else { 0.0 };
        let silence = arrival - self.arrival;
        let likely = if step > 0 { step as f64 <= PACE * rate * silence } else { silence > PAUSE };
        if step.abs() > LEAP && !likely {
            self.leapt = Some(frame);
            return Some(Order::Late);
        }
        None
    }

    fn start(&mut self, frame: u32, arrival: f64) {
        self.remembered.clear();
        self.remember(frame);
        self.began = arrival;
        (self.newest, self.arrival, self.behind) = (Some(frame), arrival, Behind::default());
        (self.step, self.span, self.came) = (0, 0, 1);
    }

    fn remember(&mut self, frame: u32) {
        if self.remembered.len() == REMEMBERED {
            self.remembered.remove(0);
        }
        self.remembered.push(frame);
    }

    fn lost(&self) -> u64 {
        let expected = if self.step > 0 { self.span / self.step + 1 } else { self.came };
        self.lost_before + u64::try_from(expected - self.came).unwrap_or(0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use Order::*;

    fn packet(frame: u32, time: f64) -> Packet {
        Packet { frame, time_of_day: Some(time), ..Packet::default() }
    }

    #[test]
    fn gaps_are_losses_until_the_late_ones_come() {
        let mut counter = FrameCounter::default();
        let orders: Vec<Order> = [10, 11, 14, 12, 12, 15].into_iter().map(|frame| counter.add(frame, 0.0)).collect();
        assert_eq!(orders, [New, New, New, Late, Duplicate, New]);
        assert_eq!(counter.lost(), 1, "only 13 never came");
    }

    #[test]
    fn every_third_frame_is_no_loss() {
        let mut counter = FrameCounter::default();
        for frame in (0..300).step_by(3).filter(|frame| frame % 30 != 9) {
            counter.add(frame, 0.0);
        }
        assert_eq!(counter.lost(), 10);
    }

    #[test]
    fn the_counter_goes_on_over_32_bits_and_a_restart_is_seen() {
        let mut counter = FrameCounter::default();
        let orders: Vec<Order> = [u32::MAX - 1, u32::MAX, 0, 2].into_iter().map(|frame| counter.add(frame, 0.0)).collect();
        assert_eq!((orders, counter.lost()), (vec![New; 4], 1));
        // Set ahead, and set back.
        let orders: Vec<Order> = [1_000_000, 1_000_001, 1_000_002, 5, 6, 7].into_iter().map(|frame| counter.add(frame, 0.0)).collect();
        assert_eq!((orders, counter.lost()), (vec![Late, Restart, New, Late, Restart, New], 1));
    }

    /// Whatever number one datagram bears, and wherever among the others it comes.
    #[test]
    fn one_far_counter_makes_no_losses() {
        for far in [4_000_000_000, 2_000_000_000, 1_000_000, 0, u32::MAX, 3_100] {
            for at in [0, 1, 2, 50, 99] {
                let mut meter = StreamMeter::default();
                for k in 0..100u32 {
                    let time = f64::from(k) / 60.0;
                    if k == at {
                        meter.add(&packet(far, time), time);
                    }
                    meter.add(&packet(2000 + k, time), time);
                }
                let figures = meter.figures(100.0 / 60.0);
                assert!(figures.lost == 0 && figures.restarts <= 1, "{far} before packet {at}: {figures:?}");
            }
        }
    }

    /// A cable that is pulled for a minute: all frames of that minute are lost.
    #[test]
    fn a_long_silence_of_a_counter_that_went_on_is_a_loss() {
        let mut counter = FrameCounter::default();
        for k in (0..100).chain(3700..3800) {
            assert_eq!(counter.add(k, f64::from(k) / 60.0), New, "frame {k}");
        }
        assert_eq!(counter.lost(), 3600);
    }

    /// A take that is sent again, or a measurement that is started again: after a while, at once, and one so short that all its counters
    /// are remembered.
    #[test]
    fn a_counter_that_falls_back_by_less_than_a_thousand_is_a_restart_too() {
        for (frames, pause) in [(600u32, 3.0), (600, 0.02), (100, 3.0), (100, 0.02)] {
            let mut meter = StreamMeter::default();
            for round in 0..3u32 {
                let begun = f64::from(round) * (f64::from(frames) / 60.0 + pause);
                // In each round every twentieth is lost.
                for k in (0..frames).filter(|k| k % 20 != 7) {
                    meter.add(&packet(1000 + k, 36_000.0 + f64::from(k) / 60.0), begun + f64::from(k) / 60.0);
                }
            }
            let figures = meter.figures(0.0);
            assert_eq!(figures.restarts, 2, "{frames} frames, {pause} s: {figures:?}");
            // Those at the start of a round that could still be late ones: 0.2 s.
            let unsure = figures.late + figures.duplicates;
            assert!(if pause > 1.0 { unsure == 0 } else { unsure <= 2 * 12 }, "{frames} frames, {pause} s: {figures:?}");
            let lost = u64::from(3 * frames / 20);
            assert!((lost - 2..=lost).contains(&figures.lost), "{frames} frames, {pause} s: {figures:?}");
            assert!((figures.tracker_rate - 60.0).abs() < 1e-3 && figures.lateness < 1e-6, "{frames} frames, {pause} s: {figures:?}");
        }
    }

    #[test]
    fn rate_falls_when_nothing_comes() {
        let mut meter = StreamMeter::default();
        for k in 0..100 {
            meter.add(&packet(k, f64::from(k) / 60.0), f64::from(k) / 60.0);
        }
        let figures = meter.figures(99.0 / 60.0);
        assert!((figures.rate - 60.0).abs() < 1e-9 && (figures.tracker_rate - 60.0).abs() < 1e-6 && figures.jitter < 1e-9, "{figures:?}");
        assert!(meter.figures(20.0).rate < 4.0);
        meter.pick_up(0.001);
        meter.pick_up(0.003);
        assert_eq!(meter.figures(20.0).pick_up, (0.002, 0.003));
    }
}

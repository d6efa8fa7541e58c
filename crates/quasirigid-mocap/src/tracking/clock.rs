//! When on the tracker's clock is now? Found from arrivals alone, in spite of jitter, loss and a drift between the clocks.

/// Length of a bucket of [`ClockSync`], s, and how many there are: a fastest packet is believed for 4 s.
/// At a drift of 100 ppm the estimate is then off by 0.4 ms at most.
const BUCKET: f64 = 0.5;
const BUCKETS: usize = 8;
/// How many packets the period and the jitter are taken from.
const RECENT: usize = 64;

/// Estimates `arrival - time` of the fastest packets, the tracker's period, and how late packets come.
#[derive(Debug, Clone)]
pub struct ClockSync {
    /// (number of the bucket, smallest `arrival - time` in it).
    buckets: [(i64, f64); BUCKETS],
    offset: f64,
    /// `arrival - time` of the latest packets.
    delays: [f64; RECENT],
    /// Times of the latest packets.
    times: [f64; RECENT],
    count: usize,
    period: f64,
    jitter: f64,
}

impl Default for ClockSync {
    fn default() -> Self {
        Self {
            buckets: [(i64::MIN, f64::INFINITY); BUCKETS],
            offset: 0.0,
            delays: [0.0; RECENT],
            times: [0.0; RECENT],
            count: 0,
            period: 0.0,
            jitter: 0.0,
        }
    }
}

impl ClockSync {
    /// A packet measured at `time` (tracker, s) came at `arrival` (own clock, s). Duplicates may be told or not.
    pub fn add(&mut self, time: f64, arrival: f64) {
        let delay = arrival - time;
        let bucket = (arrival / BUCKET).floor() as i64;
        let slot = &mut self.buckets[bucket.rem_euclid(BUCKETS as i64) as usize];
        *slot = if slot.0 == bucket { (bucket, slot.1.min(delay)) } else { (bucket, delay) };
        let alive = |&&(number, _): &&(i64, f64)| number > bucket.saturating_sub(BUCKETS as i64) && number <= bucket;
        self.offset = self.buckets.iter().filter(alive).map(|&(_, least)| least).fold(f64::INFINITY, f64::min);
        self.delays[self.count % RECENT] = delay;
        self.times[self.count % RECENT] = time;
        self.count += 1;
        self.measure();
    }

    /// Median of the steps of the time, and 95th percentile of the lateness.
    fn measure(&mut self) {
        let known = self.count.min(RECENT);
        let mut sorted = self.times;
        sorted[..known].sort_by(f64::total_cmp);
        let mut steps = [0.0; RECENT];
        let mut n = 0;
        for pair in sorted[..known].windows(2) {
            let step = pair[1] - pair[0];
            // Duplicates are no steps.
            if step > 1e-4 {
                steps[n] = step;
                n += 1;
            }
        }
        if n > 0 {
            steps[..n].sort_by(f64::total_cmp);
            self.period = steps[n / 2];
        }
        let mut late = self.delays;
        late[..known].sort_by(f64::total_cmp);
        self.jitter = (late[(known * 95 / 100).min(known - 1)] - self.offset).max(0.0);
    }

    /// Whether a packet has come.
    pub fn is_running(&self) -> bool {
        self.count > 0
    }

    /// Tracker's time at the own time `now`, as the fastest packets have it, s.
    pub fn tracker_time(&self, now: f64) -> f64 {
        now - self.offset
    }

    /// Time from frame to frame, s; 0 before the second.
    pub fn period(&self) -> f64 {
        self.period
    }

    /// How late, compared to the fastest, 95 of 100 packets come at most, s.
    pub fn jitter(&self) -> f64 {
        self.jitter
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn period_offset_and_jitter_are_found_in_a_bad_stream() {
        let mut random = fastrand::Rng::with_seed(3);
        for rate in [30.0, 60.0, 120.0, 240.0, 500.0] {
            let mut clock = ClockSync::default();
            let mut last = 0.0;
            for k in 0..(3.0 * rate) as usize {
                if random.f64() < 0.2 {
                    continue;
                }
                let time = 50_000.0 + k as f64 / rate;
                last = time - 50_000.0 + 0.003 + 0.01 * random.f64();
                clock.add(time, last);
            }
            assert!((clock.period() * rate - 1.0).abs() < 1e-6, "{rate} Hz: period {}", clock.period());
            assert!((clock.tracker_time(last) - (50_000.0 + last - 0.003)).abs() < 1e-3, "{rate} Hz");
            assert!((0.007..0.0105).contains(&clock.jitter()), "{rate} Hz: jitter {}", clock.jitter());
        }
    }

    #[test]
    fn arrivals_beyond_all_sense_do_no_harm() {
        let mut clock = ClockSync::default();
        for arrival in [-1e300, 1e300, 0.0] {
            clock.add(1.0, arrival);
        }
        assert_eq!(clock.tracker_time(0.0), 1.0);
    }

    #[test]
    fn a_slow_clock_is_followed() {
        let mut clock = ClockSync::default();
        for k in 0..3600 {
            let time = k as f64 / 60.0;
            clock.add(time, time * 1.0001 + 0.002);
        }
        let wrong = clock.tracker_time(60.0 * 1.0001 + 0.002) - 60.0;
        assert!(wrong.abs() < 5e-4, "{wrong} s off after a minute at 100 ppm");
    }
}

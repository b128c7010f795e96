//! From depth frame to command: the first command that is about a frame or a later one answers it.

/// Frames remembered.
const ROOM: usize = 256;
/// Frames that one command can answer at most; a wider gap is a restart.
const GAP_MAX: u64 = 64;
/// Intervals of which the median is the frame period.
const INTERVALS: usize = 15;

#[derive(Debug, Clone, Copy, Default, PartialEq)]
struct Frame {
    number: u64,
    sent_ns: Option<u64>,
    answered_ns: Option<u64>,
    counted: bool,
}

/// The frames of a drive on their way from depth to command.
#[derive(Debug, Clone)]
pub(crate) struct Frames {
    frames: Vec<Frame>,
    epoch: u32,
    answered: u64,
    /// Number and send stamp of the newest frame counted.
    newest: Option<(u64, u64)>,
    intervals_ns: [u64; INTERVALS],
    interval_count: usize,
    /// Whether frames come at a rate of host time, so that a long interval means missing ones.
    paced: bool,
}

impl Frames {
    pub(crate) fn new() -> Self {
        Self {
            frames: vec![Frame::default(); ROOM],
            epoch: 0,
            answered: 0,
            newest: None,
            intervals_ns: [0; INTERVALS],
            interval_count: 0,
            paced: true,
        }
    }

    /// In lockstep frames come when everybody has answered: only numbers tell which are missing.
    pub(crate) fn pace(&mut self, paced: bool) {
        self.paced = paced;
    }

    /// Forgets what belongs to an earlier epoch, in which stamps and numbers meant something else.
    pub(crate) fn enter(&mut self, epoch: u32) {
        if epoch != self.epoch {
            *self = Self { epoch, paced: self.paced, ..Self::new() };
        }
    }

    fn frame(&mut self, number: u64) -> &mut Frame {
        let frame = &mut self.frames[number as usize % ROOM];
        if frame.number != number {
            *frame = Frame { number, ..Frame::default() };
        }
        frame
    }

    /// Frame `number` left its driver at `sent_ns`.
    pub(crate) fn sent(&mut self, number: u64, sent_ns: u64, times: &mut impl FnMut(u64)) {
        if self.newest.is_some_and(|(before, before_ns)| number < before && sent_ns > before_ns) {
            // The driver was restarted and counts afresh.
            *self = Self { epoch: self.epoch, paced: self.paced, ..Self::new() };
        }
        self.frame(number).sent_ns.get_or_insert(sent_ns);
        self.count(number, times);
    }

    /// A command about frame `number` was sent at `sent_ns`; it answers this and all frames before it.
    pub(crate) fn answered(&mut self, number: u64, sent_ns: u64, times: &mut impl FnMut(u64)) {
        let first = (self.answered + 1).max(number.saturating_sub(GAP_MAX - 1));
        let gap = if self.answered == 0 { number } else { first };
        for number in gap..=number {
            self.frame(number).answered_ns = Some(sent_ns);
            self.count(number, times);
        }
        self.answered = self.answered.max(number);
    }

    /// Counts a frame once both its ends are known, and before it those that were due and never came.
    fn count(&mut self, number: u64, times: &mut impl FnMut(u64)) {
        let frame = self.frame(number);
        let (Some(sent_ns), Some(answered_ns), false) = (frame.sent_ns, frame.answered_ns, frame.counted)
        else {
            return;
        };
        frame.counted = true;
        times(answered_ns.saturating_sub(sent_ns));
        let Some((before, before_ns)) = self.newest.replace((number, sent_ns)) else { return };
        if number <= before || sent_ns <= before_ns {
            return;
        }
        let interval_ns = sent_ns - before_ns;
        let due = self.due_between(number - before, interval_ns);
        for missing in 1..due {
            // Frames that the driver skipped, or that no stage took: each counts from the time it was due.
            let due_ns = before_ns + interval_ns * missing / due;
            times(answered_ns.saturating_sub(due_ns));
        }
        if due == 1 || self.interval_count < INTERVALS {
            self.intervals_ns[self.interval_count % INTERVALS] = interval_ns / due;
            self.interval_count += 1;
        }
    }

    /// Frame periods in an interval: by number where numbers are missing, else by the usual period.
    fn due_between(&self, numbers: u64, interval_ns: u64) -> u64 {
        if !self.paced || self.interval_count < INTERVALS {
            return numbers.min(GAP_MAX);
        }
        let mut sorted = self.intervals_ns;
        sorted.sort_unstable();
        let period_ns = sorted[INTERVALS / 2].max(1);
        let periods = (interval_ns + period_ns / 2) / period_ns;
        // A pause is no missing frame.
        if periods > GAP_MAX { 1 } else { periods.max(numbers.min(GAP_MAX)) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PERIOD_NS: u64 = 33_000_000;

    /// Feeds frames (number, sent) that are answered 1 ms later; the times counted.
    fn drive(frames: impl IntoIterator<Item = (u64, u64)>) -> Vec<u64> {
        drive_with(Frames::new(), frames)
    }

    fn drive_with(mut all: Frames, frames: impl IntoIterator<Item = (u64, u64)>) -> Vec<u64> {
        let mut times = Vec::new();
        for (number, sent_ns) in frames {
            all.sent(number, sent_ns, &mut |time| times.push(time));
            all.answered(number, sent_ns + 1_000_000, &mut |time| times.push(time));
            // Further commands about the same frame answer nothing new.
            all.answered(number, sent_ns + 11_000_000, &mut |time| times.push(time));
        }
        times
    }

    #[test]
    fn each_frame_counts_once_with_its_first_command() {
        assert_eq!(drive((1..=100).map(|n| (n, n * PERIOD_NS))), vec![1_000_000; 100]);
    }

    #[test]
    fn a_frame_that_only_a_later_command_answers_counts_until_then() {
        let (mut all, mut times) = (Frames::new(), Vec::new());
        let mut count = |time| times.push(time);
        for number in 1..=3 {
            all.sent(number, number * PERIOD_NS, &mut count);
        }
        all.answered(1, PERIOD_NS + 5, &mut count);
        all.answered(3, 3 * PERIOD_NS + 7, &mut count);
        assert_eq!(times, [5, PERIOD_NS + 7, 7]);
    }

    #[test]
    fn a_frame_that_the_driver_skipped_counts_from_the_time_it_was_due() {
        // The driver numbers what it sends; after frame 40 two periods pass without a frame.
        let times = drive((1..=80).map(|n| (n, if n > 40 { n + 2 } else { n } * PERIOD_NS)));
        let late: Vec<_> = times.iter().filter(|&&time| time > 1_000_000).collect();
        assert_eq!(late, [&(2 * PERIOD_NS + 1_000_000), &(PERIOD_NS + 1_000_000)]);
        assert_eq!(times.len(), 82);
    }

    /// In lockstep every other frame comes much later than the one before; one number is missing.
    #[test]
    fn in_lockstep_only_a_missing_number_is_a_missing_frame() {
        let mut frames = Frames::new();
        frames.pace(false);
        let sent_ns = |n: u64| n * PERIOD_NS + n / 2 * 10 * PERIOD_NS;
        let times = drive_with(frames, (1..=80).filter(|n| *n != 41).map(|n| (n, sent_ns(n))));
        assert_eq!(times.len(), 80);
    }

    #[test]
    fn a_frame_that_no_stage_took_counts_although_its_stamp_is_unknown() {
        let times = drive((1..=60).filter(|n| n % 20 != 0).map(|n| (n, n * PERIOD_NS)));
        assert_eq!(times.len(), 59);
        assert_eq!(times.iter().filter(|&&time| time == PERIOD_NS + 1_000_000).count(), 2);
    }

    #[test]
    fn a_restarted_driver_and_a_pause_are_no_missing_frames() {
        let restart =
            (1..=100).map(|n| (n, n * PERIOD_NS)).chain((1..=50).map(|n| (n, (500 + n) * PERIOD_NS)));
        assert_eq!(drive(restart), vec![1_000_000; 150]);
        let pause = (1..=100).map(|n| (n, if n > 50 { n + 1000 } else { n } * PERIOD_NS));
        assert_eq!(drive(pause), vec![1_000_000; 100]);
    }
}

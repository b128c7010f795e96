//! Graph time as wall time of the file.
//!
//! A viewer's present is the time at which messages were received, and it looks transforms up by the stamps within. Both
//! must run on one clock, also where graph time is that of an old recording played at another rate, or moves in steps.
//! So every stamp becomes the wall time at which graph time had that value: exact in real time, by the word of the clock
//! in playback, between the words of the driver in lockstep.

use foxglove::messages::Timestamp;
use sidestep_msgs::{Clock, ClockMode};
use std::collections::VecDeque;

/// Words of a lockstep driver that are remembered: some seconds, longer than any message is under way.
const WORDS: usize = 512;

/// Turns graph time into wall time.
#[derive(Debug, Clone)]
pub(crate) struct FileTime {
    mono_to_wall_ns: i64,
    newest: Option<Clock>,
    /// `[ns]` graph time of a lockstep word and host time at which it was received, both rising.
    words: VecDeque<(u64, u64)>,
}

impl FileTime {
    pub(crate) fn new(mono_to_wall_ns: i64) -> Self {
        Self { mono_to_wall_ns, newest: None, words: VecDeque::with_capacity(WORDS) }
    }

    /// Takes a word of the clock, received at host time `received_ns`.
    pub(crate) fn take(&mut self, clock: &Clock, received_ns: u64) {
        self.newest = Some(*clock);
        if clock.mode != ClockMode::Lockstep as u32 {
            self.words.clear();
            return;
        }
        let word = (clock.graph_ns, received_ns);
        match self.words.back() {
            // Time was set back: what came before belongs to another life of the driver.
            Some(last) if word.0 < last.0 => self.words.clear(),
            // The first host time of a graph time counts.
            Some(last) if word.0 == last.0 || word.1 <= last.1 => return,
            _ => {}
        }
        if self.words.len() == WORDS {
            self.words.pop_front();
        }
        self.words.push_back(word);
    }

    fn host_ns(&self, graph_ns: u64) -> u64 {
        let Some(clock) = &self.newest else { return graph_ns };
        let passed_ns = |from_ns: u64| graph_ns as f64 - from_ns as f64;
        let after = |host_ns: u64, ns: f64| host_ns.saturating_add_signed(ns as i64);
        if clock.mode == ClockMode::Playback as u32 {
            return after(clock.host0_ns, passed_ns(clock.graph0_ns) / clock.rate.max(1e-3));
        }
        let (Some(first), Some(last)) = (self.words.front(), self.words.back()) else { return graph_ns };
        let next = self.words.partition_point(|word| word.0 < graph_ns);
        // Beyond the words, as the driver's own next event, time goes on as it did on average.
        let (from, to) = if next == 0 || next == self.words.len() {
            (first, last)
        } else {
            (&self.words[next - 1], &self.words[next])
        };
        let slope = if to.0 > from.0 { (to.1 - from.1) as f64 / (to.0 - from.0) as f64 } else { 1.0 };
        let base = if next == self.words.len() { last } else { from };
        after(base.1, passed_ns(base.0) * slope)
    }

    /// `[ns]` wall time at which graph time was `graph_ns`.
    pub(crate) fn wall_ns(&self, graph_ns: u64) -> u64 {
        self.host_ns(graph_ns).saturating_add_signed(self.mono_to_wall_ns)
    }

    /// The stamp of a message about `graph_ns`.
    pub(crate) fn stamp(&self, graph_ns: u64) -> Option<Timestamp> {
        let wall_ns = self.wall_ns(graph_ns);
        let seconds = u32::try_from(wall_ns / 1_000_000_000).unwrap_or(u32::MAX);
        Timestamp::new_checked(seconds, (wall_ns % 1_000_000_000) as u32)
    }
}

/// Whether something that is shown each `every_ns` of graph time is due, which is remembered; at once where time was set back.
pub(crate) fn is_due(before_ns: &mut Option<u64>, now_ns: u64, every_ns: u64) -> bool {
    let due = before_ns.is_none_or(|before_ns| now_ns < before_ns || now_ns - before_ns >= every_ns);
    if due {
        *before_ns = Some(now_ns);
    }
    due
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn real_time_is_host_time_and_playback_follows_its_rate() {
        let mut time = FileTime::new(1000);
        assert_eq!(time.wall_ns(7), 1007);
        let mode = ClockMode::Playback as u32;
        let word = Clock { mode, graph0_ns: 500, host0_ns: 9000, rate: 2.0, ..Clock::default() };
        time.take(&word, 9001);
        assert_eq!((time.wall_ns(500), time.wall_ns(700), time.wall_ns(300)), (10_000, 10_100, 9_900));
        // The word itself relates the same pairs of times.
        assert_eq!(word.graph_ns_at(9_100), 700);
    }

    #[test]
    fn a_stamp_of_lockstep_lies_between_the_words_and_never_changes_again() {
        let mut time = FileTime::new(0);
        let word = |graph_ns| Clock { mode: ClockMode::Lockstep as u32, graph_ns, ..Clock::default() };
        for (graph_ns, host_ns) in [(100, 5000), (200, 5050), (300, 5200)] {
            time.take(&word(graph_ns), host_ns);
        }
        let before: Vec<_> = (100..=300).map(|graph_ns| time.wall_ns(graph_ns)).collect();
        assert_eq!(
            (before[0], before[50], before[100], before[150], before[200]),
            (5000, 5025, 5050, 5125, 5200)
        );
        assert!(before.is_sorted());
        assert_eq!((time.wall_ns(400), time.wall_ns(0)), (5300, 4900));
        time.take(&word(400), 6000);
        assert_eq!(before, (100..=300).map(|graph_ns| time.wall_ns(graph_ns)).collect::<Vec<_>>());
    }

    #[test]
    fn a_driver_that_begins_again_is_believed() {
        let mut time = FileTime::new(0);
        let word = |graph_ns| Clock { mode: ClockMode::Lockstep as u32, graph_ns, ..Clock::default() };
        time.take(&word(900), 5000);
        time.take(&word(10), 6000);
        assert_eq!(time.wall_ns(10), 6000);
    }
}

//! Lockstep of a recording: which of its messages belong to a tick, and when a frame is asked about.

/// `[ns]` between two ticks.
const TICK_NS: u64 = 10_000_000;

/// What to do with the next message of a recording.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Beat {
    /// Publish it; the question comes later.
    Publish,
    /// First the tick at this time is to be answered.
    Tick {
        /// `[ns]` graph time.
        stamp_ns: u64,
        /// From 0.
        number: u64,
    },
    /// It is a frame: publish it and have it answered.
    Frame,
}

/// The ticks of a playback: one every 10 ms of graph time, at whole multiples, from the first message on.
#[derive(Debug, Default)]
pub(crate) struct Beats {
    tick_ns: Option<u64>,
    ticks: u64,
    /// Whether anything was published that no tick or frame has answered for.
    open: bool,
}

impl Beats {
    /// Graph time jumps: ticks begin anew at the next message.
    pub(crate) fn jump(&mut self) {
        *self = Self { ticks: self.ticks, ..Self::default() };
    }

    /// What to do with a message of this time. Messages up to a tick come before it, a frame at the very time of a tick after
    /// it: whoever answers a frame must not owe a tick.
    pub(crate) fn next(&mut self, now_ns: u64, is_frame: bool) -> Beat {
        let tick_ns = *self.tick_ns.get_or_insert(now_ns - now_ns % TICK_NS);
        if now_ns > tick_ns || (is_frame && now_ns == tick_ns) {
            return self.tick(tick_ns);
        }
        self.open = !is_frame;
        if is_frame { Beat::Frame } else { Beat::Publish }
    }

    /// After the last message: the tick that answers what is open, if anything is.
    pub(crate) fn last(&mut self) -> Option<Beat> {
        let tick_ns = self.tick_ns.filter(|_| self.open)?;
        Some(self.tick(tick_ns))
    }

    fn tick(&mut self, stamp_ns: u64) -> Beat {
        self.tick_ns = Some(stamp_ns + TICK_NS);
        self.ticks += 1;
        self.open = false;
        Beat::Tick { stamp_ns, number: self.ticks - 1 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What is done with messages at these milliseconds; frames carry a true.
    fn play(messages: &[(u64, bool)]) -> Vec<(char, u64)> {
        let mut beats = Beats::default();
        let mut done = Vec::new();
        let tick = |beat| match beat {
            Beat::Tick { stamp_ns, .. } => ('t', stamp_ns / 1_000_000),
            _ => ('?', 0),
        };
        for &(ms, is_frame) in messages {
            loop {
                match beats.next(ms * 1_000_000, is_frame) {
                    Beat::Publish => done.push(('m', ms)),
                    Beat::Frame => done.push(('f', ms)),
                    beat => {
                        done.push(tick(beat));
                        continue;
                    }
                }
                break;
            }
        }
        done.extend(beats.last().map(tick));
        done
    }

    #[test]
    fn a_tick_comes_after_the_messages_up_to_it_and_before_a_frame_at_its_time() {
        let done = play(&[(23, false), (30, false), (30, true), (33, true), (35, false), (52, false)]);
        let expected = [
            ('t', 20),
            ('m', 23),
            ('m', 30),
            ('t', 30),
            ('f', 30),
            ('f', 33),
            ('m', 35),
            ('t', 40),
            ('t', 50),
            ('m', 52),
            ('t', 60),
        ];
        assert_eq!(done, expected);
    }
}

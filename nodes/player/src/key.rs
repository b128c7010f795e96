//! What the keyboard says to a playback.

use crate::schedule::Schedule;

/// The socket in the folder of the run on which the player hears keys.
pub const KEYS_SOCKET: &str = "keys";

/// A key of the playback; on the way from the launcher's terminal to the player it is one byte.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Key {
    /// Pauses or goes on.
    Pause,
    /// While paused: on to the next frame.
    Step,
    /// A tenth faster.
    Faster,
    /// A tenth slower.
    Slower,
}

impl Key {
    /// Its byte.
    #[must_use]
    pub fn byte(self) -> u8 {
        match self {
            Self::Pause => b' ',
            Self::Step => b'n',
            Self::Faster => b'+',
            Self::Slower => b'-',
        }
    }

    /// The key of a byte.
    #[must_use]
    pub fn from_byte(byte: u8) -> Option<Self> {
        [Self::Pause, Self::Step, Self::Faster, Self::Slower].into_iter().find(|key| key.byte() == byte)
    }

    /// The keys that a terminal sent: space, n, arrows right, up and down; anything else is none.
    #[must_use]
    pub fn read(bytes: &[u8]) -> Vec<Self> {
        let mut keys = Vec::new();
        let mut rest = bytes;
        while let Some((&byte, after)) = rest.split_first() {
            rest = after;
            // An arrow is three bytes; a terminal in application mode says O for [.
            if byte == 0x1b && matches!(after, [b'[' | b'O', ..]) {
                keys.extend(match after.get(1) {
                    Some(b'A') => Some(Self::Faster),
                    Some(b'B') => Some(Self::Slower),
                    Some(b'C') => Some(Self::Step),
                    _ => None,
                });
                rest = after.get(2..).unwrap_or_default();
            } else {
                keys.extend(Self::from_byte(byte));
            }
        }
        keys
    }
}

/// Whether a playback stands, and whether it was asked for one more frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Control {
    /// Whether it stands.
    pub paused: bool,
    /// Whether it plays on to the next frame though it stands.
    pub stepping: bool,
}

impl Control {
    /// Takes a key; what to tell the user, or nothing where the key has no meaning now.
    pub fn take(&mut self, key: Key, schedule: &mut Schedule, host_ns: u64) -> Option<String> {
        match key {
            Key::Pause if self.paused => {
                *self = Self { paused: false, stepping: false };
                schedule.resume(host_ns);
                Some("goes on".into())
            }
            Key::Pause => {
                self.paused = true;
                schedule.pause(host_ns);
                Some("paused; space goes on, n or the right arrow shows the next frame".into())
            }
            Key::Step => {
                self.stepping = self.paused;
                None
            }
            Key::Faster | Key::Slower => {
                let factor = if key == Key::Faster { 1.1 } else { 1.0 / 1.1 };
                Some(format!("rate {:.2}", schedule.change_rate(factor, host_ns)))
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use sidestep_msgs::Clock;

    const SECOND_NS: u64 = 1_000_000_000;

    #[test]
    fn a_terminals_bytes_are_keys_and_what_is_none_is_passed_over() {
        use Key::{Faster, Pause, Slower, Step};
        let cases: [(&[u8], &[Key]); 6] = [
            (b" ", &[Pause]),
            (b"n\x1b[C", &[Step, Step]),
            (b"\x1b[A\x1bOB", &[Faster, Slower]),
            (b"\x1b[Z x\x1b", &[Pause]),
            (b"\x1b[", &[]),
            (b"+-", &[Faster, Slower]),
        ];
        for (bytes, keys) in cases {
            assert_eq!(Key::read(bytes), keys, "{bytes:?}");
        }
    }

    #[test]
    fn graph_time_stands_while_paused_and_goes_on_from_where_it_stood() {
        let mut schedule = Schedule::new(2.0).unwrap();
        let mut control = Control { paused: false, stepping: false };
        schedule.jump(100 * SECOND_NS, 0);
        control.take(Key::Pause, &mut schedule, SECOND_NS).unwrap();
        let stands: Clock = schedule.clock(9 * SECOND_NS);
        assert_eq!((stands.paused, stands.graph_ns), (1, 102 * SECOND_NS));
        assert_eq!(schedule.due_host_ns(102 * SECOND_NS), None);
        control.take(Key::Step, &mut schedule, 9 * SECOND_NS);
        assert!(control.stepping);
        schedule.stand_at(103 * SECOND_NS);
        assert_eq!(schedule.clock(11 * SECOND_NS).graph_ns, 103 * SECOND_NS);
        control.take(Key::Pause, &mut schedule, 20 * SECOND_NS).unwrap();
        let word = schedule.clock(21 * SECOND_NS);
        assert_eq!((word.paused, word.graph_ns), (0, 105 * SECOND_NS));
    }

    #[test]
    fn a_change_of_rate_does_not_move_time() {
        let mut schedule = Schedule::new(1.0).unwrap();
        let mut control = Control { paused: false, stepping: false };
        schedule.jump(0, 0);
        control.take(Key::Faster, &mut schedule, SECOND_NS).unwrap();
        assert_eq!(schedule.clock(SECOND_NS).graph_ns, SECOND_NS);
        assert!(schedule.clock(2 * SECOND_NS).graph_ns.abs_diff(2_100_000_000) < 10);
        for _ in 0..200 {
            control.take(Key::Faster, &mut schedule, SECOND_NS).unwrap();
        }
        assert!(schedule.clock(SECOND_NS).rate <= 100.0);
    }
}

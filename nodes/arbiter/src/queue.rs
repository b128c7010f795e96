//! Commands sent: what the base still has to obey before a new one can have an effect.
//!
//! Without them the filter hits walls whenever v/a is shorter than the dead time (notes/navigation.md 4.2, trap a).

use bytemuck::{Pod, Zeroable};
use sidestep_msgs::Twist;

/// Room for commands: half a second at 130 Hz, more than the oldest odometry and the longest dead time.
pub(crate) const SENT_MAX: usize = 64;

/// A command with the graph time of its sending.
#[repr(C)]
#[derive(Debug, Clone, Copy, Default, PartialEq, Pod, Zeroable)]
pub(crate) struct Sent {
    /// `[ns]` graph time.
    pub(crate) sent_ns: u64,
    /// The command.
    pub(crate) twist: Twist,
}

/// The last commands, oldest overwritten first.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
pub(crate) struct Queue {
    entries: [Sent; SENT_MAX],
    next: u32,
    count: u32,
}

/// A command with its sending in seconds after the odometry's stamp.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Pending {
    /// `[s]` after the stamp; negative before it.
    pub(crate) sent_s: f32,
    /// The command.
    pub(crate) twist: Twist,
}

impl Queue {
    pub(crate) fn push(&mut self, sent: Sent) {
        let slot = self.next as usize % SENT_MAX;
        self.entries[slot] = sent;
        self.next = (slot as u32 + 1) % SENT_MAX as u32;
        self.count = (self.count + 1).min(SENT_MAX as u32);
    }

    pub(crate) fn clear(&mut self) {
        self.count = 0;
    }

    /// Writes the commands that can matter after `stamp_ns - reach_s`, oldest first; returns how many.
    pub(crate) fn pending(&self, stamp_ns: u64, reach_s: f32, out: &mut [Pending; SENT_MAX]) -> usize {
        let count = (self.count as usize).min(SENT_MAX);
        let first = self.next as usize + SENT_MAX - count;
        let mut used = 0;
        for i in 0..count {
            let sent = self.entries[(first + i) % SENT_MAX];
            let sent_s = (sent.sent_ns as i128 - stamp_ns as i128) as f32 * 1e-9;
            let pending = Pending { sent_s, twist: sent.twist };
            // Of those that took effect before the stamp, only the last can still hold.
            if sent_s < -reach_s && used == 1 {
                out[0] = pending;
            } else {
                out[used] = pending;
                used += 1;
            }
        }
        used
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_the_last_command_before_the_reach_and_all_later_ones_are_pending() {
        let mut queue = Queue::zeroed();
        for i in 0..200u64 {
            queue.push(Sent { sent_ns: i * 10_000_000, twist: Twist::new(i as f32, 0.0) });
        }
        let mut out = [Pending::default(); SENT_MAX];
        let used = queue.pending(1_950_000_000, 0.08, &mut out);
        let speeds: Vec<f32> = out[..used].iter().map(|pending| pending.twist.v_m_s).collect();
        assert_eq!(speeds.first(), Some(&186.0));
        assert_eq!(speeds.last(), Some(&199.0));
        assert!((out[used - 1].sent_s - 0.04).abs() < 1e-6);
    }
}

//! What was sent and what moved, on one time.

use crate::error::IdentifyError;
use sidestep_msgs::{COMMAND, Command, ODOMETRY, Odometry};
use sidestep_player::Messages;
use std::path::Path;

/// A command as the arbiter sent it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sent {
    /// `[ns]` graph time of the arbiter's step that sent it.
    pub sent_ns: u64,
    /// `[ns]` graph time at which it ends.
    pub valid_until_ns: u64,
    /// `[m/s]` forward.
    pub v_m_s: f64,
    /// `[rad/s]` counter-clockwise.
    pub w_rad_s: f64,
}

/// A motion as the odometry measured it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Moved {
    /// `[ns]` graph time of the measurement.
    pub stamp_ns: u64,
    /// `[m/s]` forward.
    pub v_m_s: f64,
    /// `[rad/s]` counter-clockwise.
    pub w_rad_s: f64,
    /// Whether the wheels slipped, so that the measurement means nothing.
    pub slip: bool,
}

/// Commands and motion, each in the order of time.
#[derive(Debug, Clone, Default)]
pub struct Series {
    commands: Vec<Sent>,
    motion: Vec<Moved>,
    open_loop: bool,
}

impl Series {
    /// Takes a command, sent at a graph time; one that is not finite or goes back in time is left out.
    pub fn command(&mut self, command: &Command, sent_ns: u64) {
        self.open_loop |= command.open_loop != 0;
        let sent = Sent {
            sent_ns,
            valid_until_ns: command.valid_until_ns,
            v_m_s: f64::from(command.twist.v_m_s),
            w_rad_s: f64::from(command.twist.w_rad_s),
        };
        let later = self.commands.last().is_none_or(|last| last.sent_ns < sent_ns);
        if command.twist.is_finite() && later {
            self.commands.push(sent);
        }
    }

    /// Takes an odometry message; one that is not finite or goes back in time is left out.
    pub fn odometry(&mut self, odometry: &Odometry) {
        let moved = Moved {
            stamp_ns: odometry.stamp_ns,
            v_m_s: f64::from(odometry.twist.v_m_s),
            w_rad_s: f64::from(odometry.twist.w_rad_s),
            slip: odometry.slip != 0,
        };
        let later = self.motion.last().is_none_or(|last| last.stamp_ns < moved.stamp_ns);
        if odometry.twist.is_finite() && later {
            self.motion.push(moved);
        }
    }

    /// Reads a recording, complete or cut.
    ///
    /// # Errors
    /// What the player says of the file, or [`IdentifyError`] where it holds no drive.
    pub fn read(path: &Path) -> Result<Self, IdentifyError> {
        let mut series = Self::default();
        for entry in Messages::open(path)? {
            let entry = entry?;
            if let Some(command) = entry.read(COMMAND) {
                series.command(&command, entry.header.now_ns);
            }
            if let Some(odometry) = entry.read(ODOMETRY) {
                series.odometry(&odometry);
            }
        }
        let name = path.display().to_string();
        if series.open_loop {
            return Err(IdentifyError::OpenLoop(name));
        }
        if series.commands.is_empty() || series.motion.is_empty() {
            let (commands, odometry) = (series.commands.len(), series.motion.len());
            return Err(IdentifyError::Empty { path: name, commands, odometry });
        }
        Ok(series)
    }

    /// The commands.
    #[must_use]
    pub fn commands(&self) -> &[Sent] {
        &self.commands
    }

    /// The motion.
    #[must_use]
    pub fn motion(&self) -> &[Moved] {
        &self.motion
    }

    /// The commands sent in `[from_ns, to_ns)`.
    pub(crate) fn sent_within(&self, from_ns: u64, to_ns: u64) -> &[Sent] {
        let begin = self.commands.partition_point(|sent| sent.sent_ns < from_ns);
        let end = self.commands.partition_point(|sent| sent.sent_ns < to_ns);
        &self.commands[begin..end.max(begin)]
    }

    /// What moved in `[from_ns, to_ns)`.
    pub(crate) fn moved_within(&self, from_ns: u64, to_ns: u64) -> &[Moved] {
        let begin = self.motion.partition_point(|moved| moved.stamp_ns < from_ns);
        let end = self.motion.partition_point(|moved| moved.stamp_ns < to_ns);
        &self.motion[begin..end.max(begin)]
    }
}

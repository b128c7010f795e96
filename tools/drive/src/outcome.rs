//! What came of a drive.

use sidestep_msgs::{Code, Command, Pose2, Reason, Truth, Twist, Winner};
use std::collections::BTreeMap;

/// `[m/s]` and [rad/s] slower than this is standing.
const STANDING: f32 = 0.02;

/// A moment of a drive, for drawing and for finding out.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TracePoint {
    /// `[s]` since the start of the drive.
    pub time_s: f64,
    /// True pose in the world.
    pub pose: Pose2,
    /// True velocity.
    pub twist: Twist,
    /// `[m]` gap to the nearest thing.
    pub clearance_m: f32,
    /// What the winner wished.
    pub wish: Twist,
    /// What the base was told.
    pub command: Twist,
    /// [`Reason`] of the command.
    pub reason: u32,
}

/// What came of a drive.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Outcome {
    /// Goals reached.
    pub arrivals: u32,
    /// Contacts begun while moving.
    pub collisions: u32,
    /// `[m]` smallest gap to anything.
    pub min_clearance_m: f32,
    /// `[s]` time driven.
    pub time_s: f64,
    /// `[m]` way driven.
    pub distance_m: f64,
    /// `[s]` time spent standing.
    pub standing_s: f64,
    /// Commands by reason.
    pub reasons: BTreeMap<&'static str, u64>,
    /// Commands by winner.
    pub winners: BTreeMap<&'static str, u64>,
    /// Frames that the mapper refused.
    pub refused: u64,
    /// A point every 0.1 s.
    pub trace: Vec<TracePoint>,
}

impl Outcome {
    /// Takes one tick.
    pub(crate) fn note(&mut self, truth: &Truth, command: &Command, time_s: f64, tick_s: f64) {
        let reason = Reason::from_code(command.reason).map_or("unknown", Reason::label);
        let winner = Winner::from_code(command.winner).map_or("unknown", Winner::label);
        *self.reasons.entry(reason).or_default() += 1;
        *self.winners.entry(winner).or_default() += 1;
        self.arrivals = truth.arrivals;
        self.collisions = truth.collisions;
        self.min_clearance_m = truth.min_clearance_m;
        self.distance_m = truth.distance_m;
        self.time_s = time_s;
        if truth.twist.v_m_s.abs() < STANDING && truth.twist.w_rad_s.abs() < STANDING {
            self.standing_s += tick_s;
        }
        if self.trace.last().is_none_or(|last| time_s - last.time_s > 0.0999) {
            self.trace.push(TracePoint {
                time_s,
                pose: truth.pose,
                twist: truth.twist,
                clearance_m: truth.clearance_m,
                wish: command.wish,
                command: command.twist,
                reason: command.reason,
            });
        }
    }

    /// The strongest reasons of standing or slowing, most frequent first, for a report's line.
    #[must_use]
    pub fn summary(&self) -> String {
        let mut reasons: Vec<_> = self.reasons.iter().collect();
        reasons.sort_by_key(|(_, count)| std::cmp::Reverse(**count));
        let listed: Vec<_> =
            reasons.iter().take(6).map(|(reason, count)| format!("{reason} {count}")).collect();
        format!(
            "{} arrivals, {} collisions, clearance {:.3} m, {:.1} s of it {:.1} standing, {:.1} m; {}",
            self.arrivals,
            self.collisions,
            self.min_clearance_m,
            self.time_s,
            self.standing_s,
            self.distance_m,
            listed.join(", ")
        )
    }
}

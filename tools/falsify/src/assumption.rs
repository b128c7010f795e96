//! What the promise of the arbiter rests on, and how far beyond it the adversary may go when one is relaxed.

use serde::Serialize;

/// An assumption of G1 (static safety): each can be taken away alone.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Assumption {
    /// The base brakes at least as hard as the robot file says.
    Brake,
    /// A command works within the robot file's longest dead time.
    DeadTime,
    /// The pose drifts less than the margin since what is in the map was seen.
    Drift,
    /// What stands there is in the map before a tube enters it.
    Recall,
    /// Stamps are the times of capture.
    Stamps,
    /// The base brakes by itself when the last command runs out.
    Watchdog,
    /// What was granted free at the start is free.
    StartDisc,
    /// Nothing moves faster than the robot file says.
    Mover,
}

impl Assumption {
    /// Every assumption, in the order of the table.
    pub const ALL: [Self; 8] = [
        Self::Brake,
        Self::DeadTime,
        Self::Drift,
        Self::Recall,
        Self::Stamps,
        Self::Watchdog,
        Self::StartDisc,
        Self::Mover,
    ];

    /// Its name on the command line.
    #[must_use]
    pub fn label(self) -> &'static str {
        match self {
            Self::Brake => "brake",
            Self::DeadTime => "dead_time",
            Self::Drift => "drift",
            Self::Recall => "recall",
            Self::Stamps => "stamps",
            Self::Watchdog => "watchdog",
            Self::StartDisc => "start_disc",
            Self::Mover => "mover",
        }
    }

    /// What replaces it when it is relaxed.
    #[must_use]
    pub fn relaxed(self) -> &'static str {
        match self {
            Self::Brake => "brakes at 20 to 70 % of the weakest deceleration of the robot file",
            Self::DeadTime => "commands work 0.2 to 0.5 s after they were sent",
            Self::Drift => "the pose is off by 0.05 to 0.25 m",
            Self::Recall => "an obstacle is in the map only from 0.3 m on",
            Self::Stamps => "maps and odometry are 0.2 to 0.8 s older than their stamps",
            Self::Watchdog => "the base goes on with the last command while nobody commands",
            Self::StartDisc => "an obstacle stands in the disc that was granted free and never seen",
            Self::Mover => "an obstacle moves up to 1 m/s faster than the robot file says",
        }
    }

    /// The assumption of a name.
    #[must_use]
    pub fn named(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|assumption| assumption.label() == name)
    }
}

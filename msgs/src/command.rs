//! The one message that moves the robot, and why it says what it says.

use crate::geometry::Twist;
use crate::layout::{ZeroCopySend, codes, record};

/// `[ns]` a command holds this long; then the base brakes by itself.
pub const VALID_FOR_NS: u64 = 80_000_000;
/// `limiting_cell` where no cell limits.
pub const NO_CELL: u32 = u32::MAX;

codes! {
    /// Whose wish the command carries.
    pub enum Winner {
        /// Nobody's: the arbiter stops.
        Stop = 0 "stop",
        /// The policy's.
        Policy = 1 "policy",
        /// The expert's.
        Expert = 2 "expert",
        /// The operator's.
        Teleop = 3 "teleop",
        /// The arbiter's own way out: scan rotation, back-up or advance.
        Recovery = 4 "recovery",
    }
}

codes! {
    /// Why the command is what it is: the strongest reason of this tick.
    pub enum Reason {
        /// The wish passes unchanged, or only within the limits of acceleration.
        Clear = 0 "clear",
        /// Slowed along its curve for a cell that is not known free.
        Slowed = 1 "slowed for a cell that is not known free",
        /// Only turning on the spot is safe.
        Rotating = 2 "only rotation is safe",
        /// Only backing up over cells seen free is safe.
        Reversing = 3 "only reverse is safe",
        /// No motion is safe but braking.
        Braking = 4 "braking: no motion is safe",
        /// Lead failed or is in doubt; the other proposal drives.
        OtherProposal = 5 "the other proposal drives",
        /// The operator drives.
        Teleop = 6 "teleop",
        /// Only straight on is safe, not the turn of the wish.
        Straight = 7 "only straight on is safe",
        /// Slowed or stopped for what moves, or may come out of where nobody looks; `limiting_cell` could be reached by then.
        Yielding = 8 "yielding to what may move",
        /// At the goal.
        Arrived = 10 "arrived",
        /// No path and no target, or the goal node says stop.
        NoGoal = 11 "no goal",
        /// An operator's hold.
        Hold = 12 "hold",
        /// Emergency stop, latched until reset.
        EstopLatched = 13 "emergency stop latched",
        /// Braking to rest after the arbiter's own start.
        Starting = 14 "starting",
        /// At rest after a restart, waiting for an operator.
        AwaitOperator = 15 "waiting for the operator",
        /// No safety map yet.
        NoMap = 20 "no map",
        /// The newest map is older than its limit.
        StaleMap = 21 "map too old",
        /// The map's stamp repeats: the source is frozen.
        RepeatedMap = 22 "map stamp repeats",
        /// The map's stamp ran backward or lies in the future.
        BackwardMap = 23 "map stamp backward or in the future",
        /// The mapper refuses its input.
        RefusedMap = 24 "mapper refuses its input",
        /// The newest local goal is older than its limit.
        StaleGoal = 25 "local goal too old",
        /// Both proposals are older than their limit.
        StaleProposals = 26 "both proposals too old",
        /// Both proposals are unfit: not finite, infeasible or a fault.
        UnfitProposals = 27 "both proposals unfit",
        /// The depth guard once spoke and is silent now.
        StaleNearField = 28 "near field too old",
        /// No odometry yet.
        NoOdometry = 30 "no odometry",
        /// The newest odometry is older than its limit.
        StaleOdometry = 31 "odometry too old",
        /// Odometry stamps repeat or run backward.
        BackwardOdometry = 32 "odometry stamp repeats or runs backward",
        /// Odometry is not finite.
        UnfitOdometry = 33 "odometry not finite",
        /// Odometry stands still while the base is told to move.
        FrozenOdometry = 34 "odometry frozen",
        /// The wheels slip.
        Slip = 35 "wheels slip",
        /// The pose jumped; maps of the earlier epoch are void.
        PoseJump = 36 "pose jumped",
        /// The dead man's switch is held but the wish is older than its limit.
        StaleTeleop = 37 "teleop too old",
        /// Something is closer than the braking distance: brake without limit of jerk.
        Emergency = 40 "emergency: obstacle inside the braking distance",
        /// Nothing is safe for some time: neither ahead, nor turning, nor back.
        BoxedIn = 41 "boxed in",
        /// No progress for some time.
        NoProgress = 42 "no progress",
        /// Turning to see what is around.
        ScanRotation = 43 "scan rotation",
        /// A short back-up over cells seen free.
        BackUp = 44 "back-up",
        /// Slowly on towards the goal, since the lead hesitates.
        Advance = 45 "advance",
    }
}

record! {
    /// The velocity command to the base, at every tick.
    ///
    /// Frame: `base`. Writer: `arbiter` alone. Reader: the base driver, the operator.
    pub struct Command("sidestep/Command/1") {
        /// `[ns]` graph time from which the base must brake unless a newer command arrived.
        pub valid_until_ns: u64,
        /// Token of the last operator message obeyed; 0 = none.
        pub operator_token: u64,
        /// The velocity to drive.
        pub twist: Twist,
        /// What the winner wished.
        pub wish: Twist,
        /// `[1]` `[0, 1]` largest part of the wish that is safe.
        pub scale: f32,
        /// [`Winner`].
        pub winner: u32,
        /// [`Reason`].
        pub reason: u32,
        /// Index of the safety-map cell that limits, or [`NO_CELL`].
        pub limiting_cell: u32,
        /// `[s]` age of the safety map from its capture; infinite = never seen.
        pub map_age_s: f32,
        /// `[s]` age of the local goal from its map's capture.
        pub goal_age_s: f32,
        /// `[s]` age of the policy's proposal from its map's capture.
        pub policy_age_s: f32,
        /// `[s]` age of the expert's proposal from its map's capture.
        pub expert_age_s: f32,
        /// `[s]` age of the odometry.
        pub odometry_age_s: f32,
        /// `[s]` age of the operator's wish.
        pub teleop_age_s: f32,
        /// 1 on the first command that answers its source frame.
        pub answers: u32,
        /// 1 while sensors are a recording that no command can change.
        pub open_loop: u32,
        /// 1 while the emergency stop is latched.
        pub latched: u32,
        /// Zero.
        pub _pad: u32,
    }
}

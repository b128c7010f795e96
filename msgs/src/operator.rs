//! What a person says: drive, stop, reset, hold.

use crate::layout::{ZeroCopySend, codes, record};

record! {
    /// A wish of the person at the stick; it passes the same filter as any other command.
    ///
    /// Frame: `base`. Writer: the operator. Reader: `arbiter`.
    pub struct Teleop("sidestep/Teleop/1") {
        /// `[ns]` graph time of the wish.
        pub stamp_ns: u64,
        /// `[m/s]` forward speed.
        pub v_m_s: f32,
        /// `[rad/s]` turn rate.
        pub w_rad_s: f32,
        /// 1 while the dead man's switch is held; 0 releases the robot to the graph.
        pub dead_man: u32,
        /// Zero.
        pub _pad: u32,
    }
}

codes! {
    /// What an operator asks of the arbiter.
    pub enum EstopAction {
        /// Stop and stay stopped until reset.
        Stop = 1 "stop",
        /// Release the latch of an emergency stop.
        Reset = 2 "reset",
        /// Stand still, without a latch, until resumed.
        Hold = 3 "hold",
        /// End a hold.
        Resume = 4 "resume",
    }
}

record! {
    /// One message of an operator: emergency stop, reset, hold, resume.
    ///
    /// Writer: the operator. Reader: `arbiter`, which names the last token it obeyed in every command.
    pub struct Estop("sidestep/Estop/1") {
        /// Drawn by the operator's command, to know its acknowledgement.
        pub token: u64,
        /// [`EstopAction`].
        pub action: u32,
        /// Zero.
        pub _pad: u32,
    }
}

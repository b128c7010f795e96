//! The base of one evaluation: what the tube of the arbiter takes it for, with values that vary while it drives.
//!
//! Dead time, then a first-order lag, braking no harder than it can, and errors of speed and turn rate while it is told
//! to move. A base that nobody commands brakes by itself: along its curve, or each axis for itself.

use crate::scenario::Actuation;
use sidestep_msgs::{Command, Pose2, Twist};
use sidestep_sim::{Random, mix};
use std::collections::VecDeque;

/// `[m/s]` a command slower than this is followed without error, as in the tube.
const TOLD_M_S: f64 = 1e-3;
/// Stream of the random numbers of dead times and of brakes.
const STREAM: u64 = 1;

/// The state of the base.
pub(crate) struct Base {
    /// Pose in the world.
    pub(crate) pose: Pose2,
    v_m_s: f64,
    w_rad_s: f64,
    /// `[m/s, rad/s]` errors now.
    error: [f64; 2],
    target: Twist,
    queue: VecDeque<(u64, Twist)>,
    valid_until_ns: u64,
    latest_ns: u64,
    brake_m_s2: f64,
    turn_rad_s2: f64,
    random: Random,
}

impl Base {
    pub(crate) fn new(pose: Pose2, seed: u64, actuation: &Actuation, turn_rad_s2: f64) -> Self {
        Self {
            pose,
            v_m_s: 0.0,
            w_rad_s: 0.0,
            error: [0.0; 2],
            target: Twist::STOP,
            queue: VecDeque::with_capacity(64),
            valid_until_ns: 0,
            latest_ns: 0,
            brake_m_s2: actuation.brake_m_s2[0],
            turn_rad_s2,
            random: Random::new(mix(seed, STREAM)),
        }
    }

    /// Takes a command; it works after a dead time, and never before an earlier one.
    pub(crate) fn command(&mut self, command: &Command, now_ns: u64, actuation: &Actuation) {
        let [least, most] = actuation.dead_s;
        let dead_s = least + (most - least) * self.random.unit();
        self.latest_ns = self.latest_ns.max(now_ns + (dead_s * 1e9) as u64);
        self.queue.push_back((self.latest_ns, command.twist));
        self.valid_until_ns = command.valid_until_ns;
        let [least, most] = actuation.brake_m_s2;
        self.brake_m_s2 = least + (most - least) * self.random.unit();
    }

    /// Moves on by `dt_s`; the errors are those of `tick`.
    pub(crate) fn step(&mut self, now_ns: u64, dt_s: f64, tick: u64, actuation: &Actuation) {
        while let Some((effective_ns, twist)) = self.queue.front().copied() {
            if effective_ns > now_ns {
                break;
            }
            self.target = twist;
            self.queue.pop_front();
        }
        let alone = actuation.watchdog && now_ns >= self.valid_until_ns;
        if alone {
            // What has run out does not come back when the next command arrives.
            self.queue.clear();
            self.target = Twist::STOP;
        }
        let told = self.target;
        let (v_told, w_told) = (f64::from(told.v_m_s), f64::from(told.w_rad_s));
        let follow = 1.0 - libm::exp(-dt_s / actuation.lag_s.max(1e-4));
        let (v, w) = (self.v_m_s, self.w_rad_s);
        let change = (v_told - v) * follow;
        let most = if change * v < 0.0 { self.brake_m_s2 * dt_s } else { f64::INFINITY };
        self.v_m_s += change.clamp(-most, most);
        if alone && actuation.brakes_on_curve && v.abs() > TOLD_M_S {
            self.w_rad_s *= self.v_m_s / v;
        } else {
            let most = self.turn_rad_s2 * dt_s;
            self.w_rad_s += ((w_told - w) * follow).clamp(-most, most);
        }
        let sign = |ticks: u64| if (tick / ticks).is_multiple_of(2) { 1.0 } else { -1.0 };
        let moves = [v_told.abs() > TOLD_M_S, v_told.abs() > TOLD_M_S || w_told.abs() > TOLD_M_S];
        self.error = [
            if moves[0] { actuation.speed_error_m_s * sign(actuation.error_ticks[0]) } else { 0.0 },
            if moves[1] { actuation.turn_error_rad_s * sign(actuation.error_ticks[1]) } else { 0.0 },
        ];
        self.pose = self.pose.advance(&self.twist(), dt_s);
    }

    /// The true velocity; no error of the speed turns the motion round.
    pub(crate) fn twist(&self) -> Twist {
        let speed_m_s = (self.v_m_s.abs() + self.error[0]).max(0.0);
        Twist::new(speed_m_s.copysign(self.v_m_s) as f32, (self.w_rad_s + self.error[1]) as f32)
    }
}

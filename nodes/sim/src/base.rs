//! The mobile base: dead time, first-order lag, limits, lean, watchdog, and what its wheels believe.

use crate::config::Config;
use crate::random::{Random, mix};
use sidestep_msgs::{Command, Pose2, Robot, Twist};

/// Commands that can be under way at once: 80 ms at 130 Hz, three times over.
const QUEUE: usize = 32;
/// `[s]` time constant of the lean.
const LEAN_S: f64 = 0.08;
/// `[ns]` length of one slip, and of the windows in which a slip happens or not.
const SLIP_NS: u64 = 300_000_000;
/// `[1]` what the wheels turn more than the robot moves while they slip.
const SLIP_GAIN: f64 = 1.6;
/// `[rad/sqrt(m)]` random walk of the believed heading.
const WALK_RAD: f64 = 0.002;

/// The response of this base and the errors of its wheels; constant during a run.
#[derive(Debug, Clone)]
pub(crate) struct Response {
    pub(crate) dead_ns: u64,
    pub(crate) lag_s: f64,
    pub(crate) accelerate_m_s2: f64,
    pub(crate) brake_m_s2: f64,
    pub(crate) turn_rad_s2: f64,
    fastest_m_s: f64,
    fastest_rad_s: f64,
    lean_rad_per_m_s2: f64,
    scale: f64,
    turn_scale: f64,
    walk_rad: f64,
    drift_per_m: f64,
    drift_per_rad: f64,
    slip_chance: f64,
    seed: u64,
}

impl Response {
    pub(crate) fn new(config: &Config, robot: &Robot, seed: u64) -> Self {
        let between = |low: f32, high: f32, part: f64| f64::from(low) + f64::from(high - low) * part;
        let actuator = &robot.actuator;
        let dead_s = between(actuator.dead_time_min_s, actuator.dead_time_max_s, config.dead_time_part);
        let mut random = Random::new(mix(seed, 1));
        let (per_m, per_rad) = (f64::from(robot.start.drift_per_m), f64::from(robot.start.drift_per_rad));
        // Half of the assumed bound as standard deviation, never beyond the bound.
        let mut error = |bound: f64| {
            let drawn = (0.5 * random.normal()).clamp(-1.0, 1.0);
            if config.noise { bound * drawn } else { 0.0 }
        };
        Self {
            dead_ns: (dead_s * 1e9) as u64,
            lag_s: f64::from(actuator.lag_s),
            accelerate_m_s2: f64::from(robot.limits.accelerate_m_s2),
            brake_m_s2: between(actuator.brake_min_m_s2, actuator.brake_max_m_s2, config.brake_part),
            turn_rad_s2: f64::from(robot.limits.turn_accelerate_rad_s2),
            fastest_m_s: 1.5 * f64::from(robot.limits.forward_m_s),
            fastest_rad_s: 1.5 * f64::from(robot.limits.turn_rad_s),
            lean_rad_per_m_s2: f64::from(actuator.pitch_rad_per_m_s2),
            scale: 1.0 + error(per_m),
            turn_scale: 1.0 + error(per_rad),
            walk_rad: if config.noise { WALK_RAD } else { 0.0 },
            drift_per_m: per_m,
            drift_per_rad: per_rad,
            slip_chance: config.slips_per_min / 60.0 * (SLIP_NS as f64 * 1e-9),
            seed: mix(seed, 2),
        }
    }

    /// Whether the wheels slip at a time.
    fn slips(&self, now_ns: u64) -> bool {
        self.slip_chance > 0.0 && Random::new(mix(self.seed, now_ns / SLIP_NS)).unit() < self.slip_chance
    }
}

#[derive(Debug, Clone, Copy, Default)]
struct Pending {
    effective_ns: u64,
    twist: Twist,
}

/// The state of the base.
#[derive(Debug, Clone)]
pub(crate) struct Base {
    /// Pose in the world.
    pub(crate) pose: Pose2,
    /// Pose in `odom`, as the wheels believe.
    pub(crate) believed: Pose2,
    pub(crate) v_m_s: f64,
    pub(crate) w_rad_s: f64,
    pub(crate) pitch_rad: f64,
    pub(crate) distance_m: f64,
    pub(crate) turned_rad: f64,
    pub(crate) slipping: bool,
    target: Twist,
    valid_until_ns: u64,
    queue: [Pending; QUEUE],
    queued: usize,
}

impl Base {
    pub(crate) fn new(start: Pose2) -> Self {
        Self {
            pose: start,
            believed: start,
            v_m_s: 0.0,
            w_rad_s: 0.0,
            pitch_rad: 0.0,
            distance_m: 0.0,
            turned_rad: 0.0,
            slipping: false,
            target: Twist::STOP,
            valid_until_ns: 0,
            queue: [Pending::default(); QUEUE],
            queued: 0,
        }
    }

    /// Takes a command that arrives now; it works after the dead time.
    pub(crate) fn command(&mut self, command: &Command, now_ns: u64, response: &Response) {
        let twist = if command.twist.is_finite() { command.twist } else { Twist::STOP };
        if self.queued == QUEUE {
            self.queue.copy_within(1.., 0);
            self.queued -= 1;
        }
        self.queue[self.queued] = Pending { effective_ns: now_ns.saturating_add(response.dead_ns), twist };
        self.queued += 1;
        self.valid_until_ns = command.valid_until_ns;
    }

    fn take_effective(&mut self, now_ns: u64) {
        let due = self.queue[..self.queued].iter().take_while(|p| p.effective_ns <= now_ns).count();
        if due > 0 {
            self.target = self.queue[due - 1].twist;
            self.queue.copy_within(due..self.queued, 0);
            self.queued -= due;
        }
    }

    /// Moves on by `dt_s` from the graph time `now_ns`.
    pub(crate) fn step(&mut self, now_ns: u64, dt_s: f64, response: &Response) {
        self.take_effective(now_ns);
        if now_ns >= self.valid_until_ns {
            // The watchdog is the base's own: it needs no dead time, and what has run out does not come back when the
            // next command arrives.
            self.target = Twist::STOP;
            self.queued = 0;
        }
        let target = self.target;
        let v_target = f64::from(target.v_m_s).clamp(-response.fastest_m_s, response.fastest_m_s);
        let w_target = f64::from(target.w_rad_s).clamp(-response.fastest_rad_s, response.fastest_rad_s);
        let lag_s = response.lag_s.max(dt_s);
        let wished = (v_target - self.v_m_s) / lag_s;
        let most = if wished * self.v_m_s < 0.0 { response.brake_m_s2 } else { response.accelerate_m_s2 };
        let acceleration = wished.clamp(-most, most);
        let turn = ((w_target - self.w_rad_s) / lag_s).clamp(-response.turn_rad_s2, response.turn_rad_s2);
        let v_mid = self.v_m_s + 0.5 * acceleration * dt_s;
        let w_mid = self.w_rad_s + 0.5 * turn * dt_s;
        self.v_m_s += acceleration * dt_s;
        self.w_rad_s += turn * dt_s;
        self.pose = self.pose.advance(&Twist::new(v_mid as f32, w_mid as f32), dt_s);
        let lean_rad = response.lean_rad_per_m_s2 * acceleration;
        self.pitch_rad += (lean_rad - self.pitch_rad) * (dt_s / LEAN_S).min(1.0);
        self.believe(now_ns, dt_s, [v_mid, w_mid], response);
    }

    /// What the wheels make of the motion.
    fn believe(&mut self, now_ns: u64, dt_s: f64, moved: [f64; 2], response: &Response) {
        self.slipping = response.slips(now_ns);
        let gain = if self.slipping { SLIP_GAIN } else { 1.0 };
        let [v, w] = [moved[0] * response.scale * gain, moved[1] * response.turn_scale * gain];
        let step_m = moved[0].abs() * dt_s;
        self.believed = self.believed.advance(&Twist::new(v as f32, w as f32), dt_s);
        if response.walk_rad > 0.0 && step_m > 0.0 {
            let drawn = Random::new(mix(response.seed ^ 3, now_ns)).normal();
            let yaw = self.believed.yaw_rad + response.walk_rad * libm::sqrt(step_m) * drawn;
            self.believed.yaw_rad = sidestep_msgs::wrap_angle(yaw);
        }
        self.distance_m += step_m;
        self.turned_rad += (moved[1] * dt_s).abs();
    }

    /// Stands still at `pose` since something is in the way.
    pub(crate) fn stop_at(&mut self, pose: Pose2, believed: Pose2) {
        self.pose = pose;
        self.believed = believed;
        self.v_m_s = 0.0;
        self.w_rad_s = 0.0;
    }

    /// `[m^2, m^2, rad^2]` variances of the believed pose since the start.
    pub(crate) fn variance(&self, response: &Response) -> [f32; 3] {
        let along = response.drift_per_m * self.distance_m;
        let heading = response.drift_per_rad * self.turned_rad;
        let walked = response.walk_rad * response.walk_rad * self.distance_m;
        let place = (along * along) as f32;
        [place, place, (heading * heading + walked) as f32]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fixtures;

    const MS: u64 = 1_000_000;

    fn response() -> Response {
        let config = Config { noise: false, ..Config::default() };
        Response::new(&config, &fixtures::loomo(), 1)
    }

    fn command(v: f32, valid_until_ns: u64) -> Command {
        Command { twist: Twist::new(v, 0.0), valid_until_ns, ..Command::default() }
    }

    /// Drives at `v` until steady, commands zero, and returns base and time of that command.
    fn steady(v: f32, response: &Response) -> (Base, u64) {
        let mut base = Base::new(Pose2::ORIGIN);
        base.command(&command(v, u64::MAX), 0, response);
        let mut now = 0;
        while now < 4000 * MS {
            base.step(now, 1e-3, response);
            now += MS;
        }
        assert!((base.v_m_s - f64::from(v)).abs() < 1e-6);
        (base, now)
    }

    /// Dead time at full speed, then constant braking, then the exponential tail of the lag:
    /// v D + v^2 / 2a + a lag^2 / 2.
    #[test]
    fn the_braking_distance_is_the_closed_form() {
        let r = response();
        for v in [0.3_f32, 0.6, 1.0] {
            let (mut base, mut now) = steady(v, &r);
            let from = base.pose.x_m;
            base.command(&command(0.0, u64::MAX), now, &r);
            for _ in 0..6000 {
                base.step(now, 1e-3, &r);
                now += MS;
            }
            let v = f64::from(v);
            let dead_s = r.dead_ns as f64 * 1e-9;
            let expected = v * dead_s + v * v / (2.0 * r.brake_m_s2) + r.brake_m_s2 * r.lag_s * r.lag_s / 2.0;
            let found = base.pose.x_m - from;
            assert!((found - expected).abs() < 2e-3, "{v} m/s: {found} m, closed form {expected} m");
        }
    }

    #[test]
    fn nothing_moves_before_the_dead_time_and_all_does_after() {
        let r = response();
        let mut base = Base::new(Pose2::ORIGIN);
        base.command(&command(0.5, u64::MAX), 0, &r);
        for ms in 0..200 {
            base.step(ms * MS, 1e-3, &r);
            assert_eq!(base.v_m_s > 0.0, ms * MS >= r.dead_ns, "{ms} ms");
        }
    }

    #[test]
    fn the_watchdog_brakes_when_the_newest_command_ends() {
        let r = response();
        let mut base = Base::new(Pose2::ORIGIN);
        for tick in 0..100 {
            base.command(&command(0.5, (tick * 10 + 80) * MS), tick * 10 * MS, &r);
            for ms in 0..10 {
                base.step((tick * 10 + ms) * MS, 1e-3, &r);
            }
        }
        let mut before = base.v_m_s;
        for ms in 1000..4000 {
            base.step(ms * MS, 1e-3, &r);
            assert!(ms < 1070 || base.v_m_s < before, "{ms} ms: {} after {before}", base.v_m_s);
            before = base.v_m_s;
        }
        assert!(base.v_m_s < 1e-6);
    }

    /// A command for rest after a silence: in its dead time the old speed must not come back.
    #[test]
    fn what_has_run_out_does_not_come_back_with_the_next_command() {
        let r = response();
        let mut base = Base::new(Pose2::ORIGIN);
        base.command(&command(0.5, 1000 * MS), 0, &r);
        let mut before = f64::INFINITY;
        for ms in 0..1600 {
            if ms == 1200 {
                base.command(&command(0.0, 1280 * MS), ms * MS, &r);
            }
            base.step(ms * MS, 1e-3, &r);
            assert!(ms < 1001 || base.v_m_s <= before, "{ms} ms: {} after {before}", base.v_m_s);
            before = base.v_m_s;
        }
    }

    #[test]
    fn the_base_leans_forward_when_it_accelerates_and_back_when_it_brakes() {
        let r = response();
        let mut base = Base::new(Pose2::ORIGIN);
        base.command(&command(1.0, 1500 * MS), 0, &r);
        let (mut most, mut least) = (0.0_f64, 0.0_f64);
        for ms in 0..4000 {
            base.step(ms * MS, 1e-3, &r);
            most = most.max(base.pitch_rad);
            least = least.min(base.pitch_rad);
        }
        assert!((most - 0.05).abs() < 0.002 && (least + 0.05 * r.brake_m_s2).abs() < 0.002, "{most} {least}");
    }

    #[test]
    fn bytes_without_meaning_stop_the_base() {
        let r = response();
        let mut base = Base::new(Pose2::ORIGIN);
        for v in [f32::NAN, f32::INFINITY, f32::MAX] {
            base.command(&command(v, u64::MAX), 0, &r);
            for ms in 0..100 {
                base.step(ms * MS, 1e-3, &r);
            }
            assert!(base.pose.is_finite() && base.v_m_s.abs() < 2.0);
        }
    }
}

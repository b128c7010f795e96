//! What the adversary decided: obstacles, wishes, delays, the base, restarts, drift. Genes become metres and seconds.
//!
//! A scenario begins at rest on known-free floor, as the promise does. Obstacles are placed beside the way that the
//! wishes would lead without any arbiter, so that few genes are spent on what is never met.

use crate::assumption::Assumption;
use crate::genes::{Case, Reader};
use crate::thing::{Thing, Things, clear_of_start};
use serde::Serialize;
use sidestep_msgs::{Pose2, Robot, Twist};
use sidestep_sim::Solid;

/// Ticks of the longest evaluation: 3 s.
pub const TICKS: usize = 300;
/// Pieces of the wish.
const PIECES: usize = 10;
/// Obstacles.
const THINGS: usize = 5;
/// Obstacles that move where the robot minds movers.
const MOVERS: usize = 2;
/// Genes of a case.
pub const GENES: usize = 2 + 4 * PIECES + 11 * THINGS + 9 + 11 + 3 * 4 + 9 + 5 + 2;

/// `[m]` where an error of the heading counts as drift, as the mapper has it (`drift_lever_m`).
const LEVER_M: f64 = 1.0;

/// What is wished for a tenth of the evaluation.
#[derive(Debug, Clone, Copy, Serialize)]
pub struct Piece {
    /// `[m/s]` forward speed.
    pub v_m_s: f64,
    /// `[rad/s]` turn rate where nothing is chased.
    pub w_rad_s: f64,
    /// The obstacle that is chased, if any.
    pub chases: Option<usize>,
}

/// The base within the identified set: each value and how far it varies from command to command or in time.
#[derive(Debug, Clone, Copy, Serialize)]
pub struct Actuation {
    /// `[s]` least and most dead time.
    pub dead_s: [f64; 2],
    /// `[m/s^2]` least and most of the strongest deceleration.
    pub brake_m_s2: [f64; 2],
    /// `[m/s]` error of the speed followed.
    pub speed_error_m_s: f64,
    /// `[rad/s]` error of the turn rate followed.
    pub turn_error_rad_s: f64,
    /// `[ticks]` the errors change sign after this many ticks.
    pub error_ticks: [u64; 2],
    /// `[s]` time constant of the response.
    pub lag_s: f64,
    /// Whether a base that nobody commands turns on while it brakes, instead of stopping both at once.
    pub brakes_on_curve: bool,
    /// Whether it brakes at all then.
    pub watchdog: bool,
}

/// Delays and losses of one kind of message.
#[derive(Debug, Clone, Copy, Serialize)]
pub struct Channel {
    /// `[ticks]` least and most delay.
    pub delay_ticks: [u64; 2],
    /// `[1]` part of the messages that is lost.
    pub lost: f64,
    /// `[ticks]` first tick of a silence.
    pub silent_from: u64,
    /// `[ticks]` length of the silence.
    pub silent_ticks: u64,
}

/// Deaths and silences of the processes.
#[derive(Debug, Clone, Copy, Serialize)]
pub struct Restarts {
    /// `[ticks]` when the arbiter makes no commands for a while.
    pub arbiter_from: u64,
    /// `[ticks]` for how long.
    pub arbiter_ticks: u64,
    /// Whether it lost its state then; otherwise it only hung.
    pub arbiter_dies: bool,
    /// `[ticks]` when the mapper dies; its maps cease.
    pub mapper_from: u64,
    /// `[ticks]` for how long.
    pub mapper_ticks: u64,
    /// `[m]` what a restarted mapper knows: a disc of this radius.
    pub known_radius_m: f64,
    /// `[m]` the disc's centre ahead of the robot at the restart.
    pub known_ahead_m: f64,
}

/// Error of the believed pose: it changes sides between `offset` and its opposite.
#[derive(Debug, Clone, Copy, Serialize)]
pub struct Drift {
    /// `[m]` along x of the robot.
    pub x_m: f64,
    /// `[m]` along y.
    pub y_m: f64,
    /// `[rad]` of the heading.
    pub yaw_rad: f64,
    /// `[ticks]` time on each side.
    pub ticks: u64,
}

/// Everything that happens in one evaluation.
#[derive(Debug, Clone, Serialize)]
pub struct Scenario {
    /// Seed of what varies from message to message.
    pub seed: u64,
    /// `[rad]` heading at the start.
    pub yaw_rad: f64,
    /// The wishes.
    pub pieces: [Piece; PIECES],
    /// What stands there.
    pub things: Things,
    /// The base.
    pub base: Actuation,
    /// Safety maps.
    pub maps: Channel,
    /// Odometry.
    pub odometry: Channel,
    /// Goal and proposals.
    pub proposals: Channel,
    /// `[ticks]` time between maps.
    pub map_period: u64,
    /// Deaths.
    pub restarts: Restarts,
    /// Error of the pose.
    pub drift: Drift,
    /// `[s]` what the stamps of maps and odometry conceal.
    pub concealed_s: f64,
}

impl Scenario {
    /// The scenario of a case.
    #[must_use]
    pub fn new(case: &Case, robot: &Robot, margin_m: f64) -> Self {
        let mut read = Reader::new(&case.genes);
        Self::read(&mut read, case.relaxed, robot, margin_m)
    }

    fn read(read: &mut Reader<'_>, relaxed: Option<Assumption>, robot: &Robot, margin_m: f64) -> Self {
        let is = |assumption| relaxed == Some(assumption);
        let seed = (read.unit() * 65535.0) as u64;
        let yaw_rad = read.between(-0.8, 0.8);
        let pieces = pieces(read, robot);
        let way = Way::new(&pieces, yaw_rad, robot);
        let mut things = Things::default();
        for number in 0..THINGS {
            let thing = thing(read, &way, number, relaxed, f64::from(robot.start.mover_m_s));
            if clear_of_start(&thing.solid, yaw_rad, robot, thing.granted) {
                things.0.push(thing);
            }
        }
        gate(read, &way, &mut things, robot, yaw_rad);
        let base = actuation(read, relaxed, robot);
        let maps = channel(read, 5);
        let odometry = channel(read, 4);
        let proposals = channel(read, 4);
        let restarts = restarts(read, is(Assumption::Watchdog));
        let drift = drift(read, is(Assumption::Drift), margin_m);
        let map_period = read.whole(3, 4);
        let concealed_s = read.between(0.2, 0.8);
        Self {
            seed,
            yaw_rad,
            pieces,
            things,
            base,
            maps,
            odometry,
            proposals,
            map_period,
            restarts,
            drift,
            concealed_s: if is(Assumption::Stamps) { concealed_s } else { 0.0 },
        }
    }

    /// The piece of the wish at a tick.
    #[must_use]
    pub fn piece(&self, tick: usize) -> &Piece {
        &self.pieces[(tick * PIECES / TICKS).min(PIECES - 1)]
    }
}

/// Half of all pieces go on with the one before, since only a long motion becomes fast.
fn pieces(read: &mut Reader<'_>, robot: &Robot) -> [Piece; PIECES] {
    let drawn: [(Piece, bool); PIECES] = std::array::from_fn(|_| piece(read, robot));
    let mut pieces = drawn.map(|(piece, _)| piece);
    for place in 1..PIECES {
        if drawn[place].1 {
            pieces[place] = pieces[place - 1];
        }
    }
    pieces
}

/// Many pieces are driven at a limit, a quarter chases an obstacle; returns whether it gives way to the one before.
fn piece(read: &mut Reader<'_>, robot: &Robot) -> (Piece, bool) {
    let l = &robot.limits;
    let (slowest, fastest, turn) =
        (-f64::from(l.reverse_m_s), f64::from(l.forward_m_s), f64::from(l.turn_rad_s));
    let v = read.between(slowest - 0.3, fastest + 1.0).clamp(slowest, fastest);
    let w = read.between(-1.5 * turn, 1.5 * turn).clamp(-turn, turn);
    let straight = read.chance(0.3);
    let chase = read.unit();
    let chases = (chase < 0.25).then_some((chase / 0.25 * THINGS as f64) as usize % THINGS);
    (Piece { v_m_s: v, w_rad_s: if straight { 0.0 } else { w }, chases }, chase > 0.5)
}

/// Where the wishes lead within the limits.
pub(crate) struct Way(Vec<Pose2>);

impl Way {
    fn new(pieces: &[Piece; PIECES], yaw_rad: f64, robot: &Robot) -> Self {
        let (a, b) = (f64::from(robot.limits.accelerate_m_s2), f64::from(robot.limits.brake_m_s2));
        let turn = f64::from(robot.limits.turn_accelerate_rad_s2);
        let dt_s = 0.03;
        let mut pose = Pose2::new(0.0, 0.0, yaw_rad);
        let (mut v, mut w) = (0.0f64, 0.0f64);
        let mut poses = Vec::with_capacity(101);
        for step in 0..=100 {
            poses.push(pose);
            let piece = &pieces[(step / 10).min(PIECES - 1)];
            v += (piece.v_m_s - v).clamp(-b * dt_s, a * dt_s);
            w += (piece.w_rad_s - w).clamp(-turn * dt_s, turn * dt_s);
            pose = pose.advance(&Twist::new(v as f32, w as f32), dt_s);
        }
        Self(poses)
    }

    /// The pose at a part of the evaluation.
    fn at(&self, part: f64) -> Pose2 {
        self.0[((part * (self.0.len() - 1) as f64) as usize).min(self.0.len() - 1)]
    }
}

/// Where the robot file names a speed of movers, the first things move no faster, unless that is relaxed.
fn thing(
    read: &mut Reader<'_>,
    way: &Way,
    number: usize,
    relaxed: Option<Assumption>,
    mover_m_s: f64,
) -> Thing {
    let is = |assumption| relaxed == Some(assumption) && number == 0;
    let from = way.at(read.unit());
    let (ahead, left) = (read.between(-0.6, 1.5), read.between(-0.9, 0.9));
    let (x, y) = from.transform(ahead, left);
    let disc = read.chance(0.4);
    let long_m = 0.02 * libm::pow(100.0, read.unit());
    let wide_m = 0.02 * libm::pow(25.0, read.unit());
    let yaw_rad = from.yaw_rad + read.between(-1.6, 1.6);
    let height_m = [0.0, 1.0];
    let solid = if disc {
        Solid::column([x, y], 0.5 * wide_m, height_m)
    } else {
        Solid::block([x, y], [long_m, wide_m], yaw_rad, height_m)
    };
    let exists = read.chance(0.75);
    let seen = read.chance(0.7);
    let (speed, course) = (read.between(0.0, 1.0), read.between(-3.2, 3.2));
    let hurries = is(Assumption::Mover);
    let moves = hurries || mover_m_s > 0.0 && number < MOVERS;
    let speed = if hurries { mover_m_s + speed } else { mover_m_s * speed };
    let granted = is(Assumption::StartDisc);
    let missed = is(Assumption::Recall);
    let (sin, cos) = libm::sincos(course);
    Thing {
        solid,
        seen: seen || moves && mover_m_s > 0.0,
        exists: exists || hurries || granted || missed,
        seen_within_m: if missed { 0.3 } else { f64::INFINITY },
        velocity_m_s: if moves { [speed * cos, speed * sin] } else { [0.0; 2] },
        granted,
    }
}

/// A wall across the way with a gap in it, or two along it.
fn gate(read: &mut Reader<'_>, way: &Way, things: &mut Things, robot: &Robot, start_yaw_rad: f64) {
    let from = way.at(read.unit());
    let kind = read.unit();
    let ahead_m = read.between(0.0, 1.5);
    let left_m = read.between(-0.4, 0.4);
    let width_m = read.between(0.5, 1.1);
    let turn_rad = read.between(-0.6, 0.6);
    let thick_m = read.between(0.02, 0.3);
    let long_m = read.between(0.3, 2.0);
    let seen = read.chance(0.8);
    let mut put = |solid: Solid| {
        if clear_of_start(&solid, start_yaw_rad, robot, false) {
            things.0.push(Thing::standing(solid, seen));
        }
    };
    let frame = from.compose(&Pose2::new(ahead_m, left_m, turn_rad));
    for side in [-1.0, 1.0] {
        let (local, size) = if kind < 0.3 {
            ([0.0, side * 0.5 * (width_m + long_m)], [thick_m, long_m])
        } else if kind < 0.6 {
            ([0.5 * long_m, side * 0.5 * (width_m + thick_m)], [long_m, thick_m])
        } else {
            continue;
        };
        let (x, y) = frame.transform(local[0], local[1]);
        put(Solid::block([x, y], size, frame.yaw_rad, [0.0, 1.0]));
    }
}

fn actuation(read: &mut Reader<'_>, relaxed: Option<Assumption>, robot: &Robot) -> Actuation {
    let a = &robot.actuator;
    let mut span = |low: f64, high: f64| {
        let (one, other) = (read.between(low, high), read.between(low, high));
        // Half of all bases keep one value.
        let varies = read.chance(0.5);
        if varies { [one.min(other), one.max(other)] } else { [one, one] }
    };
    let dead_s = match relaxed {
        Some(Assumption::DeadTime) => span(0.2, 0.5),
        _ => span(f64::from(a.dead_time_min_s), f64::from(a.dead_time_max_s)),
    };
    let (weak, strong) = (f64::from(a.brake_min_m_s2), f64::from(a.brake_max_m_s2));
    let brake_m_s2 = match relaxed {
        Some(Assumption::Brake) => span(0.2 * weak, 0.7 * weak),
        _ => span(weak, strong),
    };
    let mut error = |most: f64| read.between(-1.5 * most, 1.5 * most).clamp(-most, most);
    let speed_error_m_s = error(f64::from(a.tracking_m_s));
    let turn_error_rad_s = error(f64::from(a.tracking_rad_s));
    let error_ticks = [read.whole(5, 400), read.whole(5, 400)];
    Actuation {
        dead_s,
        brake_m_s2,
        speed_error_m_s,
        turn_error_rad_s,
        error_ticks,
        lag_s: f64::from(a.lag_s),
        brakes_on_curve: read.chance(0.5),
        watchdog: relaxed != Some(Assumption::Watchdog),
    }
}

/// Half of all channels are late, a third is silent once.
fn channel(read: &mut Reader<'_>, most_ticks: u64) -> Channel {
    let (one, other) = (read.whole(0, most_ticks), read.whole(0, most_ticks));
    let silent = read.unit();
    let from = (silent * 3.0 * TICKS as f64) as u64;
    let lost = (read.unit() - 0.5).max(0.0);
    Channel {
        delay_ticks: [one.min(other), one.max(other)],
        lost,
        silent_from: from,
        silent_ticks: if silent < 0.33 { (lost * 60.0) as u64 } else { 0 },
    }
}

fn restarts(read: &mut Reader<'_>, always: bool) -> Restarts {
    let happens = read.unit();
    let arbiter_from = read.whole(20, TICKS as u64 - 20);
    let arbiter_ticks = read.whole(1, 60);
    let arbiter_dies = read.chance(0.6);
    let mapper = read.unit();
    let mapper_from = read.whole(20, TICKS as u64 - 20);
    let mapper_ticks = read.whole(5, 60);
    let known_radius_m = read.between(0.4, 2.0);
    let known_ahead_m = read.between(0.0, 1.5);
    Restarts {
        arbiter_from,
        arbiter_ticks: if always { arbiter_ticks + 60 } else { u64::from(happens < 0.5) * arbiter_ticks },
        arbiter_dies: arbiter_dies || always,
        mapper_from: if mapper < 0.3 { mapper_from } else { u64::MAX },
        mapper_ticks,
        known_radius_m,
        known_ahead_m,
    }
}

/// Both sides together are no more than the margin, the heading counted at [`LEVER_M`].
fn drift(read: &mut Reader<'_>, relaxed: bool, margin_m: f64) -> Drift {
    let part = read.between(0.0, 1.5).min(1.0);
    let most_m = if relaxed { 0.5 * (0.05 + 0.2 * part) } else { 0.5 * margin_m * part };
    let turning = read.unit();
    let (sin, cos) = libm::sincos(read.between(-3.2, 3.2));
    let straight_m = most_m * (1.0 - turning);
    let yaw_rad = most_m * turning / LEVER_M;
    let right = read.chance(0.5);
    let ticks = read.whole(3, 200);
    Drift {
        x_m: straight_m * cos,
        y_m: straight_m * sin,
        yaw_rad: if right { -yaw_rad } else { yaw_rad },
        ticks,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_scenario_uses_every_gene_once_whatever_is_relaxed() {
        let text = include_str!("../../../launch/robots/loomo.toml");
        let robot = Robot::from_toml("loomo.toml", text).unwrap();
        for relaxed in Assumption::ALL.into_iter().map(Some).chain([None]) {
            for value in [0, 20_000, 65_535] {
                let genes = [value; GENES];
                let mut read = Reader::new(&genes);
                let scenario = Scenario::read(&mut read, relaxed, &robot, 0.015);
                assert_eq!(read.place(), GENES);
                let b = &scenario.base;
                let inside = relaxed.is_some() || b.dead_s[1] <= 0.0801 && b.brake_m_s2[0] >= 0.449;
                assert!(inside && b.dead_s[0] <= b.dead_s[1] && b.brake_m_s2[0] <= b.brake_m_s2[1]);
            }
        }
    }
}

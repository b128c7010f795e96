//! Passive safety inside the sector (G2): whatever moves no faster than the robot file says finds the robot at rest.

use crate::Config;
use crate::fixture::{Solid, Stage, gap_m, loomo};
use sidestep_msgs::{Reason, Robot, Twist};

const CONFIG: Config = Config::STANDARD;
/// `[m]` half the side of a mover.
const HALF_M: f64 = 0.1;
/// `[m/s]`, `[rad/s]` a base that follows with a lag comes to rest only in the end.
const REST: f32 = 6e-3;

/// The shipped robot in a world whose fastest mover is this fast.
fn robot(mover_m_s: f32) -> Robot {
    let mut robot = loomo();
    robot.start.mover_m_s = mover_m_s;
    robot
}

fn square(x: f64, y: f64) -> Solid {
    [x - HALF_M, y - HALF_M, x + HALF_M, y + HALF_M]
}

/// Everything beyond a line across the way.
fn curtain(x: f64) -> Solid {
    [x, -9.0, 20.0, 9.0]
}

/// A mover that waits behind a curtain until a tick, then runs straight at the robot.
struct Runner {
    at: [f64; 2],
    from_tick: usize,
    speed_m_s: f64,
}

impl Runner {
    /// Moves for one tick; keeps off what it would touch.
    fn run(&mut self, stage: &Stage, tick: usize) {
        if tick < self.from_tick {
            return;
        }
        let (dx, dy) = (stage.pose.x_m - self.at[0], stage.pose.y_m - self.at[1]);
        let away = libm::hypot(dx, dy);
        let way =
            (0.01 * self.speed_m_s).min(gap_m(&stage.robot, &stage.pose, &[square(self.at[0], self.at[1])]));
        self.at = [self.at[0] + way.max(0.0) * dx / away, self.at[1] + way.max(0.0) * dy / away];
    }
}

/// Drives at what a runner comes out of; returns the speed in the tick in which the two met, if they did.
fn meet(stage: &mut Stage, runner: &mut Runner, ticks: usize) -> Option<f32> {
    for tick in 0..ticks {
        runner.run(stage, tick);
        stage.movers = vec![square(runner.at[0], runner.at[1])];
        stage.tick();
        if gap_m(&stage.robot, &stage.pose, &stage.movers) < 2e-3 {
            return Some(stage.twist.v_m_s.abs() + stage.twist.w_rad_s.abs());
        }
    }
    None
}

/// Out of the unseen ahead, at every phase of an approach, by bases at the corners of the identified set.
#[test]
fn what_comes_out_of_the_unseen_finds_the_robot_at_rest() {
    let a = loomo().actuator;
    for (speed, brake, dead_s) in [
        (0.3, a.brake_min_m_s2, a.dead_time_max_s),
        (0.5, a.brake_min_m_s2, a.dead_time_max_s),
        (1.0, a.brake_min_m_s2, a.dead_time_max_s),
        (0.5, a.brake_max_m_s2, a.dead_time_min_s),
    ] {
        for from_tick in (0..500).step_by(50) {
            for side in [0.0, 0.25, -0.4] {
                let mut stage = Stage::of(&CONFIG, robot(speed), &[], 0);
                (stage.brake_m_s2, stage.dead_ns) = (brake, (dead_s * 1e9) as u64);
                stage.unseen = vec![curtain(2.6)];
                stage.wish = Twist::new(1.0, 0.0);
                let mut runner = Runner { at: [2.6 + HALF_M, side], from_tick, speed_m_s: f64::from(speed) };
                let met = meet(&mut stage, &mut runner, 1000);
                assert!(met.is_none_or(|v| v < REST), "{speed} m/s from tick {from_tick} at {side}: {met:?}");
            }
        }
    }
}

/// The same runner, told of nothing: a robot that takes the world to be static is hit while it moves.
#[test]
fn a_robot_that_minds_no_movers_is_met_on_its_way() {
    let mut stage = Stage::of(&CONFIG, robot(0.0), &[], 0);
    stage.unseen = vec![curtain(2.6)];
    stage.wish = Twist::new(1.0, 0.0);
    let mut runner = Runner { at: [2.6 + HALF_M, 0.0], from_tick: 160, speed_m_s: 1.0 };
    assert!(meet(&mut stage, &mut runner, 1000).is_some_and(|v| v > 0.05));
}

/// Seen from far, standing until it runs: a thing that has stood is taken to go on standing, one that moves is not.
#[test]
fn what_moves_in_sight_is_yielded_to() {
    for (speed, side) in [(0.5, 0.0), (0.5, 0.5), (1.0, -0.3)] {
        let mut stage = Stage::of(&CONFIG, robot(speed), &[], 0);
        stage.wish = Twist::new(0.8, 0.0);
        let mut runner = Runner { at: [3.5, side], from_tick: 0, speed_m_s: f64::from(speed) };
        let met = meet(&mut stage, &mut runner, 1000);
        assert!(met.is_none_or(|v| v < REST), "{speed} m/s at {side}: {met:?}");
        // What touches the robot is in its way; ahead of it and farther off it is yielded to.
        stage.movers = vec![square(stage.pose.x_m + 0.6, stage.pose.y_m)];
        stage.ticks(50);
        assert_eq!(stage.command.reason, Reason::Yielding as u32, "{speed} m/s at {side}");
    }
}

/// `[m/s]` speed of a robot when what moves is this far ahead of its front.
fn permitted_m_s(mover_m_s: f32, clearance_m: f64) -> f32 {
    let mut stage = Stage::of(&CONFIG, robot(mover_m_s), &[], 0);
    let a = stage.robot.actuator;
    (stage.brake_m_s2, stage.dead_ns) = (a.brake_min_m_s2, (a.dead_time_max_s * 1e9) as u64);
    stage.movers = vec![curtain(4.0)];
    stage.wish = Twist::new(1.0, 0.0);
    let front_m = f64::from(stage.robot.footprint.polygon_m[0][0]);
    for _ in 0..6000 {
        stage.tick();
        if 4.0 - stage.pose.x_m - front_m <= clearance_m {
            return stage.twist.v_m_s;
        }
    }
    0.0
}

/// The table in the README, against v T + v^2 / 2b + V_h (T + v / b) = clearance with all delays in T.
#[test]
fn the_permitted_speed_is_that_of_the_closed_form() {
    let robot = loomo();
    let (b, a) = (robot.actuator.brake_min_m_s2, robot.actuator);
    for mover_m_s in [0.0, 0.25, 0.5, 1.0, 1.6f32] {
        let mut line = format!("V_h {mover_m_s}:");
        for clearance_m in [0.3, 0.5, 0.7, 1.0, 1.3, 1.6f32] {
            let v = permitted_m_s(mover_m_s, clearance_m.into());
            line += &format!(" {v:.2}");
            let shortest_s = a.dead_time_max_s + CONFIG.hold_s;
            let needed_m = v * shortest_s + v * v / (2.0 * b) + mover_m_s * (shortest_s + v / b);
            assert!(v < 0.03 || needed_m < clearance_m + 0.05, "{mover_m_s} m/s at {clearance_m} m: {v} m/s");
        }
        println!("{line}");
    }
}

/// A corridor whose walls hide everything beside it is driven as fast as one in a world that stands still.
#[test]
fn what_a_wall_hides_cannot_come_through_it() {
    let fastest = |mover_m_s| {
        let walls = [[-3.0, 0.6, 9.0, 0.7], [-3.0, -0.7, 9.0, -0.6]];
        let mut stage = Stage::of(&CONFIG, robot(mover_m_s), &walls, 0);
        stage.unseen = vec![[-9.0, 0.7, 20.0, 9.0], [-9.0, -9.0, 20.0, -0.7]];
        stage.wish = Twist::new(0.7, 0.0);
        stage.ticks(300);
        stage.twist.v_m_s
    };
    assert!((fastest(0.25) - fastest(0.0)).abs() < 0.01, "{} {}", fastest(0.25), fastest(0.0));
}

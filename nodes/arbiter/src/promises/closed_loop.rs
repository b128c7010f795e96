//! The arbiter on a base with dead time, lag and weak brakes: walls, doors, a life's end at the worst moment.

use crate::Config;
use crate::fixture::{Stage, loomo};
use sidestep_msgs::{Reason, Twist};

const CONFIG: Config = Config::STANDARD;

/// A wall at many parts of a cell, bases at the corners of the identified set and inside it, driven at with full wish.
#[test]
fn it_never_touches_a_wall_and_rests_close_before_it() {
    let a = loomo().actuator;
    for brake in [a.brake_min_m_s2, 0.6, a.brake_max_m_s2] {
        for dead_s in [a.dead_time_min_s, 0.05, a.dead_time_max_s] {
            for speed in [0.2, 0.5, 0.8, 1.0f32] {
                let wall = 1.5 + 0.1 * f64::from(dead_s) + 0.05 * f64::from(brake + speed);
                let mut stage = Stage::new(&CONFIG, &[[wall, -3.0, wall + 1.0, 3.0]]);
                stage.brake_m_s2 = brake;
                stage.dead_ns = (dead_s * 1e9) as u64;
                stage.wish = Twist::new(speed, 0.0);
                let mut least = f64::INFINITY;
                let mut last = 0;
                for _ in 0..1200 {
                    last = stage.tick().reason;
                    least = least.min(stage.gap_m());
                    assert_ne!(last, Reason::Emergency as u32, "brake {brake} dead {dead_s} speed {speed}");
                    // It would rather back up than creep.
                    if last == Reason::Reversing as u32 {
                        break;
                    }
                }
                assert_eq!(last, Reason::Reversing as u32);
                assert!((0.02..0.15).contains(&least), "brake {brake} dead {dead_s} speed {speed}: {least}");
            }
        }
    }
}

/// The permitted speed before a wall against v^2 / 2b + v T = gap, solved for the gap the map shows.
#[test]
fn the_speed_before_a_wall_is_that_of_the_closed_form() {
    let robot = loomo();
    let (b, a) = (robot.actuator.brake_min_m_s2, robot.actuator);
    for wall in [1.2, 1.5, 1.8] {
        let mut stage = Stage::new(&CONFIG, &[[wall, -3.0, wall + 1.0, 3.0]]);
        stage.wish = Twist::new(1.0, 0.0);
        stage.dead_ns = (a.dead_time_max_s * 1e9) as u64;
        stage.brake_m_s2 = a.brake_min_m_s2;
        let mut fastest = 0.0f32;
        while stage.pose.x_m < wall - 0.6 {
            stage.tick();
            let v = stage.twist.v_m_s;
            let free_m = (wall - 0.14 - stage.pose.x_m) as f32;
            assert!(v * v / (2.0 * b) <= free_m, "wall {wall}: {v} m/s at {free_m} m");
            fastest = fastest.max(v);
        }
        // Half a metre before the wall: between half and all of what the brake alone allows.
        let free_m = 0.6 - 0.14f32;
        let allowed = (2.0 * b * free_m).sqrt();
        let v = stage.twist.v_m_s;
        assert!(v > 0.5 * allowed && v < allowed, "wall {wall}: {v} of {allowed}, fastest {fastest}");
    }
}

#[test]
fn a_clear_way_is_driven_at_the_wished_speed() {
    let mut stage = Stage::new(&CONFIG, &[]);
    stage.wish = Twist::new(1.0, 0.0);
    let command = stage.ticks(300);
    assert_eq!(command.reason, Reason::Clear as u32, "{command:?}");
    assert!((command.twist.v_m_s - 1.0).abs() < 1e-3 && command.scale >= 1.0, "{command:?}");
}

/// Doors 0.1 m thick across the way, at every part of a cell, met at several headings of the map's grid.
#[test]
fn a_door_of_80_cm_is_passed_at_half_a_metre_per_second_and_a_slit_is_not() {
    let drive = |width: f64, offset: f64, speed: f32| {
        let (near, far) = (1.5 + offset, 1.6 + offset);
        let frame = [[near, 0.5 * width, far, 3.0], [near, -3.0, far, -0.5 * width]];
        let mut stage = Stage::new(&CONFIG, &frame);
        stage.pose.y_m = 0.4 * offset;
        stage.wish = Twist::new(speed, 0.0);
        let mut least = f64::INFINITY;
        let mut slowest = f32::INFINITY;
        for _ in 0..800 {
            stage.tick();
            least = least.min(stage.gap_m());
            if stage.pose.x_m > 1.0 {
                slowest = slowest.min(stage.twist.v_m_s);
            }
            if stage.pose.x_m > 2.0 {
                break;
            }
        }
        assert!(least > 0.0, "door {width} + {offset}: {least}");
        (stage.pose.x_m, slowest)
    };
    for offset in [0.0, 0.01, 0.02, 0.03, 0.04] {
        for (speed, needed) in [(0.5, 0.45), (0.9, 0.5)] {
            let (x, slowest) = drive(0.8, offset, speed);
            assert!(x > 2.0 && slowest > needed, "0.8 m + {offset} at {speed}: x {x:.2}, {slowest} m/s");
        }
        let (x, _) = drive(0.58, offset, 0.5);
        assert!(x < 1.5, "0.58 m + {offset}: x {x:.2}");
    }
}

/// Past walls on the curve: full wish round a corner of a corridor, for both hands.
#[test]
fn a_curve_into_a_wall_never_touches_it() {
    for hand in [1.0, -1.0f32] {
        for turn in [0.3, 0.8, 1.4] {
            let mut stage = Stage::new(&CONFIG, &[[-3.0, 0.7, 3.0, 1.5], [-3.0, -1.5, 3.0, -0.7]]);
            stage.wish = Twist::new(0.8, hand * turn);
            stage.brake_m_s2 = stage.robot.actuator.brake_min_m_s2;
            for _ in 0..600 {
                stage.tick();
                assert!(stage.gap_m() > 0.0, "hand {hand} turn {turn}: {:?}", stage.pose);
            }
        }
    }
}

/// The arbiter dies at every moment of an approach; the base brakes by itself when the last command runs out.
#[test]
fn a_base_left_alone_at_any_moment_still_stops_before_the_wall() {
    for alone_at in (50..400).step_by(7) {
        let mut stage = Stage::new(&CONFIG, &[[1.5, -3.0, 2.5, 3.0]]);
        stage.brake_m_s2 = stage.robot.actuator.brake_min_m_s2;
        stage.wish = Twist::new(1.0, 0.0);
        stage.ticks(alone_at);
        stage.leave_alone(alone_at % 2 == 0);
        assert!(stage.gap_m() > 0.0, "alone after {alone_at} ticks: {}", stage.gap_m());
    }
}

/// Ticks come late, early and double; the limits hold against the time that passed.
#[test]
fn limits_hold_at_irregular_ticks() {
    let mut stage = Stage::new(&CONFIG, &[]);
    let l = stage.robot.limits;
    let mut before = (0, Twist::STOP);
    for round in 0..400u64 {
        stage.wish = Twist::new(if round / 60 % 2 == 0 { 1.0 } else { -0.2 }, 1.5);
        stage.feed();
        let command = stage.step();
        let sent_ns = command.valid_until_ns - sidestep_msgs::VALID_FOR_NS;
        let dt = if before.0 == 0 { 0.01 } else { ((sent_ns - before.0) as f32 * 1e-9).min(0.02) };
        let (dv, dw) = (command.twist.v_m_s - before.1.v_m_s, command.twist.w_rad_s - before.1.w_rad_s);
        assert!(dv <= l.accelerate_m_s2 * dt + 1e-5 && dv >= -l.accelerate_m_s2 * dt - 1e-5, "{dv} in {dt}");
        assert!(dw.abs() <= l.turn_accelerate_rad_s2 * dt + 1e-5, "{dw} in {dt}");
        before = (sent_ns, command.twist);
        stage.now_ns += [0, 3, 17, 40][round as usize % 4] * 1_000_000;
    }
}

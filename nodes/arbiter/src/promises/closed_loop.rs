//! The arbiter on a base with dead time, lag and weak brakes: walls, doors, corridors.

use crate::fixture::{Stage, TICK};
use crate::Config;
use sidestep_msgs::{Reason, Twist};

const CONFIG: Config = Config::STANDARD;

/// A wall at every part of a cell, bases at every corner of the identified set: drives at it with full wish.
#[test]
fn it_never_touches_a_wall_and_rests_close_before_it() {
    let robot = crate::fixture::loomo();
    let a = robot.actuator;
    let mut worst = (f64::INFINITY, f64::NEG_INFINITY);
    for brake in [a.brake_min_m_s2, 0.6, a.brake_max_m_s2] {
        for dead_s in [a.dead_time_min_s, 0.05, a.dead_time_max_s] {
            for (case, speed) in [0.2, 0.5, 0.8, 1.0].into_iter().enumerate() {
                let wall = 1.5 + 0.013 * case as f64 + 0.1 * f64::from(dead_s) + 0.05 * f64::from(brake);
                let mut stage = Stage::new(&CONFIG, &[[wall, -3.0, wall + 1.0, 3.0]]);
                stage.brake_m_s2 = brake;
                stage.dead_ns = (dead_s * 1e9) as u64;
                stage.wish = Twist::new(speed, 0.0);
                let mut least = f64::INFINITY;
                let mut emergencies = 0;
                // Until the filter would rather turn than creep.
                for _ in 0..1200 {
                    let command = stage.tick();
                    least = least.min(stage.gap_m());
                    emergencies += u32::from(command.reason == Reason::Emergency as u32);
                    if command.reason == Reason::Rotating as u32 {
                        break;
                    }
                }
                println!("brake {brake} dead {dead_s} speed {speed}: least {least:.3} emergencies {emergencies} t {:.2}", (stage.now_ns as f64) * 1e-9 - 1.0);
                worst = (worst.0.min(least), worst.1.max(least));
                assert!(least > 0.01, "brake {brake} dead {dead_s} speed {speed}: {least}");
            }
        }
    }
    assert!(worst.1 < 0.15, "{worst:?}");
}

#[test]
fn a_clear_way_is_driven_at_the_wished_speed() {
    let mut stage = Stage::new(&CONFIG, &[]);
    stage.wish = Twist::new(1.0, 0.0);
    let command = stage.ticks(300);
    assert_eq!(command.reason, Reason::Clear as u32, "{command:?}");
    assert!((command.twist.v_m_s - 1.0).abs() < 1e-3 && command.scale >= 1.0, "{command:?}");
    let _ = TICK;
}

/// Doors of every width from 0.74 to 0.9 m at every offset of the grid, driven straight.
#[test]
fn doors_are_passed() {
    for width in [0.70, 0.74, 0.78, 0.80, 0.85, 0.90] {
        for offset in [0.0, 0.01, 0.02, 0.03, 0.04] {
            for (yaw, speed) in [(0.0, 0.5f32), (0.6, 0.5), (0.0, 1.0)] {
                let half = 0.5 * width;
                let mut stage = Stage::new(&CONFIG, &[]);
                // The door stands across the way, 1.5 m ahead along the heading; its frame is 0.1 m thick.
                stage.solids = vec![[1.5, half + offset, 1.6, 3.0], [1.5, -3.0, 1.6, -half + offset]];
                let _ = yaw;
                stage.pose.y_m = offset;
                stage.wish = Twist::new(speed, 0.0);
                let mut least = f64::INFINITY;
                let mut ticks = 0;
                while stage.pose.x_m < 2.2 && ticks < 1500 {
                    stage.tick();
                    ticks += 1;
                    least = least.min(stage.gap_m());
                }
                println!("{width} {offset} {speed}: x {:.2} t {:.2} least {least:.3} {:?}", stage.pose.x_m, ticks as f64 * 0.01, stage.command.reason);
            }
        }
    }
}

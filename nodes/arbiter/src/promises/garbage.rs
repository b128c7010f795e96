//! What is not fit is not taken: every field of every input, one at a time, ends in its reason.

use crate::Config;
use crate::fixture::{MS, Stage, TICK, map_of};
use sidestep_msgs::{
    Header, LocalGoal, NearField, Odometry, Pose2, Range, Ranges, Reason, Status, Teleop, Twist, Winner,
};

const FORWARD: Twist = Twist::new(0.5, 0.0);

fn driving(wish: Twist) -> Stage {
    let mut stage = Stage::new(&Config::STANDARD, &[]);
    stage.wish = wish;
    stage.ticks(151);
    stage
}

/// The reason after `ticks` more, with `act` before each of them.
fn after(stage: &mut Stage, ticks: usize, mut act: impl FnMut(&mut Stage)) -> u32 {
    for _ in 0..ticks {
        act(stage);
        stage.tick();
    }
    stage.command.reason
}

#[test]
fn odometry_with_any_number_that_is_none_is_unfit() {
    let spoil: [fn(&mut Odometry, f32); 7] = [
        |o, bad| o.pose.x_m = f64::from(bad),
        |o, bad| o.pose.y_m = f64::from(bad),
        |o, bad| o.pose.yaw_rad = f64::from(bad),
        |o, bad| o.twist.v_m_s = bad,
        |o, bad| o.twist.w_rad_s = bad,
        |o, bad| o.roll_rad = bad,
        |o, bad| o.pitch_rad = bad,
    ];
    for (field, spoil) in spoil.into_iter().enumerate() {
        for bad in [f32::NAN, f32::INFINITY] {
            let mut stage = driving(FORWARD);
            stage.mute.odometry = true;
            let reason = after(&mut stage, 8, |stage| {
                let mut odometry = stage.measure();
                spoil(&mut odometry, bad);
                stage.arbiter.odometry(&odometry, &Header::default());
            });
            assert_eq!(reason, Reason::UnfitOdometry as u32, "field {field}: {bad}");
        }
    }
}

#[test]
fn a_map_without_a_pose_and_a_goal_with_a_foreign_status_or_from_nowhere_are_not_taken() {
    let mut stage = driving(FORWARD);
    stage.mute.map = true;
    let nowhere = Pose2 { y_m: f64::NAN, ..Pose2::ORIGIN };
    let reason = after(&mut stage, 12, |stage| {
        let map = map_of(&[], &nowhere, stage.now_ns);
        stage.arbiter.safety_map(&map, &Header::default());
    });
    assert_eq!(reason, Reason::RefusedMap as u32);
    for status in [Status::Fault, Status::NoMap, Status::Infeasible] {
        let mut stage = driving(FORWARD);
        stage.goal_status = status;
        assert_eq!(after(&mut stage, 12, |_| ()), Reason::StaleGoal as u32, "{status:?}");
    }
    for (status, x_m, y_m) in [(999, 1.0, 0.0), (0, f32::NAN, 0.0), (0, 1.0, f32::NAN)] {
        let mut stage = driving(FORWARD);
        stage.mute.goal = true;
        let reason = after(&mut stage, 12, |stage| {
            let goal = LocalGoal { capture_ns: stage.now_ns, x_m, y_m, ..LocalGoal::default() };
            stage.arbiter.local_goal(&goal, &Header { status, ..Header::default() });
        });
        assert_eq!(reason, Reason::StaleGoal as u32, "{status} {x_m} {y_m}");
    }
}

#[test]
fn a_stick_with_any_number_that_is_none_stops_when_the_last_good_one_expires() {
    for (v_m_s, w_rad_s) in [(f32::NAN, 0.1), (0.1, f32::NAN)] {
        let mut stage = driving(FORWARD);
        let say = |stage: &mut Stage, v_m_s, w_rad_s| {
            let stamp_ns = stage.now_ns;
            stage.arbiter.teleop(&Teleop { stamp_ns, v_m_s, w_rad_s, dead_man: 1, _pad: 0 });
            stage.tick();
        };
        say(&mut stage, 0.2, 0.1);
        for tick in 1..=11 {
            say(&mut stage, v_m_s, w_rad_s);
            let reason = if tick <= 10 { Reason::Teleop } else { Reason::StaleTeleop };
            assert_eq!(stage.command.reason, reason as u32, "{v_m_s} {w_rad_s} at {tick}");
            assert!(tick > 10 || stage.command.wish == Twist::new(0.2, 0.1), "one that is held goes on");
        }
    }
    // Released garbage takes the robot from nobody.
    let mut stage = driving(FORWARD);
    let reason = after(&mut stage, 20, |stage| {
        let stamp_ns = stage.now_ns;
        stage.arbiter.teleop(&Teleop { stamp_ns, v_m_s: f32::NAN, ..Teleop::default() });
    });
    assert_eq!(reason, Reason::Clear as u32);
    // A held stick of long ago that arrives after its release takes it neither.
    for age_ns in [0, 50 * MS] {
        let mut stage = driving(FORWARD);
        let stamp_ns = stage.now_ns;
        stage.arbiter.teleop(&Teleop { stamp_ns, ..Teleop::default() });
        let old = Teleop { stamp_ns: stamp_ns - age_ns, v_m_s: 0.3, dead_man: 1, ..Teleop::default() };
        stage.arbiter.teleop(&old);
        assert_eq!(stage.tick().reason, Reason::Clear as u32, "{age_ns} ns");
    }
}

#[test]
fn a_guard_without_angles_is_silent_and_its_silence_is_noticed_after_150_ms() {
    for (left_rad, sector_rad) in [(f32::NAN, 0.015), (0.48, f32::NAN)] {
        let mut stage = driving(FORWARD);
        let say = |stage: &mut Stage, left_rad, sector_rad| {
            let capture_ns = stage.now_ns;
            let range_m = [f32::INFINITY; 64];
            stage.arbiter.near_field(&NearField { capture_ns, range_m, left_rad, sector_rad });
            stage.tick();
        };
        say(&mut stage, left_rad, sector_rad);
        assert_eq!(after(&mut stage, 20, |_| ()), Reason::Clear as u32, "a guard that never spoke is none");
        say(&mut stage, 0.48, 0.015);
        for tick in 1..=16 {
            say(&mut stage, left_rad, sector_rad);
            let reason = if tick <= 15 { Reason::Clear } else { Reason::StaleNearField };
            assert_eq!(stage.command.reason, reason as u32, "{left_rad} {sector_rad} at {tick}");
        }
    }
}

/// A count beyond the sensors there are, and one that hides the sensor that sees something.
#[test]
fn only_as_many_ultrasonic_sensors_as_there_are_and_as_are_counted_speak() {
    let near = Range { far_m: 1.5, near_m: 0.1, range_m: 0.3, ..Range::default() };
    for (count, place, stops) in [(u32::MAX, 7, true), (8, 7, true), (7, 7, false), (0, 0, false)] {
        let mut stage = driving(FORWARD);
        let reason = after(&mut stage, 1, |stage| {
            let mut ranges = Ranges { stamp_ns: stage.now_ns, count, ..Ranges::default() };
            ranges.sensors.fill(Range { range_m: f32::NAN, ..near });
            ranges.sensors[place] = near;
            stage.arbiter.ranges(&ranges);
        });
        assert_eq!(reason == Reason::Emergency as u32, stops, "{count} {place}");
    }
}

/// Each proposer's message refused for its status or its numbers, while the other is silent.
#[test]
fn a_wish_that_is_no_number_or_comes_with_a_fault_is_unfit() {
    for (v_m_s, w_rad_s, status) in [
        (f32::NAN, 0.0, Status::Ok),
        (0.2, f32::NAN, Status::Ok),
        (0.2, 0.0, Status::Fault),
        (0.2, 0.0, Status::NoMap),
    ] {
        for from in [Winner::Policy, Winner::Expert] {
            let mut stage = driving(FORWARD);
            (stage.mute.policy, stage.mute.expert) = (true, true);
            stage.ticks(12);
            stage.wish = Twist::new(v_m_s, w_rad_s);
            let reason = after(&mut stage, 3, |stage| {
                let (proposal, header) = (stage.proposal(), stage.header(status));
                stage.arbiter.proposal(from, &proposal, &header);
            });
            assert_eq!(reason, Reason::UnfitProposals as u32, "{from:?} {v_m_s} {w_rad_s} {status:?}");
            assert_eq!(stage.status, Status::Fault);
        }
    }
    let mut stage = driving(FORWARD);
    let (proposal, header) = (stage.proposal(), stage.header(Status::Ok));
    assert!(!stage.arbiter.proposal(Winner::Teleop, &proposal, &Header { source_frame: 9999, ..header }));
}

/// Bytes that stand still while the base is told to move, by speed or by turn; any one that changes ends it.
#[test]
fn odometry_is_frozen_only_where_neither_pose_nor_twist_changes_for_100_ms() {
    for wish in [Twist::new(0.3, 0.0), Twist::new(0.0, 0.5), Twist::new(0.0, -0.5), Twist::new(-0.2, 0.0)] {
        let mut stage = driving(wish);
        stage.mute.odometry = true;
        let same = stage.measure();
        let send = |stage: &mut Stage, odometry: Odometry| {
            let odometry = Odometry { stamp_ns: stage.now_ns, ..odometry };
            stage.arbiter.odometry(&odometry, &Header::default());
            stage.tick();
        };
        for tick in 0..=10 {
            send(&mut stage, same);
            assert_eq!(stage.command.reason, Reason::Clear as u32, "{wish:?} at {tick}");
        }
        send(&mut stage, same);
        assert_eq!(stage.command.reason, Reason::FrozenOdometry as u32, "{wish:?}");
        send(&mut stage, Odometry { roll_rad: 0.01, ..same });
        assert_eq!(stage.command.reason, Reason::FrozenOdometry as u32, "a head that nods moves no wheel");
        let mut other = same;
        for turn in 1..40 {
            // The pose stands and the last bit of the twist does not.
            let last = if turn < 20 { &mut other.twist.w_rad_s } else { &mut other.twist.v_m_s };
            *last = f32::from_bits(last.to_bits() ^ 1);
            send(&mut stage, other);
            assert_ne!(stage.command.reason, Reason::FrozenOdometry as u32, "{wish:?} {turn}");
        }
    }
    // Told to move too slowly to be sure, or not for long enough.
    for (wish, ticks) in [(Twist::new(0.09, 0.0), 65), (Twist::new(0.0, 0.29), 65), (FORWARD, 40)] {
        let mut stage = Stage::new(&Config::STANDARD, &[]);
        let same = stage.measure();
        stage.ticks(30);
        (stage.wish, stage.mute.odometry) = (wish, true);
        let mut reasons = Vec::new();
        for _ in 0..ticks {
            let odometry = Odometry { stamp_ns: stage.now_ns, ..same };
            stage.arbiter.odometry(&odometry, &Header::default());
            reasons.push(stage.tick().reason);
        }
        assert!(!reasons.contains(&(Reason::FrozenOdometry as u32)), "{wish:?}: {reasons:?}");
    }
}

/// A clock that is ahead of its reader by what a step may take, and one that is ahead by more.
#[test]
fn stamps_up_to_20_ms_ahead_are_believed() {
    for (ahead_ns, taken) in [(20 * MS, true), (20 * MS + 1, false)] {
        let mut stage = driving(FORWARD);
        stage.mute.map = true;
        stage.ticks(6);
        let map = map_of(&[], &stage.pose, stage.now_ns + ahead_ns);
        let header = stage.header(Status::Ok);
        stage.arbiter.safety_map(&map, &header);
        let reason = after(&mut stage, 6, |_| ());
        assert_eq!(reason == Reason::Clear as u32, taken, "{ahead_ns} ns: {reason}");
    }
    for (ahead_ns, reason) in [(20 * MS, Reason::Teleop), (20 * MS + 1, Reason::StaleTeleop)] {
        let mut stage = driving(FORWARD);
        let stamp_ns = stage.now_ns + ahead_ns;
        stage.arbiter.teleop(&Teleop { stamp_ns, v_m_s: 0.2, dead_man: 1, ..Teleop::default() });
        assert_eq!(stage.tick().reason, reason as u32, "{ahead_ns} ns");
    }
    // The first stamp of a simulation is zero, and as good as any.
    let mut stage = Stage::new(&Config::STANDARD, &[]);
    stage.now_ns = 0;
    assert_eq!(stage.tick().reason, Reason::Clear as u32);
    assert_eq!(TICK, stage.now_ns);
}

//! Every reason of the table is reached by its stimulus, and ages are exact to the tick.

use crate::fixture::{MS, Mute, Stage, TICK, loomo};
use crate::{Config, Lead, Resume};
use sidestep_msgs::{
    Code, Estop, EstopAction, Header, NearField, Odometry, Range, Ranges, Reason, SafetyMap, Status, Teleop,
    Twist, Winner,
};

const FORWARD: Twist = Twist::new(0.5, 0.0);

/// Drives 1.5 s, applies `act` before each further tick, and waits up to 40 s for the reason.
fn reach(reason: Reason, stage: &mut Stage, lead_in: usize, mut act: impl FnMut(&mut Stage, usize)) {
    stage.ticks(lead_in);
    let mut seen = Vec::new();
    for tick in 0..4000 {
        act(stage, tick);
        let command = stage.tick();
        assert_eq!(Status::from_code(0), Some(Status::Ok));
        if command.reason == reason as u32 {
            return;
        }
        if seen.last() != Some(&command.reason) {
            seen.push(command.reason);
        }
    }
    panic!("{reason:?} was not reached, but {seen:?}");
}

fn stage(solids: &[[f64; 4]]) -> Stage {
    let mut stage = Stage::new(&Config::STANDARD, solids);
    stage.wish = FORWARD;
    stage
}

fn teleop(stage: &Stage, age_ns: u64) -> Teleop {
    Teleop { stamp_ns: stage.now_ns - age_ns, v_m_s: 0.3, w_rad_s: 0.0, dead_man: 1, _pad: 0 }
}

#[test]
fn wishes_and_walls_reach_their_reasons() {
    let wall = |x: f64| [[x, -3.0, x + 1.0, 3.0]];
    reach(Reason::Clear, &mut stage(&[]), 0, |_, _| ());
    reach(Reason::Slowed, &mut stage(&wall(1.2)), 0, |_, _| ());
    // Beside the flanks there is room to go on, none to turn.
    let mut lane = stage(&[[-3.0, 0.32, 3.0, 1.0], [-3.0, -1.0, 3.0, -0.32]]);
    lane.wish = Twist::new(0.3, 0.5);
    reach(Reason::Straight, &mut lane, 0, |_, _| ());
    reach(Reason::Rotating, &mut stage(&wall(0.8)), 0, |_, _| ());
    let slot = [[0.25, -3.0, 1.0, 3.0], [-3.0, 0.34, 3.0, 1.0], [-3.0, -1.0, 3.0, -0.34]];
    reach(Reason::Reversing, &mut stage(&slot), 0, |_, _| ());
    let cage = [[0.21, -3.0, 1.0, 3.0], slot[1], slot[2], [-1.0, -3.0, -0.21, 3.0]];
    reach(Reason::Braking, &mut stage(&cage), 0, |_, _| ());
    reach(Reason::BoxedIn, &mut stage(&cage), 0, |_, _| ());
    // A wall appears out of nothing inside the braking distance.
    reach(Reason::Emergency, &mut stage(&[]), 150, |stage, _| {
        let x = stage.pose.x_m + 0.25;
        stage.solids = vec![[x, -3.0, x + 1.0, 3.0]];
    });
}

#[test]
fn sources_reach_their_reasons() {
    reach(Reason::OtherProposal, &mut stage(&[]), 30, |stage, _| stage.mute.policy = true);
    reach(Reason::Teleop, &mut stage(&[]), 30, |stage, _| {
        let wish = teleop(stage, 0);
        stage.arbiter.teleop(&wish);
    });
    reach(Reason::StaleTeleop, &mut stage(&[]), 30, |stage, tick| {
        if tick < 5 {
            let wish = teleop(stage, 0);
            stage.arbiter.teleop(&wish);
        }
    });
    for (status, reason) in [
        (Status::Arrived, Reason::Arrived),
        (Status::NoGoal, Reason::NoGoal),
        (Status::Lost, Reason::NoGoal),
        (Status::Hold, Reason::Hold),
    ] {
        reach(reason, &mut stage(&[]), 30, |stage, _| stage.goal_status = status);
    }
    reach(Reason::StaleGoal, &mut stage(&[]), 30, |stage, _| stage.mute.goal = true);
    reach(Reason::StaleProposals, &mut stage(&[]), 30, |stage, _| {
        (stage.mute.policy, stage.mute.expert) = (true, true);
    });
    reach(Reason::UnfitProposals, &mut stage(&[]), 30, |stage, _| stage.wish.v_m_s = f32::NAN);
    let mut lost = stage(&[]);
    lost.wish = Twist::STOP;
    reach(Reason::ScanRotation, &mut lost, 0, |_, _| ());
    reach(Reason::Advance, &mut lost, 0, |_, _| ());
    reach(Reason::BackUp, &mut lost, 0, |_, _| ());
    lost.solids = vec![[-1.0, -3.0, lost.pose.x_m - 0.2, 3.0]];
    reach(Reason::NoProgress, &mut lost, 0, |_, _| ());
}

#[test]
fn operators_and_restarts_reach_their_reasons() {
    let say = |action: EstopAction| Estop { token: 5, action: action as u32, _pad: 0 };
    reach(Reason::EstopLatched, &mut stage(&[]), 30, |stage, _| stage.arbiter.estop(&say(EstopAction::Stop)));
    reach(Reason::Hold, &mut stage(&[]), 30, |stage, _| stage.arbiter.estop(&say(EstopAction::Hold)));
    let restarted = |resume| {
        let mut stage = Stage::of(&Config { resume, ..Config::STANDARD }, loomo(), &[], 1);
        (stage.wish, stage.twist) = (FORWARD, FORWARD);
        stage
    };
    reach(Reason::Starting, &mut restarted(Resume::Auto), 0, |_, _| ());
    reach(Reason::Clear, &mut restarted(Resume::Auto), 0, |_, _| ());
    let mut waiting = restarted(Resume::Operator);
    reach(Reason::AwaitOperator, &mut waiting, 0, |_, _| ());
    assert!(waiting.twist.v_m_s.abs() < 0.03, "it waits at rest");
    waiting.arbiter.estop(&say(EstopAction::Resume));
    reach(Reason::Clear, &mut waiting, 0, |_, _| ());
}

#[test]
fn map_troubles_reach_their_reasons() {
    let silent = || {
        let mut stage = stage(&[]);
        stage.ticks(30);
        stage.mute.map = true;
        stage
    };
    let free = |capture_ns| SafetyMap { capture_ns, ..SafetyMap::default() };
    let mut first = stage(&[]);
    first.mute.map = true;
    reach(Reason::NoMap, &mut first, 0, |_, _| ());
    reach(Reason::StaleMap, &mut silent(), 0, |_, _| ());
    let mut frozen = silent();
    let capture_ns = frozen.now_ns - frozen.now_ns % (3 * TICK);
    frozen.arbiter.safety_map(&free(capture_ns), &Header::default());
    reach(Reason::RepeatedMap, &mut frozen, 0, |stage, _| {
        stage.arbiter.safety_map(&free(capture_ns), &Header::default());
    });
    reach(Reason::BackwardMap, &mut silent(), 0, |stage, _| {
        stage.arbiter.safety_map(&free(500 * MS), &Header::default());
    });
    reach(Reason::BackwardMap, &mut silent(), 0, |stage, _| {
        stage.arbiter.safety_map(&free(stage.now_ns + 60_000 * MS), &Header::default());
    });
    reach(Reason::RefusedMap, &mut silent(), 0, |stage, _| {
        let refused = stage.header(Status::RefusedEmpty);
        stage.arbiter.safety_map(&free(stage.now_ns), &refused);
    });
}

#[test]
fn odometry_troubles_reach_their_reasons() {
    let silent = || {
        let mut stage = stage(&[]);
        stage.ticks(150);
        stage.mute.odometry = true;
        stage
    };
    let ok = Header::default();
    let mut first = stage(&[]);
    first.mute.odometry = true;
    reach(Reason::NoOdometry, &mut first, 0, |_, _| ());
    reach(Reason::StaleOdometry, &mut silent(), 0, |_, _| ());
    reach(Reason::BackwardOdometry, &mut silent(), 0, |stage, _| {
        stage.arbiter.odometry(&Odometry { stamp_ns: 500 * MS, ..Odometry::default() }, &ok);
    });
    reach(Reason::UnfitOdometry, &mut silent(), 0, |stage, _| {
        let mut odometry = stage.measure();
        odometry.pose.x_m = f64::NAN;
        stage.arbiter.odometry(&odometry, &ok);
    });
    let mut still = silent();
    let measured = still.measure();
    reach(Reason::FrozenOdometry, &mut still, 0, |stage, _| {
        stage.arbiter.odometry(&Odometry { stamp_ns: stage.now_ns, ..measured }, &ok);
    });
    reach(Reason::Slip, &mut silent(), 0, |stage, _| {
        let odometry = stage.measure();
        stage.arbiter.odometry(&Odometry { slip: 1, ..odometry }, &ok);
    });
    reach(Reason::PoseJump, &mut silent(), 0, |stage, _| {
        let odometry = stage.measure();
        stage.arbiter.odometry(&Odometry { pose_epoch: 1, ..odometry }, &ok);
    });
}

#[test]
fn direct_sensors_cap_the_speed_and_call_emergencies() {
    let sonar = |stage: &Stage, range_m| {
        let mut ranges = Ranges { stamp_ns: stage.now_ns, count: 1, ..Ranges::default() };
        ranges.sensors[0] =
            Range { x_m: 0.1, field_of_view_rad: 0.6, near_m: 0.25, far_m: 1.5, range_m, ..Range::default() };
        ranges
    };
    reach(Reason::Emergency, &mut stage(&[]), 150, |stage, _| {
        let ranges = sonar(stage, 0.3);
        stage.arbiter.ranges(&ranges);
    });
    let mut capped = stage(&[]);
    for _ in 0..200 {
        let ranges = sonar(&capped, 0.35);
        capped.arbiter.ranges(&ranges);
        capped.tick();
    }
    // v^2 / 2b + v T = 0.35 + 0.1 - 0.14 - 0.015 m with b = 0.45, T = 0.24 s: slower than the wish.
    let expected = (0.108f32 * 0.108 + 2.0 * 0.45 * 0.295).sqrt() - 0.108;
    assert!((capped.command.twist.v_m_s - expected).abs() < 0.03, "{:?} {expected}", capped.command);
    let silent = capped.clone().ticks(100).twist;
    assert!((silent.v_m_s - 0.5).abs() < 0.01, "an old echo says nothing: {silent:?}");
    reach(Reason::Clear, &mut capped, 0, |stage, _| {
        let ranges = sonar(stage, f32::NAN);
        stage.arbiter.ranges(&ranges);
    });
    let near = |stage: &Stage, range_m: f32| NearField {
        capture_ns: stage.now_ns,
        range_m: [range_m; 64],
        left_rad: 0.48,
        sector_rad: 0.015,
    };
    reach(Reason::Emergency, &mut stage(&[]), 150, |stage, _| {
        let field = near(stage, 0.3);
        stage.arbiter.near_field(&field);
    });
    // 0.31 m to the left of where it leads.
    let mut beside = stage(&[]);
    for _ in 0..200 {
        let mut field = NearField { left_rad: 0.6, ..near(&beside, f32::INFINITY) };
        field.range_m[0] = 0.56;
        beside.arbiter.near_field(&field);
        beside.tick();
    }
    assert!((beside.command.twist.v_m_s - 0.5).abs() < 0.01, "{:?}", beside.command);
    reach(Reason::StaleNearField, &mut stage(&[]), 150, |stage, tick| {
        if tick == 0 {
            let field = near(stage, f32::INFINITY);
            stage.arbiter.near_field(&field);
        }
    });
}

/// Each input falls silent; the last good one is used at its age limit and not at the next tick.
#[test]
fn ages_are_exact_to_the_tick() {
    let limits = [
        (Mute { map: true, ..Mute::default() }, Reason::StaleMap, 100),
        (Mute { goal: true, ..Mute::default() }, Reason::StaleGoal, 100),
        (Mute { policy: true, expert: true, ..Mute::default() }, Reason::StaleProposals, 100),
        (Mute { odometry: true, ..Mute::default() }, Reason::StaleOdometry, 60),
        (Mute { policy: true, ..Mute::default() }, Reason::OtherProposal, 100),
    ];
    for (mute, reason, limit_ms) in limits {
        for phase in 0..3 {
            let mut stage = stage(&[]);
            stage.ticks(150 + phase);
            let last_tick_ns = stage.now_ns - TICK;
            let period_ns = if mute.odometry { TICK } else { 3 * TICK };
            let stamp_ns = last_tick_ns - last_tick_ns % period_ns;
            stage.mute = mute;
            loop {
                let now_ns = stage.now_ns;
                let command = stage.tick();
                let late = now_ns - stamp_ns > limit_ms * MS;
                assert_eq!(
                    command.reason == reason as u32,
                    late,
                    "{reason:?} at {} ms",
                    (now_ns - stamp_ns) / MS
                );
                if late {
                    break;
                }
            }
        }
    }
}

#[test]
fn ages_and_winner_are_told() {
    let mut stage = Stage::new(&Config { lead: Lead::Expert, ..Config::STANDARD }, &[]);
    stage.wish = FORWARD;
    let command = stage.ticks(31);
    assert_eq!(command.winner, Winner::Expert as u32);
    for age in [command.map_age_s, command.goal_age_s, command.policy_age_s, command.expert_age_s] {
        assert!((0.0..0.03).contains(&age), "{command:?}");
    }
    assert_eq!((command.odometry_age_s.to_bits(), command.teleop_age_s), (0, f32::INFINITY));
}

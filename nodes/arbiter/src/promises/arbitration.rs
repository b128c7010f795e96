//! Who drives: switching, latches, restarts, answers, and a state that carries over.

use crate::fixture::{MS, Stage, TICK, loomo};
use crate::{Arbiter, Config, Resume, Standing};
use sidestep_msgs::{Command, Estop, EstopAction, Header, Odometry, Reason, Status, Twist, Winner};

const FORWARD: Twist = Twist::new(0.5, 0.0);
const LATCHED: Standing = Standing { latched: true, held: false };

fn driving() -> Stage {
    let mut stage = Stage::new(&Config::STANDARD, &[]);
    stage.wish = FORWARD;
    stage.ticks(60);
    stage
}

fn say(action: EstopAction, token: u64) -> Estop {
    Estop { token, action: action as u32, _pad: 0 }
}

#[test]
fn the_other_drives_within_120_ms_of_the_leads_death_and_the_lead_again_after_ten_frames() {
    let mut stage = driving();
    stage.mute.policy = true;
    let died_ns = stage.now_ns;
    while stage.command.winner == Winner::Policy as u32 {
        stage.tick();
    }
    assert_eq!(stage.command.winner, Winner::Expert as u32);
    assert!(stage.now_ns - TICK - died_ns <= 120 * MS, "{} ms", (stage.now_ns - TICK - died_ns) / MS);
    assert!(stage.command.twist.v_m_s > 0.3, "the switch is seamless");
    stage.ticks(30);
    stage.mute.policy = false;
    let back_ns = stage.now_ns;
    while stage.command.winner == Winner::Expert as u32 {
        stage.tick();
    }
    let frames = (stage.now_ns - back_ns) / (3 * TICK);
    assert!((8..=11).contains(&frames), "{frames}");
}

#[test]
fn a_policy_in_doubt_gives_way_and_without_the_other_it_drives() {
    let mut stage = Stage::new(&Config { doubt_limit_m_s: 0.1, ..Config::STANDARD }, &[]);
    stage.wish = FORWARD;
    let doubtful = |stage: &mut Stage, doubt_v_m_s: f32| {
        let (mut proposal, header) = (stage.proposal(), stage.header(Status::Ok));
        proposal.doubt_v_m_s = doubt_v_m_s;
        stage.arbiter.proposal(Winner::Policy, &proposal, &header);
        stage.tick()
    };
    stage.mute.policy = true;
    for (doubt, winner) in [(0.05, Winner::Policy), (0.11, Winner::Expert), (0.09, Winner::Expert)] {
        for _ in 0..40 {
            doubtful(&mut stage, doubt);
        }
        assert_eq!(stage.command.winner, winner as u32, "{doubt}");
    }
    for _ in 0..60 {
        doubtful(&mut stage, 0.05);
    }
    assert_eq!(stage.command.winner, Winner::Policy as u32);
    stage.mute.expert = true;
    for _ in 0..40 {
        doubtful(&mut stage, 0.5);
    }
    assert_eq!(stage.command.winner, Winner::Policy as u32, "a doubtful lead is better than none");
}

#[test]
fn each_new_frame_of_the_lead_is_answered_once() {
    let mut stage = driving();
    let mut answered = Vec::new();
    for _ in 0..30 {
        let command = stage.tick();
        if command.answers != 0 {
            answered.push(stage.arbiter.source_frame());
        }
    }
    let first = answered[0];
    assert_eq!(answered, (first..first + 10).collect::<Vec<_>>());
}

#[test]
fn an_emergency_stop_is_latched_through_restart_and_restore_until_a_reset_at_rest() {
    let mut stage = driving();
    stage.arbiter.estop(&say(EstopAction::Stop, 11));
    let command = stage.tick();
    assert_eq!(
        (command.reason, command.latched, command.operator_token),
        (Reason::EstopLatched as u32, 1, 11)
    );
    stage.arbiter.estop(&say(EstopAction::Reset, 12));
    assert_eq!(stage.tick().operator_token, 11, "a reset while moving is refused");
    stage.ticks(200);
    assert!(stage.arbiter.standing().latched && stage.twist.v_m_s.abs() < 0.01);
    let mut bytes = vec![0; sidestep_msgs::ARBITER_STATE_BYTES];
    let size = stage.arbiter.state(&mut bytes);
    let mut restored = Arbiter::new(&Config::STANDARD, &loomo(), 0).unwrap();
    assert!(restored.restore(&bytes[..size]) && restored.standing().latched);
    stage.arbiter = Arbiter::new(&Config::STANDARD, &loomo(), 1).unwrap();
    stage.arbiter.take_up(LATCHED);
    stage.ticks(30);
    assert_eq!(stage.command.reason, Reason::EstopLatched as u32);
    stage.arbiter.reset();
    assert!(stage.arbiter.standing().latched, "a jump of playback is no reset");
    stage.ticks(10);
    stage.arbiter.estop(&say(EstopAction::Reset, 13));
    stage.ticks(60);
    assert_eq!((stage.command.reason, stage.command.operator_token), (Reason::Clear as u32, 13));
}

#[test]
fn a_restarted_arbiter_takes_over_the_speed_of_the_base_and_brakes_within_limits() {
    let config = Config { resume: Resume::Operator, ..Config::STANDARD };
    let mut stage = Stage::of(&config, loomo(), &[], 3);
    (stage.wish, stage.twist) = (FORWARD, Twist::new(0.6, 0.0));
    // The first command is what a braking base that was measured at 0.6 may have been told: dead time and lag below it.
    let a = stage.robot.actuator;
    let mut before = 0.6 - stage.robot.limits.brake_m_s2 * (a.dead_time_max_s + a.lag_s);
    while stage.command.reason != Reason::AwaitOperator as u32 {
        let v = stage.tick().twist.v_m_s;
        assert!(before - v <= 0.0051 && v <= before, "{before} {v}");
        before = v;
    }
    assert!(stage.twist.v_m_s.abs() < 0.03);
}

/// The arbiter dies in the middle of a brake, on bases of every dead time; its successor knows only what is measured.
#[test]
fn a_restart_while_braking_never_speeds_the_base_up_again() {
    for dead_ms in [20, 50, 80] {
        let mut stage = Stage::new(&Config::STANDARD, &[]);
        stage.dead_ns = dead_ms * crate::fixture::MS;
        stage.wish = Twist::new(0.8, 0.4);
        stage.ticks(200);
        stage.goal_status = Status::Arrived;
        let told = stage.ticks(40).twist;
        stage.arbiter = Arbiter::new(&Config::STANDARD, &stage.robot, 1).unwrap();
        let first = stage.tick().twist;
        assert!(stage.twist.v_m_s > told.v_m_s, "the base lags: {:?} {told:?}", stage.twist);
        assert!(first.v_m_s <= told.v_m_s && first.v_m_s > 0.0, "{dead_ms} ms: {first:?} after {told:?}");
        assert!((first.w_rad_s - 0.5 * first.v_m_s).abs() < 0.02, "{dead_ms} ms: {first:?} leaves the curve");
    }
}

#[test]
fn teleop_passes_the_same_filter_and_gives_the_robot_back() {
    let mut stage = Stage::new(&Config::STANDARD, &[[1.0, -3.0, 2.0, 3.0]]);
    let drive = |stage: &mut Stage, dead_man| {
        let wish =
            sidestep_msgs::Teleop { stamp_ns: stage.now_ns, v_m_s: 1.0, dead_man, ..Default::default() };
        stage.arbiter.teleop(&wish);
        stage.tick()
    };
    for _ in 0..600 {
        drive(&mut stage, 1);
        assert!(stage.gap_m() > 0.02);
    }
    assert_eq!(stage.command.winner, Winner::Teleop as u32);
    assert!(stage.gap_m() < 0.2 && stage.command.twist.w_rad_s.abs() < 1e-3, "no escapes by itself");
    stage.wish = Twist::new(0.0, 0.5);
    drive(&mut stage, 0);
    assert_eq!(stage.command.winner, Winner::Policy as u32);
}

#[test]
fn a_restored_arbiter_gives_the_same_commands() {
    let mut robot = loomo();
    robot.start.mover_m_s = 0.5;
    let solids = [[1.6, -0.2, 2.6, 3.0], [0.5, -1.5, 3.0, -0.6]];
    let mut stage = Stage::of(&Config::STANDARD, robot.clone(), &solids, 0);
    stage.movers = vec![[1.3, 0.2, 1.5, 0.6]];
    let mut yielded = false;
    stage.wish = Twist::new(0.7, 0.2);
    for _ in 0..40 {
        stage.ticks(7);
        let mut bytes = vec![0; sidestep_msgs::ARBITER_STATE_BYTES];
        let size = stage.arbiter.state(&mut bytes);
        let mut twin = Arbiter::new(&Config::STANDARD, &robot, 0).unwrap();
        assert!(twin.restore(&bytes[..size]));
        let mut mine = stage.arbiter.clone();
        let (mut a, mut b) = (Command::default(), Command::default());
        mine.step(stage.now_ns, false, &mut a);
        twin.step(stage.now_ns, false, &mut b);
        assert_eq!(bytemuck::bytes_of(&a), bytemuck::bytes_of(&b));
        yielded |= a.reason == Reason::Yielding as u32;
    }
    assert!(yielded, "the movers were minded");
    assert!(!stage.arbiter.restore(&[0; 10]));
    assert_eq!(stage.arbiter.state(&mut [0; 10]), 0);
}

/// The robot of the recording stands, to the last bit of its odometry or but for that; the arbiter's words do not move it.
#[test]
fn a_recording_that_no_command_can_change_says_so_and_starts_no_recovery() {
    for frozen in [false, true] {
        let mut stage = driving();
        let (same, pose) = (stage.measure(), stage.pose);
        stage.mute.odometry = frozen;
        for _ in 0..1500 {
            let odometry = Odometry { stamp_ns: stage.now_ns, ..same };
            if frozen {
                stage.arbiter.odometry(&odometry, &Header::default());
            }
            stage.feed();
            let mut command = Command::default();
            stage.arbiter.step(stage.now_ns, true, &mut command);
            assert_eq!((command.open_loop, command.winner), (1, Winner::Policy as u32));
            stage.now_ns += TICK;
            stage.pose = pose;
        }
    }
}

/// The base rolls while an arbiter starts again, and its odometry comes later than the first steps.
#[test]
fn rest_that_nobody_measured_ends_neither_a_start_nor_a_latch() {
    let mut stage = Stage::of(&Config::STANDARD, loomo(), &[], 1);
    (stage.wish, stage.twist) = (FORWARD, FORWARD);
    stage.arbiter.take_up(LATCHED);
    stage.mute.odometry = true;
    stage.arbiter.estop(&say(EstopAction::Reset, 3));
    let command = stage.ticks(5);
    assert_eq!((command.latched, command.operator_token), (1, 0), "{command:?}");
    stage.mute.odometry = false;
    stage.ticks(3);
    assert!(stage.twist.v_m_s > 0.1, "it still rolls");
    stage.arbiter.estop(&say(EstopAction::Reset, 4));
    assert_eq!(stage.tick().operator_token, 0);

    let mut stage = Stage::of(&Config::STANDARD, loomo(), &[], 1);
    (stage.wish, stage.twist) = (FORWARD, FORWARD);
    stage.mute.odometry = true;
    assert_eq!(stage.ticks(5).reason, Reason::NoOdometry as u32);
    stage.mute.odometry = false;
    while stage.tick().reason == Reason::Starting as u32 {
        assert_eq!(stage.command.twist, Twist::STOP);
    }
    assert!(stage.twist.v_m_s.abs() < 0.03, "it started at {:?}", stage.twist);
}

/// The lead sees no way and then both die: nobody is left whom a recovery could help.
#[test]
fn proposers_that_died_are_silent_whatever_they_said_last() {
    let mut stage = driving();
    stage.mute = crate::fixture::Mute { policy: true, expert: true, ..Default::default() };
    for tick in 0..1000 {
        if tick < 10 {
            let (proposal, header) = (stage.proposal(), stage.header(Status::Infeasible));
            stage.arbiter.proposal(Winner::Policy, &proposal, &header);
        }
        let command = stage.tick();
        let reason = if tick < 20 { Reason::UnfitProposals } else { Reason::StaleProposals };
        assert!(tick < 12 || command.reason == reason as u32, "{tick}: {command:?}");
        assert_ne!(command.winner, Winner::Recovery as u32, "{tick}");
    }
}

/// The lead dies for a moment while a person drives.
#[test]
fn a_lead_that_failed_again_while_another_drove_is_trusted_no_sooner() {
    let mut stage = driving();
    let by_hand = |stage: &mut Stage, ticks: usize, dead_man: u32| {
        for _ in 0..ticks {
            let stamp_ns = stage.now_ns;
            stage.arbiter.teleop(&sidestep_msgs::Teleop { stamp_ns, dead_man, ..Default::default() });
            stage.tick();
        }
    };
    stage.mute.policy = true;
    stage.ticks(30);
    stage.mute.policy = false;
    stage.ticks(15);
    assert_eq!(stage.command.winner, Winner::Expert as u32);
    stage.mute.policy = true;
    by_hand(&mut stage, 60, 1);
    stage.mute.policy = false;
    by_hand(&mut stage, 6, 1);
    by_hand(&mut stage, 9, 0);
    assert_eq!(stage.command.winner, Winner::Expert as u32, "good for 0.15 s only");
    by_hand(&mut stage, 25, 0);
    assert_eq!(stage.command.winner, Winner::Policy as u32);
}

#[test]
fn a_stick_that_speaks_keeps_the_robot_through_a_reset_and_one_not_understood_wishes_nothing() {
    let mut stage = driving();
    let wish = |stage: &mut Stage, v_m_s, dead_man| {
        let stamp_ns = stage.now_ns;
        stage.arbiter.teleop(&sidestep_msgs::Teleop { stamp_ns, v_m_s, dead_man, ..Default::default() });
    };
    wish(&mut stage, 0.3, 0);
    stage.tick();
    wish(&mut stage, f32::NAN, 1);
    let command = stage.tick();
    assert_eq!((command.winner, command.wish), (Winner::Teleop as u32, Twist::STOP), "{command:?}");
    wish(&mut stage, 0.3, 1);
    stage.tick();
    stage.arbiter.estop(&say(EstopAction::Resume, 5));
    wish(&mut stage, 0.3, 1);
    assert_eq!(stage.tick().winner, Winner::Teleop as u32);
    stage.ticks(15);
    assert_eq!(stage.command.reason, Reason::StaleTeleop as u32);
    stage.arbiter.estop(&say(EstopAction::Resume, 6));
    assert_eq!(stage.tick().winner, Winner::Policy as u32, "a stick that fell silent is given up");
}

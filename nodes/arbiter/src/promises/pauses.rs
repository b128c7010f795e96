//! What time does: silences of the arbiter itself, clocks that run backward, patience that starts again.

use crate::fixture::{MS, Stage, TICK, loomo};
use crate::{Config, Resume};
use sidestep_msgs::{Estop, EstopAction, Odometry, Reason, SafetyMap, Twist, VALID_FOR_NS};

const FORWARD: Twist = Twist::new(0.5, 0.0);

fn driving() -> Stage {
    let mut stage = Stage::new(&Config::STANDARD, &[]);
    stage.wish = FORWARD;
    stage.ticks(150);
    stage
}

/// The base brakes by itself once the last command ran out; who speaks again goes on from there.
#[test]
fn after_a_silence_the_arbiter_goes_on_from_where_the_base_has_braked_to() {
    let brake = loomo().limits.brake_m_s2;
    for silent_ms in [50, 80, 200, 500, 2000] {
        let mut stage = driving();
        stage.now_ns += silent_ms * MS - TICK;
        let braked_s = silent_ms.saturating_sub(VALID_FOR_NS / MS) as f32 * 1e-3;
        let left = (0.5 - brake * braked_s).max(0.0);
        stage.twist.v_m_s = left;
        let v = stage.tick().twist.v_m_s;
        // At most 20 ms of acceleration, however long the silence was.
        assert!(v >= left - 0.011 && v <= left + 0.021, "{silent_ms} ms: {v} from {left}");
    }
}

/// Playback goes back: what was sent later has no place in the queue, and one step is one tick.
#[test]
fn a_clock_that_runs_backward_is_one_tick_of_change() {
    let mut stage = driving();
    stage.wish = Twist::STOP;
    let before = stage.command.twist.v_m_s;
    stage.now_ns -= 500 * MS;
    let v = stage.step().twist.v_m_s;
    assert!(v <= before && v >= before - 0.0051, "{v} after {before}");
    stage.ticks(3);
    let situation = stage.arbiter.situation(stage.now_ns).unwrap();
    let sent_s = situation.pending[..situation.pending_count].iter().map(|sent| sent.sent_s);
    assert!(situation.pending_count > 0 && sent_s.clone().all(|sent_s| sent_s < 0.02), "{sent_s:?}");
}

/// A blocked robot waits 3 s; a jump of the pose after 2 s begins the wait anew.
#[test]
fn a_jump_of_the_pose_forgets_what_was_waited_for() {
    let cage =
        [[0.21, -3.0, 1.0, 3.0], [-3.0, 0.34, 3.0, 1.0], [-3.0, -1.0, 3.0, -0.34], [-1.0, -3.0, -0.21, 3.0]];
    let gives_up_after = |jumps: bool| {
        let mut stage = Stage::new(&Config::STANDARD, &cage);
        stage.wish = FORWARD;
        stage.ticks(200);
        (stage.mute.map, stage.mute.odometry) = (true, true);
        (0..1000).find(|_| {
            let pose_epoch = u32::from(jumps);
            let odometry = Odometry { pose_epoch, ..stage.measure() };
            let header = stage.header(sidestep_msgs::Status::Ok);
            stage.arbiter.odometry(&odometry, &header);
            let map = crate::fixture::map_of(&cage, &stage.pose, stage.now_ns);
            stage.arbiter.safety_map(&SafetyMap { pose_epoch, ..*map }, &header);
            stage.tick().reason != Reason::Braking as u32
        })
    };
    let (calm, jumped) = (gives_up_after(false).unwrap(), gives_up_after(true).unwrap());
    assert!((195..=205).contains(&(jumped - calm)), "{calm} {jumped}");
}

/// Nothing helps and nobody may try again by himself: the robot rests until it is told to go on.
#[test]
fn an_operators_word_ends_a_rest_and_nothing_else_does_where_one_is_asked() {
    let config = Config { resume: Resume::Operator, ..Config::STANDARD };
    let mut stage = Stage::new(&config, &[]);
    while stage.command.reason != Reason::NoProgress as u32 {
        stage.tick();
    }
    stage.wish = FORWARD;
    assert_eq!(stage.ticks(1000).reason, Reason::NoProgress as u32, "10 s later");
    assert_eq!(stage.command.twist, Twist::STOP);
    stage.arbiter.estop(&Estop { token: 1, action: EstopAction::Resume as u32, _pad: 0 });
    assert_eq!(stage.ticks(10).reason, Reason::Clear as u32);
    assert!(stage.command.twist.v_m_s > 0.0);
    let mut retries = Stage::new(&Config::STANDARD, &[]);
    while retries.command.reason != Reason::NoProgress as u32 {
        retries.tick();
    }
    let rested = (0..1000).find(|_| retries.tick().reason != Reason::NoProgress as u32).unwrap();
    assert!((198..=201).contains(&rested), "{rested}: it rests 2 s");
}

//! Ways out: what stands is led on, or to where it sees.

use crate::Config;
use crate::fixture::{Solid, Stage};
use sidestep_msgs::{Estop, EstopAction, LocalGoal, Pose2, Reason, Status, Twist};

const CONFIG: Config = Config::STANDARD;
/// A slot that is closed ahead and open behind, too narrow to turn in.
const SLOT: [Solid; 3] = [[0.25, -0.6, 0.5, 0.6], [-0.3, 0.4, 0.5, 0.6], [-0.3, -0.6, 0.5, -0.4]];

/// One tick with the goal at a point of the world.
fn tick_towards(stage: &mut Stage, goal_m: [f64; 2]) -> u32 {
    stage.mute.goal = true;
    let (x_m, y_m) = stage.pose.inverse_transform(goal_m[0], goal_m[1]);
    let goal = LocalGoal {
        capture_ns: stage.now_ns,
        x_m: x_m as f32,
        y_m: y_m as f32,
        remaining_m: f32::NAN,
        ..LocalGoal::default()
    };
    stage.arbiter.local_goal(&goal, &stage.header(stage.goal_status));
    stage.tick().reason
}

/// A lead that drives into the end of a slot, and turns to its goal only outside: it gets there, without a touch.
#[test]
fn out_of_a_slot_it_backs_and_turns_towards_the_goal() {
    for side in [1.0, -1.0] {
        let mut stage = Stage::new(&CONFIG, &SLOT);
        stage.wish = Twist::new(0.5, 0.0);
        let is_out = (0..2500).any(|_| {
            let (x_m, y_m) = stage.pose.inverse_transform(-1.0, 2.0 * side);
            let bearing_rad = libm::atan2(y_m, x_m) as f32;
            let turns = stage.pose.x_m < -0.5 && bearing_rad.abs() > 0.1;
            stage.wish =
                if turns { Twist::new(0.0, bearing_rad.clamp(-1.0, 1.0)) } else { Twist::new(0.5, 0.0) };
            tick_towards(&mut stage, [-1.0, 2.0 * side]);
            assert!(stage.gap_m() > 0.0, "{:?}", stage.pose);
            stage.pose.y_m * side > 1.0
        });
        assert!(is_out, "{side}: {:?} {:?}", stage.pose, stage.command);
    }
}

/// At the end of a slot, against its wish: led out within half a second of the first refusal, though what is there was seen.
#[test]
fn who_is_refused_is_led_out_before_half_a_second_has_passed() {
    let mut stage = Stage::new(&CONFIG, &SLOT);
    stage.wish = Twist::new(0.5, 0.0);
    let mut refused = 0;
    for _ in 0..300 {
        let reason = tick_towards(&mut stage, [-1.0, 2.0]);
        if is_led_out(&stage) {
            break;
        }
        let stands = stage.command.twist.v_m_s.abs() < 0.01 && stage.twist.v_m_s.abs() < 0.01;
        refused += u32::from(reason != Reason::Clear as u32 && stands);
        assert!(refused < 50, "{:?} {:?}", stage.pose, stage.command);
    }
    assert!(is_led_out(&stage), "{:?} {:?}", stage.pose, stage.command);
}

/// The slot is closed behind a robot that backs out of it: it gives the way up as soon as it stands, and begins no other.
#[test]
fn a_way_out_that_closes_is_given_up() {
    let mut stage = on_the_way();
    let behind_m = stage.pose.x_m - 0.6;
    stage.solids.push([behind_m - 0.5, -0.6, behind_m, 0.6]);
    let mut led = 0;
    for _ in 0..400 {
        tick_towards(&mut stage, [-1.0, 2.0]);
        assert!(stage.gap_m() > 0.0, "{:?}", stage.pose);
        led += u32::from(is_led_out(&stage) && stage.twist.v_m_s.abs() < 0.01);
    }
    assert!((1..40).contains(&led) && stage.arbiter.memory.recovery.ways_out().0 == 1, "{led} ticks");
}

/// Led on because it crawls, until floor that nobody saw is in the way, with too little room behind for a place to see it from:
/// it backs up as far as it can, and does not try to go on first.
#[test]
fn a_way_out_that_meets_unseen_floor_is_left_backward_at_once() {
    let mut stage = Stage::new(&CONFIG, &[]);
    stage.wish = Twist::new(0.02, 0.0);
    let drives_on = |stage: &mut Stage| {
        tick_towards(stage, [4.0, 0.0]);
        is_led_out(stage) && stage.twist.v_m_s > 0.2
    };
    assert!((0..1000).any(|_| drives_on(&mut stage)));
    let x_m = stage.pose.x_m;
    stage.unseen = vec![[x_m + 0.5, -4.0, 4.0, 4.0]];
    stage.solids = vec![[x_m - 0.7, -4.0, x_m - 0.5, 4.0], [-4.0, 0.5, 4.0, 4.0], [-4.0, -4.0, 4.0, -0.5]];
    let mut stood = 0;
    let backs_up = (0..400).any(|_| {
        tick_towards(&mut stage, [4.0, 0.0]);
        stood += u32::from(stage.twist.v_m_s.abs() < 0.01);
        stage.command.wish.v_m_s < 0.0
    });
    assert!(backs_up && stood < 30, "stood {stood} ticks: {:?} {:?}", stage.pose, stage.command);
}

/// Before a band of floor that nobody saw, without an inch seen beyond: it goes to where the camera sees the band, and looks.
#[test]
fn it_goes_to_where_it_sees_the_floor_that_it_does_not_know() {
    let mut stage = Stage::new(&CONFIG, &[]);
    stage.unseen = vec![[-3.0, 0.45, 3.0, 3.0]];
    stage.pose.yaw_rad = 1.5;
    stage.wish = Twist::new(0.5, 0.0);
    let blind_m = f64::from(stage.robot.blind_m());
    let looks = (0..3000).any(|_| {
        tick_towards(&mut stage, [0.0, 2.0]);
        let (x_m, y_m) = stage.pose.inverse_transform(0.0, 0.475);
        libm::hypot(x_m, y_m) > blind_m && libm::atan2(y_m, x_m).abs() < 0.4
    });
    assert!(looks, "{:?} {:?}", stage.pose, stage.command);
}

/// On a way out of the slot, backward.
fn on_the_way() -> Stage {
    let mut stage = Stage::new(&CONFIG, &SLOT);
    stage.wish = Twist::new(0.5, 0.0);
    let drives_out = |stage: &mut Stage| {
        tick_towards(stage, [-1.0, 2.0]);
        is_led_out(stage) && stage.twist.v_m_s < -0.1
    };
    assert!((0..1000).any(|_| drives_out(&mut stage)));
    stage
}

fn is_led_out(stage: &Stage) -> bool {
    stage.arbiter.memory.recovery.ways_out().1
}

/// Told to stop on a way out, it stops, and goes on nowhere.
#[test]
fn no_way_out_is_driven_against_a_word_to_stop() {
    for status in [Status::Arrived, Status::Hold, Status::NoGoal, Status::Lost] {
        let mut stage = on_the_way();
        stage.goal_status = status;
        (0..4).for_each(|_| _ = tick_towards(&mut stage, [-1.0, 2.0]));
        for _ in 0..200 {
            tick_towards(&mut stage, [-1.0, 2.0]);
            assert!(!is_led_out(&stage), "{status:?}");
        }
        assert!(stage.twist.v_m_s.abs() < 0.01, "{status:?}");
    }
    let mut stage = on_the_way();
    stage.arbiter.estop(&Estop { token: 5, action: EstopAction::Stop as u32, _pad: 0 });
    let latched = Reason::EstopLatched as u32;
    assert!((0..200).all(|_| tick_towards(&mut stage, [-1.0, 2.0]) == latched));
    assert!(stage.twist.v_m_s.abs() < 0.01);
}

/// Carried back into the slot again and again, never to quite the same place: ways out, at most six, then the rest that asks.
#[test]
fn who_is_put_back_is_not_led_out_for_ever() {
    let mut stage = Stage::new(&CONFIG, &SLOT);
    stage.wish = Twist::new(0.5, 0.0);
    let asks = [Reason::BoxedIn as u32, Reason::NoProgress as u32];
    let (mut most, mut asked, mut x_m) = (0, false, 0.0);
    for _ in 0..20_000 {
        if stage.pose.x_m < -0.2 {
            x_m = -0.1 - x_m;
            (stage.pose, stage.twist) = (Pose2::new(x_m, 0.0, 0.0), Twist::STOP);
        }
        asked = asks.contains(&tick_towards(&mut stage, [-1.0, 2.0]));
        if asked {
            break;
        }
        most = stage.arbiter.memory.recovery.ways_out().0.max(most);
    }
    assert!(asked && (2..=6).contains(&most), "{asked} {most}");
}

/// What bars the whole way for 2 s leaves: the lead, which drives on at once, is not led anywhere.
#[test]
fn who_waited_for_something_to_pass_is_left_alone() {
    let mut stage = Stage::new(&CONFIG, &[[0.4, -3.0, 0.6, 3.0]]);
    stage.wish = Twist::new(0.5, 0.0);
    for _ in 0..200 {
        tick_towards(&mut stage, [3.0, 0.0]);
        assert!(!is_led_out(&stage));
    }
    stage.solids.clear();
    for _ in 0..200 {
        tick_towards(&mut stage, [6.0, 0.0]);
        assert!(!is_led_out(&stage));
    }
    assert!(stage.pose.x_m > 0.4, "{:?}", stage.pose);
}

/// The same steps from a state taken on a way out as without.
#[test]
fn a_way_out_goes_on_from_a_state() {
    let mut stage = on_the_way();
    let mut bytes = vec![0; sidestep_msgs::ARBITER_STATE_BYTES];
    let size = stage.arbiter.state(&mut bytes);
    let mut other = stage.clone();
    other.arbiter = crate::Arbiter::new(&CONFIG, &stage.robot, 0).unwrap();
    assert!(size > 0 && other.arbiter.restore(&bytes[..size]));
    for _ in 0..300 {
        let reasons = [&mut stage, &mut other].map(|stage| tick_towards(stage, [-1.0, 2.0]));
        assert_eq!(reasons[0], reasons[1]);
        assert_eq!((stage.pose, stage.command), (other.pose, other.command));
    }
}

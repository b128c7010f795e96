//! Ways out: turning, backing up, recovery, squeezing away from what is too near.

use crate::Config;
use crate::fixture::{Solid, Stage, loomo, map_of};
use sidestep_msgs::{
    AGE_NEVER, AGE_OLDER, Estop, EstopAction, Header, LocalGoal, Pose2, Range, Ranges, Reason, SAFETY_GRID,
    Status, Teleop, Twist,
};

const CONFIG: Config = Config::STANDARD;

/// Boxed in from all sides for a while; then the box opens ahead.
#[test]
fn a_robot_boxed_in_stands_and_drives_on_when_the_way_opens() {
    let cage =
        [[0.21, -3.0, 1.0, 3.0], [-3.0, 0.34, 3.0, 1.0], [-3.0, -1.0, 3.0, -0.34], [-1.0, -3.0, -0.21, 3.0]];
    let mut stage = Stage::new(&CONFIG, &cage);
    stage.wish = Twist::new(0.5, 0.0);
    let mut reasons = Vec::new();
    for _ in 0..800 {
        let reason = stage.tick().reason;
        assert!(stage.gap_m() > 0.0, "{:?}", stage.pose);
        if !reasons.contains(&reason) {
            reasons.push(reason);
        }
    }
    assert!(reasons.contains(&(Reason::BoxedIn as u32)), "{reasons:?}");
    stage.solids.remove(0);
    stage.ticks(800);
    assert!(stage.pose.x_m > 0.5, "{:?} {:?}", stage.pose, stage.command);
}

/// A lead that wants to stand although there is a goal: go on, back up, scan, then rest and ask.
#[test]
fn no_progress_leads_on_then_back_then_round_then_to_rest() {
    let mut stage = Stage::new(&CONFIG, &[]);
    let mut order = Vec::new();
    let mut turned = 0.0;
    let mut yaw = 0.0;
    for _ in 0..6000 {
        let reason = stage.tick().reason;
        turned += sidestep_msgs::wrap_angle(stage.pose.yaw_rad - yaw);
        yaw = stage.pose.yaw_rad;
        if order.last() != Some(&reason) {
            order.push(reason);
        }
        if reason == Reason::NoProgress as u32 {
            break;
        }
    }
    let [clear, on, scan, back, rest] =
        [Reason::Clear, Reason::Advance, Reason::ScanRotation, Reason::BackUp, Reason::NoProgress]
            .map(|reason| reason as u32);
    assert_eq!(order[1..], [clear, on, clear, back, clear, scan, clear, rest]);
    assert!((6.2..6.8).contains(&turned), "{turned}");
    // 1.0 m on, and the way that braking takes, and 0.9 m back.
    assert!((0.2..0.5).contains(&stage.pose.x_m), "{:?}", stage.pose);
}

/// A lead that only turns: no recovery for three spans of 5 s, then one; a lead that stands gets it after 3 s.
#[test]
fn turning_counts_as_progress_for_a_while() {
    let recovers_after = |turn_rad_s: f32| {
        let mut stage = Stage::new(&CONFIG, &[]);
        stage.wish = Twist::new(0.0, turn_rad_s);
        (0..3000).find(|_| stage.tick().reason == Reason::Advance as u32).unwrap()
    };
    let (standing, turning) = (recovers_after(0.0), recovers_after(0.8));
    assert!((290..=320).contains(&standing), "{standing} ticks");
    assert!((1500..=2050).contains(&turning), "{turning} ticks");
}

/// Something that the map does not hold and an ultrasonic sensor sees, right before a robot that wants on: it backs off at once,
/// since a turn might swing a corner into it, and comes no nearer while the sensor sees it. It does not back off for ever.
#[test]
fn before_what_only_a_sensor_sees_it_backs_off() {
    for turn_rad_s in [0.3, 0.0, -0.3f32] {
        let mut stage = Stage::new(&CONFIG, &[]);
        stage.wish = Twist::new(0.4, turn_rad_s);
        let mut reversed_m = 0.0;
        for tick in 0..700 {
            let mut ranges = Ranges { stamp_ns: stage.now_ns, count: 1, ..Ranges::default() };
            ranges.sensors[0] = Range { x_m: 0.1, near_m: 0.1, far_m: 1.5, range_m: 0.1, ..Range::default() };
            stage.arbiter.ranges(&ranges);
            stage.tick();
            assert!(stage.command.twist.v_m_s < 0.01, "{:?}", stage.command);
            let reverses = stage.command.reason == Reason::Reversing as u32;
            assert!(reverses || tick != 20, "{:?}", stage.command);
            reversed_m -= if reverses { stage.command.twist.v_m_s * 0.01 } else { 0.0 };
            assert!(tick > 300 || stage.pose.yaw_rad.abs() < 0.01, "{:?}", stage.pose);
            let is_even = (stage.command.twist.v_m_s + CONFIG.back_up_m_s).abs() < 0.001;
            assert!(is_even || !(100..300).contains(&tick), "{tick}: {:?}", stage.command);
        }
        let most_m = CONFIG.back_up_m;
        assert!(reversed_m > most_m - 0.01 && reversed_m < most_m + 0.01, "{reversed_m} {:?}", stage.command);
    }
}

/// A hole of unseen floor ahead, then a wall at its place: before the hole, where waiting shows nothing, it backs up soon.
#[test]
fn before_what_nobody_saw_it_backs_up_soon_and_before_what_stands_there_it_waits() {
    let backs_up_after = |unseen: bool| {
        let wall = [[0.45, -3.0, 1.0, 3.0]];
        let mut stage = Stage::new(&CONFIG, if unseen { &[] } else { &wall });
        stage.wish = Twist::new(0.5, 0.0);
        stage.mute.map = true;
        // Without room to turn, nothing but the way back is left.
        let flanks = [[-3.0, 0.32, 3.0, 1.0], [-3.0, -1.0, 3.0, -0.32]];
        (0..1000).find(|_| {
            let mut solids = stage.solids.clone();
            solids.extend(flanks);
            let mut map = map_of(&solids, &stage.pose, stage.now_ns);
            for (index, age) in map.age.iter_mut().enumerate() {
                let (x, y) = SAFETY_GRID.centre(index / 80, index % 80);
                let (x, _) = stage.pose.transform(f64::from(x), f64::from(y));
                let old = if x < 0.0 { AGE_OLDER } else { 0 };
                *age = if unseen && x > 0.45 { AGE_NEVER } else { old };
            }
            stage.arbiter.safety_map(&map, &Header::default());
            stage.tick().reason == Reason::BackUp as u32
        })
    };
    let (soon, late) = (backs_up_after(true).unwrap(), backs_up_after(false).unwrap());
    assert!(late - soon > 150, "{soon} {late}");
}

/// A wall across the way and a wish straight at it: it backs off until it can turn, to where the goal lies or, where the
/// wish turns, to that side.
#[test]
fn it_turns_to_the_side_of_the_wish_or_else_of_the_goal() {
    for side in [1.0, -1.0f32] {
        let until = |stage: &mut Stage, reason: Reason| {
            while stage.command.reason != reason as u32 {
                let goal = LocalGoal { capture_ns: stage.now_ns, y_m: side, ..LocalGoal::default() };
                stage.arbiter.local_goal(&goal, &Header::default());
                stage.tick();
            }
        };
        let mut stage = Stage::new(&CONFIG, &[[0.42, -3.0, 1.5, 3.0]]);
        stage.wish = Twist::new(0.5, 0.0);
        stage.mute.goal = true;
        until(&mut stage, Reason::Reversing);
        let mut turning = stage.clone();
        until(&mut stage, Reason::Rotating);
        assert!(stage.command.twist.w_rad_s * side > 0.0, "goal {side}: {:?}", stage.command);
        turning.wish.w_rad_s = -0.06 * side;
        until(&mut turning, Reason::Rotating);
        assert!(turning.command.twist.w_rad_s * side < 0.0, "wish {side}: {:?}", turning.command);
    }
}

/// A wall across the way; a robot that backs off from it, then is driven backward by a wish, then wants on: it brakes and turns
/// where a turn is free, and does not back up on.
#[test]
fn who_rolls_backward_by_a_wish_tries_a_turn_before_it_backs_up() {
    let mut stage = Stage::new(&CONFIG, &[[0.34, -3.0, 1.5, 3.0]]);
    stage.wish = Twist::new(0.5, 0.0);
    while stage.tick().reason != Reason::Reversing as u32 {}
    stage.wish = Twist::new(-0.2, 0.0);
    stage.ticks(50);
    stage.wish = Twist::new(0.5, 0.0);
    let turned = (0..60).find(|tick| {
        stage.tick();
        assert!(stage.command.reason != Reason::Reversing as u32, "{tick}: {:?}", stage.command);
        stage.command.reason == Reason::Rotating as u32
    });
    assert!(turned.is_some_and(|ticks| ticks > 5), "{turned:?}: {:?}", stage.command);
}

#[test]
fn escaping_backward_crosses_only_cells_seen_lately_and_not_more_than_its_length() {
    let slot = [[0.25, -3.0, 1.0, 3.0], [-3.0, 0.34, 3.0, 1.0], [-3.0, -1.0, 3.0, -0.34]];
    for lately in [true, false] {
        let mut stage = Stage::new(&CONFIG, &slot);
        stage.wish = Twist::new(0.5, 0.0);
        stage.mute.map = true;
        let mut least = 0.0f64;
        // Before the recovery, which may cross any free cell.
        for _ in 0..if lately { 280 } else { 90 } {
            let mut map = map_of(&stage.solids, &stage.pose, stage.now_ns);
            map.age.fill(if lately { 5 } else { AGE_OLDER });
            stage.arbiter.safety_map(&map, &Header::default());
            stage.tick();
            least = least.min(stage.pose.x_m);
        }
        assert_eq!(least < -0.05, lately, "{least}");
        assert!(least > -1.0, "{least}");
    }
}

#[test]
fn unseen_cells_are_not_driven_on_however_free_they_look() {
    let mut stage = Stage::new(&CONFIG, &[]);
    stage.wish = Twist::new(0.5, 0.0);
    stage.mute.map = true;
    for _ in 0..300 {
        let mut map = map_of(&[], &stage.pose, stage.now_ns);
        for (index, age) in map.age.iter_mut().enumerate() {
            let (x, y) = SAFETY_GRID.centre(index / 80, index % 80);
            let (x, _) = stage.pose.transform(f64::from(x), f64::from(y));
            if x > 0.8 {
                *age = AGE_NEVER;
            }
        }
        stage.arbiter.safety_map(&map, &Header::default());
        stage.tick();
    }
    assert!((0.45..0.66).contains(&stage.pose.x_m), "{:?}", stage.pose);
}

/// Old memory is memory: five minutes of standing make no cell unknown by themselves.
#[test]
fn cells_seen_long_ago_carry_the_robot_on() {
    let mut stage = Stage::new(&CONFIG, &[]);
    stage.wish = Twist::new(0.5, 0.0);
    stage.mute.map = true;
    for _ in 0..300 {
        let mut map = map_of(&[], &stage.pose, stage.now_ns);
        map.age.fill(AGE_OLDER);
        map.occupancy.fill(60);
        stage.arbiter.safety_map(&map, &Header::default());
        stage.tick();
    }
    assert!(stage.pose.x_m > 1.0, "{:?}", stage.pose);
}

/// A box beside the flank whose cells leave from all of the margin to the least: it may leave, slowly, and not come nearer.
#[test]
fn a_robot_with_something_inside_its_margin_leaves_without_coming_nearer() {
    for off_m in [0.0, 0.004, 0.008, 0.012] {
        let mut stage = Stage::new(&CONFIG, &[[-0.3, 0.32, 0.3, 0.52]]);
        stage.pose.y_m = -off_m;
        stage.wish = Twist::new(0.5, 0.0);
        let start = stage.gap_m();
        for _ in 0..1000 {
            stage.tick();
            assert!(stage.gap_m() > start - 0.006, "{off_m}: {} {:?}", stage.gap_m(), stage.pose);
        }
        assert!(stage.pose.x_m > 1.0, "{off_m}: {:?} {:?}", stage.pose, stage.command);
    }
}

/// Past the end of a wall, with a base that does not err: as fast as wished with all of the margin free, slowly with less,
/// creeping with less than the least.
#[test]
fn the_nearer_to_a_wall_the_slower() {
    let mut robot = loomo();
    (robot.actuator.tracking_m_s, robot.actuator.tracking_rad_s) = (0.0, 0.0);
    for (left_m, wall, most_m_s) in [
        (-0.02, [-3.0, 0.32, 0.6, 1.0], 0.5),
        (-0.012, [-3.0, 0.32, 0.6, 1.0], CONFIG.squeeze_m_s),
        (-0.02, [-3.0, 0.31, 0.1, 1.0], 0.1),
    ] {
        let mut stage = Stage::of(&CONFIG, robot.clone(), &[wall], 0);
        stage.pose.y_m = left_m;
        stage.wish = Twist::new(0.5, 0.0);
        let fastest_m_s = (0..150).map(|_| stage.tick().twist.v_m_s).fold(0.0, f32::max);
        assert!((fastest_m_s - most_m_s).abs() < 0.01, "{left_m} {wall:?}: {fastest_m_s}");
    }
}

/// A box so near that the robot stands in cells it reaches into: it stays, but for where it leads away from all of them;
/// beside a box at its front half alone it backs out.
#[test]
fn a_robot_that_stands_in_cells_leaves_only_away_from_them() {
    for (rear, leaves) in [(-0.6, false), (0.1, true)] {
        for gap in [0.002, 0.01, 0.02] {
            let side = 0.285 + gap;
            let mut stage = Stage::new(&CONFIG, &[[rear, side, 0.6, side + 0.2]]);
            stage.wish = Twist::new(0.5, 0.3);
            let start = stage.gap_m();
            let mut least_m = 0.0f64;
            for _ in 0..1000 {
                stage.tick();
                least_m = least_m.min(stage.pose.x_m);
                assert!(stage.gap_m() > start - 0.002, "gap {gap}: {} {:?}", stage.gap_m(), stage.pose);
            }
            assert_eq!(least_m < -0.05, leaves, "gap {gap}: {least_m} {:?}", stage.command);
        }
    }
}

/// The end of a box beside the flank, wherever in its cells it lies, and the robot turned a little or not: what is nearer
/// than the least margin comes no nearer, whichever way the wish leads.
#[test]
fn what_is_nearer_than_the_least_margin_comes_no_nearer() {
    let mut tried = 0;
    for (y, yaw_rad, turn) in (0..10)
        .flat_map(|part| [-0.1, 0.0, 0.1].map(|yaw_rad| (-0.005 * f64::from(part), yaw_rad)))
        .flat_map(|(y, yaw_rad)| [-0.3, 0.3].map(|turn| (y, yaw_rad, turn)))
    {
        for gap in [0.001, 0.012] {
            let mut stage = Stage::new(&CONFIG, &[]);
            (stage.pose.y_m, stage.pose.yaw_rad) = (y, yaw_rad);
            // Slid from the side until the gap is as wanted.
            let mut side = y + 0.5;
            let beside = |side: f64| vec![[-0.05, side, 0.0895, side + 0.2]];
            for _ in 0..20 {
                stage.solids = beside(side);
                side -= stage.gap_m() - gap;
            }
            stage.solids = beside(side);
            stage.wish = Twist::new(0.1, turn);
            let start = stage.gap_m();
            for _ in 0..150 {
                stage.tick();
                assert!(
                    stage.gap_m() > start - 0.002,
                    "{y} {yaw_rad} {turn} {start}: {} {:?}",
                    stage.gap_m(),
                    stage.pose
                );
            }
            tried += 1;
        }
    }
    assert_eq!(tried, 120);
}

/// Noise: one cell ahead of the bumper flickers; the robot slows, and never calls an emergency for it when far.
#[test]
fn a_far_flicker_stops_nobody() {
    let mut stage = Stage::new(&CONFIG, &[]);
    stage.wish = Twist::new(0.5, 0.0);
    for tick in 0..300 {
        let x = stage.pose.x_m + 1.7;
        stage.solids = if tick / 3 % 4 == 0 { vec![[x, -0.02, x + 0.03, 0.02]] } else { vec![] };
        let command = stage.tick();
        if tick > 120 {
            assert!(command.twist.v_m_s > 0.45, "{command:?}");
        }
    }
}

/// A door ahead, its middle 0.1 m to the left of the robot's way.
const DOOR: [Solid; 2] = [[0.6, -3.0, 0.7, -0.3], [0.6, 0.5, 0.7, 3.0]];

fn advances(stage: &mut Stage, ticks: usize) -> Option<usize> {
    (0..ticks).find(|_| stage.tick().reason == Reason::Advance as u32)
}

/// A lead that crawls before a door, or stands, is led through its middle at once; in the open it is left alone for a second
/// where it crawls, for 3 where it stands.
#[test]
fn who_hesitates_before_a_gap_is_led_through_its_middle() {
    for crawl_m_s in [0.1, 0.0] {
        let mut stage = Stage::new(&CONFIG, &DOOR);
        stage.wish = Twist::new(crawl_m_s, 0.0);
        let begins = advances(&mut stage, 300).unwrap();
        assert!((10..40).contains(&begins), "{begins} ticks");
        let passes = (0..600).any(|_| {
            stage.tick();
            stage.pose.x_m > 0.65
        });
        assert!(passes && (stage.pose.y_m - 0.1).abs() < 0.03, "{:?}", stage.pose);
        let mut open = Stage::new(&CONFIG, &[]);
        open.wish = Twist::new(0.3 * crawl_m_s, 0.0);
        let patience = if crawl_m_s > 0.0 { 90..150 } else { 290..330 };
        let begins = advances(&mut open, 400).unwrap();
        assert!(patience.contains(&begins), "{begins} ticks");
    }
}

/// Arrived, held and stopped is who is told so, on the way through a gap too; and a person drives at once.
#[test]
fn no_advance_goes_on_against_a_word_to_stop() {
    let led_on = || {
        let mut stage = Stage::new(&CONFIG, &DOOR);
        stage.wish = Twist::new(0.1, 0.0);
        advances(&mut stage, 300).unwrap();
        stage.ticks(50);
        assert!(stage.twist.v_m_s > 0.1 && stage.command.reason == Reason::Advance as u32);
        stage
    };
    for status in [Status::Arrived, Status::Hold, Status::NoGoal, Status::Lost] {
        let mut stage = led_on();
        stage.goal_status = status;
        stage.ticks(4);
        assert!((0..200).all(|_| stage.tick().reason != Reason::Advance as u32), "{status:?}");
        assert!(stage.twist.v_m_s.abs() < 0.01, "{status:?}");
    }
    let mut stage = led_on();
    stage.arbiter.estop(&Estop { token: 5, action: EstopAction::Stop as u32, _pad: 0 });
    assert!((0..200).all(|_| stage.tick().reason == Reason::EstopLatched as u32));
    assert!(stage.twist.v_m_s.abs() < 0.01);
}

/// Carried back to the door again and again, it is led on twice from there, not for ever.
#[test]
fn who_comes_back_to_a_gap_is_not_led_on_for_ever() {
    let mut stage = Stage::new(&CONFIG, &DOOR);
    stage.wish = Twist::new(0.1, 0.0);
    let mut times = 0;
    for _ in 0..4 {
        (stage.pose, stage.twist) = (Pose2::ORIGIN, Twist::STOP);
        if advances(&mut stage, 100).is_some() {
            times += 1;
            // For 0.2 s, as the filter may let a tick pass with less than is asked.
            let mut others = 0;
            (0..600)
                .find(|_| {
                    let is_other = stage.tick().reason != Reason::Advance as u32;
                    others = if is_other { others + 1 } else { 0 };
                    others == 20
                })
                .unwrap();
        }
    }
    assert_eq!(times, 2);
}

/// Half a minute to and fro beside a wall, by hand or not, on a base that errs to one side all the time: what its errors
/// may take of the way to the wall they take once, and once more at an operator's word.
#[test]
fn errors_of_the_base_take_no_more_at_every_start() {
    for (error, is_by_hand) in [(0.02, 0.05), (-0.02, 0.05), (0.0, -0.05)]
        .into_iter()
        .flat_map(|error| [(error, false), (error, true)])
    {
        let mut stage = Stage::new(&CONFIG, &[[-3.0, 0.315, 3.0, 1.0]]);
        stage.error = Twist::new(error.0, error.1);
        let start = stage.gap_m();
        let mut least = start;
        for tick in 0..4000 {
            let v_m_s = if (tick / 60) % 2 == 0 { 0.3 } else { -0.2 };
            stage.wish = Twist::new(v_m_s, 0.0);
            if is_by_hand {
                let stamp_ns = stage.now_ns;
                stage.arbiter.teleop(&Teleop { stamp_ns, v_m_s, w_rad_s: 0.0, dead_man: 1, _pad: 0 });
            }
            if tick == 3000 {
                assert!(
                    stage.twist.v_m_s.abs() < 0.01 && least > start - 0.005,
                    "{error:?} {is_by_hand}: {least}"
                );
                stage.arbiter.estop(&Estop { token: 5, action: EstopAction::Reset as u32, _pad: 0 });
            }
            stage.tick();
            least = least.min(stage.gap_m());
        }
        assert!(least < start - 0.003 && least > start - 0.01, "{error:?} {is_by_hand}: {least}");
    }
}

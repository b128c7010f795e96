//! What the filter sweeps: against every member of the identified set, one step at a time.

use crate::Config;
use crate::brake::Brake;
use crate::clearance::{Outline, Rows};
use crate::fixture::{Stage, loomo};
use crate::limits::{Limiter, Motion};
use crate::member::{Fours, LANES, members};
use crate::rollout::{Course, Rollout, STEPS_MAX, STRIDE};
use crate::tube::{Candidate, ERROR_M, Situation};
use sidestep_msgs::{SAFETY_SIDE, Twist};

const CONFIG: Config = Config::STANDARD;
const ALL: Rows = [(1 << SAFETY_SIDE) - 1; SAFETY_SIDE];
const CURVES: [(f32, f32); 8] =
    [(0.9, 0.0), (0.4, 0.0), (0.6, 0.7), (0.5, -0.9), (0.8, -0.4), (0.3, 1.0), (0.0, 0.9), (-0.2, 0.2)];

fn candidate(twist: Twist) -> Candidate {
    Candidate { motion: Motion::steady(twist), comfort: true, lately_seen: false }
}

/// An open floor but for some boxes, and a robot on it at a twist.
fn situation(stage: &mut Stage, twist: Twist) -> Situation {
    stage.ticks(5);
    let situation = stage.arbiter.situation(stage.now_ns).unwrap();
    Situation { twist, pending_count: 0, error_m: ERROR_M, ..situation }
}

/// Adds the cells that members come nearer to than `margin_m`, those that err by `ERROR_M` less.
fn add_swept<const FOURS: usize>(
    (situation, follow): (&Situation, f32),
    wish: Twist,
    members: &Fours<FOURS>,
    margin_m: f32,
    swept: &mut Rows,
) {
    let robot = loomo();
    let outline = Outline::new(&robot).unwrap();
    let course =
        Course { situation, twist: wish, hold_s: CONFIG.hold_s, follow, radius_m: 0.4, nearer_m: 0.0 };
    let mut brake = Brake::new(&candidate(wish), &Limiter::new(&robot.limits), &robot);
    let mut rollout = Rollout::new(&course, members);
    for _ in 0..STEPS_MAX / STRIDE {
        rollout.stride(&mut brake);
        for (four, lane) in (0..FOURS).flat_map(|four| (0..LANES).map(move |lane| (four, lane))) {
            let error_m = if members[four][lane].is_faithful() { 0.0 } else { ERROR_M };
            for begins in &rollout.begins {
                let met = outline.overlapped(&begins[four].at(lane), margin_m - error_m, &ALL);
                swept.iter_mut().zip(met).for_each(|(swept, met)| *swept |= met);
            }
        }
        if rollout.begins[STRIDE - 1].iter().all(|begin| (0..LANES).all(|lane| begin.rests(lane))) {
            return;
        }
    }
}

fn swept(base: (&Situation, f32), wish: Twist, margin_m: f32) -> Rows {
    let (farthest, others) = members(&loomo(), CONFIG.hold_s);
    let mut rows = [0; SAFETY_SIDE];
    add_swept(base, wish, &farthest, margin_m, &mut rows);
    add_swept(base, wish, &others, margin_m, &mut rows);
    rows
}

/// The cells of one that are not all round in the other.
fn edge(rows: &Rows) -> Vec<[usize; 2]> {
    let is = |row: usize, bit: usize| rows[row] >> bit & 1 == 1;
    let inner = 1..SAFETY_SIDE - 1;
    let cells = inner.clone().flat_map(|row| inner.clone().map(move |bit| [row, bit]));
    let is_edge = |[row, bit]: &[usize; 2]| {
        let (row, bit) = (*row, *bit);
        let inside = is(row - 1, bit) && is(row + 1, bit) && is(row, bit - 1) && is(row, bit + 1);
        is(row, bit) && !inside
    };
    cells.filter(is_edge).collect()
}

/// A cell that any member comes nearer to than the least margin forbids the motion, however much of the margin is left at
/// the start; one that all stay clear of by more than the full one, and the way between two looks, does not.
#[test]
fn what_any_member_meets_forbids_the_motion_and_nothing_else_does() {
    let (mut met, mut clear) = (0, 0);
    for (v_m_s, w_rad_s) in CURVES {
        let wish = Twist::new(v_m_s, w_rad_s);
        let mut floor = Stage::new(&CONFIG, &[]);
        let open = situation(&mut floor, wish);
        let base = (&open, floor.arbiter.tube.follow);
        let start = Outline::new(&loomo()).unwrap().overlapped(&open.at, 0.06, &ALL);
        let must = swept(base, wish, CONFIG.margin_m - 1e-4);
        let may = swept(base, wish, CONFIG.margin_m + CONFIG.gap_m + 2.0 * ERROR_M);
        for ([row, bit], is_met) in edge(&must)
            .into_iter()
            .map(|cell| (cell, true))
            .chain(edge(&may.map(|row| !row & ALL[0])).into_iter().map(|cell| (cell, false)))
        {
            if start[row] >> bit & 1 == 1 {
                continue;
            }
            let [x_m, y_m] = [row, bit].map(|cell| (cell as f64 - 40.0) * 0.05);
            let mut stage = Stage::new(&CONFIG, &[[x_m + 0.024, y_m + 0.024, x_m + 0.026, y_m + 0.026]]);
            let beside = situation(&mut stage, wish);
            let count: u32 = beside.blocked.iter().map(|row| row.count_ones()).sum();
            assert_eq!((count, beside.blocked[row] >> bit & 1), (1, 1), "one cell is taken: {row} {bit}");
            for margin_m in [CONFIG.margin_m, CONFIG.margin_m + 0.003, stage.arbiter.tube.full_margin_m()] {
                let beside = Situation { margin_m, ..beside };
                let found = stage.arbiter.tube.check(&beside, &stage.arbiter.space, &candidate(wish));
                assert_eq!(found.is_err(), is_met, "{wish:?}, margin {margin_m}: {row} {bit}");
            }
            *(if is_met { &mut met } else { &mut clear }) += 1;
        }
    }
    assert!(met > 150 && clear > 300, "{met} {clear}");
}

/// A base that follows so slowly that it is never seen to rest.
#[test]
fn a_motion_that_never_ends_is_forbidden() {
    for (lag_s, ends) in [(0.1, true), (50.0, false)] {
        let mut robot = loomo();
        robot.actuator.lag_s = lag_s;
        let mut stage = Stage::of(&CONFIG, robot, &[], 0);
        let slow = Twist::new(0.05, 0.0);
        let situation = situation(&mut stage, slow);
        let found = stage.arbiter.tube.check(&situation, &stage.arbiter.space, &candidate(slow));
        assert_eq!(found.is_ok(), ends, "{lag_s}: {found:?}");
    }
}

/// The older the map, the farther movers may have come since.
#[test]
fn movers_go_on_while_a_map_ages() {
    let mut robot = loomo();
    robot.start.mover_m_s = 0.5;
    let mut stage = Stage::of(&CONFIG, robot, &[], 0);
    let fastest = |map_s: f32| {
        let passes = |v_cm_s: &i32| {
            let wish = Twist::new(*v_cm_s as f32 * 0.01, 0.0);
            let situation = Situation { map_s, ..situation(&mut stage, wish) };
            stage.arbiter.tube.check(&situation, &stage.arbiter.space, &candidate(wish)).is_ok()
        };
        (1..100).take_while(passes).count()
    };
    let [new, old, older] = [0.0, 0.2, 0.4].map(fastest);
    assert!(new > old && old > older && older > 0, "{new} {old} {older} cm/s");
}

//! Over random worlds, states, queues and garbage.

use crate::fixture::{MS, Solid, Stage, TICK, distance_m, gap_m, loomo};
use crate::{Arbiter, Config};
use proptest::prelude::*;
use sidestep_msgs::{
    Command, Estop, Header, LocalGoal, NearField, Odometry, Proposal, Ranges, Reason, SafetyMap, Teleop,
    Twist, Winner,
};

const CONFIG: Config = Config::STANDARD;

/// Boxes round the robot, none of which it touches.
fn worlds(most: usize) -> impl Strategy<Value = Vec<Solid>> {
    let solid = (-1.8f64..1.8, -1.8f64..1.8, 0.02f64..0.6, 0.02f64..0.6);
    prop::collection::vec(solid, 0..most).prop_map(|boxes| {
        let solids = boxes.into_iter().map(|(x, y, dx, dy)| [x, y, x + dx, y + dy]);
        solids.filter(|solid| distance_m(&[*solid], 0.0, 0.0) > 0.42).collect()
    })
}

fn wishes() -> impl Strategy<Value = Twist> {
    (-0.2f32..1.0, -1.5f32..1.5).prop_map(|(v, w)| Twist::new(v, w))
}

/// Drives by teleop, so that no escape replaces the wish.
fn by_hand(stage: &mut Stage, wish: Twist, ticks: usize) {
    for _ in 0..ticks {
        let (v_m_s, w_rad_s) = (wish.v_m_s, wish.w_rad_s);
        let teleop = Teleop { stamp_ns: stage.now_ns, v_m_s, w_rad_s, dead_man: 1, _pad: 0 };
        stage.arbiter.teleop(&teleop);
        stage.tick();
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(60))]

    /// Changing wishes through random boxes, a random member of the identified set; then the arbiter falls silent.
    #[test]
    fn no_world_no_wish_and_no_base_of_the_identified_set_makes_it_touch(
        solids in worlds(12),
        plan in prop::collection::vec(wishes(), 1..6),
        dead_ms in 20u64..80,
        brake in 0.45f32..1.2,
        error in (-0.02f32..0.02, -0.05f32..0.05),
        is_each_axis in any::<bool>(),
    ) {
        let mut stage = Stage::new(&CONFIG, &solids);
        stage.error = Twist::new(error.0, error.1);
        stage.dead_ns = dead_ms * MS;
        stage.brake_m_s2 = brake;
        for wish in plan {
            stage.wish = wish;
            for _ in 0..60 {
                stage.tick();
                prop_assert!(stage.gap_m() > 0.0, "{:?} {:?}", stage.pose, stage.command);
            }
        }
        stage.leave_alone(is_each_axis);
        prop_assert!(stage.gap_m() > 0.0, "left alone: {:?}", stage.pose);
    }

    /// The same state and wish with and without more boxes, none under the margin of the robot.
    #[test]
    fn more_obstacles_never_raise_the_scale(
        few in worlds(6), more in worlds(6), first in wishes(), wish in wishes(),
    ) {
        let mut stage = Stage::new(&CONFIG, &few);
        by_hand(&mut stage, first, 80);
        while !(stage.now_ns / TICK).is_multiple_of(3) {
            by_hand(&mut stage, first, 1);
        }
        let here = stage.pose;
        let near = |solid: &Solid| gap_m(&stage.robot, &here, &[*solid]) < 0.15;
        let added: Vec<Solid> = more.iter().filter(|solid| !near(solid)).copied().collect();
        let (arbiter, odometry) = (stage.arbiter.clone(), stage.measure());
        let scale = |solids: &[Solid]| {
            let mut arbiter = arbiter.clone();
            let now_ns = stage.now_ns;
            arbiter.odometry(&odometry, &Header::default());
            arbiter.safety_map(&crate::fixture::map_of(solids, &here, now_ns), &Header::default());
            let (v_m_s, w_rad_s) = (wish.v_m_s, wish.w_rad_s);
            arbiter.teleop(&Teleop { stamp_ns: now_ns, v_m_s, w_rad_s, dead_man: 1, _pad: 0 });
            let mut command = Command::default();
            arbiter.step(now_ns, false, &mut command);
            command.scale
        };
        let (with_few, with_more) = (scale(&few), scale(&[few.clone(), added].concat()));
        prop_assert!(with_more <= with_few, "{with_more} {with_few}");
    }

    #[test]
    fn a_mirrored_world_mirrors_the_command(solids in worlds(8), first in wishes(), wish in wishes()) {
        let mirrored: Vec<Solid> = solids.iter().map(|s| [s[0], -s[3], s[2], -s[1]]).collect();
        let mut stages = [Stage::new(&CONFIG, &solids), Stage::new(&CONFIG, &mirrored)];
        for (stage, hand) in stages.iter_mut().zip([1.0, -1.0]) {
            by_hand(stage, Twist::new(first.v_m_s, hand * first.w_rad_s), 20);
            by_hand(stage, Twist::new(wish.v_m_s, hand * wish.w_rad_s), 4);
        }
        let [a, b] = stages.map(|stage| stage.command);
        prop_assert!((a.twist.v_m_s - b.twist.v_m_s).abs() < 2e-3, "{a:?} {b:?}");
        prop_assert!((a.twist.w_rad_s + b.twist.w_rad_s).abs() < 2e-2, "{a:?} {b:?}");
    }

    /// Any bytes in any message at any time: no panic, and every command keeps the limits.
    #[test]
    fn garbage_neither_panics_nor_breaks_a_limit(
        seed in any::<u64>(), steps in prop::collection::vec((0u8..9, any::<u64>()), 1..120),
    ) {
        let mut noise = seed | 1;
        let mut draw = || {
            noise ^= noise << 13;
            noise ^= noise >> 7;
            noise ^= noise << 17;
            noise
        };
        fn fill<M: bytemuck::Pod>(message: &mut M, mut draw: impl FnMut() -> u64) {
            for byte in bytemuck::bytes_of_mut(message) {
                *byte = draw() as u8;
            }
        }
        let mut stage = Stage::new(&CONFIG, &[[0.8, -1.0, 1.0, 1.0]]);
        stage.wish = Twist::new(0.6, 0.3);
        stage.ticks(30);
        let limits = loomo().limits;
        let mut before = stage.command.twist;
        let mut map: Box<SafetyMap> = bytemuck::zeroed_box();
        for (kind, time) in steps {
            let mut header = Header::default();
            fill(&mut header, &mut draw);
            if time % 3 == 0 {
                header = stage.header(sidestep_msgs::Status::Ok);
            }
            macro_rules! garbage {
                ($message:ty) => {{
                    let mut message = <$message>::default();
                    fill(&mut message, &mut draw);
                    message
                }};
            }
            let arbiter = &mut stage.arbiter;
            match kind {
                0 => arbiter.odometry(&garbage!(Odometry), &header),
                1 => {
                    fill(&mut *map, &mut draw);
                    arbiter.safety_map(&map, &header);
                }
                2 => arbiter.local_goal(&garbage!(LocalGoal), &header),
                3 => { arbiter.proposal(Winner::Policy, &garbage!(Proposal), &header); }
                4 => arbiter.ranges(&garbage!(Ranges)),
                5 => arbiter.near_field(&garbage!(NearField)),
                6 => arbiter.teleop(&garbage!(Teleop)),
                7 => arbiter.estop(&garbage!(Estop)),
                _ => {
                    let bytes: Vec<u8> = (0..stage.arbiter.state(&mut [0; 32768])).map(|_| draw() as u8).collect();
                    prop_assert!(stage.arbiter.clone().restore(&bytes));
                    let mut broken = stage.arbiter.clone();
                    broken.restore(&bytes);
                    broken.step(time, false, &mut Command::default());
                }
            }
            let now_ns = if time % 5 == 0 { time } else { stage.now_ns };
            let mut command = Command::default();
            stage.arbiter.step(now_ns, false, &mut command);
            let (a, b) = (before, command.twist);
            prop_assert!(b.is_finite() && command.wish.is_finite());
            prop_assert!(b.v_m_s <= limits.forward_m_s && b.v_m_s >= -limits.reverse_m_s);
            prop_assert!(b.w_rad_s.abs() <= limits.turn_rad_s);
            let slower = b.v_m_s.abs() <= a.v_m_s.abs() && b.w_rad_s.abs() <= a.w_rad_s.abs();
            let near = (b.v_m_s - a.v_m_s).abs() <= 0.021 && (b.w_rad_s - a.w_rad_s).abs() <= 0.061;
            prop_assert!(slower || near, "{a:?} {b:?}");
            before = b;
            stage.tick();
            before = if stage.command.valid_until_ns == 0 { before } else { stage.command.twist };
        }
    }
}

/// The same calls give the same bytes.
#[test]
fn it_is_deterministic() {
    let drive = || {
        let mut stage = Stage::new(&CONFIG, &[[1.2, -0.3, 1.6, 2.0]]);
        stage.wish = Twist::new(0.8, 0.4);
        (0..300).map(|_| bytemuck::bytes_of(&stage.tick()).to_vec()).collect::<Vec<_>>()
    };
    assert_eq!(drive(), drive());
}

#[test]
fn an_arbiter_without_inputs_stops_and_says_why() {
    let mut arbiter = Arbiter::new(&CONFIG, &loomo(), 0).unwrap();
    let mut command = Command::default();
    for now_ns in [0, 5, u64::MAX, 3] {
        arbiter.step(now_ns, false, &mut command);
        assert_eq!((command.twist, command.reason), (Twist::STOP, Reason::NoOdometry as u32));
    }
}

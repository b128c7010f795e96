//! Known bases are found again, with noise and without.

use crate::fixture::{Truth, drive};
use crate::{Identification, LimitedBy, Onset, Series, Verdict, Watchdog, actuator_block};
use proptest::prelude::*;
use sidestep_msgs::{Actuator, Command, Odometry, Robot};

const LOOMO: &str = include_str!("../../../launch/robots/loomo.toml");
const BASE: Truth = Truth {
    dead_s: 0.05,
    lag_s: 0.08,
    accelerate_m_s2: 1.0,
    brake_m_s2: 0.525,
    watchdog_s: 0.0,
    noise_m_s: 0.0,
    seed: 1,
};

fn loomo() -> Actuator {
    Robot::from_toml("loomo.toml", LOOMO).unwrap().actuator
}

/// Ten times up to 0.6 m/s and down again.
fn steps(now_s: f64) -> Option<f64> {
    Some(if now_s % 5.0 < 0.5 || now_s % 5.0 > 3.0 { 0.0 } else { 0.6 })
}

/// Up to 0.5 m/s; then the arbiter is silent.
fn silence(now_s: f64) -> Option<f64> {
    (now_s < 3.0).then_some(0.5)
}

/// The same for a quarter of a second only.
fn short_silence(now_s: f64) -> Option<f64> {
    if (3.0..3.25).contains(&now_s) { None } else { Some(if now_s < 3.0 { 0.5 } else { 0.0 }) }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 8, failure_persistence: None, ..ProptestConfig::default() })]

    /// Noise of 0.01 m/s at 100 Hz, ramps of 1.0 and 0.5 m/s^2, ten steps up and ten down.
    #[test]
    fn a_base_that_follows_is_found_again(
        dead_s in 0.01..0.15_f64, lag_s in 0.03..0.2_f64, seed in 1..u64::MAX,
    ) {
        let truth = Truth { dead_s, lag_s, accelerate_m_s2: 3.0, brake_m_s2: 3.0, noise_m_s: 0.01, seed, ..BASE };
        let found = Identification::of(&drive(&truth, (1.0, 0.5), 50.0, steps));
        let (dead, lag) = (found.dead_s.unwrap(), found.lag_s.unwrap());
        prop_assert_eq!((dead.count, found.unfit), (20, 0));
        prop_assert!((dead.mean - dead_s).abs() < 0.012, "dead time {dead_s} s: {dead:?}, lag {lag_s} s: {lag:?}");
        prop_assert!((lag.mean - lag_s).abs() < 0.025, "lag {lag_s} s: {lag:?}");
        prop_assert!((dead.mean + lag.mean - dead_s - lag_s).abs() < 0.02, "{dead:?} {lag:?}");
        let brake = found.brake_m_s2.unwrap();
        prop_assert!((brake.mean - 0.5).abs() < 0.025, "{brake:?}");
        prop_assert!(found.own_brake_m_s2.is_none(), "{:?}", found.own_brake_m_s2);
    }

    /// Commands that stop at once, as with an emergency brake: the base's own deceleration shows.
    #[test]
    fn a_base_at_its_limit_shows_its_own_deceleration(
        brake_m_s2 in 0.4..1.5_f64, dead_s in 0.01..0.15_f64, seed in 1..u64::MAX,
    ) {
        let truth = Truth { brake_m_s2, dead_s, noise_m_s: 0.01, seed, ..BASE };
        let found = Identification::of(&drive(&truth, (0.5, 1e3), 50.0, steps));
        let own = found.own_brake_m_s2.unwrap();
        prop_assert_eq!(own.count, 10);
        prop_assert!((own.mean - brake_m_s2).abs() < 0.05 * brake_m_s2, "{brake_m_s2} m/s^2: {own:?}");
        let dead = found.dead_s.unwrap();
        prop_assert!((dead.mean - dead_s).abs() < 0.012, "{dead_s} s: {dead:?}");
    }

    #[test]
    fn the_watchdog_is_found_again(
        watchdog_s in 0.0..0.6_f64, brake_m_s2 in 0.4..1.5_f64, seed in 1..u64::MAX,
    ) {
        let truth = Truth { watchdog_s, brake_m_s2, noise_m_s: 0.01, seed, ..BASE };
        let found = Watchdog::of(&drive(&truth, (1.0, 0.5), 6.0, silence));
        prop_assert_eq!(found.lapses.len(), 1);
        let Onset::After(after_s) = found.lapses[0].onset else { panic!("{found:?}") };
        prop_assert!((after_s - watchdog_s).abs() < 0.02, "{watchdog_s} s: {after_s} s");
    }
}

#[test]
fn without_noise_a_millisecond_is_told_apart() {
    let found = Identification::of(&drive(&BASE, (1.0, 0.5), 50.0, steps));
    let (dead, lag) = (found.dead_s.unwrap(), found.lag_s.unwrap());
    assert!((dead.min - 0.05).abs() < 0.003 && (dead.max - 0.05).abs() < 0.003, "{dead:?}");
    assert!((lag.mean - 0.08).abs() < 0.003, "{lag:?}");
    assert!(found.tracking_m_s.unwrap().max < 1e-3, "{:?}", found.tracking_m_s);
    assert!(found.tests.iter().all(|test| test.limited_by == LimitedBy::Command), "{:#?}", found.tests);
    assert_eq!(found.findings(&loomo()), []);
}

#[test]
fn what_the_robot_file_does_not_contain_is_named() {
    let truth = Truth { dead_s: 0.12, lag_s: 0.15, brake_m_s2: 0.35, ..BASE };
    let found = Identification::of(&drive(&truth, (0.5, 1e3), 50.0, steps));
    let keys: Vec<_> = found.findings(&loomo()).iter().map(|finding| finding.key).collect();
    assert_eq!(keys, ["dead_time_max_s", "lag_s", "brake_min_m_s2"]);
}

/// The block replaces `[actuator]` of the file it came from, and then contains what was measured.
#[test]
fn the_block_is_a_robot_file_that_contains_the_measurement() {
    let truth = Truth { dead_s: 0.12, lag_s: 0.15, brake_m_s2: 0.35, noise_m_s: 0.005, ..BASE };
    let found = Identification::of(&drive(&truth, (0.5, 1e3), 50.0, steps));
    let block = actuator_block(&found, LOOMO);
    let (head, rest) = LOOMO.split_once("[actuator]").unwrap();
    let (_, tail) = rest.split_once("[start]").unwrap();
    let robot = Robot::from_toml("measured", &format!("{head}{block}\n[start]{tail}")).unwrap();
    assert_eq!(found.findings(&robot.actuator), [], "{block}");
    assert!(block.contains("source = \"measured: sidestep identify, 20 steps\""), "{block}");
    assert!(block.contains("watchdog_s = { ") && block.contains("guess: the base driver"), "{block}");
}

#[test]
fn a_slip_or_a_blocked_wheel_is_no_test() {
    let good = drive(&BASE, (1.0, 0.5), 20.0, steps);
    let mut series = Series::default();
    for sent in good.commands() {
        let twist = sidestep_msgs::Twist::new(sent.v_m_s as f32, 0.0);
        series.command(
            &Command { twist, valid_until_ns: sent.valid_until_ns, ..Command::default() },
            sent.sent_ns,
        );
    }
    for moved in good.motion() {
        let odometry = Odometry {
            stamp_ns: moved.stamp_ns,
            slip: u32::from(moved.stamp_ns < 8_000_000_000),
            ..Odometry::default()
        };
        series.odometry(&odometry);
    }
    let found = Identification::of(&series);
    assert!(found.is_empty() && found.unfit >= 4, "{found:?}");
}

#[test]
fn a_base_without_a_watchdog_is_found_out_before_the_arbiter_is_back() {
    let without = Truth { watchdog_s: f64::INFINITY, noise_m_s: 0.005, ..BASE };
    let found = Watchdog::of(&drive(&without, (1.0, 0.5), 6.0, silence));
    assert!(matches!(found.lapses[0].onset, Onset::NotWithin(within_s) if within_s > 0.5), "{found:?}");
    assert!(matches!(found.verdict(0.02), Verdict::Late(_)), "{found:?}");
    // The next command comes 0.17 s after the end of the last: too soon to call the base late beyond doubt.
    let short = Watchdog::of(&drive(&without, (1.0, 0.5), 6.0, short_silence));
    assert!(matches!(short.lapses[0].onset, Onset::NotWithin(within_s) if within_s < 0.2), "{short:?}");
    assert_eq!(short.verdict(0.05), Verdict::Unknown);
    let with = Watchdog::of(&drive(&BASE, (1.0, 0.5), 6.0, short_silence));
    assert!(matches!(with.verdict(0.02), Verdict::Brakes(net_s) if net_s < 0.01), "{with:?}");
}

#[test]
fn commands_that_never_cease_tell_nothing_of_the_watchdog() {
    let found = Watchdog::of(&drive(&BASE, (1.0, 0.5), 10.0, steps));
    assert_eq!((found.lapses.len(), found.verdict(0.02)), (0, Verdict::Unknown));
    let empty = Watchdog::of(&Series::default());
    assert_eq!(empty, Watchdog::default());
    assert!(Identification::of(&Series::default()).is_empty());
}

//! What the adversary promises: the same findings for any number of threads, nothing inside the assumptions, and a
//! contact soon when any one of them is relaxed.
#![allow(clippy::unwrap_used, clippy::panic, reason = "a test says what it expects by failing")]

use sidestep_falsify::{Assumption, Case, Evaluator, GENES, Search, SearchOptions, search};
use sidestep_msgs::Robot;

fn loomo() -> Robot {
    Robot::from_toml("loomo.toml", include_str!("../../../launch/robots/loomo.toml")).unwrap()
}

/// The same, minding movers of half a metre per second in its sector.
fn wary() -> Robot {
    let mut robot = loomo();
    robot.start.mover_m_s = 0.5;
    robot
}

fn attack(robot: &Robot, relaxed: Option<Assumption>, evaluations: u64, threads: usize) -> Search {
    let stops = relaxed.is_some();
    let options = SearchOptions { robot, relaxed, seed: 1, evaluations, threads, stops, keep: 3 };
    search(&options, &mut |_, _, _| ()).unwrap()
}

/// Two climbs by one thread and by three: every number and every gene is compared. The worst case replays to the same
/// bytes from its word.
#[test]
fn nothing_is_touched_while_the_assumptions_hold_and_threads_have_no_influence() {
    let found = attack(&loomo(), None, 1500, 1);
    assert_eq!(found.contacts, 0, "{:?}", found.first_contact);
    assert_eq!(attack(&loomo(), None, 1500, 3), found);
    let worst = &found.worst[0];
    assert!(worst.outcome.robustness_m < 0.1, "the adversary comes near: {worst:?}");
    let case = Case::from_word(&worst.case).unwrap();
    assert_eq!(case.word(), worst.case);
    let again = Evaluator::new(&loomo()).unwrap().evaluate(&case, &mut |_| ()).unwrap();
    assert_eq!(again, worst.outcome);
}

/// What once was a contact stays none.
#[test]
fn what_was_found_is_closed() {
    let cases = || include_str!("found.txt").lines().filter(|line| !line.starts_with('#'));
    assert_eq!(cases().count(), 2);
    for (number, word) in cases().enumerate() {
        let case = Case::from_word(word).unwrap();
        let outcome = Evaluator::new(&loomo()).unwrap().evaluate(&case, &mut |_| ()).unwrap();
        assert_eq!(outcome.contact, None, "case {number}");
    }
}

/// Each assumption alone, at most four climbs.
#[test]
fn every_assumption_is_needed() {
    for assumption in Assumption::ALL {
        let found = attack(&loomo(), Some(assumption), 4000, 2);
        let first =
            found.first_contact.unwrap_or_else(|| panic!("nothing found with {assumption:?} relaxed"));
        let case = Case::from_word(&first.case).unwrap();
        let again = Evaluator::new(&loomo()).unwrap().evaluate(&case, &mut |_| ()).unwrap();
        assert_eq!(again, first.outcome, "{assumption:?}");
        let inside = Case { relaxed: None, ..case };
        let kept = Evaluator::new(&loomo()).unwrap().evaluate(&inside, &mut |_| ()).unwrap();
        assert_eq!(kept.contact, None, "{assumption:?}: the same genes with the assumption kept");
    }
}

/// Movers of up to the speed that the robot file names, seen or out of what is not: none meets a robot that moves.
#[test]
fn a_robot_that_minds_movers_is_met_at_rest() {
    let found = attack(&wary(), None, 1500, 2);
    assert_eq!(found.contacts, 0, "{:?}", found.first_contact);
}

#[test]
fn what_is_no_case_is_refused_with_what_is_needed() {
    let genes = "0".repeat(4 * GENES);
    assert!(Case::from_word(&format!("inside:{genes}")).is_ok());
    for (word, found) in [
        (genes.clone(), "`0000"),
        (format!("outside:{genes}"), "the name `outside`"),
        ("inside:00ff".to_owned(), "4 digits"),
        (format!("inside:{}", genes.replace('0', "x")), "the digits `xxxx`"),
    ] {
        let error = Case::from_word(&word).unwrap_err().to_string();
        assert!(error.contains(found) && error.contains("needed: NAME:DIGITS"), "{error}");
    }
    let robot = loomo();
    let options = SearchOptions {
        robot: &robot,
        relaxed: None,
        seed: 1,
        evaluations: 0,
        threads: 1,
        stops: false,
        keep: 1,
    };
    let error = search(&options, &mut |_, _, _| ()).unwrap_err().to_string();
    assert_eq!(error, "falsify: --evaluations is 0, needed: at least 1");
}

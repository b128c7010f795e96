//! Small suites at map level, as the command drives large ones.
#![allow(clippy::unwrap_used, clippy::panic, missing_docs, reason = "a test says what it expects by failing")]

use sidestep_drive::{Lead, Sight};
use sidestep_msgs::{Pose2, Robot};
use sidestep_navigate::{
    CorridorOptions, Course, Ending, FIRST_SEED, Ledger, LongOptions, Navigation, RECKLESS, Suite,
    SuiteOptions, behaviour, beside, corridors, drive_courses, long, rooms, sudden, tune,
};
use sidestep_sim::{Solid, World};

fn loomo() -> Robot {
    let path = format!("{}/../../launch/robots/loomo.toml", env!("CARGO_MANIFEST_DIR"));
    Robot::from_toml(&path, &std::fs::read_to_string(&path).unwrap()).unwrap()
}

fn options(robot: &Robot) -> SuiteOptions<'_> {
    SuiteOptions {
        robot,
        model: sidestep_policy::embedded(),
        model_name: "embedded",
        leads: Lead::ALL.to_vec(),
        arbitrated: vec![true, false],
        sight: Sight::Grid,
        limit_s: 60.0,
        threads: 2,
    }
}

/// A straight path of 5 m and what stands there.
fn course(solids: &[Solid]) -> Course {
    let mut world = World::empty();
    world.solids.push(Solid::wall([0.0, -2.0], [8.0, -2.0], 0.1, 2.0));
    world.solids.push(Solid::wall([0.0, 2.0], [8.0, 2.0], 0.1, 2.0));
    world.solids.extend(solids);
    world.start = Pose2::new(1.4, 0.0, 0.0);
    world.legs_m = vec![vec![[1.4, 0.0], [6.4, 0.0]]];
    Course::of("hall", "easy", 3, world)
}

/// The only group of a suite under one condition.
fn alone(options: &SuiteOptions<'_>, course: &Course) -> Suite {
    drive_courses(options, "one", std::slice::from_ref(course), &mut |_| ()).unwrap()
}

#[test]
fn every_lead_crosses_an_empty_room_with_and_without_the_arbiter() {
    let robot = loomo();
    let suite = alone(&options(&robot), &course(&[]));
    assert_eq!(suite.groups.len(), 8);
    for group in &suite.groups {
        assert!(group.reached.count == 1 && group.contact.count == 0, "{group:?}");
        assert!((4.5..5.5).contains(&group.distance_m) && group.speed_m_s > 0.4, "{group:?}");
        assert!(group.cost.is_finite() && group.cost > 0.0, "{group:?}");
    }
}

/// One obstacle beside the path, seen by camera and mapper and drawn as a grid: nearly the same drive.
#[test]
fn camera_and_grid_agree_in_an_easy_room() {
    let robot = loomo();
    let course = course(&[Solid::block([4.0, 0.75], [0.4, 0.4], 0.4, [0.0, 1.0])]);
    let drive = |sight| {
        let options =
            SuiteOptions { leads: vec![Lead::Expert], arbitrated: vec![true], sight, ..options(&robot) };
        alone(&options, &course).groups.remove(0)
    };
    let (camera, grid) = (drive(Sight::Camera), drive(Sight::Grid));
    assert_eq!((camera.reached.count, grid.reached.count), (1, 1));
    assert!((camera.time_s - grid.time_s).abs() < 0.25 * grid.time_s, "{} {}", camera.time_s, grid.time_s);
    assert!((camera.distance_m - grid.distance_m).abs() < 0.3, "{} {}", camera.distance_m, grid.distance_m);
    let clearances = (camera.min_clearance_m, grid.min_clearance_m);
    assert!((clearances.0 - clearances.1).abs() < 0.15, "{clearances:?}");
}

#[test]
fn numbers_do_not_depend_on_the_number_of_threads() {
    let robot = loomo();
    let drive = |threads| {
        let options = SuiteOptions { leads: vec![Lead::Policy, Lead::Refined], threads, ..options(&robot) };
        serde_json::to_string(&rooms(&options, 5, 8, &mut |_| ()).unwrap()).unwrap()
    };
    assert_eq!(drive(1), drive(3));
}

/// Of an easy course and one that without the arbiter ends at a wall, the easy one alone is compared.
#[test]
fn speeds_are_compared_where_both_ways_reached() {
    let robot = loomo();
    let options = SuiteOptions { leads: vec![Lead::Solved], limit_s: 15.0, ..options(&robot) };
    let courses = [course(&[]), course(&[Solid::wall([4.0, -2.0], [4.0, 2.0], 0.1, 2.0)])];
    let groups = drive_courses(&options, "two", &courses, &mut |_| ()).unwrap().groups;
    let easy = alone(&options, &courses[0]).groups;
    for (group, easy) in groups.iter().zip(&easy) {
        let bits = [group.shared_speed_m_s, easy.shared_speed_m_s, easy.speed_m_s].map(f64::to_bits);
        assert!(group.reached.count == 1 && bits == [bits[2]; 3], "{group:?}");
    }
}

/// A path that ends behind a wall: nobody gets there, and the report and the JSON say which seed it was.
#[test]
fn a_failure_is_listed_with_its_seed() {
    let robot = loomo();
    let mut course = course(&[Solid::wall([4.0, -2.0], [4.0, 2.0], 0.1, 2.0)]);
    course.seed = 987_654_321;
    let options =
        SuiteOptions { leads: vec![Lead::Policy], arbitrated: vec![true], limit_s: 15.0, ..options(&robot) };
    let suite = alone(&options, &course);
    let failure = &suite.groups[0].failures[0];
    assert_eq!((failure.seed, failure.ending), (987_654_321, Ending::Late));
    let report = Navigation { suites: vec![suite], ..Navigation::default() }.report(&robot, "test").unwrap();
    assert!(report.html().contains("<td class=\"n\">987654321</td>") && report.json().contains("987654321"));
}

#[test]
fn without_an_arbiter_the_command_is_what_the_lead_proposes() {
    let robot = loomo();
    let mut setup = sidestep_drive::Setup::led_by(robot, course(&[]).world, Lead::Expert);
    (setup.sight, setup.arbitrated) = (Sight::Grid, false);
    let mut drive = sidestep_drive::Drive::new(setup).unwrap();
    for _ in 0..500 {
        drive.tick();
        assert_eq!(drive.command().twist, drive.chain().proposals()[1].twist);
    }
    assert!(drive.outcome().distance_m > 1.0);
}

/// One of everything: each figure is there, and the numbers stand in the page.
#[test]
fn the_report_holds_every_figure_and_its_numbers() {
    let robot = loomo();
    let model = sidestep_policy::embedded();
    let options = SuiteOptions { leads: vec![Lead::Policy], arbitrated: vec![true], ..options(&robot) };
    let corridor = CorridorOptions {
        robot: &robot,
        models: [model, model],
        first_seed: FIRST_SEED,
        seeds: 1,
        sight: Sight::Grid,
        threads: 1,
    };
    let navigation = Navigation {
        suites: vec![rooms(&options, 5, 4, &mut |_| ()).unwrap()],
        beside: beside(&robot, model, "embedded", Sight::Grid).unwrap(),
        sudden: sudden(&robot, model, "embedded").unwrap(),
        corridors: Some(corridors(&corridor, &mut |_| ()).unwrap()),
    };
    let [one, other] = &navigation.corridors.as_ref().unwrap().corridors[0].alone;
    assert_eq!(one, other, "the same model drives the same drive");
    assert!(
        navigation.beside.iter().all(|world| world.distances.iter().all(|apart| apart.max_m.is_finite()))
    );
    assert!(navigation.sudden.iter().all(|scene| scene.reaction_s.is_some()), "{:?}", navigation.sudden);
    let report = navigation.report(&robot, "test").unwrap();
    let html = report.html();
    for part in ["Fig. 7", "Fig. 8", "Fig. 9", "Depth camera", "sparse", "Needed per 100 m"] {
        assert!(html.contains(part), "{part}");
    }
    let reached = navigation.suites[0].groups[0].reached.text();
    assert!(html.contains(&reached), "{reached}");
    let data: serde_json::Value = serde_json::from_str(&report.json()).unwrap();
    assert_eq!(data["suites"][0]["groups"][0]["reached"]["of"], 4);
}

/// Two rooms for each set of weights.
#[test]
fn tuning_drives_every_weight_halved_and_doubled() {
    let trials = tune(&loomo(), 2, 2, &mut |_| ()).unwrap();
    assert_eq!(trials.len(), 11);
    assert!(trials.iter().all(|trial| trial.rooms == 2 && trial.score_s > 1.0), "{trials:?}");
    assert_eq!(trials[0].name, "as shipped");
    assert!(tune(&loomo(), 0, 2, &mut |_| ()).unwrap_err().to_string().contains("needed: at least 1"));
}

fn long_options(robot: &Robot, distance_m: f64) -> LongOptions<'_> {
    LongOptions {
        robot,
        model: sidestep_policy::embedded(),
        model_name: "embedded",
        sight: Sight::Grid,
        distance_m,
        limit_s: 60.0,
        threads: 2,
    }
}

/// A quarter of a kilometre in one go, and in two calls with another number of threads.
#[test]
fn a_long_suite_goes_on_where_it_stopped_and_touches_nothing_however_it_is_led() {
    let (robot, mut ledger) = (loomo(), Ledger::default());
    let whole = long_options(&robot, 260.0);
    let account = ledger.account("one", "grid", 5);
    long(&whole, account, &mut |_| Ok(())).unwrap();
    let account = account.clone();
    let mut kept = 0;
    for (distance_m, threads) in [(100.0, 1), (260.0, 2)] {
        let part = LongOptions { distance_m, threads, ..whole };
        let mut keep = |_: &sidestep_navigate::Account| {
            kept += 1;
            Ok(())
        };
        long(&part, ledger.account("two", "grid", 5), &mut keep).unwrap();
    }
    let again = ledger.account("two", "grid", 5);
    assert_eq!((kept * 8, &again.drivers), (account.next, &account.drivers));
    assert_eq!((account.contacts(), account.drivers.len()), (0, 5), "{account:?}");
    let reckless = &account.drivers[RECKLESS];
    assert!(reckless.drives > 0 && reckless.distance_m > 5.0, "{reckless:?}");
    let led = account.drivers.iter().filter(|(name, _)| *name != RECKLESS);
    assert!(led.clone().all(|(_, tally)| tally.reached + 1 >= tally.drives), "{account:?}");
    let refused = long(&LongOptions { limit_s: f64::NAN, ..whole }, &mut account.clone(), &mut |_| Ok(()));
    assert!(refused.unwrap_err().to_string().contains("limit is NaN, needed: more than 0"));
    let refused = long(&LongOptions { distance_m: 0.0, ..whole }, &mut account.clone(), &mut |_| Ok(()));
    assert!(refused.unwrap_err().to_string().contains("km is 0, needed: more than 0"));
}

/// Who drives otherwise opens another account.
#[test]
fn a_behaviour_is_told_by_its_commands() {
    let robot = loomo();
    let mut slower = robot.clone();
    slower.actuator.dead_time_max_s += 0.1;
    let [one, again, other] =
        [&robot, &robot, &slower].map(|robot| behaviour(&long_options(robot, 1.0)).unwrap());
    assert_eq!(one, again);
    assert_ne!(one, other);
}

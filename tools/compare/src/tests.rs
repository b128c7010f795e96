//! Promises of a comparison, on recordings whose figures are known.

use crate::fixture::{Drive, Folder, robot};
use crate::join::Joiner;
use crate::{CompareError, Comparison, Mine, Options, Rank, compare};
use sidestep_msgs::{Header, LOCAL_MAP, LocalMap, Status, Twist};
use sidestep_player::{Entry, PlayerError};
use sidestep_train::{Dataset, Source, TrainError};
use std::path::Path;

fn options(file: &Path) -> Options {
    Options { file: file.to_path_buf(), other: None, worst: 6, rank: Rank::Disagreement, mine: None }
}

fn of(folder: &Folder, drive: &Drive) -> Result<Comparison, CompareError> {
    compare(&options(&folder.write("drive.mcap", &drive.record())))
}

/// One frame of the drive asks for a turn that the expert does not want.
const ODD: Drive = Drive {
    offset: |number| if number == 77 { Twist::new(0.0, -0.8) } else { Twist::new(-0.05, 0.0) },
    ..Drive::PLAIN
};

#[test]
fn errors_agreement_and_the_worst_frame_are_those_that_were_made() {
    let comparison = of(&Folder::new("known"), &ODD).unwrap();
    let figures = &comparison.figures;
    assert_eq!(figures.frames, 120);
    let wide = figures.windows.last().unwrap();
    assert!((wide.window_s - 0.3).abs() < 1e-6);
    assert!((wide.errors.v_mean - 0.05 * 119.0 / 120.0).abs() < 1e-3, "{wide:?}");
    assert!(wide.errors.w_mean > 0.2 / 120.0 && wide.errors.w_mean < 0.9 / 120.0, "{wide:?}");
    assert!(figures.windows[0].errors.v_mean <= wide.errors.v_mean, "a narrower window is no further apart");
    assert!((figures.agreement.share - 119.0 / 120.0).abs() < 1e-9);
    assert_eq!(comparison.worst[0].frame, 77);
    assert_eq!(figures.doubt_catches, Some(1.0), "doubt was made to know");
}

#[test]
fn a_proposal_that_is_the_expert_s_own_regrets_nothing_and_a_bad_one_does() {
    let folder = Folder::new("regret");
    let same = of(&folder, &Drive::PLAIN).unwrap().figures.regret;
    assert!(same.max.abs() < 1e-9 && same.mean.abs() < 1e-9, "{same:?}");
    let bad =
        of(&folder, &Drive { offset: |_| Twist::new(-0.3, 0.0), ..Drive::PLAIN }).unwrap().figures.regret;
    assert!(bad.mean > 0.3, "{bad:?}");
    assert!((bad.costs[0] - bad.costs[1] - bad.mean).abs() < 1e-6, "{bad:?}");
    assert!(bad.gaps[0] > bad.gaps[1] && bad.gaps[1] >= 0.0, "{bad:?}");
}

#[test]
fn frames_without_work_are_counted_and_not_compared() {
    let status = |number| if number <= 20 { Status::NoGoal } else { Status::Ok };
    let comparison = of(&Folder::new("statuses"), &Drive { status, ..Drive::PLAIN }).unwrap();
    assert_eq!(comparison.figures.frames, 100);
    let coverage = &comparison.recordings[0].coverage;
    assert_eq!((coverage.maps, coverage.both), (120, 120));
    assert_eq!(coverage.expert_statuses["no goal"], 20);
    let none = of(&Folder::new("idle"), &Drive { status: |_| Status::NoGoal, ..Drive::PLAIN }).unwrap_err();
    assert!(matches!(none, CompareError::NoPair { frames: 120, .. }), "{none}");
}

#[test]
fn a_gap_is_counted_and_does_not_mislead_the_join() {
    let comparison = of(&Folder::new("gap"), &Drive { missing: 50..70, ..ODD }).unwrap();
    assert_eq!(comparison.recordings[0].coverage.skipped, 20);
    assert_eq!(comparison.figures.frames, 100);
    assert_eq!(comparison.worst[0].frame, 77);
}

#[test]
fn the_conduct_of_the_arbiter_is_told_with_its_reasons() {
    let comparison = of(&Folder::new("conduct"), &Drive::PLAIN).unwrap();
    let conduct = &comparison.recordings[0].conduct;
    // Frames 30 to 39, 70 to 79 and 110 to 119 were stops.
    assert_eq!(conduct.winners["stop"].count, 3);
    assert!((conduct.winners["stop"].total_s - 3.0 * 10.0 / 30.0).abs() < 1e-3, "{conduct:?}");
    assert_eq!(
        conduct.takeovers.iter().map(|t| (t.from, t.to, t.count)).collect::<Vec<_>>(),
        [("policy", "stop", 3), ("stop", "policy", 3)]
    );
    let outcome = conduct.outcome.unwrap();
    assert_eq!((outcome.arrivals, outcome.contacts), (2, 1));
    assert!((comparison.recordings[0].ages[0].unwrap().p50_ms - 10.0).abs() < 1e-3);
}

#[test]
fn a_recording_without_a_proposer_is_refused_by_the_topic_that_it_lacks() {
    let folder = Folder::new("lacks");
    for (runs, lacks) in [([false, true], "policy_command"), ([true, false], "expert_command")] {
        let error = of(&folder, &Drive { runs, ..Drive::PLAIN }).unwrap_err();
        assert!(matches!(&error, CompareError::NoProposals { needed, .. } if needed == lacks), "{error}");
    }
    let both = of(&folder, &Drive { runs: [false; 2], ..Drive::PLAIN }).unwrap_err().to_string();
    assert!(both.contains("no policy_command and no expert_command"), "{both}");
    let robot = of(&folder, &Drive { robot: false, ..Drive::PLAIN }).unwrap_err().to_string();
    assert!(robot.contains("robot.toml is not in it"), "{robot}");
}

#[test]
fn a_cut_recording_is_compared_as_far_as_it_goes_and_says_so() {
    let folder = Folder::new("cut");
    let bytes = Drive { frames: 1200, ..ODD }.record();
    let path = folder.write("cut.mcap", &bytes[..bytes.len() / 2]);
    let comparison = compare(&options(&path)).unwrap();
    assert!((10..1200).contains(&comparison.figures.frames), "{}", comparison.figures.frames);
    assert!(comparison.text().contains(", cut: "), "{}", comparison.text());
    assert!(comparison.report().unwrap().html().contains("cut.mcap is cut"));
}

#[test]
fn files_that_are_no_recordings_are_refused() {
    let folder = Folder::new("foreign");
    let path = folder.write("notes.mcap", b"not a recording at all");
    let error = compare(&options(&path)).unwrap_err();
    assert!(matches!(error, CompareError::Recording(PlayerError::NotMcap { .. })), "{error}");
    let error = compare(&options(&folder.0.join("nowhere.mcap"))).unwrap_err();
    assert!(matches!(error, CompareError::Recording(PlayerError::Read { .. })), "{error}");
}

fn pair(folder: &Folder, a: &Drive, b: &Drive) -> Result<Comparison, CompareError> {
    let file = folder.write("a.mcap", &a.record());
    let other = Some(folder.write("b.mcap", &b.record()));
    compare(&Options { other, ..options(&file) })
}

#[test]
fn two_models_are_compared_where_they_saw_the_same() {
    let folder = Folder::new("two");
    let slow = Drive { offset: |_| Twist::new(-0.1, 0.0), missing: 30..40, ..Drive::PLAIN };
    let comparison = pair(&folder, &Drive::PLAIN, &slow).unwrap();
    assert_eq!((comparison.figures.frames, comparison.seen_differently), (110, 0));
    let errors = comparison.figures.windows[1].errors;
    assert!((errors.v_mean - 0.1).abs() < 1e-3 && errors.w_mean < 1e-6, "{errors:?}");
    assert!(comparison.figures.regret.mean < -0.05, "A is the better one: {:?}", comparison.figures.regret);
    // Neither needs an expert.
    let alone = Drive { runs: [true, false], ..Drive::PLAIN };
    assert_eq!(pair(&folder, &alone, &alone).unwrap().figures.frames, 120);
    assert_eq!(comparison.names, ["A", "B"]);
}

#[test]
fn recordings_of_other_places_are_not_compared() {
    let folder = Folder::new("places");
    let error = pair(&folder, &Drive::PLAIN, &Drive { world: 3, ..Drive::PLAIN }).unwrap_err();
    assert!(matches!(error, CompareError::NoCommonFrame { held: 120, same: 0, .. }), "{error}");
}

#[test]
fn a_mined_sample_is_the_frame_and_carries_the_solved_label() {
    let folder = Folder::new("mine");
    let file = folder.write("drive.mcap", &ODD.record());
    let out = folder.0.join("mined.sidedata");
    let mine = Some(Mine { count: 5, out: out.clone() });
    let asked = Options { mine, ..options(&file) };
    assert_eq!(compare(&asked).unwrap().mined, Some(5));
    let data = Dataset::open(&out).unwrap();
    data.require(&robot()).unwrap();
    assert_eq!((data.header().count, data.header().by_source), (5, [0, 5]));
    assert_eq!(data.header().seed, 0x1234_5678_9abc, "the number of the run");
    let record = data.read(0).unwrap();
    let (map, goal) = ODD.seen(77);
    assert_eq!((record.stream, record.source), (77, Source::Demonstration as u8));
    assert_eq!(record.planning_cost, map.planning_cost);
    assert_eq!((u32::from(record.goal_cell), record.twist()), (goal.cell, goal.twist));
    let place = [record.goal_x_m, record.goal_y_m].map(f32::to_bits);
    assert_eq!(place, [goal.x_m, goal.y_m].map(f32::to_bits));
    assert!(record.cost_solved <= record.cost_734, "{record:?}");
    assert_eq!(record.kind, 4 + 128, "a drive, partly unknown");
    // Once more: refused, and the file is what it was.
    let before = std::fs::read(&out).unwrap();
    let error = compare(&asked).unwrap_err();
    assert!(matches!(error, CompareError::Dataset(TrainError::Exists { .. })), "{error}");
    assert_eq!(std::fs::read(&out).unwrap(), before);
}

#[test]
fn a_number_of_samples_that_cannot_be_is_refused() {
    let folder = Folder::new("none");
    let file = folder.write("drive.mcap", &ODD.record());
    for count in [0, 100_001] {
        let mine = Some(Mine { count, out: folder.0.join("none.sidedata") });
        let error = compare(&Options { mine, ..options(&file) }).unwrap_err();
        assert!(matches!(error, CompareError::Option { .. }), "{error}");
    }
}

#[test]
fn the_same_recording_gives_the_same_report_and_every_number_is_one() {
    let folder = Folder::new("same");
    let [a, b] = [0, 1].map(|_| of(&folder, &ODD).unwrap());
    let html = a.report().unwrap().html();
    assert_eq!(html, b.report().unwrap().html());
    assert_eq!(a.json(), b.json());
    assert_eq!(a.overview().unwrap().svg(), b.overview().unwrap().svg());
    assert!(!html.contains("NaN"), "a picture with a number that is none");
    assert!(html.contains("Optimality gap") && html.contains("emergency") && html.contains("data:image/png"));
    assert_eq!(a.json()["frames"]["regret"].as_array().unwrap().len(), 120);
}

/// Twenty minutes of maps, one by one: the joiner holds two seconds of them.
#[test]
fn a_long_recording_is_not_held() {
    let mut joiner = Joiner::default();
    let message = bytemuck::bytes_of(&LocalMap::default()).to_vec();
    let mut gone = 0;
    for number in 1..=36_000 {
        let header = Header { source_frame: number, ..Header::default() };
        let entry = Entry { topic: LOCAL_MAP.index, header, message: message.clone(), logged_ns: 0 };
        gone += u64::from(joiner.take(&entry, number as f64 / 30.0).is_some());
        assert!(number - gone <= 64, "{number} {gone}");
    }
    while joiner.next().is_some() {
        gone += 1;
    }
    assert_eq!((gone, joiner.coverage.maps), (36_000, 36_000));
}

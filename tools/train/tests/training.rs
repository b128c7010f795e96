//! The promises of dataset, training and evaluation, on small ones.
#![allow(clippy::unwrap_used, clippy::float_cmp, clippy::print_stdout, reason = "a test fails by panicking")]

use sidestep_msgs::Robot;
use sidestep_train::*;
use std::path::{Path, PathBuf};

fn robot() -> Robot {
    Robot::from_toml("loomo.toml", include_str!("../../../launch/robots/loomo.toml")).unwrap()
}

struct Folder(PathBuf);

impl Folder {
    fn new(name: &str) -> Self {
        let path = std::env::temp_dir().join(format!("sidestep-train-{name}-{}", std::process::id()));
        std::fs::create_dir_all(&path).unwrap();
        Self(path)
    }
    fn file(&self, name: &str) -> PathBuf {
        self.0.join(name)
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir_all(&self.0);
    }
}

fn make(out: &Path, samples: u64, seed: u64, threads: usize) -> Header {
    let frames = Frames::Artificial;
    let options = DatasetOptions { out: out.into(), frames, samples, seed, threads, robot: robot() };
    dataset(&options, &mut |_| {}).unwrap()
}

const SMALL: &[ConvolutionSize] =
    &[ConvolutionSize { outputs: 8, stride: 2 }, ConvolutionSize { outputs: 12, stride: 2 }];

/// As many parameters as those, in other places.
const FINER: &[ConvolutionSize] =
    &[ConvolutionSize { outputs: 8, stride: 4 }, ConvolutionSize { outputs: 12, stride: 1 }];

fn options(folder: &Folder, out: &str) -> TrainOptions {
    let mut options = TrainOptions::standard(vec![folder.file("data")], folder.file(out), robot());
    options.shape = Shape { rounds: 6, convolutions: SMALL, hidden: [32, 16], ..options.shape };
    options.samples = 640;
    options.batch = 32;
    options
}

fn bytes(path: &Path) -> Vec<u8> {
    std::fs::read(path).unwrap()
}

#[test]
fn a_dataset_has_the_same_bytes_for_any_number_of_threads() {
    let folder = Folder::new("threads");
    let one = make(&folder.file("one"), 300, 5, 1);
    assert_eq!(one, make(&folder.file("three"), 300, 5, 3));
    assert_eq!(bytes(&folder.file("one")), bytes(&folder.file("three")));
    assert_ne!(one.content_hash, make(&folder.file("other"), 300, 6, 1).content_hash);
}

#[test]
fn a_longer_dataset_begins_with_the_shorter_one() {
    let folder = Folder::new("prefix");
    make(&folder.file("short"), 70, 5, 2);
    make(&folder.file("long"), 200, 5, 2);
    let (short, long) =
        (Dataset::open(&folder.file("short")).unwrap(), Dataset::open(&folder.file("long")).unwrap());
    for index in 0..70 {
        assert_eq!(short.read(index).unwrap(), long.read(index).unwrap());
    }
    assert!(short.read(70).is_err());
}

#[test]
fn solving_never_costs_more_than_the_best_candidate() {
    let folder = Folder::new("labels");
    make(&folder.file("data"), 200, 8, 2);
    let data = Dataset::open(&folder.file("data")).unwrap();
    for index in 0..200 {
        let record = data.read(index).unwrap();
        assert!(record.cost_solved <= record.cost_734, "record {index}");
        assert!(record.label_solved.iter().chain(&record.label_734).all(|x| x.is_finite()));
    }
}

/// Solves each frame as labels are solved, and again by a search several times as long from other starts: what differs is
/// not in the frame, and cannot be learned.
#[test]
fn a_label_says_little_about_the_length_of_its_search() {
    use sidestep_expert::{Effort, Mode, Planner, Weights};
    let robot = robot();
    let long = Effort { candidates: 8000, rounds: 20, rungs: &[(32, 250)] };
    let mut planners = [Effort::LIVE, Effort::LABEL, long]
        .map(|e| Planner::searching(&robot.limits, &Weights::STANDARD, 734, e));
    let (mut live, mut label) = (Difference::default(), Difference::default());
    for stream in 0..150 {
        let scene = scene(4242, stream, &robot);
        let [fast, labelled, best] = planners.each_mut().map(|planner| {
            let plan = planner.plan(&scene.planning_cost, scene.goal_cell, scene.twist, Mode::Solved);
            within_window(plan.twist, scene.twist, &robot.limits, WINDOWS_S[0])
        });
        live.add(fast, best);
        label.add(labelled, best);
    }
    let [live, label] = [live, label].map(|difference| difference.errors());
    println!("off a long search within 0.1 s, m/s and rad/s: live {live:?}, label {label:?}");
    assert!(label.v_mean < 0.004 && label.w_mean < 0.008, "{label:?}");
    assert!(label.v_mean < 0.7 * live.v_mean && label.w_mean < live.w_mean, "{label:?} {live:?}");
}

/// Plans on mirrored records: the augmentation of the trainer must not contradict the expert.
#[test]
fn the_label_of_a_mirrored_record_is_the_mirrored_label() {
    use sidestep_expert::{Effort, Mode, Planner, Weights};
    let folder = Folder::new("mirror");
    make(&folder.file("data"), 100, 9, 2);
    let data = Dataset::open(&folder.file("data")).unwrap();
    let mut planner = Planner::searching(&robot().limits, &Weights::STANDARD, 734, Effort::LABEL);
    for index in 0..100 {
        let record = data.read(index).unwrap();
        let mirror = record.mirrored();
        assert_eq!(mirror.mirrored(), record);
        let plan = planner.plan(&mirror.planning_cost, mirror.goal_cell.into(), mirror.twist(), Mode::Solved);
        assert_eq!([plan.twist.v_m_s, plan.twist.w_rad_s], mirror.label_solved);
    }
}

#[test]
fn what_is_no_dataset_is_refused_with_what_is_needed() {
    let folder = Folder::new("refused");
    let refuse = |bytes: &[u8]| {
        std::fs::write(folder.file("bad"), bytes).unwrap();
        Dataset::open(&folder.file("bad")).unwrap_err().to_string()
    };
    make(&folder.file("data"), 10, 1, 1);
    let good = bytes(&folder.file("data"));
    assert!(refuse(&[0; 5000]).contains("version 0"));
    assert!(refuse(&good[..good.len() - 1]).contains("needed 12576 bytes for 10 records"));
    assert!(refuse(&[]).contains("bad"));
    assert!(Dataset::open(&folder.file("absent")).unwrap_err().to_string().contains("absent"));
}

#[test]
fn a_model_has_the_same_bytes_for_any_number_of_threads() {
    let folder = Folder::new("model");
    make(&folder.file("data"), 200, 2, 2);
    for convolutions in [SMALL, &[]] {
        let mut one = TrainOptions { threads: 1, ..options(&folder, "one") };
        one.shape.convolutions = convolutions;
        let four = TrainOptions { threads: 4, out: folder.file("four"), ..one.clone() };
        train(&one, &mut |_| {}).unwrap();
        train(&four, &mut |_| {}).unwrap();
        assert_eq!(bytes(&one.out), bytes(&four.out));
    }
}

#[test]
fn a_resumed_run_ends_with_the_bytes_of_an_uninterrupted_one() {
    let folder = Folder::new("resume");
    make(&folder.file("data"), 200, 2, 2);
    let whole = TrainOptions { samples: 9600, ..options(&folder, "whole") };
    train(&whole, &mut |_| {}).unwrap();
    let broken = TrainOptions {
        checkpoint: Some(folder.file("checkpoint")),
        out: folder.file("broken"),
        ..whole.clone()
    };
    // The checkpoint of step 200 of 300, as a killed run leaves it, is what the second line of progress replaces.
    let mut kept = None;
    train(&broken, &mut |_| kept = kept.take().or_else(|| std::fs::read(folder.file("checkpoint")).ok()))
        .unwrap();
    let first = std::fs::read(folder.file("checkpoint")).unwrap();
    std::fs::remove_file(&broken.out).unwrap();
    std::fs::write(folder.file("checkpoint"), kept.unwrap()).unwrap();
    train(&broken, &mut |_| {}).unwrap();
    assert_eq!(bytes(&whole.out), bytes(&broken.out));
    assert_eq!(first, bytes(&folder.file("checkpoint")));
    let mut others = [TrainOptions { rate: 1e-3, ..broken.clone() }, broken.clone()];
    others[1].shape.convolutions = FINER;
    for other in others {
        assert!(train(&other, &mut |_| {}).unwrap_err().to_string().contains("another run"));
    }
}

#[test]
fn options_that_make_no_sense_are_named() {
    let folder = Folder::new("options");
    make(&folder.file("data"), 10, 3, 1);
    let refuse = |options: TrainOptions| train(&options, &mut |_| {}).unwrap_err().to_string();
    assert!(refuse(TrainOptions { batch: 10, ..options(&folder, "m") }).contains("multiple of 4"));
    assert!(refuse(TrainOptions { rate: f32::NAN, ..options(&folder, "m") }).contains("rate is NaN"));
    const UNFIT: [&[ConvolutionSize]; 3] = [
        &[SMALL[0]; 5],
        &[ConvolutionSize { outputs: 8, stride: 0 }],
        &[SMALL[0], ConvolutionSize { outputs: 300, stride: 1 }],
    ];
    for convolutions in UNFIT {
        let mut options = options(&folder, "m");
        options.shape.convolutions = convolutions;
        assert!(refuse(options).contains("needed: at most 4, of 1 to 256 planes, of stride 1 to 4"));
    }
    let mut robot = robot();
    robot.limits.turn_rad_s = 1.0;
    assert!(refuse(TrainOptions { robot, ..options(&folder, "m") }).contains("motion hash"));
}

/// The first records of each held-out set: whatever changes a map, a drive or a label shows here.
#[test]
fn the_held_out_data_are_those_that_figures_were_measured_on() {
    let folder = Folder::new("frozen");
    let prefix = |set: &FrozenSet| set.make(&folder.0, 64, 2, &robot(), &mut |_| {}).unwrap().content_hash;
    let found = FROZEN_SETS.each_ref().map(prefix);
    let needed = [9_978_376_645_044_243_879, 7_080_044_637_258_266_764, 6_442_799_202_512_810_994];
    assert_eq!(
        found, needed,
        "held-out data changed: make them again, update both lists of hashes, measure all figures again"
    );
}

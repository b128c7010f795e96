//! From nothing to an evaluated model, small: data set, training, tables and figures.
#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

use sidestep_evaluate::*;
use sidestep_msgs::Robot;
use sidestep_train::{
    ConvolutionSize, DatasetOptions, DriveProfile, Frames, Shape, TrainOptions, dataset, train,
};
use std::path::{Path, PathBuf};

fn robot() -> Robot {
    Robot::from_toml("loomo.toml", include_str!("../../../launch/robots/loomo.toml")).unwrap()
}

struct Folder(PathBuf);

impl Folder {
    fn new(name: &str) -> Self {
        let path = std::env::temp_dir().join(format!("sidestep-evaluate-{name}-{}", std::process::id()));
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

fn make(out: &Path, frames: Frames, samples: u64, seed: u64) -> PathBuf {
    let options = DatasetOptions { out: out.into(), frames, samples, seed, threads: 2, robot: robot() };
    dataset(&options, &mut |_| {}).unwrap();
    out.into()
}

fn learn(data: &[PathBuf], out: PathBuf) -> Vec<u8> {
    let mut options = TrainOptions::standard(data.to_vec(), out.clone(), robot());
    let convolutions =
        &[ConvolutionSize { outputs: 8, stride: 2 }, ConvolutionSize { outputs: 16, stride: 2 }];
    options.shape = Shape { rounds: 6, convolutions, hidden: [32, 16], ..options.shape };
    options.samples = 24_000;
    options.batch = 32;
    train(&options, &mut |_| {}).unwrap();
    std::fs::read(out).unwrap()
}

/// Maps and drives, a small network, every table: the model must take away a good part of the error of keeping u', on
/// worlds that it never saw, and a second training must give the same file.
#[test]
fn a_model_from_nothing_beats_keeping_the_velocity_and_comes_out_the_same_again() {
    let folder = Folder::new("learning");
    let drives = || Frames::Drives(DriveProfile { bursts: true, ..DriveProfile::default() });
    let data = [
        make(&folder.file("maps"), Frames::Artificial, 3000, 3),
        make(&folder.file("drives"), drives(), 1000, 4),
    ];
    let held_out = vec![make(&folder.file("other"), Frames::Artificial, 500, 5)];
    let model = learn(&data, folder.file("model.onnx"));
    assert_eq!(model, learn(&data, folder.file("again.onnx")));

    let options = EvaluateOptions {
        model: Some(folder.file("model.onnx")),
        training: data.to_vec(),
        held_out,
        foreign: vec![make(&folder.file("foreign"), drives(), 200, 6)],
        samples: 500,
        robot: robot(),
    };
    let mut lines = Vec::new();
    let evaluation = evaluate(&options, &mut |line| lines.push(line.to_owned())).unwrap();
    for name in ["random.train", "random.test", "by_world.test"] {
        let set = evaluation.table(name).unwrap();
        for window in &set.solved.windows {
            assert!(window.skill > 0.2, "{name}: {window:?}");
        }
    }
    assert!(evaluation.table("random.test").unwrap().samples < 300, "one record in twenty is left out");
    let json = evaluation.json();
    assert!(json["table1"]["by_world"]["test"]["solved"]["0.1"]["v_mean"].as_f64().unwrap() > 0.0);
    assert!(json["table1"]["random"]["train"]["734"]["0.3"]["w_std"].as_f64().unwrap() > 0.0);
    let own = |path: &str| json.pointer(path).unwrap().as_f64().unwrap();
    // More candidates are nearer to the optimum, and refining a proposal makes it cheaper.
    assert!(own("/fig6b/curves/0/points/0/1/solved/0") > own("/fig6b/curves/0/points/15/1/solved/0"));
    assert!(own("/fig6b/regret/refined/mean") < own("/fig6b/regret/policy/mean"));
    assert!(own("/fig6a/us/policy_us") > 0.0 && own("/doubt/foreign.test/v/calibration_error") >= 0.0);
    // Two implementations of eq. (6) agree, and free knots find little.
    let oracle = &evaluation.oracle;
    assert!(oracle.disagreement < 0.02 && oracle.gap >= 0.0, "{oracle:?}");
    assert!(oracle.gap < 0.2 * oracle.solved_cost, "{oracle:?}");
    let page = evaluation.report(&robot()).unwrap().html();
    for part in ["Table I", "Fig. 3", "Fig. 5", "Fig. 6b", "Table II", "Doubt about w", "0.0151"] {
        assert!(page.contains(part), "{part}");
    }
    assert!(!lines.is_empty() && evaluation.to_string().contains("by world test"));
}

#[test]
fn an_evaluation_without_data_or_with_a_model_of_another_robot_says_what_is_needed() {
    let folder = Folder::new("refused");
    let mut options = EvaluateOptions {
        model: None,
        training: Vec::new(),
        held_out: Vec::new(),
        foreign: Vec::new(),
        samples: 10,
        robot: robot(),
    };
    let refuse = |options: &EvaluateOptions| evaluate(options, &mut |_| {}).unwrap_err().to_string();
    assert!(refuse(&options).contains("needed: at least one"), "{}", refuse(&options));
    options.held_out = vec![make(&folder.file("data"), Frames::Artificial, 64, 1)];
    options.robot.limits.turn_rad_s = 1.0;
    assert!(refuse(&options).contains("motion_hash"), "{}", refuse(&options));
    std::fs::write(folder.file("cut.onnx"), &sidestep_policy::embedded()[..1000]).unwrap();
    options = EvaluateOptions { model: Some(folder.file("cut.onnx")), robot: robot(), ..options };
    assert!(refuse(&options).contains("cut.onnx"), "{}", refuse(&options));
    options.model = Some(folder.file("absent.onnx"));
    assert!(refuse(&options).contains("absent.onnx"), "{}", refuse(&options));
}

#[test]
fn a_page_of_samples_shows_both_labels() {
    let folder = Folder::new("samples");
    let data = make(&folder.file("data"), Frames::Artificial, 64, 1);
    let page = samples_report(&data, &robot(), 6).unwrap().html();
    assert_eq!(page.matches("<figure>").count(), 6);
    assert!(page.contains("734 candidates") && page.contains("solved"));
}

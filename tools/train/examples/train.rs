//! The commands of this crate by hand:
//!
//! ```text
//! train dataset OUT SAMPLES SEED | train info FILE | train train DATA OUT SAMPLES [CHECKPOINT] | train evaluate DATA [MODEL]
//! ```
#![allow(clippy::print_stdout, reason = "a command line")]

use sidestep_msgs::Robot;
use sidestep_train::{
    DatasetOptions, DriveProfile, EvaluateOptions, Frames, TrainOptions, dataset, dataset_info, evaluate,
    train,
};
use std::error::Error;
use std::path::PathBuf;

fn main() -> Result<(), Box<dyn Error>> {
    let robot = Robot::from_toml("loomo.toml", include_str!("../../../launch/robots/loomo.toml"))?;
    let words: Vec<String> = std::env::args().skip(1).collect();
    let words: Vec<&str> = words.iter().map(String::as_str).collect();
    let mut print = |line: &str| println!("{line}");
    let threads = std::thread::available_parallelism()?.get();
    match words.as_slice() {
        ["dataset", kind, out, samples, seed] => {
            let frames = match *kind {
                "artificial" => Frames::Artificial,
                kind => Frames::Drives(DriveProfile { policy: None, bursts: kind == "robust" }),
            };
            let options =
                DatasetOptions { out: out.into(), frames, samples: samples.parse()?, seed: seed.parse()?, threads, robot };
            println!("{:?}", dataset(&options, &mut print)?);
        }
        ["info", file] => println!("{:?}", dataset_info(&PathBuf::from(file))?),
        ["train", out, samples, hidden0, hidden1, threads, data @ ..] => {
            let data = data.iter().map(PathBuf::from).collect();
            let mut options = TrainOptions::standard(data, out.into(), robot);
            options.shape.hidden = [hidden0.parse()?, hidden1.parse()?];
            options.threads = threads.parse()?;
            options.samples = samples.parse()?;
            options.checkpoint = Some(PathBuf::from(format!("{out}.checkpoint")));
            println!("{:?}", train(&options, &mut print)?);
        }
        ["evaluate", data, model @ ..] => {
            let model = model.first().map(PathBuf::from);
            println!("{:#?}", evaluate(&EvaluateOptions { data: data.into(), model, samples: 20_000, robot })?);
        }
        _ => return Err("dataset OUT SAMPLES SEED | info FILE | train DATA OUT SAMPLES [CHECKPOINT] | evaluate DATA [MODEL]".into()),
    }
    Ok(())
}

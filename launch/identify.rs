//! `sidestep identify`: what a base really does, against what its robot file says.

use crate::failure::Failure;
use crate::look::only_run;
use crate::manifest::robot_named;
use crate::stick::{Stick, may_drive_at, robot_of_run};
use sidestep_bus::{DomainName, host_ns};
use sidestep_identify::{Finding, Identification, IdentifyError, Series, actuator_block};
use sidestep_msgs::{Robot, Twist};
use sidestep_player::{Info, attachment};
use std::path::{Path, PathBuf};

/// `[ns]` driving ahead: the ramp, settling, and some steady motion.
const AHEAD_NS: u64 = 2_200_000_000;
/// `[ns]` standing between steps: the brake, and rest.
const REST_NS: u64 = 1_800_000_000;
/// `[ns]` most time for a turn, and listening at the end.
const TURN_MOST_NS: u64 = 8_000_000_000;
const RELEASE_NS: u64 = 200_000_000;
/// `[rad/s]` turn rate, and the turn at which to stop: what is missing to half a turn is what stopping takes.
const TURN_RAD_S: f32 = 1.0;
const TURN_RAD: f64 = core::f64::consts::PI - 0.3;
/// Fewest step tests from which a robot file may be judged.
const TESTS_LEAST: usize = 3;

/// What to measure.
#[derive(Debug, clap::Args)]
pub(crate) struct IdentifyArguments {
    /// A recording of a drive; without it, steps are driven in the live run, through the arbiter's filter.
    file: Option<PathBuf>,
    /// Steps to drive: each second one is a stop. They need a disc of free floor, 2 m in radius.
    #[arg(long, default_value_t = 20, conflicts_with = "file")]
    steps: usize,
    /// `[m/s]` speed of the steps.
    #[arg(long, default_value_t = 0.5, conflicts_with = "file")]
    speed: f32,
    /// The robot file to judge: built-in name or path; without it, the one of the recording or run.
    #[arg(long)]
    robot: Option<String>,
    /// Writes the figures, with those of every step, as JSON.
    #[arg(long)]
    json: Option<PathBuf>,
}

/// A recording without what it takes is input.
pub(crate) fn failure(error: &IdentifyError) -> Failure {
    Failure::io(error.to_string())
}

/// The robot file of a recording, with its text.
///
/// # Errors
/// Exit code 2 where it holds none that can be read, 3 where the recording cannot.
pub(crate) fn robot_of_recording(file: &Path) -> Result<(Robot, String), Failure> {
    let unreadable = |error: sidestep_player::PlayerError| Failure::io(error.to_string());
    let info = Info::read(file).map_err(unreadable)?;
    if !info.attachments.contains_key("robot.toml") {
        let why = "holds no robot file, as an import or a cut recording; name one with --robot";
        return Err(Failure::usage(format!("{}: {why}", file.display())));
    }
    let bytes = attachment(file, "robot.toml").map_err(unreadable)?;
    let text = String::from_utf8_lossy(&bytes).into_owned();
    let robot = Robot::from_toml("robot.toml of the recording", &text)
        .map_err(|error| Failure::usage(error.to_string()))?;
    Ok((robot, text))
}

/// Drives ahead and stops, turns round and comes back, and so on.
fn drive(run: &DomainName, steps: usize, v_m_s: f32) -> Result<Series, Failure> {
    may_drive_at(v_m_s)?;
    let mut stick = Stick::take(run)?;
    for step in 0..steps.div_ceil(2) {
        stick.hold(Some(Twist::new(v_m_s, 0.0)), AHEAD_NS)?;
        stick.hold(Some(Twist::STOP), REST_NS)?;
        crate::output::note(format!("step {} of {steps}: {}", 2 * step + 2, stick.reason()));
        let (begin_rad, until_ns) = (stick.turned_rad, host_ns() + TURN_MOST_NS);
        while stick.turned_rad - begin_rad < TURN_RAD && host_ns() < until_ns {
            stick.wish(Some(Twist::new(0.0, TURN_RAD_S)))?;
        }
        stick.hold(Some(Twist::STOP), REST_NS)?;
    }
    stick.hold(None, RELEASE_NS)?;
    Ok(stick.series)
}

/// Measures, prints table and block, and says what the robot file does not contain.
///
/// # Errors
/// Exit code 1 where the robot file does not contain what was measured or too little could be, 2 for a robot that is
/// none, 3 for a recording that cannot be read.
pub(crate) fn identify(arguments: &IdentifyArguments) -> Result<(), Failure> {
    arguments.json.iter().try_for_each(|path| crate::output::may_write(path))?;
    let (series, own) = match &arguments.file {
        Some(file) => (Series::read(file).map_err(|error| failure(&error))?, robot_of_recording(file)),
        None => {
            let run = only_run()?;
            (drive(&run, arguments.steps, arguments.speed)?, robot_of_run(&run))
        }
    };
    let (robot, text) = arguments.robot.as_deref().map_or(own, robot_named)?;
    let found = Identification::of(&series);
    crate::output::line(found.text().trim_end());
    let findings = found.findings(&robot.actuator);
    if let Some(path) = &arguments.json {
        let mut value = serde_json::to_value(&found).unwrap_or_default();
        value["robot"] = robot.name.clone().into();
        value["findings"] = serde_json::to_value(&findings).unwrap_or_default();
        crate::output::json(path, &value)?;
    }
    if found.tests.len() < TESTS_LEAST {
        let why = "needed: at least 3, each a change of the command by 0.2 m/s or 0.4 rad/s; drive starts and stops, or run";
        let count = found.tests.len();
        return Err(Failure::unmet(format!("{count} step tests in this drive; {why} `sidestep identify`")));
    }
    crate::output::line(&format!("\n{}", actuator_block(&found, &text).trim_end()));
    judge(&robot, &findings)
}

fn judge(robot: &Robot, findings: &[Finding]) -> Result<(), Failure> {
    if findings.is_empty() {
        crate::output::line(&format!("\nrobot {}: its file contains what was measured", robot.name));
        return Ok(());
    }
    let mut text = format!("robot {}: its file does not contain what was measured", robot.name);
    for Finding { key, found, file, needed } in findings {
        text.push_str(&format!(
            "\n  actuator.{key}: measured {found:.4}, the file has {file}, needed: {needed}"
        ));
    }
    text.push_str("\n  put the block above in place of [actuator] in the robot file");
    Err(Failure::unmet(text))
}

//! `sidestep doctor`: whether machine, installation and base are fit for a drive, one line each.

use crate::failure::Failure;
use crate::identify::{failure, robot_of_recording};
use crate::look::only_run;
use crate::manifest::robot_named;
use crate::space::{REMEDY, SHARED_MEMORY, shared_memory, space_mb};
use crate::stick::{may_drive_at, robot_of_run};
use sidestep_bus::{host_ns, live_domains, runtime_root};
use sidestep_identify::{Onset, Series, Verdict, Watchdog};
use sidestep_msgs::Robot;
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};

/// What to check.
#[derive(Debug, clap::Args)]
pub(crate) struct DoctorArguments {
    /// A recording in which commands ceased while the robot drove: measures the watchdog of its base.
    file: Option<PathBuf>,
    /// Robot file: built-in name or path; without it, that of the recording or run, else loomo.
    #[arg(long)]
    robot: Option<String>,
    /// A policy model instead of the embedded one.
    #[arg(long, default_value = "")]
    model: String,
    /// Where recordings will be written.
    #[arg(long, default_value = "recordings")]
    record: PathBuf,
    /// Measures the watchdog of the base of the live run: drives ahead, then halts the arbiter.
    #[arg(long, conflicts_with = "file")]
    base: bool,
    /// `[m/s]` speed for --base.
    #[arg(long, default_value_t = 0.4)]
    speed: f32,
    /// Confirms that 3 m ahead are free, should the base not brake.
    #[arg(long)]
    yes_the_robot_may_roll: bool,
    /// Writes the same as JSON.
    #[arg(long)]
    json: Option<PathBuf>,
}

/// How a check ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "snake_case")]
enum State {
    Ok,
    /// The run works, with less.
    Note,
    Bad,
}

/// One thing that was looked at.
#[derive(Debug, serde::Serialize)]
struct Check {
    name: &'static str,
    state: State,
    found: String,
    needed: &'static str,
    remedy: &'static str,
}

impl Check {
    fn line(&self) -> String {
        let Self { name, state, found, needed, remedy } = self;
        match state {
            State::Ok => format!("ok    {name}: {found}"),
            State::Note => format!("note  {name}: {found}; needed: {needed}; {remedy}"),
            State::Bad => format!("bad   {name}: {found}; needed: {needed}; {remedy}"),
        }
    }
}

/// A check that is fine or not, and how bad it is if not.
fn check(
    name: &'static str,
    (fine, otherwise): (bool, State),
    found: String,
    needed: &'static str,
    remedy: &'static str,
) -> Check {
    Check { name, state: if fine { State::Ok } else { otherwise }, found, needed, remedy }
}

/// A limit of this process, as the kernel lists it; the largest number = none.
fn limit(name: &str) -> u64 {
    let limits = std::fs::read_to_string("/proc/self/limits").unwrap_or_default();
    let value = limits.lines().find_map(|line| line.strip_prefix(name)?.split_whitespace().next());
    value.map_or(0, |value| value.parse().unwrap_or(u64::MAX))
}

/// Whether a file can be made in a folder, which is made where there is none.
fn writable(folder: &Path) -> Result<(), std::io::Error> {
    std::fs::create_dir_all(folder)?;
    let probe = folder.join(format!("doctor-{}", std::process::id()));
    std::fs::write(&probe, [0])?;
    std::fs::remove_file(&probe)
}

fn folder_check(name: &'static str, folder: &Path, remedy: &'static str) -> Check {
    let outcome = writable(folder);
    let found = match &outcome {
        Ok(()) => format!("{} can be written", folder.display()),
        Err(error) => format!("{}: {error}", folder.display()),
    };
    check(name, (outcome.is_ok(), State::Bad), found, "a folder that this user can write", remedy)
}

/// Shared memory, folders and disk.
fn places(record: &Path) -> Vec<Check> {
    let memory = shared_memory();
    let disk = record.ancestors().find(|path| path.is_dir()).unwrap_or(Path::new("."));
    let (disk_free, _) = space_mb(disk).unwrap_or_default();
    let root = runtime_root();
    let folders = std::fs::read_dir(&root).into_iter().flatten().flatten();
    let (live, all) = (live_domains().len(), folders.filter(|entry| entry.path().is_dir()).count());
    let stale = all.saturating_sub(live);
    vec![
        check(
            "shared memory",
            (memory.as_ref().is_none_or(|(free, _)| *free >= 256), State::Bad),
            memory.map_or_else(|| format!("{SHARED_MEMORY} without a limit"), |(_, found)| found),
            "256 MB free",
            REMEDY,
        ),
        folder_check("shared files", Path::new(SHARED_MEMORY), "give this user rights on /dev/shm"),
        folder_check("runs", &root, "remove it, or set XDG_RUNTIME_DIR to a short path of this user"),
        check(
            "stale runs",
            (stale == 0, State::Note),
            format!("{live} alive, {stale} left by killed launchers"),
            "none",
            "the next `sidestep run` of this user wipes them",
        ),
        check(
            "disk",
            (disk_free >= 1000, State::Bad),
            format!("{disk_free} MB free for {}", record.display()),
            "1000 MB free; the recorder ends at 500",
            "free the disk, or name another folder with --record",
        ),
    ]
}

/// Processor, clock and what the user may.
fn machine() -> Vec<Check> {
    let cores = std::thread::available_parallelism().map_or(1, std::num::NonZero::get);
    let class = sidestep_policy::kernel_class();
    let first_ns = host_ns();
    let step_ns = (0..100_000).map(|_| host_ns() - first_ns).find(|&step_ns| step_ns > 0).unwrap_or(u64::MAX);
    let (priority, locked) = (limit("Max realtime priority"), limit("Max locked memory"));
    let root = is_root();
    let locked_mb = locked >> 20;
    let locked_text = if locked == u64::MAX { "no limit".to_owned() } else { format!("{locked_mb} MB") };
    vec![
        check(
            "cores",
            (cores >= 2, State::Note),
            format!("{cores}"),
            "2",
            "latencies grow: the graph waits for itself",
        ),
        check(
            "processor",
            (class == "fused", State::Note),
            format!("kernel class {class}"),
            "fused multiply-add",
            "the policy is slower, and its recordings replay exactly on such machines only",
        ),
        check(
            "clock",
            (step_ns <= 1_000_000, State::Bad),
            format!("CLOCK_MONOTONIC moves on after {step_ns} ns"),
            "at most 1 ms",
            "choose another clock source of the kernel (tsc or hpet)",
        ),
        check(
            "real time",
            (root || priority >= 50, State::Note),
            if root { "root".to_owned() } else { format!("RLIMIT_RTPRIO {priority}") },
            "50 for nodes with `priority`",
            "set LimitRTPRIO=50 in the service, or rtprio in limits.conf",
        ),
        check(
            "locked memory",
            (root || locked_mb >= 1024, State::Note),
            if root { "root".to_owned() } else { locked_text },
            "1024 MB for nodes with `lock_memory`",
            "set LimitMEMLOCK=infinity in the service, or memlock in limits.conf",
        ),
    ]
}

/// Root needs no limits.
fn is_root() -> bool {
    std::fs::metadata("/proc/self").is_ok_and(|data| data.uid() == 0)
}

/// Robot file and model.
fn files(robot: &Robot, text: &str, model: &str) -> Vec<Check> {
    let (guesses, values) = (text.matches("source = \"guess").count(), text.matches("source = \"").count());
    let config = sidestep_policy::Config { model: model.to_owned() };
    let loaded = config.load(robot).map(|_| "answers as recorded in it".to_owned());
    let fine = loaded.is_ok();
    vec![
        check(
            "robot file",
            (guesses == 0, State::Note),
            format!("{}: {guesses} of {values} values are guesses", robot.name),
            "none of those that the arbiter relies on",
            "measure with `sidestep identify`",
        ),
        check(
            "model",
            (fine, State::Bad),
            loaded.unwrap_or_else(|error| error.to_string()),
            "a model of this robot whose test answer repeats",
            "name another with --model",
        ),
    ]
}

/// The watchdog of the base against its limit.
fn watchdog(found: &Watchdog, robot: &Robot) -> Check {
    let dead_s = f64::from(robot.actuator.dead_time_min_s);
    let (count, unfit) = (found.lapses.len(), found.unfit);
    let mut text = format!("commands ceased {count} times in steady motion, {unfit} times otherwise");
    for lapse in &found.lapses {
        let said = match lapse.onset {
            Onset::After(after_s) => format!("braking began {:+.0} ms after valid_until", after_s * 1e3),
            Onset::NotWithin(within_s) => {
                format!("no braking within {:.0} ms of valid_until", within_s * 1e3)
            }
        };
        text.push_str(&format!(", at {:.2} m/s {said}", lapse.speed_m_s));
    }
    let net = |net_s: f64| format!("; {:.0} ms without the dead time of {:.0} ms", net_s * 1e3, dead_s * 1e3);
    let (fine, state) = match found.verdict(dead_s) {
        Verdict::Unknown => (false, State::Bad),
        Verdict::Brakes(net_s) => {
            text.push_str(&net(net_s));
            (true, State::Ok)
        }
        Verdict::Late(net_s) => {
            text.push_str(&net(net_s));
            (false, State::Bad)
        }
    };
    let remedy = match found.verdict(dead_s) {
        Verdict::Unknown => "halt the arbiter while the robot drives steadily, or use --base on a live run",
        _ => "let the base driver brake when valid_until of the newest command passes",
    };
    check("watchdog", (fine, state), text, "braking within 150 ms of valid_until", remedy)
}

/// Checks everything, one line each.
///
/// # Errors
/// Exit code 1 where a check is bad, 2 for a robot that is none or an unconfirmed --base, 3 for a recording that cannot
/// be read or a run that cannot be joined.
pub(crate) fn doctor(arguments: &DoctorArguments) -> Result<(), Failure> {
    arguments.json.iter().try_for_each(|path| crate::output::may_write(path))?;
    if arguments.base && !arguments.yes_the_robot_may_roll {
        let why = "--base drives the robot ahead and halts the arbiter: a base without watchdog rolls on for 0.3 s and \
                   more; needed: 3 m of free floor ahead and a hand at the stop; confirm with --yes-the-robot-may-roll";
        return Err(Failure::usage(why));
    }
    may_drive_at(arguments.speed)?;
    let run = if arguments.base { Some(only_run()?) } else { None };
    let (robot, text) = match (&arguments.robot, &arguments.file, &run) {
        (None, Some(file), _) => robot_of_recording(file)?,
        (None, None, Some(run)) => robot_of_run(run)?,
        (name, ..) => robot_named(name.as_deref().unwrap_or("loomo"))?,
    };
    let mut checks = places(&arguments.record);
    checks.extend(machine());
    checks.extend(files(&robot, &text, &arguments.model));
    let series = match (&arguments.file, &run) {
        (Some(file), _) => Some(Series::read(file).map_err(|error| failure(&error))?),
        (None, Some(run)) => Some(crate::silence::measure(run, arguments.speed)?),
        (None, None) => None,
    };
    checks.extend(series.map(|series| watchdog(&Watchdog::of(&series), &robot)));
    for check in &checks {
        crate::output::line(&check.line());
    }
    if let Some(path) = &arguments.json {
        crate::output::json(path, &serde_json::json!({ "robot": robot.name, "checks": checks }))?;
    }
    let bad: Vec<_> = checks.iter().filter(|check| check.state == State::Bad).map(|c| c.name).collect();
    if bad.is_empty() {
        return Ok(());
    }
    Err(Failure::unmet(format!("not fit for a drive: {}; the lines above say what to do", bad.join(", "))))
}

//! `sidestep play`: a recording in place of the sensors, and the keyboard that holds and steps it.

use crate::failure::Failure;
use crate::manifest::Graph;
use crate::run::{Options, quoted};
use clap::Args;
use sidestep_msgs::DEPTH;
use sidestep_player::{Config, Info, Played, Selection};
use std::path::{Path, PathBuf};

/// What to play, and how.
#[derive(Debug, Args)]
pub(crate) struct Arguments {
    /// An .mcap file.
    file: PathBuf,
    /// Graph seconds per host second.
    #[arg(long, default_value_t = 1.0)]
    rate: f64,
    /// Begins again at the end.
    #[arg(long = "loop")]
    repeat: bool,
    /// `[s]` how far into the recording to begin.
    #[arg(long, default_value_t = 0.0, allow_hyphen_values = true)]
    start_offset: f64,
    /// `[s]` how much of it to play; without it, to its end.
    #[arg(long, default_value_t = f64::INFINITY, allow_hyphen_values = true)]
    duration: f64,
    /// Only these topics of the driver, with commas between them.
    #[arg(long, value_delimiter = ',')]
    topics: Vec<String>,
    /// All of the driver's topics but these.
    #[arg(long, value_delimiter = ',')]
    exclude: Vec<String>,
    /// Plays a channel of the recording on a topic of the driver that has the same messages.
    #[arg(long, value_name = "CHANNEL:=TOPIC")]
    remap: Vec<String>,
    /// Stands before the first message until the space bar says go on.
    #[arg(long)]
    start_paused: bool,
    /// As fast as the graph answers, and every frame is answered: the same recording, the same bytes.
    #[arg(long, conflicts_with = "rate")]
    lockstep: bool,
    /// Leaves the keyboard alone: on a terminal, space pauses, n or right steps, up and down change the rate.
    #[arg(long)]
    no_keys: bool,
}

/// A list of texts as TOML.
fn list(texts: &[String]) -> String {
    toml::Value::Array(texts.iter().cloned().map(toml::Value::String).collect()).to_string()
}

/// A number as TOML, where a whole one needs its point.
fn number(value: f64) -> String {
    toml::Value::Float(value).to_string()
}

/// The run that plays a recording.
///
/// # Errors
/// Exit code 2 for what cannot be played so, 3 where the recording cannot be read.
pub(crate) fn play(arguments: &Arguments, run: Options) -> Result<Options, Failure> {
    let file = &arguments.file;
    let info = Info::read(file).map_err(|error| Failure::io(error.to_string()))?;
    let absolute = std::path::absolute(file).unwrap_or_else(|_| file.clone());
    let mut settings = vec![
        format!("player.file={}", quoted(&absolute)),
        format!("player.rate={}", number(arguments.rate)),
        format!("player.repeat={}", arguments.repeat),
        format!("player.start_offset_s={}", number(arguments.start_offset)),
        format!("player.duration_s={}", number(arguments.duration)),
        format!("player.topics={}", list(&arguments.topics)),
        format!("player.exclude={}", list(&arguments.exclude)),
        format!("player.remap={}", list(&arguments.remap)),
        format!("player.paused={}", arguments.start_paused),
    ];
    if arguments.lockstep {
        settings.push("time=\"lockstep\"".into());
    }
    check(arguments, &absolute, &info)?;
    settings.extend(ages(&info));
    settings.extend(run.settings);
    let run = Options { settings, keys: !arguments.no_keys, ..run };
    // A graph that cannot be is told before anything else is.
    Graph::load(&run.graph, &run.settings)?;
    Ok(run)
}

/// Refuses what the recording cannot give, while its name and its channels are at hand.
fn check(arguments: &Arguments, file: &Path, info: &Info) -> Result<(), Failure> {
    let config = Config {
        file: file.to_owned(),
        rate: arguments.rate,
        repeat: arguments.repeat,
        start_offset_s: arguments.start_offset,
        duration_s: arguments.duration,
        topics: arguments.topics.clone(),
        exclude: arguments.exclude.clone(),
        remap: arguments.remap.clone(),
        paused: arguments.start_paused,
    };
    config.check().map_err(Failure::usage)?;
    let selection = Selection::of(&config).map_err(Failure::usage)?;
    let refused =
        |detail: String| Failure::usage(format!("recording {}: {detail}", arguments.file.display()));
    selection.check_against(info).map_err(refused)?;
    // The duration is that of the host's clock: in lockstep a recording holds more or less graph time than that.
    let beyond = arguments.start_offset > 0.0 && arguments.start_offset >= info.duration_s;
    let opened = |error: sidestep_player::PlayerError| Failure::io(error.to_string());
    if beyond && Played::open(file, &selection).map_err(opened)?.next().is_none() {
        return Err(refused(format!(
            "--start-offset is {} s and nothing comes after it, needed: less than the recording's graph time",
            arguments.start_offset
        )));
    }
    Ok(())
}

/// Frame periods for which map, goal, proposals and near field may be believed.
const AGE_FRAMES: f64 = 3.0;
/// `[Hz]` the frame rate that the age limits of the shipped graphs are made for; slower cameras need longer ones.
const AGE_RATE_HZ: f64 = 30.0;

/// Age limits of the arbiter in periods of the recording's frames, where these come more slowly than a graph expects.
fn ages(info: &Info) -> Vec<String> {
    let frames = info.channels.iter().find(|channel| channel.topic == DEPTH.row().name && channel.count > 1);
    let Some(rate_hz) = frames.map(|channel| channel.rate_hz).filter(|rate_hz| *rate_hz < 0.9 * AGE_RATE_HZ)
    else {
        return Vec::new();
    };
    let age_s = AGE_FRAMES / rate_hz;
    ["map", "goal", "proposal", "near_field"]
        .map(|input| format!("arbiter.{input}_age_s={age_s:.3}"))
        .to_vec()
}

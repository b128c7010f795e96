//! The one binary of sidestep: command line, launcher, and every node of the graph.

mod bags;
mod child;
mod compare;
mod doctor;
mod external;
mod failure;
mod falsify;
mod identify;
mod init;
mod interface;
mod keyboard;
mod learning;
mod live;
mod long;
mod look;
mod manifest;
mod monitor;
mod navigate;
mod notify;
mod operator;
mod output;
mod play;
mod recall;
mod record;
mod recordings;
mod recover;
mod replay;
mod report;
mod roles;
mod run;
mod silence;
mod space;
mod stick;
mod supervisor;
mod watched;

use clap::{Parser, Subcommand};
use failure::Failure;
use sidestep_msgs::EstopAction;
use std::io::Write;
use std::path::PathBuf;
use std::process::ExitCode;
use std::time::Duration;

/// Onboard obstacle avoidance for small ground robots.
#[derive(Debug, Parser)]
#[command(name = "sidestep", version, about, args_conflicts_with_subcommands = true)]
struct Arguments {
    #[command(subcommand)]
    command: Option<Commands>,
    #[command(flatten)]
    flags: RunFlags,
}

#[derive(Debug, clap::Args)]
struct RunFlags {
    /// Length of the drive, such as 30s or 2m; without it 30 s in the office, else until Ctrl-C.
    #[arg(long = "for", value_parser = duration)]
    time: Option<Duration>,
    /// Folder for the recording.
    #[arg(long)]
    record: Option<PathBuf>,
    /// Who drives: policy, expert, solved or refined.
    #[arg(long)]
    lead: Option<String>,
    /// A policy model instead of the embedded one.
    #[arg(long)]
    model: Option<PathBuf>,
    /// Changes a value of the graph file: NODE.KEY=VALUE, or KEY=VALUE for the graph itself.
    #[arg(long = "set", value_name = "NODE.KEY=VALUE")]
    settings: Vec<String>,
    /// Missed latency budgets count as failure (exit code 1).
    #[arg(long)]
    gate_latency: bool,
    /// Writes the summary as JSON.
    #[arg(long)]
    json: Option<PathBuf>,
}

#[derive(Debug, Subcommand)]
enum Commands {
    /// Runs a graph; without one, 30 s in the built-in office.
    Run {
        /// Built-in graph (sim, robot, play) or the path of a graph file.
        graph: Option<String>,
        #[command(flatten)]
        flags: RunFlags,
    },
    /// Writes graph.toml and robot.toml for a new robot.
    Init(init::InitArguments),
    /// Checks a graph file without starting anything.
    Check {
        /// Built-in graph or path.
        graph: String,
        /// As for `run`.
        #[arg(long = "set", value_name = "NODE.KEY=VALUE")]
        settings: Vec<String>,
    },
    /// Plays a recording into a live graph, open loop.
    Play {
        #[command(flatten)]
        play: play::Arguments,
        #[command(flatten)]
        flags: RunFlags,
    },
    /// Runs the nodes of a recording again and compares every byte.
    Replay(replay::ReplayArguments),
    /// Records the newest run beside whatever else runs, until Ctrl-C or its end.
    Record(record::RecordArguments),
    /// Keeps the last seconds: the recorder writes its black box into a file of its own.
    Snapshot,
    /// Says what a recording holds.
    Info {
        /// An .mcap or .mcap.active file.
        file: PathBuf,
        /// Writes the same as JSON.
        #[arg(long)]
        json: Option<PathBuf>,
    },
    /// Saves what can be read of a recording that was cut or damaged.
    Recover(recover::Arguments),
    /// Turns a folder of depth images or a ROS 2 bag into a recording.
    Import(bags::ImportArguments),
    /// Turns a recording into a ROS 2 bag.
    Export(bags::ExportArguments),
    /// Latencies per stage of a recording.
    Latency {
        /// An .mcap or .mcap.active file.
        file: PathBuf,
        /// Writes the figures as JSON.
        #[arg(long)]
        json: Option<PathBuf>,
        /// Writes a trace that Perfetto opens.
        #[arg(long)]
        trace: Option<PathBuf>,
        /// Missed latency budgets count as failure (exit code 1).
        #[arg(long)]
        gate_latency: bool,
    },
    /// Compares policy and expert of a recording, or the policies of two.
    Compare(compare::CompareArguments),
    /// Makes or describes a data set.
    Dataset {
        #[command(subcommand)]
        command: learning::DatasetCommands,
    },
    /// Trains a policy model.
    Train(learning::TrainArguments),
    /// Compares a policy model with the expert's labels.
    Evaluate(learning::EvaluateArguments),
    /// Drives closed loops in simulated worlds: rooms, and the paper's Figs. 7 to 9.
    Navigate(navigate::NavigateArguments),
    /// Drives the expert with each weight of eq. (6) halved and doubled.
    Tune(navigate::TuneArguments),
    /// Looks for a way to make the robot touch something in spite of the arbiter.
    Falsify(falsify::FalsifyArguments),
    /// Counts how often what stands in the way is known before it is too late to brake.
    Recall(recall::RecallArguments),
    /// Checks machine, installation and base before a drive.
    Doctor(doctor::DoctorArguments),
    /// Measures dead time, lag, braking and steady error of the base: in a recorded drive, or by driving steps.
    Identify(identify::IdentifyArguments),
    /// Prints message layouts for other languages.
    #[command(group(clap::ArgGroup::new("language").required(true)))]
    Interface {
        /// A C header.
        #[arg(long, group = "language")]
        c: bool,
        /// A Python module.
        #[arg(long, group = "language")]
        python: bool,
    },
    /// Looks at the topics of the newest run.
    Topic {
        #[command(subcommand)]
        command: TopicCommands,
    },
    /// Shows every node of the newest run, refreshed.
    Top {
        /// Ends after this time.
        #[arg(long = "for", value_parser = duration)]
        time: Option<Duration>,
        /// Time between pages.
        #[arg(long, value_parser = duration, default_value = "500ms")]
        every: Duration,
    },
    /// Shows the newest run in Foxglove or Lichtblick, over a WebSocket.
    Live(live::LiveArguments),
    /// Drives by hand while the command runs; the wish passes the same filter as any other.
    Teleop {
        /// `[m/s]` forward speed.
        #[arg(long, allow_hyphen_values = true, default_value_t = 0.0)]
        v: f32,
        /// `[rad/s]` turn rate, counter-clockwise.
        #[arg(long, allow_hyphen_values = true, default_value_t = 0.0)]
        w: f32,
        /// How long the dead man's switch is held.
        #[arg(long = "for", value_parser = duration, default_value = "1s")]
        time: Duration,
    },
    /// Stops the robot until `sidestep reset`.
    Estop,
    /// Releases the latch of an emergency stop.
    Reset,
    /// Stops the robot until `sidestep hold --release`.
    Hold {
        /// Ends the hold.
        #[arg(long)]
        release: bool,
    },
    /// One node; started by the launcher.
    #[command(hide = true)]
    Node {
        /// Its name.
        name: String,
    },
    /// Cleans up after killed nodes; started by the launcher.
    #[command(hide = true)]
    Sweep,
}

#[derive(Debug, Subcommand)]
enum TopicCommands {
    /// The table of topics.
    List,
    /// Measures the rate of a topic.
    Hz {
        /// The topic.
        topic: String,
        /// How long to listen.
        #[arg(long = "for", value_parser = duration, default_value = "3s")]
        time: Duration,
    },
    /// Prints the messages of a topic.
    Echo {
        /// The topic.
        topic: String,
        /// How many messages.
        #[arg(long, default_value_t = 1)]
        count: u64,
        /// How long to listen at most.
        #[arg(long = "for", value_parser = duration, default_value = "5s")]
        time: Duration,
    },
}

/// Reads 500ms, 30s, 2m or 1h.
fn duration(text: &str) -> Result<Duration, String> {
    let wrong = || format!("{text} is no duration; needed: a number with ms, s, m or h, such as 30s");
    let split = text.find(|c: char| !c.is_ascii_digit() && c != '.').ok_or_else(wrong)?;
    let number: f64 = text[..split].parse().map_err(|_| wrong())?;
    let unit_s = match &text[split..] {
        "ms" => 1e-3,
        "s" => 1.0,
        "m" => 60.0,
        "h" => 3600.0,
        _ => return Err(wrong()),
    };
    Duration::try_from_secs_f64(number * unit_s).map_err(|_| wrong())
}

/// Without a graph: half a minute in the office, and a goal must be reached there.
fn run_options(graph: Option<String>, flags: RunFlags) -> run::Options {
    let office = graph.is_none();
    run::Options {
        graph: graph.unwrap_or_else(|| "sim".to_owned()),
        time: flags.time.or_else(|| office.then_some(Duration::from_secs(30))),
        record: flags.record,
        lead: flags.lead,
        model: flags.model,
        settings: flags.settings,
        gate_latency: flags.gate_latency,
        json: flags.json,
        must_arrive: office,
        keys: false,
    }
}

fn topic(command: TopicCommands) -> Result<(), Failure> {
    match command {
        TopicCommands::List => output::line(look::list().trim_end()),
        TopicCommands::Hz { topic, time } => {
            let count = look::listen(&topic, false, time, u64::MAX)?;
            output::line(&format!("{topic}: {count} messages, {:.2} Hz", count as f64 / time.as_secs_f64()));
        }
        TopicCommands::Echo { topic, count, time } => {
            if look::listen(&topic, true, time, count)? == 0 {
                return Err(Failure::unmet(format!(
                    "{topic}: no message within {:.1} s",
                    time.as_secs_f64()
                )));
            }
        }
    }
    Ok(())
}

fn execute(command: Commands) -> Result<(), Failure> {
    match command {
        Commands::Run { graph, flags } => run::run(&run_options(graph, flags)),
        Commands::Init(arguments) => init::run(&arguments),
        Commands::Check { graph, settings } => {
            let graph = manifest::Graph::load(&graph, &settings)?;
            let names: Vec<_> = graph.nodes.iter().map(|node| node.name.as_str()).collect();
            output::line(&format!(
                "graph {}: {} nodes: {}; robot {}",
                graph.origin,
                names.len(),
                names.join(", "),
                graph.robot.name
            ));
            // Checked perhaps far from the robot: worth a word, not a failure.
            let _ = external::find_programs(&graph).map_err(|failure| output::note(failure.message));
            Ok(())
        }
        Commands::Play { play, flags } => {
            run::run(&play::play(&play, run_options(Some("play".to_owned()), flags))?)
        }
        Commands::Replay(arguments) => replay::run(&arguments),
        Commands::Record(arguments) => record::record(arguments),
        Commands::Snapshot => record::snapshot(),
        Commands::Info { file, json } => recordings::info(&file, json.as_deref()),
        Commands::Recover(arguments) => recover::recover(&arguments),
        Commands::Import(arguments) => bags::import(arguments),
        Commands::Export(arguments) => bags::export(&arguments),
        Commands::Latency { file, json, trace, gate_latency } => {
            recordings::latency(&file, json.as_deref(), trace.as_deref(), gate_latency)
        }
        Commands::Compare(arguments) => compare::compare(arguments),
        Commands::Dataset { command } => learning::dataset(command),
        Commands::Train(arguments) => learning::train(arguments),
        Commands::Evaluate(arguments) => learning::evaluate(arguments),
        Commands::Navigate(arguments) => navigate::navigate(&arguments),
        Commands::Tune(arguments) => navigate::tune(&arguments),
        Commands::Falsify(arguments) => falsify::falsify(&arguments),
        Commands::Recall(arguments) => recall::recall(&arguments),
        Commands::Doctor(arguments) => doctor::doctor(&arguments),
        Commands::Identify(arguments) => identify::identify(&arguments),
        Commands::Interface { c, .. } => {
            let language = if c { interface::Language::C } else { interface::Language::Python };
            output::line(interface::print(language).trim_end());
            Ok(())
        }
        Commands::Topic { command } => topic(command),
        Commands::Top { time, every } => look::top(time, every),
        Commands::Live(arguments) => live::live(&arguments),
        Commands::Teleop { v, w, time } => operator::teleop(v, w, time),
        Commands::Estop => said(EstopAction::Stop),
        Commands::Reset => said(EstopAction::Reset),
        Commands::Hold { release } => said(if release { EstopAction::Resume } else { EstopAction::Hold }),
        Commands::Node { name } => roles::run_node(&name),
        Commands::Sweep => roles::run_sweeper(),
    }
}

fn said(action: EstopAction) -> Result<(), Failure> {
    output::line(&operator::say(action)?);
    Ok(())
}

fn main() -> ExitCode {
    let arguments = Arguments::parse();
    let result = match arguments.command {
        Some(command) => execute(command),
        None => run::run(&run_options(None, arguments.flags)),
    };
    output::flush();
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(failure) => {
            // Nobody may be listening; the exit code says it too.
            let _ = writeln!(std::io::stderr(), "sidestep: {}", failure.message);
            ExitCode::from(failure.code)
        }
    }
}

//! `sidestep navigate` and `sidestep tune`: closed loops by the thousand, the counterparts of the paper's Figs. 7, 8 and
//! 9, and what each weight of the expert is worth.

use crate::failure::Failure;
use crate::learning::{read, threads};
use crate::long::LongArguments;
use crate::manifest::robot_named;
use clap::{Args, ValueEnum};
use sidestep_drive::{Lead, Sight};
use sidestep_navigate::{
    CorridorOptions, FIRST_SEED, NavigateError, Navigation, SEEDS, SIGHT, SuiteOptions, beside, corridors,
    rooms, sudden,
};
use std::path::PathBuf;

/// What to drive.
#[derive(Debug, Args)]
pub(crate) struct NavigateArguments {
    /// Unseen rooms at map level: both maps drawn from the world itself.
    #[arg(long, default_value_t = 0)]
    rooms: u64,
    /// Unseen rooms through the whole chain, depth to map to command.
    #[arg(long, default_value_t = 0)]
    full: u64,
    /// Kilometres under every lead and a reckless one, added up in a ledger.
    #[command(flatten)]
    long: LongArguments,
    /// Seed of the rooms; a robot has never been in those of another one.
    #[arg(long, default_value_t = 1)]
    pub(crate) seed: u64,
    /// Leads to drive; without it all four.
    #[arg(long)]
    lead: Vec<LeadName>,
    /// With the arbiter, without it, or both by turns.
    #[arg(long, default_value = "both")]
    arbiter: ArbiterUse,
    /// `[s]` a room not crossed within this is not reached.
    #[arg(long, default_value_t = 60.0)]
    pub(crate) limit: f64,
    /// The worlds of Fig. 7 and the scenes of Fig. 8.
    #[arg(long)]
    figures: bool,
    /// The corridors of Fig. 9: a model of demonstrations only, beside --model, which learned made-up maps too.
    #[arg(long)]
    normal: Option<PathBuf>,
    /// A model instead of the embedded one.
    #[arg(long)]
    pub(crate) model: Option<PathBuf>,
    /// Built-in robot or path of a robot file.
    #[arg(long, default_value = "loomo")]
    pub(crate) robot: String,
    /// Threads; no influence on the numbers.
    #[arg(long)]
    pub(crate) threads: Option<usize>,
    /// Writes the report, all in one page.
    #[arg(long)]
    html: Option<PathBuf>,
    /// Writes the figures.
    #[arg(long)]
    json: Option<PathBuf>,
}

/// As [`Lead`], on the command line.
#[derive(Debug, Clone, Copy, ValueEnum)]
enum LeadName {
    Policy,
    Expert,
    Solved,
    Refined,
}

/// Whether the arbiter takes part.
#[derive(Debug, Clone, Copy, ValueEnum)]
enum ArbiterUse {
    On,
    Off,
    Both,
}

/// How many rooms to tune in.
#[derive(Debug, Args)]
pub(crate) struct TuneArguments {
    /// Rooms for each set of weights.
    #[arg(long, default_value_t = 100)]
    rooms: u64,
    /// Built-in robot or path of a robot file.
    #[arg(long, default_value = "loomo")]
    robot: String,
    /// Threads; no influence on the numbers.
    #[arg(long)]
    threads: Option<usize>,
    /// Writes the figures.
    #[arg(long)]
    json: Option<PathBuf>,
}

/// Drives the expert with each of its weights halved and doubled, and prints what came of it, the best first.
///
/// # Errors
/// Exit code 2 for an option, 3 for a file.
pub(crate) fn tune(arguments: &TuneArguments) -> Result<(), Failure> {
    arguments.json.iter().try_for_each(|path| crate::output::may_write(path))?;
    let robot = robot_named(&arguments.robot)?.0;
    let mut progress = |line: &str| crate::output::note(line.to_owned());
    let mut trials =
        sidestep_navigate::tune(&robot, arguments.rooms, threads(arguments.threads), &mut progress)
            .map_err(|error| failure(&error))?;
    trials.sort_by(|a, b| a.score_s.total_cmp(&b.score_s));
    for trial in &trials {
        crate::output::line(&format!(
            "{:14} score {:6.2} s, reached {} of {}, contacts {}, clearance {:.3} m",
            trial.name, trial.score_s, trial.reached, trial.rooms, trial.contacts, trial.clearance_m
        ));
    }
    arguments.json.as_ref().map_or(Ok(()), |path| {
        let numbers = serde_json::to_value(&trials).map_err(|error| failure(&error.into()))?;
        crate::output::json(path, &numbers)
    })
}

pub(crate) fn failure(error: &NavigateError) -> Failure {
    match error {
        NavigateError::Option { .. } => Failure::usage(error.to_string()),
        _ => Failure::io(error.to_string()),
    }
}

/// Drives, prints the shares, and writes what was asked for.
///
/// # Errors
/// Exit code 1 for a contact while the arbiter was on, 2 for an option, 3 for a file.
pub(crate) fn navigate(arguments: &NavigateArguments) -> Result<(), Failure> {
    [&arguments.html, &arguments.json]
        .into_iter()
        .flatten()
        .try_for_each(|path| crate::output::may_write(path))?;
    if arguments.long.is_asked_for()? {
        return crate::long::long(arguments, &arguments.long);
    }
    if arguments.rooms + arguments.full == 0 && !arguments.figures && arguments.normal.is_none() {
        let text = "navigate: nothing to drive, needed: --rooms N, --full N, --figures, --normal MODEL or --suite long";
        return Err(Failure::usage(text));
    }
    let navigation = drive(arguments)?;
    print(&navigation);
    if let Some(path) = &arguments.html {
        let robot = robot_named(&arguments.robot)?.0;
        let subtitle = format!("robot {}", robot.name);
        let report = navigation.report(&robot, &subtitle).map_err(|error| failure(&error))?;
        crate::output::file(path, &report.html())?;
    }
    if let Some(path) = &arguments.json {
        let numbers = serde_json::to_value(&navigation).map_err(|error| failure(&error.into()))?;
        crate::output::json(path, &numbers)?;
    }
    let guarded = navigation.suites.iter().flat_map(|suite| &suite.groups).filter(|group| group.arbitrated);
    let contacts: u64 = guarded.map(|group| group.contact.count).sum();
    if contacts > 0 {
        return Err(Failure::unmet(format!("{contacts} contacts with the arbiter on")));
    }
    Ok(())
}

impl NavigateArguments {
    /// Bytes of the model that was asked for, and what to call it.
    pub(crate) fn model(&self) -> Result<(Vec<u8>, String), Failure> {
        Ok(match &self.model {
            None => (sidestep_policy::embedded().to_vec(), "embedded".to_owned()),
            Some(path) => (read(path)?, path.display().to_string()),
        })
    }
}

fn drive(arguments: &NavigateArguments) -> Result<Navigation, Failure> {
    let robot = robot_named(&arguments.robot)?.0;
    let (model, model_name) = arguments.model()?;
    let threads = threads(arguments.threads);
    let mut progress = |line: &str| crate::output::note(line.to_owned());
    let mut navigation = Navigation::default();
    for (count, sight) in [(arguments.rooms, Sight::Grid), (arguments.full, Sight::Camera)] {
        let options = SuiteOptions {
            robot: &robot,
            model: &model,
            model_name: &model_name,
            leads: leads(&arguments.lead),
            arbitrated: match arguments.arbiter {
                ArbiterUse::On => vec![true],
                ArbiterUse::Off => vec![false],
                ArbiterUse::Both => vec![true, false],
            },
            sight,
            limit_s: arguments.limit,
            threads,
        };
        if count > 0 {
            let suite = rooms(&options, arguments.seed, count, &mut progress);
            navigation.suites.push(suite.map_err(|error| failure(&error))?);
        }
    }
    if arguments.figures {
        let beside = beside(&robot, &model, &model_name, Sight::Grid);
        navigation.beside = beside.map_err(|error| failure(&error))?;
        navigation.sudden = sudden(&robot, &model, &model_name).map_err(|error| failure(&error))?;
    }
    if let Some(normal) = &arguments.normal {
        let normal = read(normal)?;
        let options = CorridorOptions {
            robot: &robot,
            models: [&normal, &model],
            first_seed: FIRST_SEED,
            seeds: SEEDS,
            sight: SIGHT,
            threads,
        };
        let driven = corridors(&options, &mut progress).map_err(|error| failure(&error))?;
        navigation.corridors = Some(driven);
    }
    Ok(navigation)
}

fn leads(asked: &[LeadName]) -> Vec<Lead> {
    if asked.is_empty() {
        return Lead::ALL.to_vec();
    }
    let lead = |name: &LeadName| match name {
        LeadName::Policy => Lead::Policy,
        LeadName::Expert => Lead::Expert,
        LeadName::Solved => Lead::Solved,
        LeadName::Refined => Lead::Refined,
    };
    asked.iter().map(lead).collect()
}

fn print(navigation: &Navigation) {
    for suite in &navigation.suites {
        crate::output::line(&format!("{}, sight {}, model {}", suite.name, suite.sight, suite.model));
        for group in &suite.groups {
            crate::output::line(&format!(
                "  {:8} arbiter {:3}  reached {}, contact {}, {:.2} m/s ({:.2} where both ways reached), standing {:.2} s, J {:.3}",
                group.lead.label(),
                if group.arbitrated { "on" } else { "off" },
                group.reached.text(),
                group.contact.text(),
                group.speed_m_s,
                group.shared_speed_m_s,
                group.standing_s,
                group.cost
            ));
        }
    }
    if let Some(corridors) = &navigation.corridors {
        for (name, contrast) in
            [("interventions", &corridors.interventions), ("takeovers", &corridors.takeovers)]
        {
            let [normal, mixed] = contrast.totals;
            crate::output::line(&format!("{name}: normal {normal}, mixed {mixed}, p {:.4}", contrast.p));
        }
    }
}

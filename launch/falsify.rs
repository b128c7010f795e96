//! `sidestep falsify`: an adversary against the arbiter's promise, inside its assumptions and with one of them relaxed.

use crate::failure::Failure;
use crate::learning::threads;
use crate::manifest::robot_named;
use clap::Args;
use sidestep_falsify::{Assumption, Case, Evaluator, FalsifyError, Search, SearchOptions, Trace, search};
use sidestep_msgs::{Code, Reason, Robot};
use std::path::PathBuf;

/// Evaluations with an assumption relaxed, unless told otherwise: what it takes within minutes.
const RELAXED_EVALUATIONS: u64 = 100_000;

/// What to attack.
#[derive(Debug, Args)]
pub(crate) struct FalsifyArguments {
    /// Most evaluations, each at most 3 s of the arbiter's ticks; without it 10,000, and 100,000 for each --relax.
    #[arg(long)]
    evaluations: Option<u64>,
    /// Seed of the search.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Relaxes one assumption (brake, `dead_time`, drift, recall, stamps, watchdog, `start_disc`, mover), or each in turn
    /// (all).
    #[arg(long)]
    relax: Option<String>,
    /// Replays one case, as a report names it, tick by tick.
    #[arg(long, conflicts_with_all = ["relax", "evaluations"])]
    case: Option<String>,
    /// How many of the worst cases to name.
    #[arg(long, default_value_t = 5)]
    worst: usize,
    /// Built-in robot or path of a robot file.
    #[arg(long, default_value = "loomo")]
    robot: String,
    /// Threads; no influence on what is found.
    #[arg(long)]
    threads: Option<usize>,
    /// Draws the case, or the worst one found.
    #[arg(long)]
    svg: Option<PathBuf>,
    /// Writes the figures.
    #[arg(long)]
    json: Option<PathBuf>,
}

fn failure(error: &FalsifyError) -> Failure {
    match error {
        FalsifyError::Report(_) => Failure::io(error.to_string()),
        _ => Failure::usage(error.to_string()),
    }
}

/// Searches or replays, and prints what was found.
///
/// # Errors
/// Exit code 1 for a contact inside the assumptions, or none where one is relaxed; 2 for an option, 3 for a file.
pub(crate) fn falsify(arguments: &FalsifyArguments) -> Result<(), Failure> {
    [&arguments.svg, &arguments.json]
        .into_iter()
        .flatten()
        .try_for_each(|path| crate::output::may_write(path))?;
    let robot = robot_named(&arguments.robot)?.0;
    if let Some(word) = &arguments.case {
        return replay(arguments, &robot, word);
    }
    let mut searches = Vec::new();
    for relaxed in relaxed(arguments.relax.as_deref())? {
        searches.push(attack(arguments, &robot, relaxed)?);
    }
    if let Some(path) = &arguments.json {
        let told = searches.iter().map(|(search, seconds)| {
            serde_json::json!({
                "search": search,
                "seconds": seconds,
                "seed": arguments.seed,
                "robot": robot.name,
                "scenarios": search.worst.iter().map(|found| scenario(&robot, &found.case)).collect::<Vec<_>>(),
            })
        });
        crate::output::json(path, &serde_json::Value::Array(told.collect()))?;
    }
    let worst = searches.first().and_then(|(search, _)| search.worst.first());
    if let (Some(path), Some(found)) = (&arguments.svg, worst) {
        draw(path, &robot, &found.case)?;
    }
    verdict(&searches)
}

/// What is to be searched: nothing relaxed, one assumption, or each of them.
fn relaxed(name: Option<&str>) -> Result<Vec<Option<Assumption>>, Failure> {
    match name {
        None => Ok(vec![None]),
        Some("all") => Ok(Assumption::ALL.into_iter().map(Some).collect()),
        Some(name) => Assumption::named(name).map(|assumption| vec![Some(assumption)]).ok_or_else(|| {
            let names: Vec<_> = Assumption::ALL.iter().map(|assumption| assumption.label()).collect();
            Failure::usage(format!("falsify: --relax is `{name}`, needed: {} or all", names.join(", ")))
        }),
    }
}

fn attack(
    arguments: &FalsifyArguments,
    robot: &Robot,
    relaxed: Option<Assumption>,
) -> Result<(Search, f64), Failure> {
    let usual = if relaxed.is_some() { RELAXED_EVALUATIONS } else { 10_000 };
    let options = SearchOptions {
        robot,
        relaxed,
        seed: arguments.seed,
        evaluations: arguments.evaluations.unwrap_or(usual),
        threads: threads(arguments.threads),
        stops: relaxed.is_some(),
        keep: arguments.worst.max(1),
    };
    let begun_ns = sidestep_bus::host_ns();
    let seconds = || (sidestep_bus::host_ns() - begun_ns) as f64 * 1e-9;
    let found = search(&options, &mut |evaluations, contacts, worst_m| {
        let rate = evaluations as f64 / seconds().max(1e-3);
        crate::output::note(format!(
            "falsify: {evaluations} evaluations, {contacts} contacts, worst {worst_m:.4} m, {rate:.0} a second"
        ));
    });
    let found = found.map_err(|error| failure(&error))?;
    print(&found, seconds(), relaxed);
    Ok((found, seconds()))
}

fn print(search: &Search, seconds: f64, relaxed: Option<Assumption>) {
    let rate = search.evaluations as f64 / seconds.max(1e-3);
    let first = match &search.first_contact {
        Some(found) => format!("first contact after {} evaluations", found.evaluation),
        None => "no contact".to_owned(),
    };
    let worst_m = search.worst.first().map_or(f64::INFINITY, |found| found.outcome.robustness_m);
    crate::output::line(&format!(
        "{:10} {first}, {} evaluations, {seconds:.1} s, {rate:.0} a second, worst {worst_m:.4} m{}",
        search.relaxed,
        search.evaluations,
        relaxed.map_or(String::new(), |assumption| format!(" ({})", assumption.relaxed())),
    ));
    // With an assumption relaxed one case is enough to see how.
    let shown = if relaxed.is_some() { 1 } else { search.worst.len() };
    for found in search.worst.iter().take(shown) {
        crate::output::line(&format!("  {:8.4} m  {}", found.outcome.robustness_m, found.case));
    }
}

/// All parameters of a case.
fn scenario(robot: &Robot, word: &str) -> serde_json::Value {
    let made = Case::from_word(word).and_then(|case| Ok(Evaluator::new(robot)?.scenario(&case)));
    made.ok().and_then(|scenario| serde_json::to_value(scenario).ok()).unwrap_or_default()
}

fn draw(path: &std::path::Path, robot: &Robot, word: &str) -> Result<(), Failure> {
    let case = Case::from_word(word).map_err(|error| failure(&error))?;
    let figure = sidestep_falsify::picture(&case, robot).map_err(|error| failure(&error))?;
    crate::output::file(path, &figure.svg())
}

fn replay(arguments: &FalsifyArguments, robot: &Robot, word: &str) -> Result<(), Failure> {
    let case = Case::from_word(word).map_err(|error| failure(&error))?;
    let mut evaluator = Evaluator::new(robot).map_err(|error| failure(&error))?;
    let outcome = evaluator.evaluate(&case, &mut tell).map_err(|error| failure(&error))?;
    match outcome.contact {
        Some(contact) => crate::output::line(&format!(
            "contact with obstacle {} after {:.3} s at {:.3} m/s, {:.3} rad/s",
            contact.thing, contact.time_s, contact.v_m_s, contact.w_rad_s
        )),
        None => crate::output::line(&format!("no contact, smallest gap {:.4} m", outcome.robustness_m)),
    }
    if let Some(path) = &arguments.json {
        let numbers = serde_json::json!({ "outcome": outcome, "scenario": scenario(robot, word) });
        crate::output::json(path, &numbers)?;
    }
    arguments.svg.as_ref().map_or(Ok(()), |path| draw(path, robot, word))
}

fn tell(trace: &Trace) {
    let command = &trace.command;
    let reason = Reason::from_code(command.reason).map_or("?".to_owned(), |reason| format!("{reason:?}"));
    crate::output::line(&format!(
        "{:5.2} s  x {:7.4} y {:7.4} yaw {:7.4}  v {:6.3} w {:6.3}  command {:6.3} {:6.3} scale {:4.2} {}  gap {:.4}",
        trace.time_s,
        trace.pose.x_m,
        trace.pose.y_m,
        trace.pose.yaw_rad,
        trace.twist.v_m_s,
        trace.twist.w_rad_s,
        command.twist.v_m_s,
        command.twist.w_rad_s,
        command.scale,
        if trace.commanded { reason } else { "(silent)".to_owned() },
        trace.gap_m,
    ));
}

/// Whether the promise held inside, and broke wherever an assumption was relaxed.
fn verdict(searches: &[(Search, f64)]) -> Result<(), Failure> {
    let mut broken = Vec::new();
    for (search, _) in searches {
        match (search.relaxed, &search.first_contact) {
            ("inside", Some(_)) => {
                broken.push(format!("{} contacts inside the assumptions", search.contacts));
            }
            ("inside", None) | (_, Some(_)) => {}
            (name, None) => broken.push(format!("no contact found with {name} relaxed")),
        }
    }
    if broken.is_empty() { Ok(()) } else { Err(Failure::unmet(broken.join("; "))) }
}

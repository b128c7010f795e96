//! `sidestep compare`: where policy and expert, or two models, disagree.

use crate::failure::Failure;
use clap::{Args, ValueEnum};
use sidestep_compare::{CompareError, Comparison, Mine, Options, Rank};
use std::path::PathBuf;

/// What to compare.
#[derive(Debug, Args)]
pub(crate) struct CompareArguments {
    /// A recording: its policy against its expert.
    file: PathBuf,
    /// A second recording of the same sensors: policy of the first against policy of this one.
    other: Option<PathBuf>,
    /// Writes the report, all in one page.
    #[arg(long)]
    html: Option<PathBuf>,
    /// Writes the figures, with those of every frame.
    #[arg(long)]
    json: Option<PathBuf>,
    /// Writes a picture of the optimality gap and the worst frames.
    #[arg(long)]
    svg: Option<PathBuf>,
    /// Worst frames to draw.
    #[arg(long, default_value_t = 12)]
    worst: usize,
    /// What makes a frame bad: its regret, or how far apart the two are.
    #[arg(long, default_value = "regret")]
    by: By,
    /// Writes the worst frames as training samples.
    #[arg(long, requires = "out")]
    mine: Option<usize>,
    /// The data set for --mine; never written over.
    #[arg(long, requires = "mine")]
    out: Option<PathBuf>,
}

/// As [`Rank`], on the command line.
#[derive(Debug, Clone, Copy, ValueEnum)]
enum By {
    Regret,
    Disagreement,
}

/// Most frames drawn: a page of more is neither read nor small.
const WORST_MOST: usize = 120;

fn failure(error: &CompareError) -> Failure {
    match error {
        CompareError::Option { .. } => Failure::usage(error.to_string()),
        _ => Failure::io(error.to_string()),
    }
}

/// Compares, prints the figures, and writes what was asked for.
///
/// # Errors
/// Exit code 2 for an option, 3 for a recording that cannot be compared or a file that cannot be written.
pub(crate) fn compare(arguments: CompareArguments) -> Result<(), Failure> {
    let CompareArguments { file, other, html, json, svg, worst, by, mine, out } = arguments;
    if worst > WORST_MOST {
        return Err(Failure::usage(format!("--worst is {worst}, needed: at most {WORST_MOST}")));
    }
    let rank = match by {
        By::Regret => Rank::Regret,
        By::Disagreement => Rank::Disagreement,
    };
    [&html, &json, &svg].into_iter().flatten().try_for_each(|path| crate::output::may_write(path))?;
    out.iter().try_for_each(|out| crate::output::refuse_existing(out))?;
    let mine = mine.zip(out).map(|(count, out)| Mine { count, out });
    let begin_ns = sidestep_bus::host_ns();
    let options = Options { file, other, worst, rank, mine };
    let comparison = sidestep_compare::compare(&options).map_err(|error| failure(&error))?;
    crate::output::note(speed(&comparison, sidestep_bus::host_ns().saturating_sub(begin_ns)));
    crate::output::line(comparison.text().trim_end());
    if let Some(path) = &html {
        let report = comparison.report().map_err(|error| failure(&error))?;
        crate::output::file(path, &report.html())?;
    }
    if let Some(path) = &svg {
        crate::output::file(path, &comparison.overview().map_err(|error| failure(&error))?.svg())?;
    }
    if let Some(path) = &json {
        crate::output::json(path, &comparison.json())?;
    }
    if let (Some(mined), Some(mine)) = (comparison.mined, &options.mine) {
        let asked = mine.count;
        crate::output::line(&format!(
            "mined        {mined} of {asked} frames asked for: {}",
            mine.out.display()
        ));
    }
    Ok(())
}

/// How fast the recordings were read and compared.
fn speed(comparison: &Comparison, took_ns: u64) -> String {
    let (bytes, seconds) = comparison.read();
    let took_s = (took_ns as f64 * 1e-9).max(1e-6);
    let megabytes = bytes as f64 * 1e-6;
    format!(
        "read {megabytes:.0} MB, {seconds:.1} s of recording, in {took_s:.2} s: {:.0} MB/s, {:.0} times real time",
        megabytes / took_s,
        seconds / took_s
    )
}

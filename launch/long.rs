//! `sidestep navigate --suite long`: kilometres, added up over as many calls as it takes.

use crate::failure::Failure;
use crate::learning::threads;
use crate::manifest::robot_named;
use crate::navigate::{NavigateArguments, failure};
use clap::{Args, ValueEnum};
use sidestep_drive::Sight;
use sidestep_navigate::{Account, Ledger, LongOptions, behaviour};
use std::fs::{File, TryLockError};
use std::path::{Path, PathBuf};

/// How far to drive, and where it is written down.
#[derive(Debug, Args)]
pub(crate) struct LongArguments {
    /// Unseen rooms without end, under every lead and one that drives full speed and turns at random.
    #[arg(long, conflicts_with_all = ["rooms", "full", "figures", "normal", "lead", "arbiter", "html", "json"])]
    suite: Option<SuiteName>,
    /// `[km]` way of the whole account at which to end; what earlier calls drove counts. Without it 1.
    #[arg(long)]
    km: Option<f64>,
    /// File that the suite adds up in, one account for each arbiter, mapper and robot; without it `ledger.json`.
    #[arg(long)]
    ledger: Option<PathBuf>,
    /// How the robot sees in it; without it through its camera.
    #[arg(long)]
    sight: Option<SightName>,
}

/// Suites by name.
#[derive(Debug, Clone, Copy, ValueEnum)]
enum SuiteName {
    Long,
}

/// As [`Sight`], on the command line.
#[derive(Debug, Clone, Copy, ValueEnum)]
enum SightName {
    /// The whole chain, from rendered depth on.
    Camera,
    /// Both maps drawn from the world.
    Grid,
    /// The same with the mapper's errors, as often as they were measured.
    Noisy,
}

impl LongArguments {
    /// Whether a long suite is asked for.
    ///
    /// # Errors
    /// Exit code 2 for options of a suite without one. (The parser does not ask for what conflicts with other options.)
    pub(crate) fn is_asked_for(&self) -> Result<bool, Failure> {
        let Self { suite, km, ledger, sight } = self;
        if suite.is_none() && (km.is_some() || ledger.is_some() || sight.is_some()) {
            let text = "navigate: --km, --ledger and --sight are given, needed: --suite long with them";
            return Err(Failure::usage(text));
        }
        Ok(suite.is_some())
    }
}

/// Drives on until the account has its kilometres, and prints what it adds up to.
///
/// # Errors
/// Exit code 1 for a contact, 2 for an option, 3 for a file.
pub(crate) fn long(arguments: &NavigateArguments, long: &LongArguments) -> Result<(), Failure> {
    let path = long.ledger.clone().unwrap_or_else(|| "ledger.json".into());
    let km = long.km.unwrap_or(1.0);
    crate::output::may_write(&path)?;
    let _alone = lock(&path)?;
    let robot = robot_named(&arguments.robot)?.0;
    let (model, model_name) = arguments.model()?;
    let options = LongOptions {
        robot: &robot,
        model: &model,
        model_name: &model_name,
        sight: match long.sight {
            None | Some(SightName::Camera) => Sight::Camera,
            Some(SightName::Grid) => Sight::Grid,
            Some(SightName::Noisy) => Sight::Noisy,
        },
        distance_m: 1000.0 * km,
        limit_s: arguments.limit,
        threads: threads(arguments.threads),
    };
    let mut ledger = Ledger::read(&path).map_err(|error| failure(&error))?;
    let behaviour = behaviour(&options).map_err(|error| failure(&error))?;
    let mut account = ledger.account(&behaviour, options.sight.label(), arguments.seed).clone();
    let mut keep = |account: &Account| {
        crate::output::note(format!("{:.2} of {} km", account.distance_m() / 1000.0, km));
        ledger.account(&behaviour, options.sight.label(), arguments.seed).clone_from(account);
        ledger.write(&path)
    };
    let driven = sidestep_navigate::long(&options, &mut account, &mut keep);
    driven.map_err(|error| failure(&error))?;
    print(&account);
    match account.contacts() {
        0 => Ok(()),
        contacts => Err(Failure::unmet(format!("{contacts} contacts with the arbiter on"))),
    }
}

/// Keeps a second call off the same ledger: each writes the whole file.
fn lock(ledger: &Path) -> Result<File, Failure> {
    let path = ledger.with_extension("lock");
    let failed = |error: &dyn std::fmt::Display| Failure::io(format!("{}: {error}", path.display()));
    let file = File::create(&path).map_err(|error| failed(&error))?;
    match file.try_lock() {
        Ok(()) => Ok(file),
        Err(TryLockError::WouldBlock) => Err(Failure::usage(format!(
            "{}: another call adds to it; wait for that one, or name another with --ledger",
            ledger.display()
        ))),
        Err(TryLockError::Error(error)) => Err(failed(&error)),
    }
}

fn print(account: &Account) {
    let Account { behaviour, sight, seed, .. } = account;
    crate::output::line(&format!("behaviour {behaviour}, sight {sight}, rooms of seed {seed}"));
    for (driver, tally) in &account.drivers {
        crate::output::line(&format!("  {driver:9} {}", tally.line()));
        for contact in &tally.contacts {
            let [x_m, y_m] = contact.at_m;
            crate::output::line(&format!(
                "    contact in room {} after {:.2} s at ({x_m:.2}, {y_m:.2}): {}",
                contact.room, contact.time_s, contact.summary
            ));
        }
    }
    crate::output::line(&format!("  all       {}", account.line()));
}

//! Trials by the thousand, counted.

use crate::class::Class;
use crate::error::RecallError;
use crate::reach::reach_m;
use crate::trial::{Seen, Witness};
use serde::Serialize;
use sidestep_crew::in_order;
use sidestep_msgs::Robot;
use sidestep_report::Proportion;
use sidestep_sim::mix;
use std::fmt::Write as _;

/// `[m/s]` speeds beside the robot's fastest.
const SLOWER_M_S: [f64; 2] = [0.3, 0.6];
/// Most trials of a class at a speed.
const TRIALS_MOST: u64 = 100_000;
/// Trials between two words of progress.
const PROGRESS: usize = 200;

/// What to measure.
#[derive(Debug, Clone, Copy)]
pub struct Options<'a> {
    /// Who drives.
    pub robot: &'a Robot,
    /// The classes.
    pub classes: &'a [Class],
    /// `[m/s]` how fast.
    pub speeds_m_s: &'a [f64],
    /// Trials of each class at each speed.
    pub trials: u64,
    /// Seed of places and noise.
    pub seed: u64,
    /// Threads; no influence on the numbers.
    pub threads: usize,
}

/// A speed, and how early a thing must be known at it.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Speed {
    /// `[m/s]`
    pub speed_m_s: f64,
    /// `[m]` from the robot's front to the end of the tube.
    pub reach_m: f64,
}

/// A class at a speed.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Row {
    /// The class.
    pub class: &'static str,
    /// Whether anything is there; if not, the shares are those of false alarms.
    pub is_object: bool,
    /// `[m/s]`
    pub speed_m_s: f64,
    /// Marked in the safety map.
    pub marked: Proportion,
    /// Marked there, or not known to be free.
    pub not_known_free: Proportion,
    /// Seen by the guard.
    pub guarded: Proportion,
    /// Marked in the map or seen by the guard.
    pub either: Proportion,
    /// Not known to be free in the map, or seen by the guard: what keeps the robot from driving on.
    pub stopped: Proportion,
}

/// All rows.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Recall {
    /// The robot.
    pub robot: String,
    /// Seed of places and noise.
    pub seed: u64,
    /// Trials of each row.
    pub trials: u64,
    /// What was driven.
    pub speeds: Vec<Speed>,
    /// Class by class, the slowest first.
    pub rows: Vec<Row>,
}

/// `[m/s]` 0.3, 0.6 and the fastest of a robot; of a slower one, what it reaches.
#[must_use]
pub fn speeds_m_s(robot: &Robot) -> Vec<f64> {
    let fastest = f64::from(robot.limits.forward_m_s);
    SLOWER_M_S.into_iter().filter(|speed| *speed < fastest - 0.01).chain([fastest]).collect()
}

/// Drives all trials; `progress` hears a line now and then.
///
/// # Errors
/// An option out of range, a robot without a depth camera, a node that refuses its configuration.
pub fn measure(
    options: &Options<'_>,
    progress: &mut (dyn FnMut(&str) + Send),
) -> Result<Recall, RecallError> {
    if !(1..=TRIALS_MOST).contains(&options.trials) {
        let found = options.trials.to_string();
        return Err(RecallError::Option { option: "--trials", found, needed: "1 to 100000" });
    }
    let speeds = options.speeds_m_s;
    let trials = options.trials as usize;
    let count = options.classes.len() * speeds.len() * trials;
    let place = |number: usize| (number / trials / speeds.len(), number / trials % speeds.len());
    let job = |witness: &mut Witness, number: usize| {
        let (class, speed) = place(number);
        let (class, speed_m_s) = (&options.classes[class], speeds[speed]);
        // By name and speed, so that a row keeps its trials whatever stands beside it.
        let name = class.name.bytes().fold(options.seed, |hash, byte| mix(hash, u64::from(byte)));
        witness.trial(class, speed_m_s, mix(mix(name, speed_m_s.to_bits()), (number % trials) as u64))
    };
    let mut done = |finished: usize| {
        if finished.is_multiple_of(PROGRESS) || finished == count {
            progress(&format!("recall: {finished} of {count} trials"));
        }
    };
    let seen = in_order(count, options.threads, || Witness::new(options.robot), job, &mut done)?;
    let rows = seen.chunks_exact(trials).enumerate().map(|(row, seen)| {
        let (class, speed) = place(row * trials);
        summarise(&options.classes[class], speeds[speed], seen)
    });
    let config = sidestep_arbiter::Config::STANDARD;
    let reach = |&speed_m_s: &f64| Speed { speed_m_s, reach_m: reach_m(options.robot, &config, speed_m_s) };
    Ok(Recall {
        robot: options.robot.name.clone(),
        seed: options.seed,
        trials: options.trials,
        rows: rows.collect(),
        speeds: speeds.iter().map(reach).collect(),
    })
}

fn summarise(class: &Class, speed_m_s: f64, seen: &[Seen]) -> Row {
    let share = |is: &dyn Fn(&Seen) -> bool| {
        Proportion::new(seen.iter().filter(|seen| is(seen)).count() as u64, seen.len() as u64)
    };
    Row {
        class: class.name,
        is_object: class.is_object(),
        speed_m_s,
        marked: share(&|seen| seen.marked),
        not_known_free: share(&|seen| seen.unfree),
        guarded: share(&|seen| seen.guarded),
        either: share(&|seen| seen.marked || seen.guarded),
        stopped: share(&|seen| seen.unfree || seen.guarded),
    }
}

/// A share with its interval, in percent.
fn cell(share: &Proportion) -> String {
    let percent = [share.share(), share.low, share.high].map(|part| 100.0 * part);
    format!("{:5.1} ({:.1} to {:.1})", percent[0], percent[1], percent[2])
}

impl Recall {
    /// The table for a terminal.
    #[must_use]
    pub fn text(&self) -> String {
        let mut text = format!(
            "robot {}, seed {}, {} trials a row; percent with the 95 % interval, when the tube would first touch:\n",
            self.robot, self.seed, self.trials
        );
        for speed in &self.speeds {
            let _ = writeln!(
                text,
                "at {:.2} m/s {:.2} m ahead of the robot's front",
                speed.speed_m_s, speed.reach_m
            );
        }
        let columns = ["marked in the map", "not known free", "seen by the guard", "map or guard", "stops"];
        let _ = write!(text, "{:37} {:>4}", "", "m/s");
        columns.iter().for_each(|column| {
            let _ = write!(text, "  {column:23}");
        });
        for row in &self.rows {
            let shares = [&row.marked, &row.not_known_free, &row.guarded, &row.either, &row.stopped];
            let _ = write!(text, "\n{:37} {:4.2}", row.class, row.speed_m_s);
            shares.iter().for_each(|share| {
                let _ = write!(text, "  {:23}", cell(share));
            });
        }
        text.lines().map(str::trim_end).collect::<Vec<_>>().join("\n")
    }
}

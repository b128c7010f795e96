//! The adversary: a cross-entropy search that begins again and again, each climb of a number of its own.
//!
//! A climb depends on nothing but seed and number, so that threads share climbs and have no influence on what is found.

use crate::assumption::Assumption;
use crate::error::FalsifyError;
use crate::evaluation::{Evaluator, Outcome};
use crate::genes::Case;
use crate::scenario::GENES;
use serde::Serialize;
use sidestep_crew::in_order;
use sidestep_msgs::Robot;
use sidestep_sim::{Random, mix};

/// Evaluations of a climb.
pub const CLIMB: usize = 1000;
/// The first of them are uniform.
const UNIFORM: usize = 200;
/// One in so many of the later ones is uniform too.
const UNIFORM_EVERY: usize = 10;
/// Evaluations between two fits.
const GENERATION: usize = 50;
/// The best so far, to which mean and deviation are fitted.
const ELITE: usize = 12;
/// `[1]` least deviation, of the range of a gene.
const DEVIATION_LEAST: f64 = 0.04;
/// `[1]` part of a gene's new values that are those of the best case itself.
const KEPT: f64 = 0.5;

/// A case with what came of it.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Found {
    /// The case as a word; `sidestep falsify --case` shows it.
    pub case: String,
    /// Number of the evaluation, from 1.
    pub evaluation: u64,
    /// What came of it.
    #[serde(flatten)]
    pub outcome: Outcome,
}

/// What a search did.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Search {
    /// What was relaxed: `inside`, or the assumption.
    pub relaxed: &'static str,
    /// Evaluations made; up to the first contact where that ends the search.
    pub evaluations: u64,
    /// Evaluations with a contact of the moving robot.
    pub contacts: u64,
    /// Ticks of the arbiter in all evaluations.
    pub ticks: u64,
    /// The worst case of each of the worst climbs, worst first.
    pub worst: Vec<Found>,
    /// The first contact.
    pub first_contact: Option<Found>,
}

/// What to search.
#[derive(Debug, Clone, Copy)]
pub struct SearchOptions<'a> {
    /// The robot.
    pub robot: &'a Robot,
    /// The assumption that does not hold.
    pub relaxed: Option<Assumption>,
    /// Seed.
    pub seed: u64,
    /// Most evaluations; the last climb may be short.
    pub evaluations: u64,
    /// Threads; no influence on what is found.
    pub threads: usize,
    /// Whether the first contact ends the search.
    pub stops: bool,
    /// How many of the worst cases to keep.
    pub keep: usize,
}

/// A climb's result.
struct Climb {
    contacts: u64,
    ticks: u64,
    evaluations: u64,
    worst: Option<(Case, u64, Outcome)>,
    first: Option<(Case, u64, Outcome)>,
}

/// Searches; `progress` hears evaluations done, contacts and the smallest robustness `[m]` so far.
///
/// # Errors
/// The arbiter refuses the robot, or nothing is to be done.
pub fn search(
    options: &SearchOptions<'_>,
    progress: &mut (dyn FnMut(u64, u64, f64) + Send),
) -> Result<Search, FalsifyError> {
    if options.evaluations == 0 {
        let found = "0".to_owned();
        return Err(FalsifyError::Option { option: "--evaluations", found, needed: "at least 1" });
    }
    let climbs = options.evaluations.div_ceil(CLIMB as u64);
    let mut search = Search {
        relaxed: Case::label(options.relaxed),
        evaluations: 0,
        contacts: 0,
        ticks: 0,
        worst: Vec::new(),
        first_contact: None,
    };
    let batch = 4 * options.threads.max(1) as u64;
    let mut next = 0;
    while next < climbs && !(options.stops && search.first_contact.is_some()) {
        let count = batch.min(climbs - next);
        let hire = || Evaluator::new(options.robot);
        let job = |evaluator: &mut Evaluator, index: usize| climb(evaluator, options, next + index as u64);
        for found in in_order(count as usize, options.threads, hire, job, &mut |_| ())? {
            // What was done beyond the first contact depends on the number of threads, and is not told.
            if !(options.stops && search.first_contact.is_some()) {
                search.add(found, options.keep);
            }
        }
        next += count;
        let worst_m = search.worst.first().map_or(f64::INFINITY, |found| found.outcome.robustness_m);
        progress(search.evaluations, search.contacts, worst_m);
    }
    Ok(search)
}

impl Search {
    fn add(&mut self, climb: Climb, keep: usize) {
        let before = self.evaluations;
        let tell = |(case, number, outcome): (Case, u64, Outcome)| Found {
            case: case.word(),
            evaluation: before + number,
            outcome,
        };
        self.evaluations += climb.evaluations;
        self.contacts += climb.contacts;
        self.ticks += climb.ticks;
        if self.first_contact.is_none() {
            self.first_contact = climb.first.map(tell);
        }
        self.worst.extend(climb.worst.map(tell));
        self.worst.sort_by(|a, b| a.outcome.robustness_m.total_cmp(&b.outcome.robustness_m));
        self.worst.truncate(keep);
    }
}

/// One climb from uniform cases to the worst that the fit leads to.
fn climb(evaluator: &mut Evaluator, options: &SearchOptions<'_>, number: u64) -> Result<Climb, FalsifyError> {
    let mut random = Random::new(mix(options.seed, number));
    let length = (options.evaluations - number * CLIMB as u64).min(CLIMB as u64) as usize;
    let mut elite: Vec<(f64, [u16; GENES])> = Vec::with_capacity(ELITE + 1);
    let mut fit: Option<Fit> = None;
    let mut result = Climb { contacts: 0, ticks: 0, evaluations: 0, worst: None, first: None };
    for evaluation in 0..length {
        let genes = match &fit {
            Some(fit) if evaluation % UNIFORM_EVERY != 0 => fit.draw(&mut random, &elite[0].1),
            _ => std::array::from_fn(|_| (random.bits() >> 48) as u16),
        };
        let case = Case { relaxed: options.relaxed, genes };
        let outcome = evaluator.evaluate(&case, &mut |_| ())?;
        result.evaluations += 1;
        result.ticks += outcome.ticks;
        result.contacts += u64::from(outcome.contact.is_some());
        let entry = (case, evaluation as u64 + 1, outcome);
        if outcome.contact.is_some() && result.first.is_none() {
            result.first = Some(entry.clone());
        }
        let worse = |(_, _, before): &(Case, u64, Outcome)| outcome.robustness_m < before.robustness_m;
        if result.worst.as_ref().is_none_or(worse) {
            result.worst = Some(entry);
        }
        if options.stops && result.first.is_some() {
            break;
        }
        let place = elite.partition_point(|(robustness_m, _)| *robustness_m <= outcome.robustness_m);
        elite.insert(place, (outcome.robustness_m, genes));
        elite.truncate(ELITE);
        if evaluation + 1 >= UNIFORM && (evaluation + 1) % GENERATION == 0 {
            fit = Some(Fit::new(&elite));
        }
    }
    Ok(result)
}

/// Mean and deviation of the genes of the best.
struct Fit {
    mean: [f64; GENES],
    deviation: [f64; GENES],
}

impl Fit {
    fn new(elite: &[(f64, [u16; GENES])]) -> Self {
        let count = elite.len().max(1) as f64;
        let unit = |genes: &[u16; GENES], place: usize| f64::from(genes[place]) / 65535.0;
        let mean: [f64; GENES] = std::array::from_fn(|place| {
            elite.iter().map(|(_, genes)| unit(genes, place)).sum::<f64>() / count
        });
        let deviation = std::array::from_fn(|place| {
            let square = |(_, genes): &(f64, [u16; GENES])| {
                let off = unit(genes, place) - mean[place];
                off * off
            };
            (elite.iter().map(square).sum::<f64>() / count).sqrt().max(DEVIATION_LEAST)
        });
        Self { mean, deviation }
    }

    /// A case near the best: genes are correlated, so half of them stay as they are in the best case.
    fn draw(&self, random: &mut Random, best: &[u16; GENES]) -> [u16; GENES] {
        let kept = KEPT + (1.0 - KEPT) * random.unit();
        std::array::from_fn(|place| {
            if random.unit() < kept {
                return best[place];
            }
            let drawn = self.mean[place] + self.deviation[place] * random.normal();
            (drawn.clamp(0.0, 1.0) * 65535.0) as u16
        })
    }
}

//! How the weights of eq. (6) were chosen: closed loops of the expert alone, each weight halved and doubled in turn, in
//! rooms of a seed that no evaluation uses.

use crate::error::NavigateError;
use crate::pilot::PIXELS;
use crate::room::{Course, room};
use serde::Serialize;
use sidestep_crew::in_order;
use sidestep_drive::{Drive, Lead, Setup, Sight};
use sidestep_expert::Weights;
use sidestep_msgs::Robot;

/// Seed of the rooms that weights are tuned in.
pub const TUNING_SEED: u64 = 770_000;
/// `[s]` a room not crossed within this counts as this.
const LIMIT_S: f64 = 60.0;
/// `[s]` what a contact counts.
const CONTACT_S: f64 = 120.0;

/// One set of weights, driven.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Trial {
    /// Which weight was changed, and by what.
    pub name: String,
    /// `[1/m]` w1.
    pub distance_per_m: f32,
    /// `[1/rad]` w2.
    pub heading_per_rad: f32,
    /// `[1]` w3.
    pub change: f32,
    /// `[1]` m of eq. (6c).
    pub limit: f32,
    /// `[1]` price of crossing it.
    pub penalty: f32,
    /// Rooms driven.
    pub rooms: u64,
    /// Rooms crossed without contact.
    pub reached: u64,
    /// Rooms with a contact.
    pub contacts: u64,
    /// `[s]` mean time, a room not reached counting 60 s and a contact 120 s: what is made small.
    pub score_s: f64,
    /// `[m]` mean over rooms of the smallest gap to anything.
    pub clearance_m: f64,
}

/// Drives the standard weights, and each of them halved and doubled, through `count` rooms without an arbiter.
///
/// # Errors
/// [`NavigateError`] where a node refuses, or no room is asked for.
pub fn tune(
    robot: &Robot,
    count: u64,
    threads: usize,
    progress: &mut (dyn FnMut(&str) + Send),
) -> Result<Vec<Trial>, NavigateError> {
    if count == 0 {
        return Err(NavigateError::Option { option: "rooms", found: "0".into(), needed: "at least 1" });
    }
    let courses: Vec<Course> = (0..count).map(|number| room(TUNING_SEED, number)).collect();
    let mut trials = Vec::new();
    for (name, weights) in variants() {
        progress(&format!("tune: {name}"));
        let job = |(): &mut (), number: usize| drive(robot, &courses[number], weights);
        let driven = in_order(courses.len(), threads, || Ok(()), job, &mut |_| ())?;
        trials.push(trial(name, &weights, &driven));
    }
    Ok(trials)
}

fn variants() -> Vec<(String, Weights)> {
    let standard = Weights::STANDARD;
    let mut all = vec![("as shipped".to_owned(), standard)];
    for factor in [0.5, 2.0] {
        let named = |what: &str| format!("{what} x {factor}");
        all.extend([
            (named("w1"), Weights { distance_per_m: factor * standard.distance_per_m, ..standard }),
            (named("w2"), Weights { heading_per_rad: factor * standard.heading_per_rad, ..standard }),
            (named("w3"), Weights { change: factor * standard.change, ..standard }),
            (named("m"), Weights { limit: factor * standard.limit, ..standard }),
            (named("penalty"), Weights { penalty: factor * standard.penalty, ..standard }),
        ]);
    }
    all
}

/// Time, whether reached, whether touched, clearance.
type Drove = (f64, bool, bool, f64);

fn drive(robot: &Robot, course: &Course, weights: Weights) -> Result<Drove, NavigateError> {
    let mut setup = Setup::led_by(robot.clone(), course.world.clone(), Lead::Expert);
    (setup.sim.width_px, setup.sim.height_px) = PIXELS;
    setup.sim.seed = course.seed;
    setup.sight = Sight::Grid;
    setup.arbitrated = false;
    setup.expert.weights = weights;
    let goals = course.world.legs_m.len() as u32;
    let mut drive = Drive::new(setup)?;
    let outcome = drive.run(goals, LIMIT_S);
    let touched = outcome.collisions > 0;
    let reached = outcome.arrivals >= goals && !touched;
    Ok((outcome.time_s, reached, touched, f64::from(outcome.min_clearance_m)))
}

fn trial(name: String, weights: &Weights, driven: &[Drove]) -> Trial {
    let part = 1.0 / driven.len() as f64;
    let score = |(time_s, reached, touched, _): &Drove| match (reached, touched) {
        (_, true) => CONTACT_S,
        (true, _) => *time_s,
        _ => LIMIT_S,
    };
    Trial {
        name,
        distance_per_m: weights.distance_per_m,
        heading_per_rad: weights.heading_per_rad,
        change: weights.change,
        limit: weights.limit,
        penalty: weights.penalty,
        rooms: driven.len() as u64,
        reached: driven.iter().filter(|drove| drove.1).count() as u64,
        contacts: driven.iter().filter(|drove| drove.2).count() as u64,
        score_s: part * driven.iter().map(score).sum::<f64>(),
        clearance_m: part * driven.iter().map(|drove| drove.3).sum::<f64>(),
    }
}

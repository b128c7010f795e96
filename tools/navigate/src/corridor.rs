//! The counterpart of the paper's Fig. 9: a corridor driven to and fro by a policy trained on demonstrations only and by
//! one trained on artificial maps as well.
//!
//! Everything that could be tuned towards a wish is a constant of this file. Without an arbiter, each contact and each
//! time the robot is stuck is an intervention: it is pushed back onto the way and goes on. With the arbiter, each time the
//! arbiter does something else than let through or slow the policy's wish is a takeover.

use crate::error::NavigateError;
use crate::pilot::{Conditions, Pilot};
use crate::reference::Floor;
use crate::room::{Course, WAY_M};
use crate::statistics::sign_flip_test;
use serde::Serialize;
use sidestep_crew::in_order;
use sidestep_drive::{Drive, Lead, Sight};
use sidestep_msgs::{Code, Pose2, Reason, Robot, wrap_angle};
use sidestep_sim::World;
use sidestep_train::Random;

/// `[m]` length and width of the corridor (paper, Fig. 9).
pub const CORRIDOR_M: [f64; 2] = [18.0, 2.5];
/// `[1]` crowding: an obstacle every 1.5 m on average. The solved expert alone gets to the far end of 29 of 30 corridors
/// of other seeds (80,000 on); at 1.6 of 27, at 2.2 of 25: beyond, it would be dead ends that are measured.
pub const DENSITY: f64 = 1.2;
/// Ways along the corridor: twice to and twice fro.
pub const LEGS: usize = 4;
/// How the robot sees: everything the paper's robot had, noise included.
pub const SIGHT: Sight = Sight::Camera;
/// Seeds driven unless asked otherwise, and the first of them; no dataset has worlds of these.
pub const SEEDS: u64 = 24;
/// The first seed.
pub const FIRST_SEED: u64 = 90_000;
/// `[s]` without [`PROGRESS_M`] of way, after which the robot is stuck.
pub const STUCK_S: f64 = 12.0;
/// `[m]` what counts as progress.
pub const PROGRESS_M: f64 = 0.3;
/// `[s]` longest drive.
pub const LIMIT_S: f64 = 300.0;
/// `[m]` along the way, how far the robot is pushed at an intervention; and how far, and `[rad]`, per tick of 10 ms.
pub const PUT_M: f64 = 0.5;
const PUSH_M: f64 = 0.005;
const PUSH_RAD: f64 = 0.01;
/// `[m]` radius of the disc for which every corridor has a way: as in rooms. A gap of 0.8 m may be closed on a map of
/// cells of 0.1 m, one of 0.9 m never is.
pub const FREE_WAY_M: f64 = WAY_M;
/// Ticks of 10 ms between two words of a localiser, which places the path anew: 1 s.
pub const LOCALISED_TICKS: u64 = 100;
/// `[s]` a takeover ends when the policy has driven this long.
const APART_S: f64 = 0.5;
/// `[m]` between the points of a way.
const STRIDE_M: f64 = 0.1;
/// Names of the two models.
pub const TRAININGS: [&str; 2] = ["normal", "mixed"];

/// Both models in every corridor.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Corridors {
    /// How the robots saw.
    pub sight: &'static str,
    /// `[1]` crowding.
    pub density: f64,
    /// Ways along each corridor.
    pub legs: usize,
    /// One for each seed.
    pub corridors: Vec<Corridor>,
    /// The arbiter off: interventions.
    pub interventions: Contrast,
    /// The arbiter off: those of the interventions that were contacts.
    pub contacts: Contrast,
    /// The arbiter on: takeovers, and times it was stuck.
    pub takeovers: Contrast,
}

/// One corridor.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Corridor {
    /// Its seed.
    pub seed: u64,
    /// The arbiter off: normal, mixed.
    pub alone: [Patrol; 2],
    /// The arbiter on: normal, mixed.
    pub guarded: [Patrol; 2],
    /// The world, for a picture.
    #[serde(skip)]
    pub world: World,
}

/// One drive to and fro.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Patrol {
    /// Contacts.
    pub contacts: u32,
    /// Times it was stuck.
    pub stuck: u32,
    /// Times the arbiter took over.
    pub takeovers: u32,
    /// Ways along the corridor that were finished.
    pub legs: u32,
    /// `[s]` time driven.
    pub time_s: f64,
    /// `[m]` way driven.
    pub distance_m: f64,
    /// `[m]` smallest gap to anything.
    pub min_clearance_m: f64,
    /// `[m]` where someone had to intervene.
    pub interventions_m: Vec<[f64; 2]>,
    /// `[m]` the way, every 0.1 s, for a picture.
    #[serde(skip)]
    pub trace_m: Vec<[f64; 2]>,
}

/// The two models compared by a count per corridor.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Contrast {
    /// Sums over all corridors: normal, mixed.
    pub totals: [u64; 2],
    /// Per 100 m driven: normal, mixed.
    pub per_100_m: [f64; 2],
    /// Corridors in which the normal one needed more, as many, fewer.
    pub more_same_fewer: [u64; 3],
    /// `[1]` exact two-sided probability of such a difference by chance (paired, signs flipped).
    pub p: f64,
}

/// What to drive.
#[derive(Debug, Clone)]
pub struct CorridorOptions<'a> {
    /// The robot.
    pub robot: &'a Robot,
    /// Model files: trained on demonstrations only, and on artificial maps as well.
    pub models: [&'a [u8]; 2],
    /// First seed; [`FIRST_SEED`] under the committed conditions.
    pub first_seed: u64,
    /// Corridors; [`SEEDS`] under the committed conditions.
    pub seeds: u64,
    /// How the robots see; [`SIGHT`] under the committed conditions.
    pub sight: Sight,
    /// Threads; no influence on the numbers.
    pub threads: usize,
}

/// Drives both models through every corridor, with and without the arbiter.
///
/// # Errors
/// [`NavigateError`] where a model or a node refuses, or no corridor is asked for.
pub fn corridors(
    options: &CorridorOptions<'_>,
    progress: &mut (dyn FnMut(&str) + Send),
) -> Result<Corridors, NavigateError> {
    if options.seeds == 0 {
        return Err(NavigateError::Option { option: "seeds", found: "0".into(), needed: "at least 1" });
    }
    let hire = || -> Result<[Pilot<'_>; 2], NavigateError> {
        let pilot = |which: usize| Pilot::new(options.robot, options.models[which], TRAININGS[which]);
        Ok([pilot(0)?, pilot(1)?])
    };
    let job = |pilots: &mut [Pilot<'_>; 2], number: usize| {
        let course = crowded(options.first_seed + number as u64);
        let mut patrol = |which: usize, arbitrated| {
            patrol(
                &mut pilots[which],
                &course,
                Conditions { lead: Lead::Policy, arbitrated, sight: options.sight },
            )
        };
        let alone = [patrol(0, false)?, patrol(1, false)?];
        let guarded = [patrol(0, true)?, patrol(1, true)?];
        Ok(Corridor { seed: options.first_seed + number as u64, alone, guarded, world: course.world })
    };
    let mut done = |finished: usize| progress(&format!("corridors: {finished} of {}", options.seeds));
    let corridors = in_order(options.seeds as usize, options.threads, hire, job, &mut done)?;
    Ok(Corridors {
        sight: options.sight.label(),
        density: DENSITY,
        legs: LEGS,
        interventions: contrast(&corridors, |corridor| &corridor.alone, |drive| drive.contacts + drive.stuck),
        contacts: contrast(&corridors, |corridor| &corridor.alone, |drive| drive.contacts),
        takeovers: contrast(&corridors, |corridor| &corridor.guarded, |drive| drive.takeovers + drive.stuck),
        corridors,
    })
}

fn contrast(
    corridors: &[Corridor],
    drives: impl Fn(&Corridor) -> &[Patrol; 2],
    count: impl Fn(&Patrol) -> u32,
) -> Contrast {
    let total = |which: usize| corridors.iter().map(|c| u64::from(count(&drives(c)[which]))).sum::<u64>();
    let way_m = |which: usize| corridors.iter().map(|c| drives(c)[which].distance_m).sum::<f64>();
    let differences: Vec<i64> = corridors
        .iter()
        .map(|c| drives(c).each_ref().map(|drive| i64::from(count(drive))))
        .map(|[a, b]| a - b)
        .collect();
    let totals = [total(0), total(1)];
    let times = |is: &dyn Fn(i64) -> bool| differences.iter().filter(|d| is(**d)).count() as u64;
    Contrast {
        totals,
        per_100_m: [0, 1].map(|which| 100.0 * totals[which] as f64 / way_m(which).max(1e-9)),
        more_same_fewer: [times(&|d| d > 0), times(&|d| d == 0), times(&|d| d < 0)],
        p: sign_flip_test(&differences),
    }
}

/// The corridor of a seed: the first that is drawn with something on its middle line and a way through.
#[must_use]
pub fn crowded(seed: u64) -> Course {
    let mut random = Random::new(seed, 0x434f_5252_4944);
    loop {
        let mut world = World::corridor(random.bits() >> 16, DENSITY);
        let Some([from, to]) = world.legs_m.first().and_then(|leg| leg.first_chunk().copied()) else {
            continue;
        };
        if Floor::new(&world, CORRIDOR_M).way(from, to, FREE_WAY_M).is_some() {
            world.legs_m =
                (0..LEGS).map(|leg| if leg % 2 == 0 { vec![from, to] } else { vec![to, from] }).collect();
            let course = Course::of(&format!("corridor {seed}"), "crowded", random.bits() >> 16, world);
            if course.path_blocked {
                return course;
            }
        }
    }
}

/// Counts what begins anew after some time without.
#[derive(Debug, Default)]
struct Episodes {
    count: u32,
    last_s: Option<f64>,
}

impl Episodes {
    fn note(&mut self, happens: bool, time_s: f64) {
        if happens {
            self.count += u32::from(self.last_s.is_none_or(|last_s| time_s - last_s > APART_S));
            self.last_s = Some(time_s);
        }
    }
}

fn patrol(pilot: &mut Pilot<'_>, course: &Course, conditions: Conditions) -> Result<Patrol, NavigateError> {
    let mut drive = pilot.begin(course, conditions)?;
    let floor = Floor::new(&course.world, CORRIDOR_M);
    let [from, to] = [course.world.legs_m[0][0], course.world.legs_m[0][1]];
    let way = floor.way(from, to, FREE_WAY_M).unwrap_or_default();
    let mut takeovers = Episodes::default();
    let (mut contacts, mut stuck, mut interventions_m) = (0, 0, Vec::new());
    let (mut left_m, mut since_s, mut ticks) = ([from[0], from[1]], 0.0, 0_u64);
    while drive.outcome().arrivals < LEGS as u32 && drive.outcome().time_s < LIMIT_S {
        let before = drive.outcome().collisions;
        ticks += 1;
        if ticks.is_multiple_of(LOCALISED_TICKS) {
            drive.localise();
        }
        drive.tick();
        let (truth, time_s) = (drive.truth(), drive.outcome().time_s);
        let at_m = [truth.pose.x_m, truth.pose.y_m];
        takeovers.note(conditions.arbitrated && is_takeover(drive.command().reason), time_s);
        if libm::hypot(at_m[0] - left_m[0], at_m[1] - left_m[1]) > PROGRESS_M {
            (left_m, since_s) = (at_m, time_s);
        }
        let hit = drive.outcome().collisions > before;
        let waits = time_s - since_s > STUCK_S;
        if hit || waits {
            contacts += u32::from(hit);
            stuck += u32::from(!hit);
            interventions_m.push(at_m);
            let there = drive.outcome().arrivals.is_multiple_of(2);
            push_on(&mut drive, &way, there);
            (left_m, since_s) = (at_m, drive.outcome().time_s);
        }
    }
    let outcome = drive.outcome();
    let patrol = Patrol {
        contacts,
        stuck,
        takeovers: takeovers.count,
        legs: outcome.arrivals,
        time_s: outcome.time_s,
        distance_m: outcome.distance_m,
        min_clearance_m: f64::from(outcome.min_clearance_m),
        interventions_m,
        trace_m: outcome.trace.iter().map(|point| [point.pose.x_m, point.pose.y_m]).collect(),
    };
    pilot.take_back(drive);
    Ok(patrol)
}

/// Pushes the robot onto the way and a little along it, as somebody does who walks behind: its camera goes on seeing.
fn push_on(drive: &mut Drive, way_m: &[[f64; 2]], there: bool) {
    let pose = drive.truth().pose;
    let far = |point: &[f64; 2]| libm::hypot(point[0] - pose.x_m, point[1] - pose.y_m);
    let Some(nearest) = (0..way_m.len()).min_by(|a, b| far(&way_m[*a]).total_cmp(&far(&way_m[*b]))) else {
        return;
    };
    let last = way_m.len() - 1;
    let step = |by: usize| if there { (nearest + by).min(last) } else { nearest.saturating_sub(by) };
    for by in 0..=(PUT_M / STRIDE_M) as usize {
        let (place, next) = (way_m[step(by)], way_m[step(by + 3)]);
        let off = [next[0] - place[0], next[1] - place[1]];
        let end_rad = if there { 0.0 } else { std::f64::consts::PI };
        let yaw = if libm::hypot(off[0], off[1]) > STRIDE_M { libm::atan2(off[1], off[0]) } else { end_rad };
        push_to(drive, &Pose2::new(place[0], place[1], yaw));
    }
}

/// Pushes the robot straight to a pose, at most [`PUSH_M`] and [`PUSH_RAD`] per tick.
fn push_to(drive: &mut Drive, to: &Pose2) {
    let from = drive.truth().pose;
    let turn_rad = wrap_angle(to.yaw_rad - from.yaw_rad);
    let way_m = libm::hypot(to.x_m - from.x_m, to.y_m - from.y_m);
    let ticks = libm::ceil((way_m / PUSH_M).max(turn_rad.abs() / PUSH_RAD)) as u32;
    for tick in 1..=ticks {
        let part = f64::from(tick) / f64::from(ticks);
        let x_m = from.x_m + part * (to.x_m - from.x_m);
        let y_m = from.y_m + part * (to.y_m - from.y_m);
        drive.push(&Pose2::new(x_m, y_m, wrap_angle(from.yaw_rad + part * turn_rad)));
        drive.tick();
    }
}

/// Whether the arbiter does something else than let through or slow the wish.
fn is_takeover(reason: u32) -> bool {
    !matches!(
        Reason::from_code(reason),
        Some(
            Reason::Clear
                | Reason::Slowed
                | Reason::Arrived
                | Reason::NoGoal
                | Reason::NoMap
                | Reason::Starting
                | Reason::NoOdometry
                | Reason::StaleGoal
                | Reason::StaleProposals
                | Reason::PoseJump
        )
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_corridor_is_crowded_and_has_a_way() {
        for seed in FIRST_SEED..FIRST_SEED + SEEDS {
            let course = crowded(seed);
            let obstacles = course.world.solids.len() - 4;
            assert!(obstacles >= 7 && course.path_blocked, "seed {seed}: {obstacles}");
            assert_eq!(course.world.legs_m.len(), LEGS);
        }
    }

    #[test]
    fn an_episode_ends_only_after_some_time_without() {
        let mut episodes = Episodes::default();
        for (time_s, happens) in [(0.1, true), (0.2, false), (0.4, true), (1.0, false), (1.1, true)] {
            episodes.note(happens, time_s);
        }
        assert_eq!(episodes.count, 2);
    }
}

//! A suite of courses under every condition asked for: shares with intervals, means, and each failure by its seed.

use crate::error::NavigateError;
use crate::pilot::{Conditions, Driven, Ending, Pilot};
use crate::room::{Course, room};
use serde::{Serialize, Serializer};
use sidestep_crew::in_order;
use sidestep_drive::{Lead, Sight};
use sidestep_msgs::Robot;
use sidestep_report::Proportion;

/// Courses between two lines of progress.
const PROGRESS: usize = 50;

/// What to drive, and how.
#[derive(Debug, Clone)]
pub struct SuiteOptions<'a> {
    /// The robot.
    pub robot: &'a Robot,
    /// Model file of the policy.
    pub model: &'a [u8],
    /// What messages and reports call it.
    pub model_name: &'a str,
    /// Who leads, one after the other.
    pub leads: Vec<Lead>,
    /// With the arbiter, without it, or one after the other.
    pub arbitrated: Vec<bool>,
    /// How the robot sees.
    pub sight: Sight,
    /// `[s]` a course that takes longer is not reached.
    pub limit_s: f64,
    /// Threads; no influence on the numbers.
    pub threads: usize,
}

/// A suite under every condition.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Suite {
    /// What was driven.
    pub name: String,
    /// Name of the model.
    pub model: String,
    /// How the robot saw.
    pub sight: &'static str,
    /// `[s]` time limit of a course.
    pub limit_s: f64,
    /// Courses whose straight line from start to goal is blocked.
    pub straight_blocked: Proportion,
    /// Courses whose reference path itself is blocked.
    pub path_blocked: Proportion,
    /// One for each condition.
    pub groups: Vec<Group>,
}

/// What came of one condition.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Group {
    /// Who led.
    #[serde(serialize_with = "label")]
    pub lead: Lead,
    /// Whether the arbiter filtered.
    pub arbitrated: bool,
    /// Courses whose goal was reached without contact in time.
    pub reached: Proportion,
    /// Courses with a contact.
    pub contact: Proportion,
    /// The same for each difficulty.
    pub grades: Vec<GradeShare>,
    /// `[s]` mean time of the courses reached.
    pub time_s: f64,
    /// `[m]` mean way of the courses reached.
    pub distance_m: f64,
    /// `[m/s]` mean speed of the courses reached, standing included.
    pub speed_m_s: f64,
    /// `[m/s]` the same of the courses that this lead reached with the arbiter and without, as far as it drove both ways.
    pub shared_speed_m_s: f64,
    /// `[s]` mean time of standing, all courses.
    pub standing_s: f64,
    /// Mean number of stops on the way, all courses.
    pub stops: f64,
    /// `[m]` mean over all courses of the smallest gap to anything.
    pub clearance_m: f64,
    /// `[m]` smallest gap in any course.
    pub min_clearance_m: f64,
    /// `[1]` mean J of eq. (6) of the commands, every 0.5 s of all courses.
    pub cost: f64,
    /// `[1]` median over the courses of the mean J of each: what a few that were stuck do not move.
    pub cost_median: f64,
    /// Every course that was not reached.
    pub failures: Vec<Failure>,
}

/// A difficulty within a group.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct GradeShare {
    /// Its name.
    pub grade: String,
    /// Courses reached without contact in time.
    pub reached: Proportion,
    /// Courses with a contact.
    pub contact: Proportion,
}

/// A course that was not reached.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Failure {
    /// Name of the course.
    pub course: String,
    /// Its difficulty.
    pub grade: String,
    /// Seed of the drive.
    pub seed: u64,
    /// How it ended.
    pub ending: Ending,
    /// `[s]` after how long.
    pub time_s: f64,
    /// `[m]` where.
    pub at_m: [f64; 2],
    /// In words.
    pub summary: String,
    /// `[m]` the way there, for a picture.
    #[serde(skip)]
    pub trace_m: Vec<[f64; 2]>,
    /// The course, for a picture.
    #[serde(skip)]
    pub whole: Course,
}

pub(crate) fn label<S: Serializer>(lead: &Lead, serializer: S) -> Result<S::Ok, S::Error> {
    serializer.serialize_str(lead.label())
}

/// Drives `count` unseen rooms of a seed, each of its own difficulty ([`crate::GRADES`]), under every condition.
///
/// # Errors
/// [`NavigateError`] where a model or a node refuses, or nothing is asked for.
pub fn rooms(
    options: &SuiteOptions<'_>,
    seed: u64,
    count: u64,
    progress: &mut (dyn FnMut(&str) + Send),
) -> Result<Suite, NavigateError> {
    let courses: Vec<Course> = (0..count).map(|number| room(seed, number)).collect();
    drive_courses(options, &format!("{count} rooms of seed {seed}"), &courses, progress)
}

/// Drives courses of any origin under every condition.
///
/// # Errors
/// [`NavigateError`] where a model or a node refuses, or nothing is asked for.
pub fn drive_courses(
    options: &SuiteOptions<'_>,
    name: &str,
    courses: &[Course],
    progress: &mut (dyn FnMut(&str) + Send),
) -> Result<Suite, NavigateError> {
    let mut groups = Vec::new();
    for lead in &options.leads {
        let mut ways = Vec::new();
        for arbitrated in &options.arbitrated {
            let conditions = Conditions { lead: *lead, arbitrated: *arbitrated, sight: options.sight };
            ways.push((conditions, drive_all(options, conditions, courses, progress)?));
        }
        let reached = |number: usize| ways.iter().all(|(_, driven)| driven[number].ending == Ending::Reached);
        let shared: Vec<bool> = (0..courses.len()).map(reached).collect();
        let summary = |(conditions, driven): &(Conditions, Vec<Driven>)| {
            summarise(*conditions, courses, driven, &shared)
        };
        groups.extend(ways.iter().map(summary));
    }
    if groups.is_empty() || courses.is_empty() {
        let found = format!("{} courses, {} conditions", courses.len(), groups.len());
        return Err(NavigateError::Option { option: "suite", found, needed: "at least one of each" });
    }
    let share = |is: &dyn Fn(&Course) -> bool| {
        Proportion::new(courses.iter().filter(|course| is(course)).count() as u64, courses.len() as u64)
    };
    Ok(Suite {
        name: name.into(),
        model: options.model_name.into(),
        sight: options.sight.label(),
        limit_s: options.limit_s,
        straight_blocked: share(&|course| course.straight_blocked),
        path_blocked: share(&|course| course.path_blocked),
        groups,
    })
}

fn drive_all(
    options: &SuiteOptions<'_>,
    conditions: Conditions,
    courses: &[Course],
    progress: &mut (dyn FnMut(&str) + Send),
) -> Result<Vec<Driven>, NavigateError> {
    let mut done = |finished: usize| {
        if finished.is_multiple_of(PROGRESS) || finished == courses.len() {
            progress(&format!("{}: {finished} of {} courses", conditions.label(), courses.len()));
        }
    };
    in_order(
        courses.len(),
        options.threads,
        || Pilot::new(options.robot, options.model, options.model_name),
        |pilot, number| pilot.drive(&courses[number], conditions, options.limit_s),
        &mut done,
    )
}

/// What came of the courses; `shared` says which of them the lead reached both ways.
fn summarise(conditions: Conditions, courses: &[Course], driven: &[Driven], shared: &[bool]) -> Group {
    let both = || courses.iter().zip(driven);
    let share = |ending: Ending, grade: Option<&str>| {
        let of = both().filter(|(course, _)| grade.is_none_or(|grade| course.grade == grade));
        let (mut count, mut all) = (0, 0);
        of.for_each(|(_, drive)| (count, all) = (count + u64::from(drive.ending == ending), all + 1));
        Proportion::new(count, all)
    };
    let mut names: Vec<&str> = Vec::new();
    for course in courses {
        if !names.contains(&course.grade.as_str()) {
            names.push(&course.grade);
        }
    }
    let grade = |name: &&str| GradeShare {
        grade: (*name).into(),
        reached: share(Ending::Reached, Some(name)),
        contact: share(Ending::Contact, Some(name)),
    };
    let mean =
        |number: &dyn Fn(&Driven) -> f64| driven.iter().map(number).sum::<f64>() / driven.len().max(1) as f64;
    let way = |counts: &dyn Fn(usize, &Driven) -> bool| {
        let counted = driven.iter().enumerate().filter(|(number, drive)| counts(*number, drive));
        counted
            .fold((0.0, 0.0), |(time_s, way_m), (_, drive)| (time_s + drive.time_s, way_m + drive.distance_m))
    };
    let (time_s, distance_m) = way(&|_, drive| drive.ending == Ending::Reached);
    let (shared_time_s, shared_m) = way(&|number, _| shared[number]);
    let arrivals = driven.iter().filter(|drive| drive.ending == Ending::Reached).count().max(1) as f64;
    let judged: u64 = driven.iter().map(|drive| drive.judged).sum();
    Group {
        lead: conditions.lead,
        arbitrated: conditions.arbitrated,
        reached: share(Ending::Reached, None),
        contact: share(Ending::Contact, None),
        grades: names.iter().map(grade).collect(),
        time_s: time_s / arrivals,
        distance_m: distance_m / arrivals,
        speed_m_s: distance_m / time_s.max(1e-9),
        shared_speed_m_s: shared_m / shared_time_s.max(1e-9),
        standing_s: mean(&|drive| drive.standing_s),
        stops: mean(&|drive| f64::from(drive.stops)),
        clearance_m: mean(&|drive| drive.min_clearance_m),
        min_clearance_m: driven.iter().map(|drive| drive.min_clearance_m).fold(f64::INFINITY, f64::min),
        cost: driven.iter().map(|drive| drive.cost_sum).sum::<f64>() / judged.max(1) as f64,
        cost_median: median(driven.iter().filter(|drive| drive.judged > 0).map(Driven::cost).collect()),
        failures: both().filter(|(_, drive)| drive.ending != Ending::Reached).map(failure).collect(),
    }
}

fn median(mut numbers: Vec<f64>) -> f64 {
    numbers.sort_by(f64::total_cmp);
    numbers.get(numbers.len() / 2).copied().unwrap_or(0.0)
}

fn failure((course, drive): (&Course, &Driven)) -> Failure {
    Failure {
        course: course.name.clone(),
        grade: course.grade.clone(),
        seed: course.seed,
        ending: drive.ending,
        time_s: drive.time_s,
        at_m: drive.trace_m.last().copied().unwrap_or_default(),
        summary: drive.summary.clone(),
        trace_m: drive.trace_m.clone(),
        whole: course.clone(),
    }
}

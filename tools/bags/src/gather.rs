//! The second look through a bag: poses, moving joints and the times of all frames, small enough to hold at once.

use crate::cdr::decode;
use crate::choice::{Choice, Poses, Sensor};
use crate::error::BagError;
use crate::messages::{self, TransformMessage};
use crate::options::BagOptions;
use crate::rigid::Rigid;
use crate::survey::{Kind, Stamped, Survey};
use crate::track::{Sample, Track};
use crate::tree::{Motions, Route, Tree};
use sidestep_import::FIRST_NS;
use sidestep_msgs::{Pose2, Twist};
use sidestep_player::{ForeignChannel, ForeignMessage, read_foreign};

/// `[ns]` a message that arrives sooner after its stamp, or later, was stamped or recorded by another clock.
const DELAYS_NS: std::ops::RangeInclusive<i64> = -50_000_000..=1_000_000_000;
/// `[ns]` no arrival is later than this: what is late in a bag was late for the recorder, not for the robot.
const DELAY_MAX_NS: i64 = 500_000_000;
/// `[ns]` a hundred years: no sum of times overflows.
const GRAPH_NS_MAX: u64 = 100 * 365 * 86_400 * 1_000_000_000;
/// `[ns]` a frame this far outside the odometry may still be mapped.
const EDGE_NS: u64 = 100_000_000;

/// Times of a bag as graph time.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(crate) struct Times {
    arrival_stamps: bool,
    /// Stamp that becomes [`FIRST_NS`].
    pub(crate) first_ns: u64,
    /// How far the clock of arrivals is ahead of that of stamps.
    ahead_ns: i64,
}

impl Times {
    /// The stamp that counts.
    pub(crate) fn stamp_ns(&self, header: &messages::Header, logged_ns: u64) -> u64 {
        if self.arrival_stamps { logged_ns } else { header.stamp.ns() }
    }

    /// Graph time of a stamp; stamps beyond [`GRAPH_NS_MAX`] are nonsense, and stay in order.
    pub(crate) fn graph_ns(&self, stamp_ns: u64) -> u64 {
        stamp_ns.saturating_sub(self.first_ns).min(GRAPH_NS_MAX) + FIRST_NS
    }

    /// Graph time of an arrival, never before the stamp.
    pub(crate) fn now_ns(&self, stamp_ns: u64, logged_ns: u64) -> u64 {
        let delay_ns = delay_ns(stamp_ns, logged_ns).saturating_sub(self.ahead_ns).clamp(0, DELAY_MAX_NS);
        self.graph_ns(stamp_ns).saturating_add_signed(delay_ns)
    }

    /// `[ns]` from graph time to the wall time of the stamps.
    pub(crate) fn to_wall_ns(self) -> i64 {
        i64::try_from(self.first_ns).unwrap_or(0) - FIRST_NS as i64
    }
}

fn delay_ns(stamp_ns: u64, logged_ns: u64) -> i64 {
    i64::try_from(i128::from(logged_ns) - i128::from(stamp_ns)).unwrap_or(0)
}

/// Stamp and arrival, by the clocks of the bag.
pub(crate) type Mark = (u64, u64);

/// What an import must know before it can write the first frame.
#[derive(Debug, Default)]
pub(crate) struct Gathered {
    pub(crate) times: Times,
    pub(crate) track: Track,
    pub(crate) motions: Motions,
    pub(crate) frames: Vec<Mark>,
    pub(crate) sweeps: Vec<Mark>,
    /// Odometry that could not be read.
    pub(crate) broken: usize,
}

/// A pose in the times of the bag.
struct Raw {
    mark: Mark,
    rigid: Rigid,
    twist: Option<Twist>,
    variance: [f32; 3],
}

impl Raw {
    fn of(odometry: &messages::Odometry, mark: Mark) -> Option<Self> {
        let rigid = odometry.pose.rigid()?;
        let twist = Twist::new(odometry.twist.linear.x as f32, odometry.twist.angular.z as f32);
        let variance = [0, 1, 5].map(|i| odometry.pose_covariance[i][i] as f32);
        let variance = variance.map(|part| if part.is_finite() && part >= 0.0 { part } else { 0.0 });
        Some(Self { mark, rigid, twist: twist.is_finite().then_some(twist), variance })
    }
}

fn topic_of(sensor: Option<&Sensor>) -> &str {
    sensor.map_or("", |sensor| sensor.topic.as_str())
}

/// Reads all messages but the pixels.
pub(crate) fn gather(survey: &Survey, choice: &Choice, options: &BagOptions) -> Result<Gathered, BagError> {
    let times = Times { arrival_stamps: options.arrival_stamps, ..Times::default() };
    let tree = &survey.tree;
    let sensors = [&choice.depth, &choice.scan].into_iter().flatten();
    let mut routes: Vec<&Route> = sensors.filter_map(|sensor| sensor.route.as_ref()).collect();
    if let Poses::Transforms(route) = &choice.poses {
        routes.push(route);
    }
    let mut found = Gathered {
        times,
        motions: Motions::of(routes.into_iter().flat_map(|route| tree.moving(route))),
        ..Gathered::default()
    };
    let (depth, scan) = (topic_of(choice.depth.as_ref()), topic_of(choice.scan.as_ref()));
    let odometry = if let Poses::Topic(topic) = &choice.poses { topic.as_str() } else { "" };
    let mut raw = Vec::new();
    let mut look = |channel: &ForeignChannel, message: ForeignMessage| {
        let (topic, logged_ns) = (channel.topic.as_str(), message.logged_ns);
        let mark = |header: &messages::Header| (times.stamp_ns(header, logged_ns), logged_ns);
        if topic == depth || topic == scan {
            let marks = if topic == depth { &mut found.frames } else { &mut found.sweeps };
            // What cannot be read is counted when its pixels are.
            marks.extend(decode::<Stamped>(message.data).ok().map(|stamped| mark(&stamped.header)));
        } else if topic == odometry {
            let read = decode::<messages::Odometry>(message.data).ok();
            let sample = read.and_then(|odometry| Raw::of(&odometry, mark(&odometry.header)));
            found.broken += usize::from(sample.is_none());
            raw.extend(sample);
        } else if survey.topics.get(topic).is_some_and(|seen| seen.kind == Kind::Transforms)
            && !found.motions.is_empty()
            && let Ok(transforms) = decode::<TransformMessage>(message.data)
        {
            found.motions.learn(&transforms, options.arrival_stamps.then_some(logged_ns));
        }
        Ok::<(), BagError>(())
    };
    for file in &survey.files {
        read_foreign(file, &mut look)?;
    }
    found.motions.sort();
    raw.extend(derived(&found, tree, choice));
    found.set_times(&raw);
    found.track = Track::new(found.samples(&raw, choice));
    found.check(survey, choice)?;
    Ok(found)
}

/// The poses that transforms give.
fn derived(found: &Gathered, tree: &Tree, choice: &Choice) -> Vec<Raw> {
    let Poses::Transforms(route) = &choice.poses else { return Vec::new() };
    let moving = Motions::of(tree.moving(route));
    let stamps = if moving.is_empty() {
        // A robot that never moved has one pose, which held from first to last.
        found.frames.iter().chain(&found.sweeps).map(|mark| mark.0).collect()
    } else {
        found.motions.stamps()
    };
    let at = |&stamp_ns: &u64| {
        let rigid = found.motions.at(tree, route, stamp_ns)?;
        Some(Raw { mark: (stamp_ns, stamp_ns), rigid, twist: None, variance: [0.0; 3] })
    };
    stamps.iter().filter_map(at).collect()
}

impl Gathered {
    fn set_times(&mut self, raw: &[Raw]) {
        let all = || raw.iter().map(|raw| raw.mark).chain(self.frames.iter().chain(&self.sweeps).copied());
        let soonest_ns = all().map(|(stamp_ns, logged_ns)| delay_ns(stamp_ns, logged_ns)).min().unwrap_or(0);
        self.times.ahead_ns = if DELAYS_NS.contains(&soonest_ns) { 0 } else { soonest_ns };
        self.times.first_ns = all().map(|(stamp_ns, _)| stamp_ns).min().unwrap_or(0);
    }

    fn samples(&self, raw: &[Raw], choice: &Choice) -> Vec<Sample> {
        let (times, marks) = (&self.times, self.frames.iter().chain(&self.sweeps));
        let standing = |(place, &(stamp_ns, logged_ns)): (usize, &Mark)| {
            let (at_ns, now_ns) = (times.graph_ns(stamp_ns), times.now_ns(stamp_ns, logged_ns));
            let sample = Sample::new(at_ns, now_ns, &Rigid::planar(&Pose2::ORIGIN, 0.0, 0.0));
            Sample { pose_epoch: place as u32 + 1, ..sample }
        };
        if matches!(choice.poses, Poses::Floor(_)) {
            return marks.enumerate().map(standing).collect();
        }
        let sample = |raw: &Raw| {
            let (stamp_ns, logged_ns) = raw.mark;
            let (at_ns, now_ns) = (times.graph_ns(stamp_ns), times.now_ns(stamp_ns, logged_ns));
            Sample { twist: raw.twist, variance: raw.variance, ..Sample::new(at_ns, now_ns, &raw.rigid) }
        };
        raw.iter().map(sample).collect()
    }

    /// Frames whose time the odometry does not cover.
    pub(crate) fn uncovered(&self) -> usize {
        let Some((first_ns, last_ns)) = self.track.span_ns() else { return self.frames.len() };
        let covered = first_ns.saturating_sub(EDGE_NS)..=last_ns + EDGE_NS;
        let marks = self.frames.iter().chain(&self.sweeps);
        marks.filter(|mark| !covered.contains(&self.times.graph_ns(mark.0))).count()
    }

    /// Refuses stamps that say nothing.
    fn check(&self, survey: &Survey, choice: &Choice) -> Result<(), BagError> {
        let all = self.frames.len() + self.sweeps.len();
        let marks = || self.frames.iter().chain(&self.sweeps);
        let same = all > 1 && marks().all(|mark| Some(mark.0) == marks().next().map(|mark| mark.0));
        if all == 0 || (!same && self.uncovered() < all) {
            return Ok(());
        }
        let seconds = |stamp_ns: u64| stamp_ns.saturating_add_signed(self.times.to_wall_ns()) as f64 * 1e-9;
        let span = self.track.span_ns().map_or("none".into(), |(first_ns, last_ns)| {
            format!("{:.3} to {:.3} s", seconds(first_ns), seconds(last_ns))
        });
        let (first, last) = (marks().map(|mark| mark.0).min(), marks().map(|mark| mark.0).max());
        let range = |at: Option<u64>| at.unwrap_or(0) as f64 * 1e-9;
        let sensor = choice.depth.as_ref().or(choice.scan.as_ref());
        let found = format!(
            "{} stamped {:.3} to {:.3} s, poses stamped {span}",
            topic_of(sensor),
            range(first),
            range(last)
        );
        let remedy = "give --stamps arrival to take the times at which messages were recorded";
        Err(BagError::content(&survey.path, found, "stamps that differ, and poses at the same time", remedy))
    }
}

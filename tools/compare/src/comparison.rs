//! The comparison: recordings in, figures and the frames worth a look out.

use crate::conduct::Conduct;
use crate::error::CompareError;
use crate::figures::{Ages, Figures};
use crate::frames::{Pair, Point, Rank, Shown};
use crate::join::{Coverage, Frame, Joiner, Seconds};
use crate::keep::{Highest, HighestApart};
use crate::source::{Origin, Source};
use serde::Serialize;
use sidestep_expert::{Config, Judge};
use sidestep_latency::Collector;
use sidestep_msgs::{
    CLOCK, COMMAND, Code, LOCAL_CELLS, LOCAL_MAP, LocalGoal, LocalMap, Proposal, Robot, Status, TRUTH, Twist,
    layout_hash,
};
use sidestep_player::Messages;
use sidestep_train::{
    Demonstration, Difference, Header, TrainError, WINDOWS_S, demonstrations, within_window,
};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Most samples that can be mined at once: they are held until the file is written.
const MINE_MOST: usize = 100_000;

/// Frames to keep as training samples.
#[derive(Debug, Clone, PartialEq)]
pub struct Mine {
    /// How many.
    pub count: usize,
    /// The data set to write; never written over.
    pub out: PathBuf,
}

/// What to compare.
#[derive(Debug, Clone, PartialEq)]
pub struct Options {
    /// A recording.
    pub file: PathBuf,
    /// Another one of the same sensors: then policy is compared with policy.
    pub other: Option<PathBuf>,
    /// How many of the worst frames are drawn.
    pub worst: usize,
    /// What makes a frame bad.
    pub rank: Rank,
    /// Training samples to write.
    pub mine: Option<Mine>,
}

/// One recording, read.
#[derive(Debug, Clone, Serialize)]
pub(crate) struct Read {
    pub(crate) origin: Origin,
    pub(crate) coverage: Coverage,
    pub(crate) conduct: Conduct,
    /// Of policy and expert.
    pub(crate) ages: [Option<Ages>; 2],
    pub(crate) latency_ms: serde_json::Value,
}

/// What came out.
#[derive(Debug, Clone, Serialize)]
pub struct Comparison {
    /// Names of the two that are compared.
    pub names: [String; 2],
    /// What makes a frame bad.
    pub rank: Rank,
    /// The figures.
    pub figures: Figures,
    pub(crate) recordings: Vec<Read>,
    /// Of two recordings: frames of equal number and depth stamp whose map, goal or velocity differ, left out.
    pub seen_differently: u64,
    /// The worst frames.
    pub worst: Vec<Shown>,
    /// What was mined.
    pub mined: Option<u64>,
    #[serde(skip)]
    pub(crate) points: Vec<Point>,
    #[serde(skip)]
    pub(crate) robot: Robot,
}

/// What one model said about a frame, and what it saw.
#[derive(Debug, Clone, Copy)]
struct Said {
    inputs: u64,
    twist: Twist,
    doubt: [f32; 2],
}

/// A fingerprint of what proposers see.
fn inputs(map: &LocalMap, goal: &LocalGoal) -> u64 {
    let numbers = [goal.twist.v_m_s.to_bits(), goal.twist.w_rad_s.to_bits(), goal.cell];
    let cells: &[u8; LOCAL_CELLS] = &map.planning_cost;
    // FNV over the bytes; collisions do not matter to a share of frames.
    let mut hash = layout_hash(&format!("{numbers:?}"), &[]);
    for byte in cells {
        hash = (hash ^ u64::from(*byte)).wrapping_mul(0x0100_0000_01b3);
    }
    hash
}

/// The proposal, where its step could do its work.
fn fit(said: &Option<(Proposal, u32)>) -> Option<&Proposal> {
    said.as_ref()
        .filter(|(proposal, status)| *status == Status::Ok.code() && proposal.twist.is_finite())
        .map(|said| &said.0)
}

/// Gathers what is compared.
struct Gatherer<'a> {
    judge: Judge,
    robot: &'a Robot,
    rank: Rank,
    windows: [Difference; WINDOWS_S.len()],
    points: Vec<Point>,
    worst: HighestApart<Shown>,
    mined: Highest<Demonstration>,
}

impl<'a> Gatherer<'a> {
    fn new(source: &'a Source, options: &Options) -> Self {
        Self {
            judge: Judge::new(&source.robot.limits, &source.weights, Config::STANDARD.candidates),
            robot: &source.robot,
            rank: options.rank,
            windows: Default::default(),
            points: Vec::new(),
            worst: HighestApart::new(options.worst),
            mined: Highest::new(options.mine.as_ref().map_or(0, |mine| mine.count)),
        }
    }

    fn pair(&mut self, pair: &Pair<'_>) {
        let within = WINDOWS_S.map(|window_s| {
            pair.twists.map(|twist| within_window(twist, pair.goal.twist, &self.robot.limits, window_s))
        });
        for ([first, second], difference) in within.iter().zip(&mut self.windows) {
            difference.add(*first, *second);
        }
        let judged = pair.judged(&mut self.judge);
        let point = pair.point(&judged, within[0]);
        let score = point.score(self.rank);
        self.points.push(point);
        // Where the policy was the better one, nothing was bad.
        if score > 0.0 {
            self.worst.offer(point.time_s, score, || pair.shown(&judged, &point));
        }
        self.mined.offer(score, || pair.sample());
    }
}

/// Reads a recording and shows each frame with everything that was said about it.
fn read(source: &Source, mut show: impl FnMut(&Frame)) -> Result<Read, CompareError> {
    let (mut joiner, mut conduct) = (Joiner::default(), Conduct::default());
    let (mut seconds, mut latency) = (Seconds::default(), Collector::new(&BTreeMap::new()));
    let mut messages = Messages::open(&source.path)?;
    for entry in &mut messages {
        let entry = entry?;
        if let Some(clock) = entry.read(CLOCK) {
            latency.clock(&clock);
        }
        latency.header(entry.topic, &entry.header);
        if let Some(truth) = entry.read(TRUTH) {
            conduct.truth(&truth);
        }
        if ![LOCAL_MAP.index, COMMAND.index].contains(&entry.topic) && entry.header.source_frame == 0 {
            continue;
        }
        let time_s = seconds.of(entry.header.epoch, entry.header.now_ns);
        if let Some(command) = entry.read(COMMAND) {
            latency.command(&command);
            conduct.command(&command, time_s);
        }
        if let Some(frame) = joiner.take(&entry, time_s) {
            show(&frame);
        }
    }
    while let Some(frame) = joiner.next() {
        show(&frame);
    }
    conduct.finish();
    let mut origin = source.origin.clone();
    origin.damage = origin.damage.or_else(|| messages.damage().map(str::to_owned));
    // In lockstep a drive is recorded faster or slower than it was; its own time is what counts.
    origin.duration_s = seconds.last_s();
    let (ages, latency_ms) = (Ages::of(&conduct), latency.json());
    Ok(Read { origin, coverage: joiner.coverage, conduct, ages, latency_ms })
}

/// Refuses a recording in which a proposer never spoke.
fn require(path: &Path, coverage: &Coverage, needed: &[(&str, u64)]) -> Result<(), CompareError> {
    let missing: Vec<_> = needed.iter().filter(|(_, count)| *count == 0).map(|(topic, _)| *topic).collect();
    if missing.is_empty() && coverage.maps > 0 {
        return Ok(());
    }
    let needed = if missing.is_empty() { "local_map".to_owned() } else { missing.join(" and no ") };
    Err(CompareError::NoProposals { path: path.to_path_buf(), needed })
}

fn said_by(statuses: &BTreeMap<&'static str, u64>) -> u64 {
    statuses.values().sum()
}

/// Compares the proposals of one recording or of two.
///
/// # Errors
/// [`CompareError`] with what was found, what is needed and what to do.
pub fn compare(options: &Options) -> Result<Comparison, CompareError> {
    if let Some(mine) = &options.mine {
        if !(1..=MINE_MOST).contains(&mine.count) {
            let found = mine.count.to_string();
            return Err(CompareError::Option { option: "mine", found, needed: "1 to 100000" });
        }
        if mine.out.exists() {
            // Said before a long recording is read; the writer makes sure of it once more.
            return Err(TrainError::Exists { path: mine.out.display().to_string() }.into());
        }
    }
    let source = Source::open(&options.file)?;
    let mut gatherer = Gatherer::new(&source, options);
    let (names, recordings, seen_differently) = match &options.other {
        None => one(&source, &mut gatherer)?,
        Some(other) => two(&source, &Source::open(other)?, &mut gatherer)?,
    };
    let Gatherer { windows, points, worst, mined, .. } = gatherer;
    let mined =
        options.mine.as_ref().map(|mine| write_mined(mine, &source, &mined.into_sorted())).transpose()?;
    Ok(Comparison {
        names,
        rank: options.rank,
        figures: Figures::of(&points, WINDOWS_S.into_iter().zip(windows).collect()),
        recordings,
        seen_differently,
        worst: worst.into_sorted(),
        mined: mined.map(|header| header.count),
        points,
        robot: source.robot.clone(),
    })
}

fn write_mined(mine: &Mine, source: &Source, samples: &[Demonstration]) -> Result<Header, CompareError> {
    Ok(demonstrations(&mine.out, &source.robot, samples)?)
}

type Outcome = ([String; 2], Vec<Read>, u64);

/// Policy against expert.
fn one(source: &Source, gatherer: &mut Gatherer<'_>) -> Result<Outcome, CompareError> {
    let read = read(source, |frame| {
        let (Some(map), Some(goal)) = (&frame.map, &frame.goal) else { return };
        let (Some(policy), Some(expert)) = (fit(&frame.proposals[0]), fit(&frame.proposals[1])) else {
            return;
        };
        let doubt = [policy.doubt_v_m_s, policy.doubt_w_rad_s];
        gatherer.pair(&Pair { frame, map, goal, twists: [policy.twist, expert.twist], doubt });
    })?;
    let coverage = &read.coverage;
    let said = [
        ("policy_command", said_by(&coverage.policy_statuses)),
        ("expert_command", said_by(&coverage.expert_statuses)),
    ];
    require(&source.path, coverage, &said)?;
    if gatherer.points.is_empty() {
        return Err(CompareError::NoPair { path: source.path.clone(), frames: coverage.maps });
    }
    Ok((["policy".into(), "expert".into()], vec![read], 0))
}

/// Policy of A against policy of B, on frames of equal number, depth stamp, map, goal and velocity.
fn two(a: &Source, b: &Source, gatherer: &mut Gatherer<'_>) -> Result<Outcome, CompareError> {
    if a.robot.motion_hash() != b.robot.motion_hash() {
        return Err(CompareError::OtherRobot { a: a.path.clone(), b: b.path.clone() });
    }
    let mut known: BTreeMap<(u64, u64), Said> = BTreeMap::new();
    let first = read(a, |frame| {
        let (Some(map), Some(goal)) = (&frame.map, &frame.goal) else { return };
        if let Some(policy) = fit(&frame.proposals[0]) {
            let doubt = [policy.doubt_v_m_s, policy.doubt_w_rad_s];
            let said = Said { inputs: inputs(map, goal), twist: policy.twist, doubt };
            known.insert((frame.number, frame.capture_ns), said);
        }
    })?;
    require(&a.path, &first.coverage, &[("policy_command", said_by(&first.coverage.policy_statuses))])?;
    let (mut held, mut same) = (0, 0);
    let second = read(b, |frame| {
        let (Some(map), Some(goal)) = (&frame.map, &frame.goal) else { return };
        let (Some(policy), Some(said)) =
            (fit(&frame.proposals[0]), known.get(&(frame.number, frame.capture_ns)))
        else {
            return;
        };
        held += 1;
        if said.inputs == inputs(map, goal) {
            same += 1;
            let twists = [said.twist, policy.twist];
            gatherer.pair(&Pair { frame, map, goal, twists, doubt: said.doubt });
        }
    })?;
    require(&b.path, &second.coverage, &[("policy_command", said_by(&second.coverage.policy_statuses))])?;
    if same == 0 {
        return Err(CompareError::NoCommonFrame { a: a.path.clone(), b: b.path.clone(), held, same });
    }
    Ok((["A".into(), "B".into()], vec![first, second], held - same))
}

impl Comparison {
    /// The numbers, with those of every frame in columns.
    #[must_use]
    pub fn json(&self) -> serde_json::Value {
        let mut value = self.summary();
        let column =
            |number: &dyn Fn(&Point) -> f64| -> Vec<f64> { self.points.iter().map(number).collect() };
        let rounded = |value: f32| (f64::from(value) * 1e5).round() * 1e-5;
        let gaps = [0, 1].map(|side| column(&|point| rounded(point.gap(side))));
        value["frames"] = serde_json::json!({
            "number": self.points.iter().map(|point| point.number).collect::<Vec<_>>(),
            "time_s": column(&|point| (point.time_s * 1e4).round() * 1e-4),
            "v_m_s": column(&|point| rounded(point.v_m_s)),
            "w_rad_s": column(&|point| rounded(point.w_rad_s)),
            "gaps": gaps,
            "regret": column(&|point| rounded(point.regret())),
        });
        value
    }

    /// Bytes and seconds of all recordings.
    #[must_use]
    pub fn read(&self) -> (u64, f64) {
        let origins = self.recordings.iter().map(|read| &read.origin);
        origins.fold((0, 0.0), |sum, origin| (sum.0 + origin.size_bytes, sum.1 + origin.duration_s))
    }

    /// The numbers without those of each frame.
    pub(crate) fn summary(&self) -> serde_json::Value {
        // Strings and finite numbers only: this cannot fail, and not-finite numbers become null.
        serde_json::to_value(self).unwrap_or_default()
    }
}

//! The modes: every sequence of events up to a stated depth, each tick of it compared with a model of two pages.
//!
//! An event changes one input, or is an operator's word, a restart or a jump of playback, and holds until what depends on
//! its age shows. The room is open, so that modes decide and not walls. Nothing is sampled and nothing merged: two
//! sequences that lead to the same state are both run.

mod model;
mod rig;

use crate::{Config, Lead, Resume};
use rig::{Rig, Source, Stick};
use sidestep_msgs::{EstopAction, Reason, Status};

/// What may happen.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Event {
    Odometry(Source),
    Map(Source),
    Policy(Source),
    Expert(Source),
    /// The goal node says so; `None` = it falls silent.
    Goal(Option<Status>),
    Field(Source),
    Stick(Stick),
    /// The odometry announces a jump; the map follows with the next event about it.
    PoseJump,
    Say(EstopAction),
    PlaybackJump,
    Restart,
    /// Long enough to come to rest, and for a lead to be trusted again.
    Wait,
}

const SENSORS: [Event; 18] = [
    Event::Odometry(Source::Good),
    Event::Odometry(Source::Silent),
    Event::Odometry(Source::Repeated),
    Event::Odometry(Source::Backward),
    Event::Odometry(Source::Future),
    Event::Odometry(Source::Unfit),
    Event::Odometry(Source::Slips),
    Event::Odometry(Source::Frozen),
    Event::PoseJump,
    Event::Map(Source::Good),
    Event::Map(Source::Silent),
    Event::Map(Source::Repeated),
    Event::Map(Source::Backward),
    Event::Map(Source::Future),
    Event::Map(Source::Unfit),
    Event::Field(Source::Good),
    Event::Field(Source::Silent),
    Event::Wait,
];

const PROPOSERS: [Event; 11] = [
    Event::Policy(Source::Good),
    Event::Policy(Source::Silent),
    Event::Policy(Source::Unfit),
    Event::Policy(Source::Infeasible),
    Event::Policy(Source::Doubtful),
    Event::Policy(Source::Unsure),
    Event::Expert(Source::Good),
    Event::Expert(Source::Silent),
    Event::Expert(Source::Unfit),
    Event::Expert(Source::Infeasible),
    Event::Wait,
];

const WORDS: [Event; 11] = [
    Event::Say(EstopAction::Stop),
    Event::Say(EstopAction::Reset),
    Event::Say(EstopAction::Hold),
    Event::Say(EstopAction::Resume),
    Event::Restart,
    Event::PlaybackJump,
    Event::Stick(Stick::Held),
    Event::Stick(Stick::Garbage),
    Event::Stick(Stick::Released),
    Event::Stick(Stick::Silent),
    Event::Wait,
];

const GOALS: [Event; 6] = [
    Event::Goal(Some(Status::Ok)),
    Event::Goal(Some(Status::Arrived)),
    Event::Goal(Some(Status::NoGoal)),
    Event::Goal(Some(Status::Lost)),
    Event::Goal(Some(Status::Hold)),
    Event::Goal(None),
];

/// Shipped, but with a limit of doubt.
fn config() -> Config {
    Config { doubt_limit_m_s: 0.1, ..Config::STANDARD }
}

/// Runs every sequence of `depth` events that begins as this rig did; counts them and the reasons they show.
fn every_sequence(rig: &Rig, events: &[Event], depth: u32, found: &mut (u64, u64)) {
    for event in events {
        let mut next = rig.clone();
        next.happen(*event);
        if depth > 1 {
            every_sequence(&next, events, depth - 1, found);
        } else {
            *found = (found.0 + 1, found.1 | next.seen);
        }
    }
}

/// All sequences of `depth` events from a driving robot; the reasons named must have been among the answers.
fn explore(what: &str, config: &Config, events: &[Event], depth: u32, reasons: &[Reason]) {
    let mut found = (0, 0);
    every_sequence(&Rig::new(config), events, depth, &mut found);
    assert_eq!(found.0, (events.len() as u64).pow(depth));
    println!("{what}: all {} sequences of {depth} out of {} events", found.0, events.len());
    for reason in reasons {
        assert!(found.1 >> (*reason as u64) & 1 == 1, "{what}: no sequence led to {reason:?}");
    }
}

/// 18 events to depth 3: 5,832 sequences.
#[test]
fn every_fault_of_odometry_map_and_guard_stops_with_its_reason_and_ends_with_it() {
    use Reason as R;
    let odometry = [R::StaleOdometry, R::BackwardOdometry, R::UnfitOdometry, R::Slip, R::FrozenOdometry];
    let map = [R::StaleMap, R::RepeatedMap, R::BackwardMap, R::RefusedMap, R::PoseJump, R::StaleNearField];
    explore("sensors", &config(), &SENSORS, 3, &[&odometry[..], &map].concat());
}

/// 11 events to depth 4 under either lead: 29,282 sequences.
#[test]
fn the_lead_drives_while_it_is_good_and_comes_back_after_ten_frames_or_half_a_second() {
    let reasons = [Reason::Clear, Reason::OtherProposal, Reason::StaleProposals, Reason::UnfitProposals];
    for lead in [Lead::Policy, Lead::Expert] {
        explore("proposers", &Config { lead, ..config() }, &PROPOSERS, 4, &reasons);
    }
}

/// 11 events to depth 4 under either way to resume: 29,282 sequences.
#[test]
fn nothing_but_a_reset_at_rest_ends_a_latch_and_nothing_moves_before_the_operators_word() {
    use Reason as R;
    let reasons = [R::EstopLatched, R::Hold, R::Starting, R::Teleop, R::StaleTeleop, R::Clear];
    explore("words", &config(), &WORDS, 4, &reasons);
    let asks = Config { resume: Resume::Operator, ..config() };
    explore("words, resume = operator", &asks, &WORDS, 4, &[&reasons[..], &[R::AwaitOperator]].concat());
}

/// All 44 events to depth 2 under either way to resume: 3,872 sequences.
#[test]
fn any_two_events_together_keep_the_order_of_the_modes() {
    let events = [&SENSORS[..], &PROPOSERS[..10], &WORDS[..10], &GOALS].concat();
    use Reason as R;
    let reasons = [R::NoOdometry, R::Arrived, R::NoGoal, R::StaleGoal, R::NoMap];
    for resume in [Resume::Auto, Resume::Operator] {
        explore("all", &Config { resume, ..config() }, &events, 2, &reasons);
    }
}

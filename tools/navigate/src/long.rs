//! Kilometres: unseen rooms without end, with the arbiter on, under every lead and under one that does not care.
//!
//! Rooms are driven in blocks, each block by the driver with the shortest way so far, so that all get their share of the
//! distance. After each block the account is complete; whoever goes on with it drives the rooms that come next.

use crate::error::NavigateError;
use crate::ledger::{Account, Contact, Tally};
use crate::pilot::{Conditions, Ending, Pilot, is_standing};
use crate::room::room;
use sidestep_crew::in_order;
use sidestep_drive::{Drive, Lead, Sight};
use sidestep_msgs::{Command, Limits, Reason, Robot, Twist};
use sidestep_policy::fingerprint;
use sidestep_train::Random;

/// Rooms of a block.
const BLOCK: u64 = 6;
/// Rooms, and seconds in each, that tell one arbiter from another.
const PROBES: u64 = 4;
const PROBE_S: f64 = 20.0;
/// Seed of those rooms.
const PROBE_SEED: u64 = 0x4c4f_4e47;
/// `[s]` how far ahead of a stop the way must have been free for the stop to be a false one.
const AHEAD_S: f64 = 1.0;
/// Steps of that way.
const AHEAD_STEPS: usize = 40;
/// `[m/s]` a wish slower than this is none to drive on.
const WISHED_M_S: f32 = 0.1;
/// Name of the driver that does not care: full speed, turning at random.
pub const RECKLESS: &str = "reckless";

/// What to drive.
#[derive(Debug, Clone, Copy)]
pub struct LongOptions<'a> {
    /// The robot.
    pub robot: &'a Robot,
    /// Model file of the policy.
    pub model: &'a [u8],
    /// What messages call it.
    pub model_name: &'a str,
    /// How the robot sees.
    pub sight: Sight,
    /// `[m]` way of the account at which to end.
    pub distance_m: f64,
    /// `[s]` a room that takes longer is not reached.
    pub limit_s: f64,
    /// Threads; no influence on the numbers.
    pub threads: usize,
}

/// Fingerprint of how arbiter and robot behave: every command of a few drives of the expert. Whatever changes what the
/// arbiter does there opens a new account; a comment does not.
///
/// # Errors
/// [`NavigateError`] where a model or a node refuses.
pub fn behaviour(options: &LongOptions<'_>) -> Result<String, NavigateError> {
    let conditions = Conditions { lead: Lead::Expert, arbitrated: true, sight: Sight::Grid };
    let mut pilot = Pilot::new(options.robot, options.model, options.model_name)?;
    let mut bytes = options.robot.hash().to_le_bytes().to_vec();
    for number in 0..PROBES {
        let mut setup = pilot.setup(&room(PROBE_SEED, number), conditions);
        // Without the network, so that a new model goes on with the kilometres of the old one.
        setup.policy = None;
        let mut drive = Drive::new(setup)?;
        while drive.outcome().time_s < PROBE_S {
            drive.tick();
            let Command { twist, reason, .. } = drive.command();
            bytes.extend(twist.v_m_s.to_le_bytes());
            bytes.extend(twist.w_rad_s.to_le_bytes());
            bytes.extend(reason.to_le_bytes());
        }
    }
    Ok(format!("{:016x}", fingerprint(&bytes)))
}

/// Drives until the account has its distance; `keep` hears after each block.
///
/// # Errors
/// [`NavigateError`] where a model or a node refuses, or what `keep` says.
pub fn long(
    options: &LongOptions<'_>,
    account: &mut Account,
    keep: &mut dyn FnMut(&Account) -> Result<(), NavigateError>,
) -> Result<(), NavigateError> {
    if !(options.distance_m.is_finite() && options.distance_m > 0.0) {
        let found = format!("{} km", options.distance_m / 1000.0);
        return Err(NavigateError::Option { option: "km", found, needed: "more than 0" });
    }
    let names = || Lead::ALL.map(Lead::label).into_iter().chain([RECKLESS]);
    for name in names() {
        account.drivers.entry(name.to_owned()).or_default();
    }
    while account.distance_m() < options.distance_m {
        let way = |name: &&str| account.drivers[*name].distance_m;
        let driver = names().min_by(|a, b| way(a).total_cmp(&way(b))).unwrap_or(RECKLESS);
        let (seed, first) = (account.seed, account.next);
        let tallies = in_order(
            BLOCK as usize,
            options.threads,
            || Pilot::new(options.robot, options.model, options.model_name),
            |pilot, index| cross(options, pilot, driver, seed, first + index as u64),
            &mut |_| (),
        )?;
        let own = account.drivers.entry(driver.to_owned()).or_default();
        tallies.iter().for_each(|tally| own.add(tally));
        account.next += BLOCK;
        keep(account)?;
    }
    Ok(())
}

/// Drives one room.
fn cross(
    options: &LongOptions<'_>,
    pilot: &mut Pilot<'_>,
    driver: &str,
    seed: u64,
    number: u64,
) -> Result<Tally, NavigateError> {
    let course = room(seed, number);
    let lead = Lead::ALL.into_iter().find(|lead| lead.label() == driver);
    let conditions =
        Conditions { lead: lead.unwrap_or(Lead::Expert), arbitrated: true, sight: options.sight };
    let mut drive = pilot.begin(&course, conditions)?;
    let mut whims = lead.is_none().then(|| Whims::new(seed, number));
    let (mut tally, mut stood) = (Tally { drives: 1, ..Tally::default() }, true);
    let goals = course.world.legs_m.len() as u32;
    let open = |drive: &Drive| {
        let outcome = drive.outcome();
        outcome.arrivals < goals && outcome.collisions == 0 && outcome.time_s < options.limit_s
    };
    while open(&drive) {
        if let Some(whims) = &mut whims {
            drive.overrule(Some(whims.wish(&options.robot.limits)));
        }
        drive.tick();
        let stands = is_standing(drive.truth().twist);
        if stands && !stood && was_stopped(drive.command()) {
            tally.stops += 1;
            tally.false_stops += u64::from(is_free_ahead(&drive));
        }
        stood = stands;
    }
    let outcome = drive.outcome();
    (tally.distance_m, tally.time_s) = (outcome.distance_m, outcome.time_s);
    match Ending::of(outcome, goals) {
        Ending::Reached => tally.reached = 1,
        Ending::Late => {}
        Ending::Contact => {
            let pose = drive.truth().pose;
            let at_m = [pose.x_m, pose.y_m];
            tally.contacts.push(Contact {
                room: number,
                time_s: outcome.time_s,
                at_m,
                summary: outcome.summary(),
            });
        }
    }
    pilot.take_back(drive);
    Ok(tally)
}

/// Whether it was the filter that brought the robot to rest, against a wish to drive on.
fn was_stopped(command: &Command) -> bool {
    let by_the_filter =
        [Reason::Braking, Reason::Emergency].iter().any(|reason| command.reason == *reason as u32);
    by_the_filter && command.wish.v_m_s > WISHED_M_S
}

/// Whether the footprint would have met nothing along the wish for a second.
fn is_free_ahead(drive: &Drive) -> bool {
    let (mut pose, wish) = (drive.truth().pose, drive.command().wish);
    (0..AHEAD_STEPS).all(|_| {
        pose = pose.advance(&wish, AHEAD_S / AHEAD_STEPS as f64);
        drive.simulator().clearance_at_m(&pose) > 0.0
    })
}

/// Full speed ahead, a new turn rate every now and then.
struct Whims {
    random: Random,
    left: usize,
    turn: f32,
}

impl Whims {
    fn new(seed: u64, room: u64) -> Self {
        Self { random: Random::new(seed, 0x5748_494d_0000 + room), left: 0, turn: 0.0 }
    }

    fn wish(&mut self, limits: &Limits) -> Twist {
        if self.left == 0 {
            self.left = 30 + self.random.below(170);
            self.turn = self.random.between(-1.0, 1.0);
        }
        self.left -= 1;
        Twist::new(limits.forward_m_s, self.turn * limits.turn_rad_s)
    }
}

impl Tally {
    fn add(&mut self, other: &Self) {
        self.drives += other.drives;
        self.reached += other.reached;
        self.distance_m += other.distance_m;
        self.time_s += other.time_s;
        self.stops += other.stops;
        self.false_stops += other.false_stops;
        self.contacts.extend(other.contacts.iter().cloned());
    }
}

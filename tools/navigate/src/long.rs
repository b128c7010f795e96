//! Kilometres: unseen rooms without end, with the arbiter on, under every lead and under one that does not care.
//!
//! Rooms are driven in blocks, each block by the driver with the shortest way so far, so that all get their share of the
//! distance. After each block the account is complete; whoever goes on with it drives the rooms that come next.

use crate::error::NavigateError;
use crate::ledger::{Account, Contact, Tally};
use crate::pilot::{Conditions, Ending, Pilot, is_standing, setup};
use crate::room::{GRADES, room};
use sidestep_crew::in_order;
use sidestep_drive::{Drive, Lead, Sight};
use sidestep_msgs::{Command, Limits, Pose2, Reason, Robot, Twist};
use sidestep_policy::fingerprint;
use sidestep_train::Random;

/// Rooms of a block: of every difficulty the same number.
const BLOCK: u64 = 2 * GRADES.len() as u64;
/// `[m]` a block shorter than this does not bring its driver on.
const BLOCK_LEAST_M: f64 = 0.1;
/// Rooms, and seconds in each, that tell one chain in front of the arbiter from another.
const PROBES: u64 = 2;
const PROBE_S: f64 = 20.0;
/// The code of arbiter and mapper without its comments: what a few drives do not show tells one from another too.
const NODES: &str = include_str!(concat!(env!("OUT_DIR"), "/nodes.txt"));
/// That of the errors of maps drawn from the world.
const NOISE: &str = include_str!(concat!(env!("OUT_DIR"), "/noise.txt"));
/// Seed of those rooms.
const PROBE_SEED: u64 = 0x4c4f_4e47;
/// Steps of the tube that a wish would have needed.
const TUBE_STEPS: usize = 40;
/// `[m/s]` a wish slower than this is none to drive on.
const WISHED_M_S: f32 = 0.1;
/// A stop lasts this many ticks of 10 ms.
const STOOD_TICKS: u32 = 50;
/// `[m]` from where a stop was counted, the next one is another.
const MOVED_M: f64 = 0.05;
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

/// Fingerprint of the code of arbiter and mapper, of the errors of the maps where they have some, of the robot, of the time
/// limit, and of how the chain behaves with this way of seeing: twist and reason of every command of a few drives of the
/// expert. Whatever changes one of these opens a new account; a comment does not.
///
/// # Errors
/// [`NavigateError`] where a model or a node refuses.
pub fn behaviour(options: &LongOptions<'_>) -> Result<String, NavigateError> {
    let conditions = Conditions { lead: Lead::Expert, arbitrated: true, sight: options.sight };
    let mut bytes = options.robot.hash().to_le_bytes().to_vec();
    bytes.extend(options.limit_s.to_le_bytes());
    bytes.extend(NODES.bytes());
    if options.sight == Sight::Noisy {
        bytes.extend(NOISE.bytes());
    }
    for number in 0..PROBES {
        let mut drive = Drive::new(setup(options.robot, &room(PROBE_SEED, number), conditions))?;
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
    for (option, value) in [("km", options.distance_m / 1000.0), ("limit", options.limit_s)] {
        if !(value.is_finite() && value > 0.0) {
            return Err(NavigateError::Option { option, found: value.to_string(), needed: "more than 0" });
        }
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
        let before_m = own.distance_m;
        tallies.iter().for_each(|tally| own.add(tally));
        if own.distance_m - before_m < BLOCK_LEAST_M {
            let found = format!("{driver}, which does not move");
            return Err(NavigateError::Option { option: "driver", found, needed: "one that gets on" });
        }
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
    let mut refusals = Refusals::new(options.robot);
    let mut drive = pilot.begin(&course, conditions)?;
    let mut whims = lead.is_none().then(|| Whims::new(seed, number));
    let mut tally = Tally { drives: 1, ..Tally::default() };
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
        refusals.note(&drive);
    }
    (tally.stops, tally.false_stops) = (refusals.stops, refusals.false_stops);
    tally.held_up.extend((lead.is_some() && refusals.false_stops > 0).then_some(number));
    let outcome = drive.outcome();
    (tally.distance_m, tally.time_s) = (outcome.distance_m, outcome.time_s);
    match Ending::of(outcome, goals) {
        Ending::Reached => tally.reached = 1,
        Ending::Late => tally.late.extend(lead.map(|_| number)),
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

/// Counts the times that the filter kept the robot standing against a wish to drive on, and of them those for nothing.
struct Refusals {
    dead_time_s: f64,
    brake_m_s2: f64,
    /// Ticks of standing so.
    stood: u32,
    /// Where it stood when that was counted last.
    counted: Option<Pose2>,
    stops: u64,
    false_stops: u64,
}

impl Refusals {
    fn new(robot: &Robot) -> Self {
        let hold_s = sidestep_arbiter::Config::STANDARD.hold_s;
        Self {
            dead_time_s: f64::from(robot.actuator.dead_time_max_s + hold_s),
            brake_m_s2: f64::from(robot.actuator.brake_min_m_s2),
            stood: 0,
            counted: None,
            stops: 0,
            false_stops: 0,
        }
    }

    fn note(&mut self, drive: &Drive) {
        let stands = is_standing(drive.truth().twist) && is_refused(drive.command());
        self.stood = if stands { self.stood + 1 } else { 0 };
        let pose = drive.truth().pose;
        // Whoever has not moved since stands there still, whatever else was tried.
        self.counted = self.counted.filter(|counted| counted.distance_m(&pose) < MOVED_M);
        if self.stood == STOOD_TICKS && self.counted.is_none() {
            self.counted = Some(pose);
            self.stops += 1;
            self.false_stops += u64::from(self.is_free(drive));
        }
    }

    /// Whether the footprint would meet nothing in the tube of the wish: the way until the newest command works, and
    /// that of the brake.
    fn is_free(&self, drive: &Drive) -> bool {
        let (mut pose, wish) = (drive.truth().pose, drive.command().wish);
        let tube_s = self.dead_time_s + f64::from(wish.v_m_s) / (2.0 * self.brake_m_s2);
        (0..TUBE_STEPS).all(|_| {
            pose = pose.advance(&wish, tube_s / TUBE_STEPS as f64);
            drive.simulator().clearance_at_m(&pose) > 0.0
        })
    }
}

/// Whether the filter answers a wish to drive on with less than that.
fn is_refused(command: &Command) -> bool {
    use Reason::{Braking, Emergency, Reversing, Rotating, Slowed};
    let refuses = [Slowed, Braking, Emergency, Rotating, Reversing]
        .iter()
        .any(|reason| command.reason == *reason as u32);
    refuses && command.wish.v_m_s > WISHED_M_S
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
        self.late.extend(&other.late);
        self.held_up.extend(&other.held_up);
        self.contacts.extend(other.contacts.iter().cloned());
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use sidestep_drive::Setup;
    use sidestep_sim::{Solid, World};

    fn loomo() -> Robot {
        Robot::from_toml("loomo.toml", include_str!("../../../launch/robots/loomo.toml")).unwrap()
    }

    /// Stops and false ones of five seconds under one wish among solids.
    fn refused(solids: &[Solid], sight: Sight, wish: Twist) -> (u64, u64) {
        let mut world = World::empty();
        world.solids.extend(solids);
        world.start = Pose2::ORIGIN;
        world.legs_m = vec![vec![[0.0, 0.0], [9.0, 0.0]]];
        let mut setup = Setup::led_by(loomo(), world, Lead::Expert);
        setup.sight = sight;
        setup.mapper.grant_start_disc = false;
        let mut refusals = Refusals::new(&loomo());
        let mut drive = Drive::new(setup).unwrap();
        drive.overrule(Some(wish));
        while drive.outcome().time_s < 5.0 {
            drive.tick();
            refusals.note(&drive);
        }
        assert_eq!(drive.outcome().collisions, 0);
        (refusals.stops, refusals.false_stops)
    }

    #[test]
    fn the_code_of_arbiter_and_mapper_is_known_without_comments_and_tests() {
        for part in ["const REFUSED_NS: u64", "impl Arbiter {", "HELD_GAP_M", "SEES_PAST_M"] {
            assert!(NODES.contains(part), "{part}");
        }
        assert!(NOISE.contains("const OF_SAFETY: Chances"));
        for code in [NODES, NOISE] {
            assert!(code.lines().all(|line| !line.starts_with("//") && !line.starts_with("#[test]")));
        }
    }

    /// Boxed in on all sides, since before a single wall there is a way out.
    #[test]
    fn a_stop_before_a_wall_is_a_true_one_and_a_free_way_has_none() {
        let walls = [
            [0.24, -1.0, 0.24, 1.0],
            [-0.24, -1.0, -0.24, 1.0],
            [-1.0, 0.38, 1.0, 0.38],
            [-1.0, -0.38, 1.0, -0.38],
        ];
        let walls = walls.map(|[x, y, to_x, to_y]| Solid::wall([x, y], [to_x, to_y], 0.1, 2.0));
        let (stops, false_stops) = refused(&walls, Sight::Grid, Twist::new(0.8, 0.0));
        assert!(stops > 0 && false_stops == 0, "{stops} {false_stops}");
        assert_eq!(refused(&[], Sight::Grid, Twist::new(0.8, 0.0)), (0, 0));
    }

    /// Nobody granted the floor before its feet, and the camera does not see it: the arbiter refuses to drive onto it,
    /// though it is free.
    #[test]
    fn a_stop_before_floor_that_is_free_but_unseen_is_a_false_one() {
        let (stops, false_stops) = refused(&[], Sight::Camera, Twist::new(0.6, 0.0));
        assert!(stops > 0 && false_stops == stops, "{stops} {false_stops}");
    }
}

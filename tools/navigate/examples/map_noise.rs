//! What the mapper's maps are worth, cell by cell: rooms driven through the camera under the expert and the arbiter, and at
//! every fifth frame both maps compared with what truly stands there, seen from where the robot truly is.
//!
//! `cargo run --release -p sidestep-navigate --example map_noise [SEED] [ROOMS] [SEEN_TENTHS]`
//!
//! A line for each band of cells ([`BANDS`]), for the cells nearer to the robot than 1.2 m and for those farther: of the
//! cells known and seen within the last SEEN_TENTHS of a second, how many, and the share that is taken. Then how errors
//! last, over 0.5 and 2 s: the share taken of the cells that were, less that of those that were not; 1 where what a cell
//! shows never changes, 0 where it is drawn anew. Last whether they come in runs: the same for a cell and those of its band
//! one, two, four and eight cells on along each axis. At the end the solids of which a cell of the safety map is known, and
//! the share of those that it hides, whose cells are all known and free: of poles, and of what is wider.
#![allow(clippy::print_stdout, reason = "the figures are the output")]

use sidestep_drive::{BANDS, Drive, GROWN_M, Lead, NEAR_M, Outlook, SHRUNK_M, Setup, UNDER, body};
use sidestep_msgs::{
    AGE_NEVER, FREE_BELOW, Grid, LOCAL_GRID, Pose2, Robot, SAFETY_GRID, SafetyMap, probability_code,
};
use sidestep_navigate::room;
use sidestep_policy::Policy;
use sidestep_sim::{draw, seen_from};
use std::collections::{HashMap, VecDeque};
use std::error::Error;

/// Frames between two comparisons: at 30 Hz a sixth of a second.
const STRIDE: u64 = 5;
/// Comparisons over which the duration of errors is looked at: 0.5 s and 2 s.
const LAGS: [usize; 2] = [3, 12];
/// Cells from one to the other of those that are compared with each other.
const STEPS: [i32; 4] = [1, 2, 4, 8];
/// `[m]` a column up to this radius is a pole.
const POLE_M: f64 = 0.05;
/// `[s]` a room that takes longer is left.
const LIMIT_S: f64 = 60.0;

/// How often cells were taken, of how many.
#[derive(Debug, Clone, Copy, Default)]
struct Share {
    taken: u64,
    cells: u64,
}

impl Share {
    fn note(&mut self, taken: bool) {
        self.cells += 1;
        self.taken += u64::from(taken);
    }

    fn part(self) -> f64 {
        self.taken as f64 / self.cells.max(1) as f64
    }
}

/// What a cell of a place showed.
#[derive(Debug, Clone, Copy)]
struct Look {
    band: usize,
    far: bool,
    taken: bool,
    lately: bool,
}

/// The account of one of the two maps.
struct Account {
    name: &'static str,
    grid: Grid,
    /// By nearness and band.
    shares: [[Share; BANDS]; 2],
    /// By lag and band, of the cells that were free and of those that were taken.
    lasting: [[[Share; 2]; BANDS]; LAGS.len()],
    /// By distance and band, beside a cell that is free and beside one that is taken.
    beside: [[[Share; 2]; BANDS]; STEPS.len()],
    /// By place in `odom`, the newest last.
    past: VecDeque<HashMap<[i32; 2], Look>>,
}

impl Account {
    fn new(name: &'static str, grid: Grid) -> Self {
        Self {
            name,
            grid,
            shares: Default::default(),
            lasting: Default::default(),
            beside: Default::default(),
            past: VecDeque::new(),
        }
    }

    /// Compares a map with what truly stands there; `place` is its frame in `odom`, where `base` is the robot's pose.
    fn take(
        &mut self,
        [occupancy, age]: [&[u8]; 2],
        seen: u8,
        outlook: &Outlook<'_>,
        [place, base]: [&Pose2; 2],
    ) {
        let (grid, cell_m) = (self.grid, f64::from(self.grid.cell_m));
        let mut band = vec![0; occupancy.len()];
        outlook.bands(&base.relative(place), &grid, &mut band);
        let mut looks = HashMap::new();
        for (index, age) in age.iter().enumerate().filter(|(_, age)| **age != AGE_NEVER) {
            let (x, y) = grid.centre(index / grid.side, index % grid.side);
            let (x_m, y_m) = place.transform(x.into(), y.into());
            let taken = is_taken(occupancy[index]);
            let far = libm::hypot(x_m - base.x_m, y_m - base.y_m) >= NEAR_M;
            let look = Look { band: band[index].into(), far, taken, lately: *age <= seen };
            looks.insert([x_m, y_m].map(|part| libm::floor(part / cell_m) as i32), look);
            if look.lately {
                self.shares[usize::from(far)][look.band].note(taken);
            }
        }
        for (step, beside) in STEPS.into_iter().zip(&mut self.beside) {
            for ([x, y], look) in looks.iter().filter(|(_, look)| look.lately) {
                let next = [[x + step, *y], [*x, y + step]].into_iter().filter_map(|place| looks.get(&place));
                for next in next.filter(|next| next.lately && (next.band, next.far) == (look.band, look.far))
                {
                    beside[look.band][usize::from(look.taken)].note(next.taken);
                }
            }
        }
        self.past.push_back(looks);
        self.last();
    }

    /// Compares the newest looks with those of earlier.
    fn last(&mut self) {
        let Some((now, past)) = self.past.make_contiguous().split_last() else { return };
        for (lag, lasting) in LAGS.into_iter().zip(&mut self.lasting) {
            let Some(then) = past.len().checked_sub(lag).map(|index| &past[index]) else { continue };
            for (place, look) in then.iter().filter(|(_, look)| look.lately) {
                if let Some(now) = now.get(place) {
                    lasting[look.band][usize::from(look.taken)].note(now.taken);
                }
            }
        }
        if self.past.len() > LAGS[LAGS.len() - 1] {
            self.past.pop_front();
        }
    }

    fn print(&self) {
        println!(
            "{}: band, cells and share taken below {NEAR_M} m and beyond, lasting over 0.5 s and 2 s, in runs",
            self.name
        );
        let kept = |[free, taken]: [Share; 2]| taken.part() - free.part();
        for band in 0..BANDS {
            let edge = match band {
                0 => "beyond".into(),
                UNDER => "under".into(),
                1..UNDER => format!("{:+.3}", GROWN_M[band - 1]),
                _ => format!("{:+.3}", SHRUNK_M[band - UNDER - 1]),
            };
            let [near, far] = [self.shares[0][band], self.shares[1][band]];
            println!(
                "  {edge:6}  {:9} {:.5}  {:9} {:.5}  {:6.3} {:6.3}  {:6.3} {:6.3} {:6.3} {:6.3}",
                near.cells,
                near.part(),
                far.cells,
                far.part(),
                kept(self.lasting[0][band]),
                kept(self.lasting[1][band]),
                kept(self.beside[0][band]),
                kept(self.beside[1][band]),
                kept(self.beside[2][band]),
                kept(self.beside[3][band])
            );
        }
    }
}

/// Counts the solids of which something is known, and those that the map hides.
fn count(hidden: &mut [Share; 2], safety: &SafetyMap, outlook: &Outlook<'_>) {
    let world = outlook.pose.compose(&safety.base.relative(&safety.frame()));
    for solid in outlook.solids {
        let mut own = vec![0; safety.age.len()];
        draw(&seen_from(solid, &world), &SAFETY_GRID, &mut own);
        let cells = || own.iter().enumerate().filter(|(_, own)| **own > 0).map(|(index, _)| index);
        if cells().any(|index| safety.age[index] != AGE_NEVER) {
            let is_free = |index| safety.age[index] != AGE_NEVER && !is_taken(safety.occupancy[index]);
            hidden[usize::from(solid.reach_m() > POLE_M)].note(cells().all(is_free));
        }
    }
}

fn is_taken(occupancy: u8) -> bool {
    occupancy >= probability_code(FREE_BELOW)
}

/// Drives one room and takes its frames into both accounts; returns the policy for the next one.
fn cross(
    setup: Setup,
    seen: u8,
    accounts: &mut [Account; 2],
    hidden: &mut [Share; 2],
) -> Result<Option<Policy>, Box<dyn Error>> {
    let goals = setup.world.legs_m.len() as u32;
    let band_top_m = f64::from(setup.mapper.band_top_m);
    let body = body(&setup.robot);
    let mut drive = Drive::new(setup)?;
    let mut before = *drive.truth();
    while drive.outcome().arrivals < goals
        && drive.outcome().collisions == 0
        && drive.outcome().time_s < LIMIT_S
    {
        let frames = drive.chain().frames();
        drive.tick();
        let (chain, truth) = (drive.chain(), drive.truth());
        if chain.frames() > frames && frames.is_multiple_of(STRIDE) && before.stamp_ns > 0 {
            let (local, safety) = (chain.local_map(), chain.safety_map());
            // The frame came between two ticks of 10 ms.
            let since = local.capture_ns.saturating_sub(before.stamp_ns) as f64;
            let pose =
                before.pose.interpolate(&truth.pose, since / (truth.stamp_ns - before.stamp_ns) as f64);
            let solids = drive.simulator().solids().filter(|solid| solid.is_in_band(band_top_m));
            let outlook = Outlook { solids: &solids.collect::<Vec<_>>(), pose, body };
            let base = &local.pose;
            accounts[0].take([&local.occupancy, &local.age], seen, &outlook, [base, base]);
            accounts[1].take([&safety.occupancy, &safety.age], seen, &outlook, [&safety.frame(), base]);
            count(hidden, safety, &outlook);
        }
        before = *truth;
    }
    accounts.iter_mut().for_each(|account| account.past.clear());
    Ok(drive.into_policy())
}

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = std::env::args().skip(1);
    let seed: u64 = arguments.next().map_or(Ok(9), |text| text.parse())?;
    let rooms: u64 = arguments.next().map_or(Ok(120), |text| text.parse())?;
    let seen: u8 = arguments.next().map_or(Ok(30), |text| text.parse())?;
    let robot = Robot::from_toml("loomo.toml", include_str!("../../../launch/robots/loomo.toml"))?;
    let mut policy = Some(Policy::load(sidestep_policy::embedded(), "embedded", &robot)?);
    let mut accounts = [Account::new("local map", LOCAL_GRID), Account::new("safety map", SAFETY_GRID)];
    let mut hidden = [Share::default(); 2];
    for number in 0..rooms {
        let course = room(seed, number);
        let mut setup = Setup::led_by(robot.clone(), course.world, Lead::Expert);
        (setup.sim.width_px, setup.sim.height_px, setup.sim.seed) = (320, 240, course.seed);
        setup.policy = policy.take();
        policy = cross(setup, seen, &mut accounts, &mut hidden)?;
    }
    accounts.iter().for_each(Account::print);
    for (name, Share { taken, cells }) in ["poles", "wider solids"].into_iter().zip(hidden) {
        println!("{name}: hidden {taken} of {cells}");
    }
    Ok(())
}

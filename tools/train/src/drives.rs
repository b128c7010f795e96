//! Demonstrations: closed-loop drives through the whole chain, depth to map to command, as a robot would record them.
//!
//! Drive `n` of a seed has a world, noise and lead of its own and gives a frame every 0.1 s. In the robust profile the
//! lead is overruled now and then by a random command for a moment, so that there are frames of what a good driver never
//! gets into; the labels are the expert's all the same.

use crate::demonstration::Demonstration;
use crate::error::TrainError;
use crate::random::Random;
use sidestep_drive::{Drive, Setup};
use sidestep_expert::Lead;
use sidestep_msgs::{AGE_NEVER, GoalKind, Robot, Status, Twist, Winner};
use sidestep_policy::Policy;
use sidestep_sim::World;

/// Frames of the camera per sample.
const STRIDE: u64 = 3;
/// `[s]` longest drive.
const DRIVE_S: f64 = 60.0;
/// `[s]` a robot that stands this long has arrived or is stuck.
const STANDING_S: f64 = 3.0;
/// Columns and rows of the rendered depth: the robot's view, coarser.
const PIXELS: (u32, u32) = (160, 120);

/// Who drives, and how.
#[derive(Debug, Clone, Default)]
pub struct DriveProfile {
    /// Model file of a policy that leads; `None` for the solved expert.
    pub policy: Option<Vec<u8>>,
    /// Worlds to drive through, one after the other; none for offices, corridors and rooms of every seed.
    pub worlds: Vec<String>,
    /// Overrule the lead by random commands, 3 % of the samples for 0.3 to 0.8 s.
    pub bursts: bool,
}

/// The samples of drive `number`: kind of world and frame.
///
/// # Errors
/// [`TrainError::Drive`] where a node refuses the robot or a model.
pub(crate) fn drive(
    robot: &Robot,
    seed: u64,
    number: u64,
    profile: &DriveProfile,
) -> Result<Vec<(u8, Demonstration)>, TrainError> {
    let mut random = Random::new(seed, 0x4452_4956_4500 + number);
    let (kind, world) = match profile.worlds.as_slice() {
        [] => world(&mut random),
        names => (11, World::named(&names[number as usize % names.len()], seed).map_err(refused)?),
    };
    let lead = if profile.policy.is_some() { Winner::Policy } else { Winner::Expert };
    let mut setup = Setup::shipped(robot.clone(), world, lead);
    (setup.sim.width_px, setup.sim.height_px) = PIXELS;
    setup.sim.seed = random.bits() >> 16;
    setup.expert.mode = Lead::Solved;
    if let Some(model) = &profile.policy {
        setup.policy = Some(Policy::load(model, "the policy that leads", robot)?);
    }
    let mut drive = Drive::new(setup).map_err(refused)?;
    let mut samples = Vec::new();
    let (mut frames, mut burst_left, mut standing_s) = (0, 0, 0.0);
    while drive.outcome().time_s < DRIVE_S && standing_s < STANDING_S && drive.outcome().collisions == 0 {
        drive.tick();
        if drive.chain().frames() < frames + STRIDE {
            continue;
        }
        frames = drive.chain().frames();
        samples.extend(sample(&drive, number).map(|frame| (kind, frame)));
        let twist = drive.chain().local_goal().twist;
        let stands = twist.v_m_s.abs() < 0.02 && twist.w_rad_s.abs() < 0.02;
        standing_s = if stands { standing_s + 0.1 } else { 0.0 };
        if profile.bursts && burst_left == 0 && random.chance(0.03) {
            burst_left = 3 + random.below(6);
            let (limits, turn) = (&robot.limits, robot.limits.turn_rad_s);
            let wish = Twist::new(random.between(0.0, limits.forward_m_s), random.between(-turn, turn));
            drive.overrule(Some(wish));
        } else if burst_left > 0 {
            burst_left -= 1;
            if burst_left == 0 {
                drive.overrule(None);
            }
        }
    }
    Ok(samples)
}

fn refused(error: impl std::fmt::Display) -> TrainError {
    TrainError::Drive { detail: error.to_string() }
}

/// An office, driven round, or a corridor or a room of any density: a fifth, nearly half, and a third of the samples.
fn world(random: &mut Random) -> (u8, World) {
    let seed = random.bits() >> 16;
    let density = f64::from(random.between(0.5, 2.0));
    let mut world = match random.below(6) {
        0 => (8, World::office(seed)),
        1 | 2 => (9, World::corridor(seed, density)),
        _ => (10, World::room(seed, density)),
    };
    if random.chance(0.5) {
        world.1 = world.1.mirrored();
    }
    world
}

/// The newest frame, if there was something to decide.
fn sample(drive: &Drive, number: u64) -> Option<Demonstration> {
    let chain = drive.chain();
    let (map, goal, statuses) = (chain.local_map(), chain.local_goal(), chain.statuses());
    let moving = goal.kind == GoalKind::Path as u32;
    let good = statuses[0] == Status::Ok && statuses[1] == Status::Ok && moving;
    good.then(|| Demonstration {
        planning_cost: map.planning_cost,
        goal_cell: goal.cell as u16,
        goal_m: [goal.x_m, goal.y_m],
        velocity: goal.twist,
        partly_unknown: map.age.contains(&AGE_NEVER),
        frame: chain.frames(),
        run: number,
    })
}

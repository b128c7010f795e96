//! What reaches the arbiter, and when: maps, odometry and wishes, late, lost, repeated, or of a mapper just restarted.

use crate::scenario::Channel;
use sidestep_msgs::{AGE_NEVER, Pose2, SAFETY_GRID, SAFETY_SIDE, STILL, SafetyMap, Twist};
use sidestep_sim::{Random, Solid, draw, mix, seen_from};

/// `[m]` half of the diagonal of a cell.
const HALF_DIAGONAL_M: f64 = 0.0354;

/// What the robot was at a tick.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Moment {
    pub(crate) tick: u64,
    /// Pose in the world.
    pub(crate) pose: Pose2,
    /// Pose in `odom`.
    pub(crate) believed: Pose2,
    /// Pose in `odom` by the error that there was when what is in the map was seen.
    pub(crate) remembered: Pose2,
    pub(crate) twist: Twist,
}

/// Messages of one kind on their way.
pub(crate) struct Mail {
    channel: Channel,
    random: Random,
    waiting: Vec<(u64, Moment)>,
}

impl Mail {
    pub(crate) fn new(channel: &Channel, seed: u64, stream: u64) -> Self {
        Self { channel: *channel, random: Random::new(mix(seed, stream)), waiting: Vec::with_capacity(16) }
    }

    /// Sends a message about a moment at a tick.
    pub(crate) fn send(&mut self, at_tick: u64, moment: Moment) {
        let (delay, lost) = (self.random.unit(), self.random.unit());
        let c = &self.channel;
        let silent = at_tick >= c.silent_from && at_tick < c.silent_from + c.silent_ticks;
        if silent || lost < c.lost {
            return;
        }
        let [least, most] = c.delay_ticks;
        let delay = least + (delay * (most - least + 1) as f64) as u64;
        self.waiting.push((at_tick + delay, moment));
    }

    /// The newest message that has arrived by a tick; older ones are skipped, as the transport does.
    pub(crate) fn take(&mut self, tick: u64) -> Option<Moment> {
        let arrived = self.waiting.iter().filter(|(at, _)| *at <= tick).map(|(_, moment)| *moment);
        let newest = arrived.max_by_key(|moment| moment.tick);
        self.waiting.retain(|(at, _)| *at > tick);
        newest
    }
}

/// What a restarted mapper knows: a disc in the world.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Known {
    pub(crate) centre_m: [f64; 2],
    pub(crate) radius_m: f64,
}

/// A thing as the map shows it.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Shown {
    pub(crate) solid: Solid,
    /// Whether it is seen; otherwise nobody looked there.
    pub(crate) seen: bool,
    /// Whether it is on its way.
    pub(crate) moving: bool,
}

/// Draws the safety map of a moment: a cell is taken, or not seen, where a thing touches it. What moves is seen within
/// `blind_m` over floor that is not.
pub(crate) fn draw_map(
    moment: &Moment,
    shown: &[Shown],
    known: Option<&Known>,
    blind_m: f32,
    map: &mut SafetyMap,
) {
    map.base = moment.believed;
    let frame = map.frame();
    map.occupancy.fill(0);
    map.age.fill(0);
    map.still.fill(STILL);
    // Where the map's frame was when that was seen.
    let from = moment.pose.compose(&moment.remembered.relative(&frame));
    let (at_x_m, at_y_m) = frame.inverse_transform(map.base.x_m, map.base.y_m);
    for Shown { solid, seen, moving } in shown {
        let solid = seen_from(solid, &from);
        // What is taken and what was never seen are the same number, in the one array or in the other.
        draw(&solid, &SAFETY_GRID, if *seen { &mut map.occupancy } else { &mut map.age });
        if *moving && *seen {
            draw(&solid, &SAFETY_GRID, &mut map.still);
        }
    }
    for (index, still) in map.still.iter_mut().enumerate().filter(|(_, still)| **still > STILL) {
        *still = 0;
        let (x_m, y_m) = SAFETY_GRID.centre(index / SAFETY_SIDE, index % SAFETY_SIDE);
        if libm::hypotf(x_m - at_x_m as f32, y_m - at_y_m as f32) < blind_m {
            map.age[index] = 0;
        }
    }
    let Some(known) = known else { return };
    let (x, y) = from.inverse_transform(known.centre_m[0], known.centre_m[1]);
    let reach_m = (known.radius_m - HALF_DIAGONAL_M).max(0.0);
    for row in 0..SAFETY_SIDE {
        for col in 0..SAFETY_SIDE {
            let (cx, cy) = SAFETY_GRID.centre(row, col);
            let (dx, dy) = (f64::from(cx) - x, f64::from(cy) - y);
            if dx * dx + dy * dy > reach_m * reach_m {
                map.age[row * SAFETY_SIDE + col] = AGE_NEVER;
            }
        }
    }
}

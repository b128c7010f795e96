//! How far a solved plan is from the optimum: eq. (6) once more, plainly and in double precision, with twelve free knots
//! instead of three pieces, and a search that takes its time.

use serde::Serialize;
use sidestep_expert::{HORIZON_STEPS, PIECE_STEPS, Plan, STEP_S, UNKNOWN_COST, Weights};
use sidestep_msgs::{LOCAL_CELLS, LOCAL_GRID, LOCAL_SIDE, Limits, Twist};
use sidestep_train::{Random, Record};

/// Knots of a plan.
const KNOTS: usize = 12;
/// Steps from knot to knot.
const KNOT_STEPS: usize = HORIZON_STEPS / KNOTS;
/// `[m]` inside this distance from the goal the heading to it fades out (as the expert has it).
const FADE_M: f64 = 0.25;
/// Searches from one problem: from the solved plan, then from plans of one velocity.
const STARTS: usize = 6;
/// Tries of each search.
const TRIES: usize = 6000;

/// What the oracle found.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize)]
pub struct Oracle {
    /// Frames.
    pub frames: usize,
    /// `[1]` mean J of the solved plans.
    pub solved_cost: f64,
    /// `[1]` mean J of the solved plans above the best with free knots.
    pub gap: f64,
    /// `[1]` largest difference between the expert's J and this one for the same plan.
    pub disagreement: f64,
}

/// Velocity targets at the knots.
type Knots = [[f64; 2]; KNOTS];

/// One instance of eq. (6).
pub(crate) struct Question<'a> {
    pub(crate) cost: &'a [u8; LOCAL_CELLS],
    pub(crate) goal_m: [f64; 2],
    pub(crate) from: [f64; 2],
    pub(crate) limits: &'a Limits,
    pub(crate) weights: &'a Weights,
}

impl<'a> Question<'a> {
    pub(crate) fn of(record: &'a Record, limits: &'a Limits, weights: &'a Weights) -> Self {
        let cell = usize::from(record.goal_cell).min(LOCAL_CELLS - 1);
        let (x_m, y_m) = LOCAL_GRID.centre(cell / LOCAL_SIDE, cell % LOCAL_SIDE);
        Self {
            cost: &record.planning_cost,
            goal_m: [x_m.into(), y_m.into()],
            from: record.velocity.map(f64::from),
            limits,
            weights,
        }
    }

    /// `[0, 1]` planning cost at a point, bilinear between cell centres, unknown outside.
    fn met(&self, x_m: f64, y_m: f64) -> f64 {
        let side = LOCAL_SIDE as i64;
        let forward = (x_m - f64::from(LOCAL_GRID.rear_m)) / 0.1 - 0.5;
        let left = (y_m - f64::from(LOCAL_GRID.right_m)) / 0.1 - 0.5;
        let (row, col) = (forward.floor(), left.floor());
        let cell = |forward: i64, left: i64| {
            let inside = (0..side).contains(&forward) && (0..side).contains(&left);
            let index = (side - 1 - forward) * side + side - 1 - left;
            f64::from(if inside { self.cost[index as usize] } else { UNKNOWN_COST }) / 255.0
        };
        let (fx, fy) = (forward - row, left - col);
        let (row, col) = (row as i64, col as i64);
        (1.0 - fx) * ((1.0 - fy) * cell(row, col) + fy * cell(row, col + 1))
            + fx * ((1.0 - fy) * cell(row + 1, col) + fy * cell(row + 1, col + 1))
    }

    /// J of eq. (6) for the targets of each step.
    pub(crate) fn cost_of(&self, target: impl Fn(usize) -> [f64; 2]) -> f64 {
        let (weights, dt) = (self.weights, f64::from(STEP_S));
        let most =
            [self.limits.accelerate_m_s2, self.limits.turn_accelerate_rad_s2].map(|a| f64::from(a) * dt);
        let [mut v, mut w] = self.from;
        let (mut x, mut y, mut yaw, mut sum) = (0.0, 0.0, 0.0, 0.0);
        for step in 0..HORIZON_STEPS {
            let [to_v, to_w] = target(step);
            let (dv, dw) = ((to_v - v).clamp(-most[0], most[0]), (to_w - w).clamp(-most[1], most[1]));
            (v, w) = (v + dv, w + dw);
            // The chord of the arc.
            let half = 0.5 * w * dt;
            let chord = v * dt * if half.abs() < 1e-9 { 1.0 } else { libm::sin(half) / half };
            x += chord * libm::cos(yaw + half);
            y += chord * libm::sin(yaw + half);
            yaw += w * dt;
            let met = self.met(x, y);
            sum += met + f64::from(weights.penalty) * (met - f64::from(weights.limit)).max(0.0);
            sum += f64::from(weights.change) * libm::hypot(dv, dw);
        }
        let (dx, dy) = (self.goal_m[0] - x, self.goal_m[1] - y);
        let distance = libm::hypot(dx, dy);
        let along = libm::cos(yaw) * dx + libm::sin(yaw) * dy;
        let across = libm::cos(yaw) * dy - libm::sin(yaw) * dx;
        sum + f64::from(weights.distance_per_m) * distance
            + f64::from(weights.heading_per_rad)
                * libm::atan2(across, along).abs()
                * (distance / FADE_M).min(1.0)
    }

    fn cost_of_knots(&self, knots: &Knots) -> f64 {
        self.cost_of(|step| knots[step / KNOT_STEPS])
    }

    /// The least J found with free knots, beginning with those of a plan and with plain ones.
    fn least(&self, plan: &Knots, random: &mut Random) -> f64 {
        let (forward, turn) = (f64::from(self.limits.forward_m_s), f64::from(self.limits.turn_rad_s));
        let mut least = f64::INFINITY;
        for start in 0..STARTS {
            let one = [f64::from(random.unit()) * forward, f64::from(random.between(-1.0, 1.0)) * turn];
            let mut knots = if start == 0 { *plan } else { [one; KNOTS] };
            let mut cost = self.cost_of_knots(&knots);
            let mut size = 0.3;
            for _ in 0..TRIES {
                let mut tried = knots;
                // A stretch of knots moves together, as a longer piece would.
                let first = random.below(KNOTS);
                let last = (first + random.below(KNOTS)).min(KNOTS - 1);
                let (dv, dw) = (f64::from(random.normal()) * size, f64::from(random.normal()) * size);
                for knot in &mut tried[first..=last] {
                    knot[0] = (knot[0] + dv * forward).clamp(0.0, forward);
                    knot[1] = (knot[1] + dw * turn).clamp(-turn, turn);
                }
                let next = self.cost_of_knots(&tried);
                // One try in five should succeed.
                size = if next < cost { (size * 1.5).min(0.5) } else { (size * 0.905).max(1e-4) };
                if next < cost {
                    (knots, cost) = (tried, next);
                } else if size <= 1e-4 {
                    size = 0.1;
                }
            }
            least = least.min(cost);
        }
        least
    }
}

/// Compares solved plans with the oracle; `plans` are those of `records`.
pub(crate) fn oracle(records: &[(Record, Plan)], limits: &Limits, weights: &Weights) -> Oracle {
    let mut out = Oracle { frames: records.len(), ..Oracle::default() };
    let part = 1.0 / records.len().max(1) as f64;
    for (number, (record, plan)) in records.iter().enumerate() {
        let question = Question::of(record, limits, weights);
        let pieces = |step: usize| {
            let piece = if step < PIECE_STEPS[0] {
                0
            } else if step < PIECE_STEPS[0] + PIECE_STEPS[1] {
                1
            } else {
                2
            };
            let Twist { v_m_s, w_rad_s } = plan.pieces[piece];
            [f64::from(v_m_s), f64::from(w_rad_s)]
        };
        let own = question.cost_of(pieces);
        let knots = std::array::from_fn(|knot| pieces(knot * KNOT_STEPS));
        let least = question.least(&knots, &mut Random::new(0x4f52_4143, number as u64));
        out.solved_cost += part * own;
        out.gap += part * (own - least);
        out.disagreement = out.disagreement.max((own - f64::from(plan.cost)).abs());
    }
    out
}

//! Covariance matrix adaptation: improves a candidate in all its six numbers where a pattern search is caught.
//!
//! J has a crease along every set of velocities that ends at the goal, and is nearly flat within it: no probe along an
//! axis is better there, so a pattern search stops at a place that says more about where it began than about the
//! problem. An evolution strategy learns the direction of the crease (N. Hansen, The CMA Evolution Strategy: A
//! Tutorial, 2016; sixteen samples in mirrored pairs, rank-one and rank-mu update, Cholesky factor). Its random numbers
//! are one table for all problems, so that an answer is a function of the question.

use crate::candidates::PIECES;
use crate::problem::Problem;
use crate::refinement::{Range, Scored};
use crate::rollout::{Group, Kernel, LANES, Scores};
use sidestep_msgs::{Limits, Twist};

/// Numbers of a candidate.
const SIZE: usize = 2 * PIECES;
/// Mirrored pairs of samples.
const PAIRS: usize = LANES / 2;
/// Samples, the best ones, that make the next mean.
const PARENTS: usize = LANES / 2;
/// Deviation of the first samples, as part of the range.
const STEP_FIRST: f32 = 0.12;
/// Below this deviation a search has converged.
const STEP_LAST: f32 = 0.002;

/// The numbers of a candidate as parts of their ranges, or a direction among them.
type Point = [f32; SIZE];

/// What all searches share: random numbers by generation, and the rates of adaptation.
#[derive(Debug, Clone)]
pub(crate) struct Strategy {
    draws: Vec<[Point; PAIRS]>,
    /// Weights of the parents, best first.
    weights: [f32; PARENTS],
    /// Effective number of parents.
    mass: f32,
    /// Rates of the step's path, the path of the mean, the rank-one and the rank-mu update; damping of the step.
    step_rate: f32,
    path_rate: f32,
    one_rate: f32,
    rank_rate: f32,
    damping: f32,
    /// Mean length of a standard normal point.
    length: f32,
}

impl Strategy {
    /// A strategy for searches of this many generations.
    pub(crate) fn new(generations: usize) -> Self {
        let n = SIZE as f32;
        let raw: [f32; PARENTS] =
            std::array::from_fn(|rank| libm::logf(PARENTS as f32 + 0.5) - libm::logf(rank as f32 + 1.0));
        let sum: f32 = raw.iter().sum();
        let weights = raw.map(|weight| weight / sum);
        let mass = 1.0 / weights.iter().map(|weight| weight * weight).sum::<f32>();
        let step_rate = (mass + 2.0) / (n + mass + 5.0);
        let one_rate = 2.0 / ((n + 1.3) * (n + 1.3) + mass);
        let rank_rate = 2.0 * (mass - 2.0 + 1.0 / mass) / ((n + 2.0) * (n + 2.0) + mass);
        Self {
            draws: draws(generations),
            weights,
            mass,
            step_rate,
            path_rate: (4.0 + mass / n) / (n + 4.0 + 2.0 * mass / n),
            one_rate,
            rank_rate: rank_rate.min(1.0 - one_rate),
            damping: 1.0 + step_rate + 2.0 * (((mass - 1.0) / (n + 1.0)).sqrt() - 1.0).max(0.0),
            length: n.sqrt() * (1.0 - 1.0 / (4.0 * n) + 1.0 / (21.0 * n * n)),
        }
    }
}

/// Roughly normal numbers, always the same ones (sums of twelve uniform numbers of a linear congruence).
fn draws(generations: usize) -> Vec<[Point; PAIRS]> {
    let mut state = 0x5349_4445_u64;
    let mut uniform = move || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 40) as f32 / 16_777_216.0
    };
    let mut normal = || (0..12).map(|_| uniform()).sum::<f32>() - 6.0;
    (0..generations).map(|_| std::array::from_fn(|_| std::array::from_fn(|_| normal()))).collect()
}

/// One search, between two generations.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Evolution {
    /// The best so far.
    pub(crate) best: Scored,
    mean: Point,
    step: f32,
    covariance: [Point; SIZE],
    step_path: Point,
    path: Point,
    generation: usize,
}

impl Evolution {
    /// A search that begins at a candidate.
    pub(crate) fn new(start: Scored, limits: &Limits) -> Self {
        let scale = scale(limits);
        let mean = std::array::from_fn(|number| {
            let twist = start.pieces[number / 2];
            [twist.v_m_s, twist.w_rad_s][number % 2] / scale[number % 2]
        });
        let covariance =
            std::array::from_fn(|row| std::array::from_fn(|col| f32::from(u8::from(row == col))));
        let path = [0.0; SIZE];
        Self { best: start, mean, step: STEP_FIRST, covariance, step_path: path, path, generation: 0 }
    }

    /// Goes on to a generation; returns how many were needed.
    pub(crate) fn run_to(
        &mut self,
        generation: usize,
        strategy: &Strategy,
        (kernel, problem): (Kernel, &Problem),
        (limits, range): (&Limits, &Range),
    ) -> usize {
        let first = self.generation;
        let (mut group, mut scores) = ([Group::STOP], [Scores::NONE]);
        let scale = scale(limits);
        while self.generation < generation.min(strategy.draws.len()) && self.step >= STEP_LAST {
            let draws = samples(&strategy.draws[self.generation]);
            let factor = cholesky(&self.covariance);
            let moves = draws.map(|draw| turned(&factor, &draw));
            for (lane, moved) in moves.iter().enumerate() {
                let at = |number: usize| (self.mean[number] + self.step * moved[number]) * scale[number % 2];
                let pieces = std::array::from_fn(|piece| Twist::new(at(2 * piece), at(2 * piece + 1)));
                group[0].set(lane, &range.clamped(&pieces));
            }
            kernel.evaluate(problem, &group, &mut scores);
            let mut order: [usize; LANES] = std::array::from_fn(|lane| lane);
            let cost = &scores[0].cost;
            order.sort_unstable_by(|a, b| cost[*a].total_cmp(&cost[*b]).then(a.cmp(b)));
            if cost[order[0]] < self.best.cost {
                let lane = order[0];
                let worst = scores[0].worst[lane];
                self.best = Scored { pieces: group[0].get(lane), cost: cost[lane], worst };
            }
            self.adapt(strategy, &order, &draws, &moves);
            self.generation += 1;
        }
        self.generation - first
    }

    /// Moves mean, step and covariance towards the best half of the samples.
    fn adapt(
        &mut self,
        s: &Strategy,
        order: &[usize; LANES],
        draws: &[Point; LANES],
        moves: &[Point; LANES],
    ) {
        let parents = || s.weights.iter().zip(order);
        let mean_of = |points: &[Point; LANES]| -> Point {
            std::array::from_fn(|number| parents().map(|(weight, lane)| weight * points[*lane][number]).sum())
        };
        let (shift, drift) = (mean_of(moves), mean_of(draws));
        let gain = |rate: f32| (rate * (2.0 - rate) * s.mass).sqrt();
        for number in 0..SIZE {
            self.mean[number] += self.step * shift[number];
            self.step_path[number] =
                (1.0 - s.step_rate) * self.step_path[number] + gain(s.step_rate) * drift[number];
            self.path[number] = (1.0 - s.path_rate) * self.path[number] + gain(s.path_rate) * shift[number];
        }
        for row in 0..SIZE {
            for col in 0..=row {
                let rank: f32 =
                    parents().map(|(weight, lane)| weight * moves[*lane][row] * moves[*lane][col]).sum();
                self.covariance[row][col] = (1.0 - s.one_rate - s.rank_rate) * self.covariance[row][col]
                    + s.one_rate * self.path[row] * self.path[col]
                    + s.rank_rate * rank;
            }
        }
        let length = self.step_path.iter().map(|x| x * x).sum::<f32>().sqrt();
        self.step *= libm::expf(s.step_rate / s.damping * (length / s.length - 1.0));
    }
}

fn scale(limits: &Limits) -> [f32; 2] {
    [limits.forward_m_s, limits.turn_rad_s]
}

/// Draws and their mirror images.
fn samples(pairs: &[Point; PAIRS]) -> [Point; LANES] {
    std::array::from_fn(|lane| if lane % 2 == 0 { pairs[lane / 2] } else { pairs[lane / 2].map(|x| -x) })
}

fn turned(factor: &[Point; SIZE], draw: &Point) -> Point {
    std::array::from_fn(|row| factor[row].iter().zip(draw).map(|(a, b)| a * b).sum())
}

/// The lower triangle L of a matrix L L^T, from its lower triangle.
fn cholesky(matrix: &[Point; SIZE]) -> [Point; SIZE] {
    let mut lower = [[0.0; SIZE]; SIZE];
    for row in 0..SIZE {
        for col in 0..=row {
            let known: f32 = (0..col).map(|k| lower[row][k] * lower[col][k]).sum();
            let rest = matrix[row][col] - known;
            lower[row][col] = if row == col { rest.max(1e-12).sqrt() } else { rest / lower[col][col] };
        }
    }
    lower
}

//! The bare optimiser: bytes of planning cost, a goal cell and a velocity in, a plan out; for node and training alike.

use crate::candidates::{PIECE_STEPS, PIECES, Pieces, groups};
use crate::config::Weights;
use crate::evolution::{Evolution, Strategy};
use crate::problem::{HORIZON_STEPS, Problem, STEP_S};
use crate::refinement::{Range, Scored, best_lane, improve};
use crate::rollout::{Group, Kernel, LANES, Scores, look_up};
use sidestep_msgs::{LOCAL_CELLS, Limits, Pose2, Twist};

/// Most starts of a search.
const STARTS_MAX: usize = 32;
/// Candidates differ when a number of theirs differs by this part of its range.
const DISTINCT: f32 = 0.2;
/// Groups of sixteen candidates beside the seed of a refined plan.
const REFINED_GROUPS: usize = 5;
/// Generations of a refined plan: with the groups and the seed's own, a quarter of 734 evaluations.
const REFINED_ROUNDS: usize = 5;
/// Planning cost above the limit that discrete candidates may show without counting as inadmissible.
const TOLERANCE: f32 = 0.1;

/// How hard to think.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Mode {
    /// The best candidate.
    Plain,
    /// The best distinct candidates, improved with the planner's [`Effort`].
    Solved,
    /// A proposal from elsewhere, improved; better than 734 candidates at a quarter of their evaluations.
    Refined(Twist),
}

/// How long a solved plan is searched for: many starts for a moment, the better of them for longer.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Effort {
    /// Candidates that it begins with, at least.
    pub candidates: usize,
    /// Rounds of sixteen probes of each start.
    pub rounds: usize,
    /// Starts that are still searched from, at most 32, and the generation of sixteen samples that they go on to.
    pub rungs: &'static [(usize, usize)],
}

impl Effort {
    /// What a robot has time for.
    pub const LIVE: Self = Self { candidates: 2000, rounds: 10, rungs: &[(10, 12), (3, 60)] };

    /// What a label deserves: three and a half times as long, for a half to a third of the distance to the optimum. What is
    /// left of that distance is noise to whoever learns.
    pub const LABEL: Self = Self { candidates: 2000, rounds: 10, rungs: &[(32, 12), (16, 60), (8, 200)] };
}

/// An answer to eq. (6).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Plan {
    /// u: the target of the first piece.
    pub twist: Twist,
    /// Targets of all pieces, approached within the limits of acceleration.
    pub pieces: [Twist; PIECES],
    /// J of eq. (6), the limit as penalty.
    pub cost: f32,
    /// `[1]` largest planning cost met.
    pub worst: f32,
    /// `[1]` planning cost where the robot stands.
    pub here: f32,
    /// Candidates evaluated.
    pub evaluated: u32,
}

impl Plan {
    /// Whether the plan keeps the limit, or at least does not enter higher cost than where the robot stands.
    #[must_use]
    pub fn is_admissible(&self, limit: f32) -> bool {
        self.worst <= limit.max(self.here) + TOLERANCE
    }
}

/// The poses of a robot that approaches the targets of all pieces from a velocity, changing it by at most `step` per 0.1 s.
pub(crate) fn follow(pieces: &Pieces, from: Twist, step: Twist) -> [Pose2; HORIZON_STEPS] {
    let mut twist = from;
    let mut pose = Pose2::ORIGIN;
    let mut targets = (0..PIECES).flat_map(|piece| std::iter::repeat_n(pieces[piece], PIECE_STEPS[piece]));
    std::array::from_fn(|_| {
        let target = targets.next().unwrap_or(pieces[PIECES - 1]);
        twist.v_m_s += (target.v_m_s - twist.v_m_s).clamp(-step.v_m_s, step.v_m_s);
        twist.w_rad_s += (target.w_rad_s - twist.w_rad_s).clamp(-step.w_rad_s, step.w_rad_s);
        pose = pose.advance(&twist, f64::from(STEP_S));
        pose
    })
}

/// The optimiser with its memory; one per thread.
#[derive(Debug, Clone)]
pub struct Planner {
    limits: Limits,
    range: Range,
    candidates: usize,
    groups: Vec<Group>,
    scores: Vec<Scores>,
    problem: Problem,
    kernel: Kernel,
    strategy: Strategy,
    effort: Effort,
}

impl Planner {
    /// Makes the first `candidates` candidates (at least one) for a robot; solves as long as a robot has time for.
    #[must_use]
    pub fn new(limits: &Limits, weights: &Weights, candidates: usize) -> Self {
        Self::searching(limits, weights, candidates, Effort::LIVE)
    }

    /// As [`Planner::new`], but solves with an effort of the caller's choice.
    #[must_use]
    pub fn searching(limits: &Limits, weights: &Weights, candidates: usize, effort: Effort) -> Self {
        let candidates = candidates.max(1);
        let made = groups(0..candidates.max(effort.candidates), limits);
        Self::of(limits, weights, candidates, made, effort)
    }

    /// A planner whose plain plans choose from candidates of the endless sequence that the caller names (at least one);
    /// for comparisons of sets. Its solved plans begin with them too.
    #[must_use]
    pub fn choosing_from(limits: &Limits, weights: &Weights, numbers: &[usize]) -> Self {
        let numbers = if numbers.is_empty() { &[0] } else { numbers };
        Self::of(limits, weights, numbers.len(), groups(numbers.iter().copied(), limits), Effort::LIVE)
    }

    fn of(limits: &Limits, weights: &Weights, candidates: usize, groups: Vec<Group>, effort: Effort) -> Self {
        Self {
            limits: *limits,
            range: Range::whole(limits),
            candidates,
            scores: vec![Scores::NONE; groups.len()],
            groups,
            problem: Problem::new(limits, *weights),
            kernel: Kernel::best(),
            strategy: Strategy::new(effort.rungs.iter().fold(0, |most, rung| most.max(rung.1))),
            effort,
        }
    }

    /// Plans on bytes of planning cost towards a cell of the local map, from a velocity.
    pub fn plan(&mut self, cost: &[u8; LOCAL_CELLS], goal_cell: usize, from: Twist, mode: Mode) -> Plan {
        self.problem.pose(cost, goal_cell, from);
        let (best, evaluated) = match mode {
            Mode::Plain => (self.best_of(self.candidates), self.candidates),
            Mode::Solved => self.solved(),
            Mode::Refined(seed) => self.refined(seed),
        };
        self.answer(&best, evaluated)
    }

    /// The best of the candidates of the last plain or solved plan that is admissible, if there is any.
    #[must_use]
    pub fn best_admissible(&self) -> Option<Plan> {
        let limit = self.problem.weights.limit;
        let bound = 255.0 * (limit.max(self.here()) + TOLERANCE);
        let admissible = |index: &usize| self.scores[index / LANES].worst[index % LANES] <= bound;
        let best = (0..self.candidates).filter(admissible).reduce(|best, index| {
            if self.cost_of_candidate(index) < self.cost_of_candidate(best) { index } else { best }
        })?;
        Some(self.answer(&self.scored(best), self.candidates))
    }

    /// J of eq. (6) for velocities of one's own.
    pub fn cost_of(
        &mut self,
        cost: &[u8; LOCAL_CELLS],
        goal_cell: usize,
        from: Twist,
        pieces: &[Twist; PIECES],
    ) -> f32 {
        self.problem.pose(cost, goal_cell, from);
        let mut group = [Group::STOP];
        let mut scores = [Scores::NONE];
        group[0].set(0, &pieces.map(|twist| self.within(self.problem.turned(twist))));
        self.kernel.evaluate(&self.problem, &group, &mut scores);
        scores[0].cost[0]
    }

    /// Solves within a range, the candidates moved into it; `candidates` are those that [`Planner::new`] made.
    pub(crate) fn solve_within(&mut self, candidates: &[Group], range: &Range) -> Plan {
        self.range = *range;
        for (own, group) in self.groups.iter_mut().zip(candidates) {
            for lane in 0..LANES {
                own.set(lane, &range.clamped(&group.get(lane)));
            }
        }
        let (best, evaluated) = self.solved();
        self.answer(&best, evaluated)
    }

    /// The problem that the next answer is for.
    pub(crate) fn problem(&mut self) -> &mut Problem {
        &mut self.problem
    }

    /// The candidates.
    pub(crate) fn groups(&self) -> &[Group] {
        &self.groups
    }

    /// The poses of a plan in `base`, one per 0.1 s, the first at 0.1 s.
    #[must_use]
    pub fn trajectory(&self, plan: &Plan) -> [Pose2; HORIZON_STEPS] {
        follow(&plan.pieces, self.problem.turned(self.problem.from), self.problem.step)
    }

    fn here(&self) -> f32 {
        look_up(&self.problem, 0.0, 0.0) * (1.0 / 255.0)
    }

    fn answer(&self, best: &Scored, evaluated: usize) -> Plan {
        let pieces = best.pieces.map(|twist| self.problem.turned(twist));
        Plan {
            twist: pieces[0],
            pieces,
            cost: best.cost,
            worst: best.worst * (1.0 / 255.0),
            here: self.here(),
            evaluated: u32::try_from(evaluated).unwrap_or(u32::MAX),
        }
    }

    fn within(&self, twist: Twist) -> Twist {
        let number =
            |value: f32, least: f32, most: f32| if value.is_nan() { 0.0 } else { value.clamp(least, most) };
        let turn = self.limits.turn_rad_s;
        Twist::new(number(twist.v_m_s, 0.0, self.limits.forward_m_s), number(twist.w_rad_s, -turn, turn))
    }

    fn cost_of_candidate(&self, index: usize) -> f32 {
        self.scores[index / LANES].cost[index % LANES]
    }

    fn scored(&self, index: usize) -> Scored {
        let (group, lane) = (index / LANES, index % LANES);
        let score = &self.scores[group];
        Scored { pieces: self.groups[group].get(lane), cost: score.cost[lane], worst: score.worst[lane] }
    }

    /// Evaluates the first `count` candidates, whole groups; the best, the first of equals.
    fn best_of(&mut self, count: usize) -> Scored {
        let groups = count.div_ceil(LANES).min(self.groups.len());
        self.kernel.evaluate(&self.problem, &self.groups[..groups], &mut self.scores[..groups]);
        let index = (0..count).reduce(|best, index| {
            if self.cost_of_candidate(index) < self.cost_of_candidate(best) { index } else { best }
        });
        self.scored(index.unwrap_or_default())
    }

    fn solved(&mut self) -> (Scored, usize) {
        let effort = self.effort;
        let candidates = self.candidates.max(effort.candidates).min(self.groups.len() * LANES);
        let best = self.best_of(candidates);
        let mut starts = [best; STARTS_MAX];
        let wanted = effort.rungs.first().map_or(1, |rung| rung.0.clamp(1, STARTS_MAX));
        let mut count = 1;
        while let Some(next) = (count < wanted).then(|| self.best_distinct(&starts[..count])).flatten() {
            starts[count] = next;
            count += 1;
        }
        let mut rounds = 0;
        for start in &mut starts[..count] {
            rounds += improve(self.kernel, &self.problem, &self.limits, &self.range, start, effort.rounds);
        }
        let mut searches = starts.map(|start| Evolution::new(start, &self.limits));
        for &(survivors, generation) in effort.rungs {
            for search in &mut searches[..count.min(survivors)] {
                rounds += self.evolve(search, generation);
            }
            searches[..count].sort_unstable_by(|a, b| a.best.cost.total_cmp(&b.best.cost));
        }
        let found = searches[..count].iter().map(|search| search.best);
        let best = found.fold(best, |best, next| if next.cost < best.cost { next } else { best });
        (best, candidates + rounds * LANES)
    }

    fn evolve(&self, search: &mut Evolution, generation: usize) -> usize {
        search.run_to(generation, &self.strategy, (self.kernel, &self.problem), (&self.limits, &self.range))
    }

    /// The best candidate that differs from all of `taken`.
    fn best_distinct(&self, taken: &[Scored]) -> Option<Scored> {
        let (mut best, mut least) = (None, f32::INFINITY);
        for (number, score) in self.scores.iter().enumerate() {
            for lane in 0..LANES {
                if score.cost[lane] < least
                    && taken.iter().all(|other| self.differ(&self.groups[number].get(lane), &other.pieces))
                {
                    (best, least) = (Some(number * LANES + lane), score.cost[lane]);
                }
            }
        }
        best.map(|index| self.scored(index))
    }

    fn differ(&self, one: &Pieces, other: &Pieces) -> bool {
        let (v, w) = (DISTINCT * self.limits.forward_m_s, DISTINCT * 2.0 * self.limits.turn_rad_s);
        one.iter().zip(other).any(|(a, b)| (a.v_m_s - b.v_m_s).abs() > v || (a.w_rad_s - b.w_rad_s).abs() > w)
    }

    fn refined(&mut self, seed: Twist) -> (Scored, usize) {
        let seed = self.within(self.problem.turned(seed));
        let count = REFINED_GROUPS.min(self.groups.len());
        // The seed's own group: the seed now, then each of the first candidates; lane 0 keeps the seed.
        let (mut own, mut own_scores) = ([Group::STOP], [Scores::NONE]);
        for lane in 0..LANES {
            let later = if lane == 0 { [seed; PIECES] } else { self.groups[0].get(lane - 1) };
            own[0].set(lane, &[seed, later[1], later[2]]);
        }
        self.kernel.evaluate(&self.problem, &own, &mut own_scores);
        self.kernel.evaluate(&self.problem, &self.groups[..count], &mut self.scores[..count]);
        let lane = best_lane(&own_scores[0]);
        let mut best = Scored {
            pieces: own[0].get(lane),
            cost: own_scores[0].cost[lane],
            worst: own_scores[0].worst[lane],
        };
        for index in 0..(count * LANES).min(self.candidates) {
            if self.cost_of_candidate(index) < best.cost {
                best = self.scored(index);
            }
        }
        let mut search = Evolution::new(best, &self.limits);
        let rounds = self.evolve(&mut search, REFINED_ROUNDS);
        (search.best, (1 + count + rounds) * LANES)
    }
}

//! Promises of the optimiser, on closed forms and on artificial problems.

use crate::candidates::groups;
use crate::problem::Problem;
use crate::rollout::{Kernel, Scores, look_up};
use crate::samples::{LOOMO, Random, Sample};
use crate::{HORIZON_STEPS, Mode, Plan, Planner, STEP_S, UNKNOWN_COST, Weights};
use sidestep_msgs::{LOCAL_CELLS, LOCAL_GRID, LOCAL_SIDE, Twist};

const EMPTY: [u8; LOCAL_CELLS] = [0; LOCAL_CELLS];

fn planner(candidates: usize) -> Planner {
    Planner::new(&LOOMO, &Weights::STANDARD, candidates)
}

fn plan(planner: &mut Planner, sample: &Sample, mode: Mode) -> Plan {
    planner.plan(&sample.cost, sample.goal, sample.from, mode)
}

fn at(row: usize, col: usize) -> usize {
    row * LOCAL_SIDE + col
}

fn samples() -> impl Iterator<Item = Sample> {
    (0..200).map(|number| Sample::artificial(1000 + number))
}

/// Mean cost of a mode over all samples.
fn mean_cost(planner: &mut Planner, mode: impl Fn(&Sample) -> Mode) -> f32 {
    samples().map(|sample| plan(planner, &sample, mode(&sample)).cost).sum::<f32>() / 200.0
}

/// In an empty map at full speed, goal ahead on the axis' left cell: distance and heading are left, by hand.
#[test]
fn driving_straight_costs_what_the_closed_form_says() {
    let goal = at(4, 13);
    let (goal_x_m, goal_y_m) = LOCAL_GRID.centre(4, 13);
    let straight = [Twist::new(0.5, 0.0); 3];
    let cost = planner(50).cost_of(&EMPTY, goal, Twist::new(0.5, 0.0), &straight);
    let x_m = 0.5 * HORIZON_STEPS as f32 * STEP_S;
    let needed = 4.0 * libm::hypotf(goal_x_m - x_m, goal_y_m) + 0.5 * libm::atan2f(goal_y_m, goal_x_m - x_m);
    assert!((cost - needed).abs() < 1e-4, "{cost} {needed}");
}

/// From rest to 1 m/s: the change of velocity costs w3 times 1 m/s, the way is short of full speed by 0.45 m.
#[test]
fn speeding_up_costs_its_change_and_its_time() {
    let cost = planner(50).cost_of(&EMPTY, at(0, 13), Twist::STOP, &[Twist::new(1.0, 0.0); 3]);
    let (goal_x_m, goal_y_m) = LOCAL_GRID.centre(0, 13);
    let x_m = 2.4 - 0.45;
    let needed = 0.3 * 1.0
        + 4.0 * libm::hypotf(goal_x_m - x_m, goal_y_m)
        + 0.5 * libm::atan2f(goal_y_m, goal_x_m - x_m);
    assert!((cost - needed).abs() < 1e-4, "{cost} {needed}");
}

/// A map of one cost: each of 24 steps pays it, and what is above 0.4 twenty times more.
#[test]
fn every_step_pays_the_map_and_the_penalty_above_the_limit() {
    let mut planner = planner(50);
    let stop = [Twist::STOP; 3];
    let [free, low, high] =
        [0_u8, 51, 204].map(|byte| planner.cost_of(&[byte; LOCAL_CELLS], at(23, 13), Twist::STOP, &stop));
    assert!((low - free - 24.0 * 0.2).abs() < 1e-4, "{low} {free}");
    assert!((high - free - 24.0 * (0.8 + 20.0 * 0.4)).abs() < 1e-2, "{high} {free}");
}

#[test]
fn beyond_the_map_is_unknown() {
    let mut problem = Problem::new(&LOOMO, Weights::STANDARD);
    problem.pose(&EMPTY, at(0, 0), Twist::STOP);
    for (x_m, y_m) in [(3.0, 0.0), (-1.0, 0.0), (0.0, 9.0), (1.0, -2.0)] {
        assert!((look_up(&problem, x_m, y_m) - f32::from(UNKNOWN_COST)).abs() < 1e-3);
    }
    assert!(look_up(&problem, 0.0, 0.0).abs() < 1e-6);
}

/// Cell centres give their own byte, the middle between two cells the mean, on both sides of the map.
#[test]
fn the_look_up_is_bilinear_between_cell_centres() {
    for sample in samples().take(20) {
        let mut problem = Problem::new(&LOOMO, Weights::STANDARD);
        problem.pose(&sample.cost, sample.goal, Twist::STOP);
        for index in 0..LOCAL_CELLS - 1 {
            let (x_m, y_m) = LOCAL_GRID.centre(index / LOCAL_SIDE, index % LOCAL_SIDE);
            let side = if problem.mirrored { -1.0 } else { 1.0 };
            let (one, next) = (f32::from(sample.cost[index]), f32::from(sample.cost[index + 1]));
            assert!((look_up(&problem, x_m, side * y_m) - one).abs() < 2e-3, "{index}");
            if index % LOCAL_SIDE < LOCAL_SIDE - 1 {
                let between = look_up(&problem, x_m, side * (y_m - 0.05));
                assert!((between - 0.5 * (one + next)).abs() < 2e-3, "{index}: {between}");
            }
        }
    }
}

#[test]
fn a_mirrored_problem_gives_the_mirrored_plan_to_the_last_bit() {
    let mut planner = planner(734);
    for sample in samples() {
        for mode in [Mode::Plain, Mode::Solved, Mode::Refined(Twist::new(0.4, 0.7))] {
            let other_mode =
                if let Mode::Refined(seed) = mode { Mode::Refined(seed.mirrored()) } else { mode };
            let one = plan(&mut planner, &sample, mode);
            let other = plan(&mut planner, &sample.mirrored(), other_mode);
            assert_eq!(one.twist, other.twist.mirrored());
            assert_eq!(one.cost.to_bits(), other.cost.to_bits());
            assert_eq!(one.evaluated, other.evaluated);
        }
    }
}

#[test]
fn more_candidates_are_never_worse() {
    let mut planners = [50, 124, 270, 734, 2000].map(planner);
    for sample in samples() {
        let costs = planners.each_mut().map(|planner| plan(planner, &sample, Mode::Plain).cost);
        assert!(costs.is_sorted_by(|few, many| few >= many), "{costs:?}");
    }
}

#[test]
fn solving_is_never_worse_than_the_best_candidate() {
    let mut planner = planner(734);
    for sample in samples() {
        let (plain, solved) =
            (plan(&mut planner, &sample, Mode::Plain), plan(&mut planner, &sample, Mode::Solved));
        assert!(solved.cost <= plain.cost, "{solved:?} {plain:?}");
    }
}

#[test]
fn refining_is_never_worse_than_its_seed() {
    let mut planner = planner(734);
    for (number, sample) in samples().enumerate() {
        let mut random = Random(number as u64);
        let seed = Twist::new(random.uniform(0.0, 1.0), random.uniform(-1.5, 1.5));
        let before = planner.cost_of(&sample.cost, sample.goal, sample.from, &[seed; 3]);
        assert!(plan(&mut planner, &sample, Mode::Refined(seed)).cost <= before);
    }
}

/// SPEC section 1: refined is better than 734 samples at a quarter of their work; seed as far off as a policy's.
#[test]
fn refining_beats_734_candidates_at_a_quarter_of_their_evaluations() {
    let (mut planner, mut solver) = (planner(734), planner(734));
    let plain = mean_cost(&mut planner, |_| Mode::Plain);
    let seeds = std::cell::RefCell::new(&mut solver);
    let refined = mean_cost(&mut planner, |sample| {
        let best = plan(&mut seeds.borrow_mut(), sample, Mode::Solved).twist;
        Mode::Refined(Twist::new(best.v_m_s - 0.1, best.w_rad_s + 0.2))
    });
    let sample = Sample::artificial(0);
    let evaluated = plan(&mut planner, &sample, Mode::Refined(Twist::STOP)).evaluated;
    assert!(refined < plain && evaluated * 4 <= 734, "{refined} {plain} {evaluated}");
}

/// Solving finds most of what ten thousand candidates with thorough search find.
#[test]
fn solving_leaves_little_to_find() {
    let [plain, solved] = [Mode::Plain, Mode::Solved].map(|mode| mean_cost(&mut planner(734), |_| mode));
    let thorough = mean_cost(&mut planner(10_000), |_| Mode::Solved);
    assert!(solved - thorough < 0.05 && plain - thorough > 0.2, "{plain} {solved} {thorough}");
}

/// A wall across the way, goal behind it: whatever the mode and speed, the plan stays before the wall.
#[test]
fn no_plan_leads_through_a_wall() {
    let mut planner = planner(734);
    let mut cost = EMPTY;
    for row in 8..12 {
        cost[at(row, 0)..at(row + 1, 0)].fill(255);
    }
    let wall_m = LOCAL_GRID.centre(12, 0).0 + 0.05;
    for mode in [Mode::Plain, Mode::Solved, Mode::Refined(Twist::new(1.0, 0.0))] {
        for v in [0.0, 0.5, 1.0] {
            let plan = planner.plan(&cost, at(2, 14), Twist::new(v, 0.0), mode);
            let last = planner.trajectory(&plan).iter().fold(0.0_f64, |most, pose| most.max(pose.x_m));
            assert!(last < f64::from(wall_m) && plan.worst < 0.5, "{mode:?} {v}: {last} {plan:?}");
        }
    }
}

/// Eq. (6) once more, term by term along the trajectory shown, with `atan2` and exact arcs.
fn cost_by_hand(planner: &Planner, plan: &Plan, sample: &Sample) -> f64 {
    let mut problem = Problem::new(&LOOMO, Weights::STANDARD);
    problem.pose(&sample.cost, sample.goal, sample.from);
    let side = if problem.mirrored { -1.0 } else { 1.0 };
    let (mut sum, mut twist) = (0.0, sample.from);
    let poses = planner.trajectory(plan);
    for (step, pose) in poses.iter().enumerate() {
        let met = f64::from(look_up(&problem, pose.x_m as f32, side * pose.y_m as f32)) / 255.0;
        sum += met + 20.0 * (met - 0.4).max(0.0);
        let target = plan.pieces[if step < 12 { step / 6 } else { 2 }];
        let dv = (target.v_m_s - twist.v_m_s).clamp(-0.1, 0.1);
        let dw = (target.w_rad_s - twist.w_rad_s).clamp(-0.3, 0.3);
        sum += 0.3 * f64::from(libm::hypotf(dv, dw));
        twist = Twist::new(twist.v_m_s + dv, twist.w_rad_s + dw);
    }
    let (goal_x_m, goal_y_m) = LOCAL_GRID.centre(sample.goal / LOCAL_SIDE, sample.goal % LOCAL_SIDE);
    let end = poses[HORIZON_STEPS - 1];
    let (x_m, y_m) = end.inverse_transform(f64::from(goal_x_m), f64::from(goal_y_m));
    let distance = libm::hypot(x_m, y_m);
    sum + 4.0 * distance + 0.5 * libm::atan2(y_m, x_m).abs() * (distance / 0.25).min(1.0)
}

#[test]
fn the_trajectory_shown_is_the_one_that_was_judged() {
    let mut planner = planner(734);
    for sample in samples() {
        for mode in [Mode::Plain, Mode::Solved] {
            let plan = plan(&mut planner, &sample, mode);
            let by_hand = cost_by_hand(&planner, &plan, &sample) as f32;
            assert!((plan.cost - by_hand).abs() < 5e-3, "{by_hand} {plan:?}");
        }
    }
}

#[test]
fn every_kernel_gives_the_same_bits() {
    for sample in samples() {
        let mut problem = Problem::new(&LOOMO, Weights::STANDARD);
        problem.pose(&sample.cost, sample.goal, sample.from);
        let groups = groups(0..734, &LOOMO);
        let mut scores = vec![vec![Scores::NONE; groups.len()]; 3];
        for (kernel, scores) in Kernel::available().zip(&mut scores) {
            kernel.evaluate(&problem, &groups, scores);
        }
        for (kernel, other) in Kernel::available().zip(&scores) {
            assert_eq!(&scores[0], other, "{kernel:?}");
        }
    }
}

#[test]
fn garbage_gives_a_finite_plan() {
    let mut planner = planner(50);
    for byte in [0, 77, 255] {
        for number in [f32::NAN, f32::INFINITY, -1e30, 1e30] {
            for mode in [Mode::Plain, Mode::Solved, Mode::Refined(Twist::new(number, number))] {
                let plan = planner.plan(&[byte; LOCAL_CELLS], usize::MAX, Twist::new(number, number), mode);
                assert!(plan.twist.is_finite() && plan.cost.is_finite(), "{byte} {number} {plan:?}");
            }
        }
    }
}

#[test]
fn a_planner_can_move_to_another_thread() {
    fn assert_send<T: Send>(_: &T) {}
    assert_send(&planner(50));
}

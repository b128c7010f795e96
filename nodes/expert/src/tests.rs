//! Promises of the optimiser, on closed forms and on artificial problems.

use crate::samples::{LOOMO, Random, Sample};
use crate::{HORIZON_STEPS, Mode, Plan, Planner, STEP_S, Weights};
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

#[test]
fn study() {
    let n = 300;
    let mut reference = planner(10_000);
    let samples: Vec<Sample> = (0..n).map(|s| Sample::artificial(1000 + s)).collect();
    let best: Vec<Plan> = samples.iter().map(|s| {
        let a = plan(&mut reference, s, Mode::Solved);
        a
    }).collect();
    let mean = best.iter().map(|p| p.cost).sum::<f32>() / n as f32;
    println!("reference mean J {mean}");
    let mut p734 = planner(734);
    let window = |p: Twist, f: Twist, d: f32| Twist::new(p.v_m_s.clamp(f.v_m_s - d, f.v_m_s + d), p.w_rad_s.clamp(f.w_rad_s - 3.0*d, f.w_rad_s + 3.0*d));
    let mut report = |name: &str, plans: Vec<Plan>| {
        let mut dj: Vec<f32> = plans.iter().zip(&best).map(|(p, b)| p.cost - b.cost).collect();
        dj.sort_by(f32::total_cmp);
        let l2 = |d: f32| plans.iter().zip(&best).zip(&samples).map(|((p, b), s)| {
            let (p, b) = (window(p.twist, s.from, d), window(b.twist, s.from, d));
            libm::hypotf(p.v_m_s - b.v_m_s, p.w_rad_s - b.w_rad_s)
        }).sum::<f32>() / n as f32;
        println!("{name}: dJ {:.3} p99 {:.3} min {:.3} l2 {:.4} {:.4} eval {}", dj.iter().sum::<f32>() / n as f32, dj[n as usize * 99 / 100], dj[0], l2(0.1), l2(0.3), plans[0].evaluated);
    };
    for c in [50, 125, 270, 734, 2000, 10000] {
        let mut p = planner(c);
        report(&format!("plain {c}"), samples.iter().map(|s| plan(&mut p, s, Mode::Plain)).collect());
    }
    report("solved 734", samples.iter().map(|s| plan(&mut p734, s, Mode::Solved)).collect());
    let mut p2000 = planner(2000);
    report("solved 2000", samples.iter().map(|s| plan(&mut p2000, s, Mode::Solved)).collect());
    let seeds: Vec<Twist> = samples.iter().zip(&best).enumerate().map(|(i, (_, b))| {
        let mut r = Random(i as u64);
        // A policy as good as measured: now and then far off.
        let e = if r.uniform(0.0, 1.0) < 0.1 { 1.0 } else { 0.06 };
        Twist::new(b.twist.v_m_s + e * r.uniform(-0.3, 0.3), b.twist.w_rad_s + e * r.uniform(-1.0, 1.0))
    }).collect();
    report("refined", samples.iter().zip(&seeds).map(|(s, t)| plan(&mut p734, s, Mode::Refined(*t))).collect());
    report("refined stop", samples.iter().map(|s| plan(&mut p734, s, Mode::Refined(Twist::STOP))).collect());
}

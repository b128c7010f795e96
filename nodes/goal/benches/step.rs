//! Time of one step: a long path over free ground, and one that runs into an obstacle.

use sidestep_goal::{Config, Goal};
use sidestep_msgs::{LocalGoal, LocalMap, Odometry, PATH_POINTS, Path, PathPoint, Robot, Status};

fn main() {
    divan::main();
}

fn time(bencher: divan::Bencher<'_, '_>, map: &LocalMap) {
    let text = include_str!("../../../launch/robots/loomo.toml");
    let Ok(robot) = Robot::from_toml("loomo.toml", text) else { return };
    let Ok(mut goal) = Goal::new(&Config::STANDARD, &robot) else { return };
    let mut path = Path { id: 1, count: PATH_POINTS as u32, ..Path::default() };
    for (index, point) in path.points.iter_mut().enumerate() {
        *point = PathPoint { x_m: index as f32 * 0.05, y_m: 0.0 };
    }
    goal.path(&path);
    goal.odometry(&Odometry::default(), 1);
    let mut out = LocalGoal::default();
    bencher.bench_local(|| goal.step(divan::black_box(map), 1, Status::Ok, &mut out));
}

#[divan::bench(sample_count = 500)]
fn free(bencher: divan::Bencher<'_, '_>) {
    time(bencher, &LocalMap::default());
}

#[divan::bench(sample_count = 500)]
fn blocked(bencher: divan::Bencher<'_, '_>) {
    let mut map = LocalMap::default();
    map.planning_cost[8 * 28..12 * 28].fill(255);
    time(bencher, &map);
}

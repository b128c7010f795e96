//! People: they walk to and fro along their waypoints, wait for the robot in front of them, and turn back after a while.

use crate::solid::Solid;
use sidestep_msgs::{PEOPLE_MAX, Person};

/// `[m]` radius of a person.
const RADIUS_M: f64 = 0.25;
/// `[m]` height of a person.
const HEIGHT_M: f64 = 1.7;
/// `[m]` a person waits when the robot's centre is nearer than this and ahead.
const POLITE_M: f64 = 1.2;
/// `[s]` longest wait before turning back.
const PATIENCE_S: f64 = 3.0;

/// A person's way.
#[derive(Debug, Clone, PartialEq)]
pub struct Walker {
    /// `[m]` waypoints in the world, walked to and fro; one point = stands still.
    pub waypoints_m: Vec<[f64; 2]>,
    /// `[m/s]` walking speed.
    pub speed_m_s: f64,
}

impl Walker {
    fn length_m(&self) -> f64 {
        self.waypoints_m.windows(2).map(|w| libm::hypot(w[1][0] - w[0][0], w[1][1] - w[0][1])).sum()
    }

    /// Place and direction at a distance along the way.
    fn at(&self, along_m: f64) -> ([f64; 2], [f64; 2]) {
        let mut left = along_m;
        for pair in self.waypoints_m.windows(2) {
            let (dx, dy) = (pair[1][0] - pair[0][0], pair[1][1] - pair[0][1]);
            let length = libm::hypot(dx, dy).max(1e-9);
            if left <= length {
                let direction = [dx / length, dy / length];
                return ([pair[0][0] + left * direction[0], pair[0][1] + left * direction[1]], direction);
            }
            left -= length;
        }
        (self.waypoints_m.last().copied().unwrap_or([0.0; 2]), [0.0; 2])
    }
}

#[derive(Debug, Clone, Copy, Default)]
struct Progress {
    along_m: f64,
    back: bool,
    waited_s: f64,
    walking: bool,
}

/// Where everybody is now.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct People {
    progress: [Progress; PEOPLE_MAX],
    count: usize,
}

impl People {
    /// The first `count` walkers, at places along their ways drawn by `unit` in [0, 1).
    pub(crate) fn new(walkers: &[Walker], count: usize, mut unit: impl FnMut() -> f64) -> Self {
        let mut people = Self { count: count.min(walkers.len()).min(PEOPLE_MAX), ..Self::default() };
        for (progress, walker) in people.progress.iter_mut().zip(walkers).take(people.count) {
            progress.along_m = unit() * walker.length_m();
        }
        people
    }

    /// Everybody walks on for `dt_s`.
    pub(crate) fn step(&mut self, walkers: &[Walker], robot_m: [f64; 2], dt_s: f64) {
        for (progress, walker) in self.progress[..self.count].iter_mut().zip(walkers) {
            let length = walker.length_m();
            let (place, direction) = walker.at(progress.along_m);
            let sign = if progress.back { -1.0 } else { 1.0 };
            let (rx, ry) = (robot_m[0] - place[0], robot_m[1] - place[1]);
            let ahead = sign * (rx * direction[0] + ry * direction[1]) > 0.0;
            progress.walking = length > 0.0 && !(ahead && libm::hypot(rx, ry) < POLITE_M);
            if progress.walking {
                progress.waited_s = 0.0;
                progress.along_m = (progress.along_m + sign * walker.speed_m_s * dt_s).clamp(0.0, length);
                if progress.along_m <= 0.0 || progress.along_m >= length {
                    progress.back = progress.along_m >= length;
                }
            } else {
                progress.waited_s += dt_s;
                if progress.waited_s > PATIENCE_S {
                    progress.back = !progress.back;
                    progress.waited_s = 0.0;
                }
            }
        }
    }

    /// Everybody as a solid.
    pub(crate) fn solids<'a>(&'a self, walkers: &'a [Walker]) -> impl Iterator<Item = Solid> + 'a {
        self.progress[..self.count]
            .iter()
            .zip(walkers)
            .map(|(progress, walker)| Solid::column(walker.at(progress.along_m).0, RADIUS_M, [0.0, HEIGHT_M]))
    }

    /// Everybody as the truth tells it.
    pub(crate) fn report(&self, walkers: &[Walker], out: &mut [Person; PEOPLE_MAX]) -> u32 {
        for ((progress, walker), person) in self.progress[..self.count].iter().zip(walkers).zip(out) {
            let (place, direction) = walker.at(progress.along_m);
            let speed = if progress.walking { walker.speed_m_s } else { 0.0 };
            let speed = if progress.back { -speed } else { speed };
            *person = Person {
                x_m: place[0] as f32,
                y_m: place[1] as f32,
                vx_m_s: (speed * direction[0]) as f32,
                vy_m_s: (speed * direction[1]) as f32,
            };
        }
        self.count as u32
    }

    /// `[m/s]` the fastest of them.
    pub(crate) fn fastest_m_s(&self, walkers: &[Walker]) -> f64 {
        walkers.iter().take(self.count).fold(0.0, |most, walker| most.max(walker.speed_m_s))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn walk(robot_m: [f64; 2], seconds: usize) -> [f64; 2] {
        let walkers = [Walker { waypoints_m: vec![[0.0, 0.0], [3.0, 0.0]], speed_m_s: 0.5 }];
        let mut people = People::new(&walkers, 1, || 0.0);
        for _ in 0..seconds * 100 {
            people.step(&walkers, robot_m, 0.01);
        }
        let solid = people.solids(&walkers).next().unwrap();
        [solid.x_m, solid.y_m]
    }

    #[test]
    fn a_person_walks_to_and_fro() {
        assert!((walk([50.0, 0.0], 4)[0] - 2.0).abs() < 0.02);
        assert!((walk([50.0, 0.0], 8)[0] - 2.0).abs() < 0.03);
    }

    #[test]
    fn a_person_never_walks_into_the_robot() {
        for seconds in 1..30 {
            assert!(walk([2.0, 0.1], seconds)[0] < 2.0 - POLITE_M + 0.1);
        }
    }
}

//! How the robot sees: through its camera and the mapper, or the world itself drawn into both maps.

use crate::noise::{Noise, Outlook, Sheet};
use sidestep_mapper::{Widening, planning_cost};
use sidestep_msgs::{LOCAL_GRID, LocalMap, Pose2, SAFETY_GRID, STILL, SafetyMap};
use sidestep_sim::{draw, seen_from};

/// How the robot sees.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Sight {
    /// A rendered depth image or sweep, and the mapper: the whole chain.
    Camera,
    /// Both maps drawn from what stands there round the true pose, everything known and of age 0: a cell is taken
    /// where a solid touches it.
    Grid,
    /// As [`Self::Grid`], with errors as often as the mapper makes them: cells before surfaces are taken, cells of them
    /// free. No cell is unknown.
    Noisy,
}

impl Sight {
    /// A name for reports.
    #[must_use]
    pub fn label(self) -> &'static str {
        match self {
            Self::Camera => "camera",
            Self::Grid => "grid",
            Self::Noisy => "noisy",
        }
    }
}

/// What stands round the robot at the time of a frame.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Surroundings<'a> {
    /// What stands there, and the robot.
    pub(crate) outlook: Outlook<'a>,
    /// The errors, if there are any.
    pub(crate) noise: Option<Noise>,
    /// Pose in `odom`.
    pub(crate) believed: Pose2,
    pub(crate) pose_epoch: u32,
    pub(crate) capture_ns: u64,
    /// `[m]` half-width of the footprint.
    pub(crate) half_width_m: f32,
}

impl Surroundings<'_> {
    /// Fills both maps.
    pub(crate) fn write(&self, local: &mut LocalMap, safety: &mut SafetyMap) {
        (local.capture_ns, safety.capture_ns) = (self.capture_ns, self.capture_ns);
        (local.pose, safety.base) = (self.believed, self.believed);
        let Outlook { solids, pose, .. } = self.outlook;
        // The world from where the safety map's frame would truly be.
        let frame = pose.compose(&self.believed.relative(&safety.frame()));
        (local.pose_epoch, safety.pose_epoch) = (self.pose_epoch, self.pose_epoch);
        local.occupancy.fill(0);
        local.age.fill(0);
        safety.occupancy.fill(0);
        safety.age.fill(0);
        safety.still.fill(STILL);
        for solid in solids {
            draw(&seen_from(solid, &pose), &LOCAL_GRID, &mut local.occupancy);
            draw(&seen_from(solid, &frame), &SAFETY_GRID, &mut safety.occupancy);
        }
        if let Some(noise) = self.noise {
            let sheets = [Sheet::local(self.believed), Sheet::safety(safety.frame(), self.believed)];
            let maps: [&mut [u8]; 2] = [&mut local.occupancy, &mut safety.occupancy];
            for (sheet, occupancy) in sheets.iter().zip(maps) {
                noise.spoil(sheet, &self.outlook, self.capture_ns, occupancy);
            }
        }
        planning_cost(
            &local.occupancy,
            &local.age,
            Widening::by(self.half_width_m),
            &mut local.planning_cost,
        );
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::noise::{BANDS, NEAR_M, UNDER, body};
    use sidestep_msgs::{Pose2, Robot, SAFETY_SIDE};
    use sidestep_sim::Solid;

    const MINUTE_NS: u64 = 60_000_000_000;

    /// A wall, a box, a column and a pole.
    fn solids() -> [Solid; 4] {
        [
            Solid::wall([-4.0, 1.4], [4.0, 1.6], 0.1, 2.0),
            Solid::block([1.5, -0.9], [0.5, 0.3], 0.7, [0.0, 1.0]),
            Solid::column([0.9, 0.4], 0.2, [0.0, 1.0]),
            Solid::column([0.3, -0.7], 0.02, [0.0, 1.5]),
        ]
    }

    fn round(solids: &[Solid], pose: Pose2, noise: Option<Noise>) -> Surroundings<'_> {
        let loomo = include_str!("../../../launch/robots/loomo.toml");
        let body = body(&Robot::from_toml("loomo.toml", loomo).unwrap());
        // Somewhere else in `odom`, and turned.
        let believed = Pose2::new(7.0, -3.0, 0.4).compose(&pose);
        let outlook = Outlook { solids, pose, body };
        Surroundings { outlook, noise, believed, pose_epoch: 3, capture_ns: MINUTE_NS, half_width_m: 0.285 }
    }

    fn maps(surroundings: &Surroundings<'_>) -> (LocalMap, Box<SafetyMap>) {
        let mut maps = (LocalMap::default(), Box::default());
        surroundings.write(&mut maps.0, &mut maps.1);
        maps
    }

    fn pose(step: u32) -> Pose2 {
        let t = f64::from(step);
        Pose2::new(0.4 * libm::sin(t), 0.3 * libm::cos(2.3 * t), 0.7 * t)
    }

    #[test]
    fn without_errors_the_cells_that_a_solid_touches_are_taken_and_no_others() {
        let (solids, pose) = (solids(), pose(1));
        let (local, safety) = maps(&round(&solids, pose, None));
        let mut drawn = [0; sidestep_msgs::LOCAL_CELLS];
        solids.iter().for_each(|solid| draw(&seen_from(solid, &pose), &LOCAL_GRID, &mut drawn));
        assert_eq!(local.occupancy, drawn);
        let frame = pose.compose(&local.pose.relative(&safety.frame()));
        let mut drawn = [0; sidestep_msgs::SAFETY_CELLS];
        solids.iter().for_each(|solid| draw(&seen_from(solid, &frame), &SAFETY_GRID, &mut drawn));
        assert_eq!(safety.occupancy, drawn);
    }

    /// Every band of both maps, near and far, from many poses with as many seeds.
    #[test]
    fn cells_are_taken_as_often_as_measured() {
        let solids = solids();
        let mut counts = [[[[0_u32; 2]; BANDS]; 2]; 2];
        for step in 0..1500 {
            let surroundings = round(&solids, pose(step), Some(Noise(step.into())));
            let (local, safety) = maps(&surroundings);
            let sheets = [Sheet::local(local.pose), Sheet::safety(safety.frame(), local.pose)];
            let cells: [&[u8]; 2] = [&local.occupancy, &safety.occupancy];
            for ((sheet, cells), counts) in sheets.iter().zip(cells).zip(&mut counts) {
                let mut bands = vec![0; cells.len()];
                surroundings.outlook.bands(&sheet.base.relative(&sheet.frame), sheet.grid, &mut bands);
                for (index, (cell, band)) in cells.iter().zip(bands).enumerate() {
                    let (x, y) = sheet.grid.centre(index / sheet.grid.side, index % sheet.grid.side);
                    let (x_m, y_m) = sheet.frame.transform(x.into(), y.into());
                    let far = libm::hypot(x_m - local.pose.x_m, y_m - local.pose.y_m) >= NEAR_M;
                    let count = &mut counts[usize::from(far)][usize::from(band)];
                    *count = [count[0] + u32::from(*cell > 0), count[1] + 1];
                }
            }
        }
        for (map, sheet) in
            [Sheet::local(Pose2::ORIGIN), Sheet::safety(Pose2::ORIGIN, Pose2::ORIGIN)].iter().enumerate()
        {
            for (place, count) in counts[map].as_flattened().iter().enumerate() {
                let (share, chance) =
                    (f64::from(count[0]) / f64::from(count[1].max(1)), sheet.chances.as_flattened()[place]);
                assert!(count[1] > 1000 || place == BANDS + UNDER, "map {map}, {place}: {count:?}");
                assert!((share - f64::from(chance)).abs() < 0.03, "map {map}, {place}: {share} {chance}");
            }
        }
    }

    /// A pole at many places, with as many seeds: all its cells are free in a few of a thousand, those of a box never.
    #[test]
    fn nothing_wider_than_a_pole_is_hidden() {
        let mut hidden = [0, 0];
        for seed in 0..4000_u32 {
            let centre = [0.6 + 0.3 * libm::sin(f64::from(seed)), 0.3 * libm::cos(1.7 * f64::from(seed))];
            let pole = Solid::column(centre, 0.02, [0.0, 1.5]);
            let block = Solid::block(centre, [0.2, 0.2], f64::from(seed), [0.0, 1.0]);
            for (solid, hidden) in [pole, block].iter().zip(&mut hidden) {
                let solid = std::slice::from_ref(solid);
                let ideal = maps(&round(solid, Pose2::ORIGIN, None)).1;
                let noisy = maps(&round(solid, Pose2::ORIGIN, Some(Noise(seed.into())))).1;
                let mut cells = ideal.occupancy.iter().zip(&noisy.occupancy).filter(|(ideal, _)| **ideal > 0);
                *hidden += u32::from(cells.all(|(_, noisy)| *noisy == 0));
            }
        }
        println!("{hidden:?} of 4000");
        assert!((1..20).contains(&hidden[0]) && hidden[1] == 0, "{hidden:?} of 4000");
    }

    #[test]
    fn equal_seeds_err_equally_others_do_not_and_a_free_world_is_free() {
        let (solids, pose) = (solids(), pose(1));
        let [one, again, other] = [5, 5, 6].map(|seed| maps(&round(&solids, pose, Some(Noise(seed)))));
        assert!(one == again && one.0 != other.0 && one.1 != other.1);
        let (local, safety) = maps(&round(&[], pose, Some(Noise(5))));
        assert!(local.occupancy.iter().chain(&safety.occupancy).all(|cell| *cell == 0));
    }

    /// Half a metre on, the cells that are near both times or far both times show what they did; a minute later they
    /// do not.
    #[test]
    fn errors_stay_with_their_places_until_they_are_drawn_anew() {
        let (solids, noise) = (solids(), Some(Noise(5)));
        let mut surroundings = round(&solids, Pose2::ORIGIN, noise);
        let before = maps(&surroundings).1;
        surroundings.capture_ns += MINUTE_NS;
        let later = maps(&surroundings).1;
        assert_ne!(before.occupancy, later.occupancy);
        let pose = Pose2::ORIGIN.advance(&sidestep_msgs::Twist::new(0.5, 0.0), 1.0);
        let after = maps(&round(&solids, pose, noise)).1;
        let class = |map: &SafetyMap, x_m: f64, y_m: f64| {
            libm::hypot(x_m - map.base.x_m, y_m - map.base.y_m) >= NEAR_M
        };
        let mut errors = 0;
        let ideal = maps(&round(&solids, pose, None)).1;
        for index in 0..after.occupancy.len() {
            let (x, y) = SAFETY_GRID.centre(index / SAFETY_SIDE, index % SAFETY_SIDE);
            let (x_m, y_m) = after.frame().transform(x.into(), y.into());
            let (x, y) = before.frame().inverse_transform(x_m, y_m);
            let Some(then) = SAFETY_GRID.index(x as f32, y as f32) else { continue };
            let under =
                [&before, &after].iter().any(|map| libm::hypot(x_m - map.base.x_m, y_m - map.base.y_m) < 0.4);
            if class(&before, x_m, y_m) == class(&after, x_m, y_m) && !under {
                assert_eq!(before.occupancy[then], after.occupancy[index], "{x_m} {y_m}");
                errors += u32::from(ideal.occupancy[index] != after.occupancy[index]);
            }
        }
        assert!(errors > 20, "{errors}");
    }
}

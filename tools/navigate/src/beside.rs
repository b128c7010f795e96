//! The counterpart of the paper's Fig. 7: a reference path close to and across obstacles, driven by the policy beside
//! its demonstrator, and how far their paths lie apart.

use crate::error::NavigateError;
use crate::pilot::{Conditions, Ending, Pilot};
use crate::room::Course;
use crate::suite::label;
use serde::Serialize;
use sidestep_drive::{Lead, Sight};
use sidestep_msgs::{Pose2, Robot};
use sidestep_sim::{Solid, World, resample};

/// `[s]` time limit of a drive.
const LIMIT_S: f64 = 60.0;
/// `[m]` between the points of a path that are compared.
const SPACING_M: f64 = 0.05;
/// Who is compared: the policy, its demonstrator, and the solved plans.
pub const DRIVERS: [Lead; 3] = [Lead::Policy, Lead::Expert, Lead::Solved];
/// Noise of odometry and sensors.
const SEED: u64 = 7;

/// One world driven by each of [`DRIVERS`], without an arbiter, as in the paper.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Beside {
    /// Name of the world.
    pub name: String,
    /// How the robots saw.
    pub sight: &'static str,
    /// `[m]` the reference path.
    pub reference_m: Vec<[f64; 2]>,
    /// One for each of [`DRIVERS`].
    pub drives: Vec<BesideDrive>,
    /// Each pair of drives.
    pub distances: Vec<Apart>,
    /// The world, for a picture.
    #[serde(skip)]
    pub world: World,
}

/// One drive along the reference path.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct BesideDrive {
    /// Who drove.
    #[serde(serialize_with = "label")]
    pub lead: Lead,
    /// How it ended.
    pub ending: Ending,
    /// `[s]` time driven.
    pub time_s: f64,
    /// `[m]` smallest gap to anything.
    pub min_clearance_m: f64,
    /// `[m]` where it was, every 0.1 s.
    pub trace_m: Vec<[f64; 2]>,
}

/// How far two paths lie apart, both ways.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Apart {
    /// The one.
    #[serde(serialize_with = "label")]
    pub one: Lead,
    /// The other.
    #[serde(serialize_with = "label")]
    pub other: Lead,
    /// `[m]` mean distance of a point of either path to the other path.
    pub mean_m: f64,
    /// `[m]` largest distance (Hausdorff).
    pub max_m: f64,
}

/// Drives both worlds.
///
/// # Errors
/// [`NavigateError`] where the model or a node refuses.
pub fn beside(
    robot: &Robot,
    model: &[u8],
    model_name: &str,
    sight: Sight,
) -> Result<Vec<Beside>, NavigateError> {
    let mut pilot = Pilot::new(robot, model, model_name)?;
    let worlds = [("a line through obstacles", straight()), ("two bends past obstacles", bent())];
    worlds.into_iter().map(|(name, world)| side_by_side(&mut pilot, name, world, sight)).collect()
}

fn side_by_side(
    pilot: &mut Pilot<'_>,
    name: &str,
    world: World,
    sight: Sight,
) -> Result<Beside, NavigateError> {
    let course = Course::of(name, "reference path", SEED, world);
    let mut drives = Vec::new();
    for lead in DRIVERS {
        let driven = pilot.drive(&course, Conditions { lead, arbitrated: false, sight }, LIMIT_S)?;
        drives.push(BesideDrive {
            lead,
            ending: driven.ending,
            time_s: driven.time_s,
            min_clearance_m: driven.min_clearance_m,
            trace_m: driven.trace_m,
        });
    }
    let pairs = [(0, 1), (0, 2), (1, 2)];
    let distances = pairs.map(|(one, other)| apart(&drives[one], &drives[other])).to_vec();
    Ok(Beside {
        name: name.into(),
        sight: sight.label(),
        reference_m: course.world.legs_m[0].clone(),
        drives,
        distances,
        world: course.world,
    })
}

fn apart(one: &BesideDrive, other: &BesideDrive) -> Apart {
    let (a, b) = (resample(&one.trace_m, SPACING_M), resample(&other.trace_m, SPACING_M));
    let distances: Vec<f64> = a
        .iter()
        .map(|point| nearest_m(*point, &b))
        .chain(b.iter().map(|point| nearest_m(*point, &a)))
        .collect();
    let mean_m = distances.iter().sum::<f64>() / distances.len().max(1) as f64;
    let max_m = distances.iter().copied().fold(0.0, f64::max);
    Apart { one: one.lead, other: other.lead, mean_m, max_m }
}

/// `[m]` distance of a point to the nearest of dense points.
pub(crate) fn nearest_m(point: [f64; 2], points: &[[f64; 2]]) -> f64 {
    let distances = points.iter().map(|other| libm::hypot(other[0] - point[0], other[1] - point[1]));
    distances.fold(f64::INFINITY, f64::min)
}

/// A room of 9 x 5 m with what stands in it, and a path from its first point on.
fn hall(path_m: &[[f64; 2]], solids: &[Solid]) -> World {
    let mut world = World::empty();
    let corners = [[0.0, 0.0], [9.0, 0.0], [9.0, 5.0], [0.0, 5.0]];
    for index in 0..4 {
        world.solids.push(Solid::wall(corners[index], corners[(index + 1) % 4], 0.1, 2.4));
    }
    world.solids.extend(solids);
    let [from, to] = [path_m[0], path_m[1]];
    world.start = Pose2::new(from[0], from[1], libm::atan2(to[1] - from[1], to[0] - from[0]));
    world.legs_m = vec![path_m.to_vec()];
    world
}

/// A straight path: close to a box, across a column, across the corner of a box.
fn straight() -> World {
    let height = [0.0, 1.0];
    hall(
        &[[1.4, 2.4], [8.0, 2.4]],
        &[
            Solid::block([3.2, 2.85], [0.5, 0.5], 0.2, height),
            Solid::column([5.0, 2.3], 0.2, height),
            Solid::block([6.7, 2.8], [0.5, 0.7], 0.6, height),
        ],
    )
}

/// A path with two bends: a column inside the first, a box on the middle leg, a box beside the last.
fn bent() -> World {
    let height = [0.0, 1.0];
    hall(
        &[[1.4, 1.4], [3.4, 1.4], [5.4, 3.6], [8.0, 3.6]],
        &[
            Solid::column([2.9, 1.7], 0.15, height),
            Solid::block([4.5, 2.5], [0.4, 0.4], 0.9, height),
            Solid::block([6.6, 3.35], [0.6, 0.3], 0.0, height),
        ],
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::reference::is_blocked;

    #[test]
    fn both_reference_paths_lead_across_obstacles() {
        for world in [straight(), bent()] {
            assert!(is_blocked(&world, &world.legs_m[0], 0.285));
        }
    }

    /// Two parallel lines 0.3 m apart, one 1 m longer at its end.
    #[test]
    fn distances_between_paths_are_those_of_plane_geometry() {
        let drive = |lead, y: f64, end: f64| BesideDrive {
            lead,
            ending: Ending::Reached,
            time_s: 0.0,
            min_clearance_m: 0.0,
            trace_m: vec![[0.0, y], [end, y]],
        };
        let found = apart(&drive(Lead::Policy, 0.0, 2.0), &drive(Lead::Expert, 0.3, 3.0));
        assert!((found.max_m - libm::hypot(0.3, 1.0)).abs() < 1e-9, "{found:?}");
        assert!(found.mean_m > 0.3 && found.mean_m < 0.45, "{found:?}");
    }
}

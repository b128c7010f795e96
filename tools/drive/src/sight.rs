//! How the robot sees: through its camera and the mapper, or the world itself drawn into both maps.

use sidestep_mapper::{Widening, planning_cost};
use sidestep_msgs::{LOCAL_GRID, LocalMap, Pose2, SAFETY_GRID, STILL, SafetyMap};
use sidestep_sim::{Solid, draw, seen_from};

/// How the robot sees.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Sight {
    /// A rendered depth image or sweep, and the mapper: the whole chain.
    Camera,
    /// Both maps drawn from what stands there round the true pose, everything known and of age 0: a cell is taken
    /// where a solid touches it.
    Grid,
}

impl Sight {
    /// A name for reports.
    #[must_use]
    pub fn label(self) -> &'static str {
        match self {
            Self::Camera => "camera",
            Self::Grid => "grid",
        }
    }
}

/// What stands round the robot at the time of a frame.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Surroundings<'a> {
    /// Whatever stands in the robot's way.
    pub(crate) solids: &'a [Solid],
    /// True pose in the world.
    pub(crate) pose: Pose2,
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
        // The world from where the safety map's frame would truly be.
        let frame = self.pose.compose(&self.believed.relative(&safety.frame()));
        (local.pose_epoch, safety.pose_epoch) = (self.pose_epoch, self.pose_epoch);
        local.occupancy.fill(0);
        local.age.fill(0);
        safety.occupancy.fill(0);
        safety.age.fill(0);
        safety.still.fill(STILL);
        for solid in self.solids {
            draw(&seen_from(solid, &self.pose), &LOCAL_GRID, &mut local.occupancy);
            draw(&seen_from(solid, &frame), &SAFETY_GRID, &mut safety.occupancy);
        }
        planning_cost(
            &local.occupancy,
            &local.age,
            Widening::by(self.half_width_m),
            &mut local.planning_cost,
        );
    }
}

//! The robot's own map as pictures have it: its cells, its outline, a velocity as an arrow.

use crate::map::{Cells, Overlay, Shade};
use crate::style::Ink;
use sidestep_msgs::{LOCAL_GRID, LOCAL_SIDE, Pose2, Twist};

/// `[s]` a velocity drawn as an arrow is held this long.
const ARROW_S: f64 = 1.0;
/// `[1]` eq. (6c): planning cost above this is not safe.
const LIMIT: f32 = 0.4;

impl Cells {
    /// The cells of a local map, drawn dark above the limit of eq. (6c).
    #[must_use]
    pub fn local(shades: Vec<Shade>) -> Self {
        Self {
            side: LOCAL_SIDE,
            cell_m: LOCAL_GRID.cell_m.into(),
            rear_m: LOCAL_GRID.rear_m.into(),
            right_m: LOCAL_GRID.right_m.into(),
            limit: LIMIT,
            shades,
        }
    }
}

impl Overlay {
    /// The outline of a robot, of the corners in its file.
    #[must_use]
    pub fn outline(polygon_m: &[[f32; 2]]) -> Self {
        Self::Footprint(polygon_m.iter().map(|corner| (corner[0].into(), corner[1].into())).collect())
    }

    /// A velocity (v `[m/s]`, w `[rad/s]`) as the way of a second, of a width in pixels.
    #[must_use]
    pub fn velocity([v_m_s, w_rad_s]: [f32; 2], ink: Ink, width_px: f64) -> Self {
        const STEPS: u32 = 20;
        let twist = Twist::new(v_m_s, w_rad_s);
        let pose = |step| Pose2::ORIGIN.advance(&twist, ARROW_S * f64::from(step) / f64::from(STEPS));
        Self::Arrow((0..=STEPS).map(|step| (pose(step).x_m, pose(step).y_m)).collect(), ink, width_px)
    }
}

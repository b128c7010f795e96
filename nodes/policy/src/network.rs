//! The network as plain numbers: what the trainer makes, the exporter writes and the loader finds again.
//!
//! ```text
//! m_r      = lambda * goal - planning_cost                          paper eq. (3)
//! rq       = conv3x3(m_r), once                                     "vi/reward"
//! V        <- max over channels of (rq + conv3x3(V)), K times       "vi/value", paper eq. (5), zero padding
//! planes   = [V - V(robot), m_r] on a crop round the robot
//! planes   <- ReLU(conv3x3(planes)), per convolution; zero padding
//! features = [planes, one after the other | u' | goal features]
//! head     = dense layers with ReLU, 4 outputs
//! command  = u' + head[0..2]; doubt = exp(clip(head[2..4]))
//! ```

use sidestep_msgs::{LOCAL_CELLS, LOCAL_GRID, LOCAL_SIDE};

/// First row of the crop: x from -0.2 m to 1.4 m.
pub const CROP_ROW: usize = 10;
/// Rows of the crop.
pub const CROP_ROWS: usize = 16;
/// First column of the crop: y within 1 m of the robot.
pub const CROP_COL: usize = 4;
/// Columns of the crop.
pub const CROP_COLS: usize = 20;
/// Cells of the crop.
pub const CROP_CELLS: usize = CROP_ROWS * CROP_COLS;
/// First of the two rows, and of the two columns, that meet at the robot.
pub const ROBOT_ROW: usize = 23;
/// First of the two columns that meet at the robot.
pub const ROBOT_COL: usize = 13;
/// Numbers that describe where the goal is.
pub const GOAL_FEATURES: usize = 5;
/// Planes that the head begins with: V and m_r on the crop.
pub const CROP_PLANES: usize = 2;
/// Features that come from no plane: u', goal.
pub const DIRECT_FEATURES: usize = 2 + GOAL_FEATURES;
/// Outputs of the last dense layer: change of (v, w), logarithm of the doubt of (v, w).
pub const HEAD_OUTPUTS: usize = 4;
/// Range of the logarithm of the doubt.
pub const LOG_DOUBT_RANGE: (f32, f32) = (-7.0, 1.5);

/// A 3x3 convolution with a border of zeros, and ReLU behind it.
#[derive(Debug, Clone, PartialEq)]
pub struct ConvolutionLayer {
    /// Planes it reads.
    pub inputs: usize,
    /// Planes it makes.
    pub outputs: usize,
    /// Cells from one output to the next, in both directions; the first lies on the first cell.
    pub stride: usize,
    /// `[1]` outputs x inputs x 3 x 3, row by row.
    pub weight: Vec<f32>,
    /// `[1]` one per output.
    pub bias: Vec<f32>,
}

/// A dense layer: out = in * weight + bias.
#[derive(Debug, Clone, PartialEq)]
pub struct DenseLayer {
    /// Number of inputs.
    pub inputs: usize,
    /// Number of outputs.
    pub outputs: usize,
    /// `[1]` inputs x outputs, row by row.
    pub weight: Vec<f32>,
    /// `[1]` one per output.
    pub bias: Vec<f32>,
}

/// All parameters of a policy, in SI units at its inputs and outputs.
#[derive(Debug, Clone, PartialEq)]
pub struct Network {
    /// `[1]` weight of the goal in m_r.
    pub lambda: f32,
    /// Value iterations K.
    pub rounds: usize,
    /// `[1]` 3x3 reward kernel per channel, row by row.
    pub reward: Vec<[f32; 9]>,
    /// `[1]` bias per channel.
    pub reward_bias: Vec<f32>,
    /// `[1]` 3x3 value kernel per channel, shared by all rounds.
    pub value: Vec<[f32; 9]>,
    /// Convolutions from [`CROP_PLANES`] on; with none, the dense layers see the crop itself.
    pub convolutions: Vec<ConvolutionLayer>,
    /// Dense layers from [`Network::features`] to [`HEAD_OUTPUTS`].
    pub dense: Vec<DenseLayer>,
}

impl Network {
    /// Inputs of the first dense layer: the planes, one after the other, row by row, then u' and goal.
    #[must_use]
    pub fn features(&self) -> usize {
        let planes = self.convolutions.last().map_or(CROP_PLANES, |layer| layer.outputs);
        let size = self.convolutions.iter().fold([CROP_ROWS, CROP_COLS], |size, l| convolved(size, l.stride));
        planes * size[0] * size[1] + DIRECT_FEATURES
    }
}

/// Rows and columns that a 3x3 convolution of this stride makes of a plane with a border of zeros.
#[must_use]
pub fn convolved(size: [usize; 2], stride: usize) -> [usize; 2] {
    size.map(|cells| cells.div_ceil(stride))
}

/// What the network is told of a goal in `cell`: x `[m]`, y `[m]`, distance `[m]`, cosine and sine of its bearing.
#[must_use]
pub fn goal_features(cell: usize) -> [f32; GOAL_FEATURES] {
    let (x_m, y_m) = LOCAL_GRID.centre(cell / LOCAL_SIDE % LOCAL_SIDE, cell % LOCAL_SIDE);
    let distance_m = libm::hypotf(x_m, y_m);
    [x_m, y_m, distance_m, x_m / distance_m, y_m / distance_m]
}

/// [`goal_features`] of every cell, row by row: the constant table that the graph multiplies the one-hot goal with.
#[must_use]
pub fn goal_feature_table() -> Vec<f32> {
    (0..LOCAL_CELLS).flat_map(goal_features).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_crop_is_mirror_symmetric_and_holds_the_robot() {
        assert_eq!(CROP_COL, LOCAL_SIDE - CROP_COL - CROP_COLS);
        assert!((CROP_ROW..CROP_ROW + CROP_ROWS - 1).contains(&ROBOT_ROW));
        assert_eq!(LOCAL_GRID.row_col(0.05, 0.05), Some((ROBOT_ROW, ROBOT_COL)));
    }

    #[test]
    fn goal_features_are_finite_and_mirror_with_the_map() {
        for cell in 0..LOCAL_CELLS {
            let here = goal_features(cell);
            let there = goal_features(cell / LOCAL_SIDE * LOCAL_SIDE + LOCAL_SIDE - 1 - cell % LOCAL_SIDE);
            assert!(here.iter().all(|x| x.is_finite()));
            for (a, b) in here.iter().zip([there[0], -there[1], there[2], there[3], -there[4]]) {
                assert!((a - b).abs() < 1e-5, "cell {cell}: {here:?} {there:?}");
            }
        }
    }
}

//! One instance of eq. (6): the planning cost ready for interpolation, the goal and the state to start from.
//!
//! Every problem is solved with the goal on the left; one with the goal on the right is mirrored first and the answer
//! mirrored back. So the expert is exactly symmetric, whatever rounding does. (A cell centre never lies on the axis.)

use crate::config::Weights;
use sidestep_msgs::{LOCAL_CELLS, LOCAL_GRID, LOCAL_SIDE, Limits, Twist};

/// N of eq. (6).
pub const HORIZON_STEPS: usize = 24;
/// `[s]` length of a step.
pub const STEP_S: f32 = 0.1;
/// `[1/255]` planning cost outside the map: unknown, 0.3, as the mapper writes it for cells never seen.
pub const UNKNOWN_COST: u8 = 77;

/// Side of the map with one ring of unknown round it.
const RINGED_SIDE: usize = LOCAL_SIDE + 2;
/// Places between four cell centres lie in rows of this many, so that an index is bits put together.
const CORNER_STRIDE: usize = 32;
/// Room for the places; a power of two, so that a masked index needs no check.
const CORNER_ROOM: usize = 1024;

/// The four cells round each place, one byte each: one load per look-up instead of four.
///
/// Low byte first: behind right, behind left, ahead right, ahead left.
#[repr(align(64))]
#[derive(Debug, Clone)]
pub(crate) struct Corners(pub(crate) [u32; CORNER_ROOM]);

/// Index of a place in [`Corners`] from its cells counted from the rear right corner of the ring.
#[inline(always)]
pub(crate) fn corner_index(forward: u32, left: u32) -> usize {
    ((forward * CORNER_STRIDE as u32 + left) as usize) & (CORNER_ROOM - 1)
}

/// What all rollouts of one plan share.
#[derive(Debug, Clone)]
pub(crate) struct Problem {
    pub(crate) corners: Corners,
    /// `[m]` centre of the goal's cell.
    pub(crate) goal_x_m: f32,
    pub(crate) goal_y_m: f32,
    /// u'.
    pub(crate) from: Twist,
    /// `[m/s]` and [rad/s] largest change per step.
    pub(crate) step: Twist,
    pub(crate) weights: Weights,
    /// Whether left and right are exchanged.
    pub(crate) mirrored: bool,
}

impl Problem {
    pub(crate) fn new(limits: &Limits, weights: Weights) -> Self {
        let step = Twist::new(limits.accelerate_m_s2 * STEP_S, limits.turn_accelerate_rad_s2 * STEP_S);
        Self {
            corners: Corners([0; CORNER_ROOM]),
            goal_x_m: 0.0,
            goal_y_m: 0.0,
            from: Twist::STOP,
            step,
            weights,
            mirrored: false,
        }
    }

    /// Takes a map (bytes of planning cost), a goal cell and a velocity; a cell outside the map is the robot's own.
    pub(crate) fn pose(&mut self, cost: &[u8; LOCAL_CELLS], goal_cell: usize, from: Twist) {
        let own = 23 * LOCAL_SIDE + 13;
        let cell = if goal_cell < LOCAL_CELLS { goal_cell } else { own };
        let (row, col) = (cell / LOCAL_SIDE, cell % LOCAL_SIDE);
        self.mirrored = col >= LOCAL_SIDE / 2;
        let left_col = if self.mirrored { LOCAL_SIDE - 1 - col } else { col };
        // Row 23.5 and column 13.5 are the robot's corner of four cells.
        self.goal_x_m = (23.5 - row as f32) * LOCAL_GRID.cell_m;
        self.goal_y_m = (13.5 - left_col as f32) * LOCAL_GRID.cell_m;
        self.from = self.turned(sane(from));
        self.fill_corners(cost);
    }

    /// To the side that the problem is solved on, or back.
    pub(crate) fn turned(&self, twist: Twist) -> Twist {
        if self.mirrored { twist.mirrored() } else { twist }
    }

    fn fill_corners(&mut self, cost: &[u8; LOCAL_CELLS]) {
        let mut ringed = [[UNKNOWN_COST; RINGED_SIDE]; RINGED_SIDE];
        for (row, cells) in cost.chunks_exact(LOCAL_SIDE).enumerate() {
            // From the rear and, in a row, from the right.
            let to = &mut ringed[LOCAL_SIDE - row][1..=LOCAL_SIDE];
            to.copy_from_slice(cells);
            if !self.mirrored {
                to.reverse();
            }
        }
        for forward in 0..RINGED_SIDE - 1 {
            let (behind, ahead) = (&ringed[forward], &ringed[forward + 1]);
            let start = forward * CORNER_STRIDE;
            let places = &mut self.corners.0[start..start + RINGED_SIDE - 1];
            for (left, place) in places.iter_mut().enumerate() {
                *place = u32::from_le_bytes([behind[left], behind[left + 1], ahead[left], ahead[left + 1]]);
            }
        }
    }
}

/// A velocity that arithmetic cannot fall over: not-finite becomes standing still, far-off is clipped.
fn sane(twist: Twist) -> Twist {
    let number = |value: f32| if value.is_finite() { value.clamp(-10.0, 10.0) } else { 0.0 };
    Twist::new(number(twist.v_m_s), number(twist.w_rad_s))
}

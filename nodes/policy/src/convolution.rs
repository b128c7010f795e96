//! The 3x3 convolution of a row of cells, for the network that drives and the one that learns.

use crate::lanes::multiply_add;

/// Cells computed per row: the side of the local map rounded up to whole vectors.
pub const ROW_CELLS: usize = 32;

/// One row of `N` 3x3 convolutions added to `sums`, over a plane with a border of zeros and `STRIDE` floats between rows;
/// the loads of the plane are shared by the channels.
#[inline(always)]
#[must_use]
pub fn convolve<const FUSED: bool, const N: usize, const STRIDE: usize>(
    kernels: &[[f32; 9]],
    mut sums: [[f32; ROW_CELLS]; N],
    plane: &[f32],
    row: usize,
) -> [[f32; ROW_CELLS]; N] {
    for tap in 0..9 {
        let cells = &plane[(row + tap / 3) * STRIDE + tap % 3..][..ROW_CELLS];
        for n in 0..N {
            for lane in 0..ROW_CELLS {
                sums[n][lane] = multiply_add::<FUSED>(kernels[n][tap], cells[lane], sums[n][lane]);
            }
        }
    }
    sums
}

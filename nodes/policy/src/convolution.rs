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
    for line in 0..3 {
        for column in 0..3 {
            let cells = &plane[(row + line) * STRIDE + column..][..ROW_CELLS];
            for n in 0..N {
                let weight = kernels[n][line * 3 + column];
                for lane in 0..ROW_CELLS {
                    sums[n][lane] = multiply_add::<FUSED>(weight, cells[lane], sums[n][lane]);
                }
            }
        }
    }
    sums
}

//! Pixels counted by sector and range, and the nearest range of a sector that enough of them agree on.
//!
//! One wrong pixel is no obstacle: stereo has outliers, and at edges pixels fly between what is near and what is far.

use sidestep_msgs::NEAR_SECTORS;

/// Ranges told apart.
const BINS: usize = 500;
/// `[m]` width of one of them.
const BIN_M: f32 = 0.02;
/// `[m]` what is farther is not counted.
pub(crate) const RANGE_MAX_M: f32 = BINS as f32 * BIN_M;

/// How many pixels it takes to believe a range.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Support {
    /// `[px]` at 1 m; falls with the square of the range.
    pub(crate) pixels_at_1_m: f32,
    /// `[px]` least at any range.
    pub(crate) pixels_min: f32,
    /// `[m]` depth within which they must lie.
    pub(crate) depth_m: f32,
    /// `[m]` standard deviation of depth at 1 m; grows with the square of the range.
    pub(crate) sigma_at_1_m: f32,
}

impl Support {
    /// Pixels, and the bins within which they must lie, for a range that ends in this bin.
    fn at(&self, bin: usize) -> (f32, usize) {
        let range_m = (bin + 1) as f32 * BIN_M;
        let square = range_m * range_m;
        let depth_m = self.depth_m.max(2.0 * self.sigma_at_1_m * square);
        ((self.pixels_at_1_m / square).max(self.pixels_min), (depth_m / BIN_M + 0.5) as usize)
    }
}

/// The counts of one frame.
#[derive(Debug, PartialEq)]
pub(crate) struct Tally {
    /// Pixels in the way.
    counts: Box<[[u16; BINS]; NEAR_SECTORS]>,
    /// Pixels with a measurement, whatever it is of.
    measured: [u32; NEAR_SECTORS],
    /// Support by bin.
    needed: Box<[(f32, usize); BINS]>,
}

impl Tally {
    pub(crate) fn new() -> Self {
        Self {
            counts: Box::new([[0; BINS]; NEAR_SECTORS]),
            measured: [0; NEAR_SECTORS],
            needed: Box::new([(0.0, 0); BINS]),
        }
    }

    /// Forgets the frame before and notes what this one needs.
    pub(crate) fn begin(&mut self, support: &Support) {
        self.counts.as_flattened_mut().fill(0);
        self.measured.fill(0);
        self.needed.iter_mut().enumerate().for_each(|(bin, needed)| *needed = support.at(bin));
    }

    /// Counts a measured pixel.
    #[inline]
    pub(crate) fn see(&mut self, sector: usize) {
        self.measured[sector] += 1;
    }

    /// Counts a pixel that is in the way at a range.
    #[inline]
    pub(crate) fn block(&mut self, sector: usize, range_m: f32) {
        // What is negative is a huge bin, and none of these.
        let bin = (range_m * (1.0 / BIN_M)) as i32 as usize;
        if let Some(count) = self.counts[sector].get_mut(bin) {
            *count = count.saturating_add(1);
        }
    }

    /// `[m]` where the nearest pixels of a sector that support each other lie: the near edge of the bin that completes
    /// their number, infinite where there are none, NaN where fewer than `measured_min` pixels were measured.
    pub(crate) fn nearest_m(&self, sector: usize, measured_min: f32) -> f32 {
        let counts = &self.counts[sector];
        let (mut sum, mut begin) = (0_u32, 0);
        for (bin, (&count, &(pixels, depth))) in counts.iter().zip(self.needed.iter()).enumerate() {
            sum += u32::from(count);
            while begin + depth.max(1) <= bin {
                sum -= u32::from(counts[begin]);
                begin += 1;
            }
            if count != 0 && sum as f32 >= pixels {
                return bin as f32 * BIN_M;
            }
        }
        if self.measured[sector] as f32 >= measured_min { f32::INFINITY } else { f32::NAN }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SUPPORT: Support =
        Support { pixels_at_1_m: 20.0, pixels_min: 4.0, depth_m: 0.06, sigma_at_1_m: 0.0047 };

    fn tally() -> Tally {
        let mut tally = Tally::new();
        tally.begin(&SUPPORT);
        tally
    }

    /// Outliers before a wall, fewer than the support; then as many as it takes.
    #[test]
    fn a_range_needs_the_support_of_its_neighbours() {
        let mut tally = tally();
        (0..200).for_each(|_| tally.block(5, 2.03));
        (0..3).for_each(|_| tally.block(5, 1.51));
        (0..4).for_each(|_| tally.block(5, 1.71));
        assert!((tally.nearest_m(5, 1.0) - 2.02).abs() < 1e-4, "4 px of 7 at 1.7 m");
        (0..4).for_each(|_| tally.block(5, 1.75));
        assert!((tally.nearest_m(5, 1.0) - 1.74).abs() < 1e-4);
        tally.begin(&SUPPORT);
        assert!(tally.nearest_m(5, 1.0).is_nan(), "a new frame begins with nothing");
    }

    #[test]
    fn a_sector_without_obstacle_is_clear_only_where_it_was_measured() {
        let mut tally = tally();
        (0..9).for_each(|_| tally.see(0));
        assert!(tally.nearest_m(0, 9.0).is_infinite() && tally.nearest_m(0, 9.5).is_nan());
        for range_m in [f32::NAN, -1.0, f32::INFINITY, 1e9] {
            tally.block(1, range_m);
        }
        assert!(tally.nearest_m(1, 1.0).is_nan());
    }
}

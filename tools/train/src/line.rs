//! Sixteen numbers on a cache line of their own: a register of AVX-512.

use bytemuck::{Pod, Zeroable};
use sidestep_policy::multiply_add;

/// Numbers of a line.
pub(crate) const LANES: usize = 16;

/// One line. A load or store that straddles two takes twice as long.
#[repr(C, align(64))]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
pub(crate) struct Line(pub(crate) [f32; LANES]);

impl Line {
    /// Zeros.
    pub(crate) const ZERO: Self = Self([0.0; LANES]);

    /// The first sixteen of some numbers.
    #[inline(always)]
    pub(crate) fn load(numbers: &[f32]) -> Self {
        let mut line = Self::ZERO;
        line.0.copy_from_slice(&numbers[..LANES]);
        line
    }

    /// Lane by lane.
    #[inline(always)]
    pub(crate) fn plus(self, other: Self) -> Self {
        let mut sum = self;
        for lane in 0..LANES {
            sum.0[lane] += other.0[lane];
        }
        sum
    }

    /// self + a * b, lane by lane.
    #[inline(always)]
    pub(crate) fn plus_product<const FUSED: bool>(self, a: Self, b: Self) -> Self {
        Self(std::array::from_fn(|lane| multiply_add::<FUSED>(a.0[lane], b.0[lane], self.0[lane])))
    }

    /// The sum of all, in pairs.
    #[inline(always)]
    pub(crate) fn total(self) -> f32 {
        let Self(mut lanes) = self;
        let mut count = LANES;
        while count > 1 {
            count /= 2;
            for lane in 0..count {
                lanes[lane] += lanes[lane + count];
            }
        }
        lanes[0]
    }
}

/// `count` numbers on whole lines, and one line of zeros to read beyond the last.
pub(crate) fn lines(count: usize) -> Vec<Line> {
    vec![Line::ZERO; count.div_ceil(LANES) + 1]
}

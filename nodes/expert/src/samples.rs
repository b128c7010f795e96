//! Artificial problems for tests and benches: clusters of obstacles, blurred, with a goal on or around the map
//! (paper section III-E), from a seed.

use sidestep_msgs::{LOCAL_CELLS, LOCAL_SIDE, Limits, Twist};

/// Limits of Loomo.
pub(crate) const LOOMO: Limits = Limits {
    forward_m_s: 1.0,
    reverse_m_s: 0.2,
    turn_rad_s: 1.5,
    accelerate_m_s2: 1.0,
    brake_m_s2: 0.5,
    turn_accelerate_rad_s2: 3.0,
    comfort_jerk_m_s3: 10.0,
};

/// SplitMix64.
pub(crate) struct Random(pub(crate) u64);

impl Random {
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    pub(crate) fn uniform(&mut self, least: f32, most: f32) -> f32 {
        least + (most - least) * (self.next() >> 40) as f32 / (1_u32 << 24) as f32
    }
}

/// One problem.
#[derive(Clone)]
pub(crate) struct Sample {
    pub(crate) cost: [u8; LOCAL_CELLS],
    pub(crate) goal: usize,
    pub(crate) from: Twist,
}

impl Sample {
    /// Up to six discs and boxes on an empty map, the robot's surroundings clear, goal and velocity at random.
    pub(crate) fn artificial(seed: u64) -> Self {
        let mut random = Random(seed);
        let mut plain = [0.0_f32; LOCAL_CELLS];
        for _ in 0..random.uniform(0.0, 7.0) as usize {
            let (row, col) = (random.uniform(-2.0, 30.0), random.uniform(-2.0, 30.0));
            let (long, wide) = (random.uniform(0.7, 5.0), random.uniform(0.7, 5.0));
            let round = random.uniform(0.0, 1.0) < 0.5;
            for (index, cell) in plain.iter_mut().enumerate() {
                let (dr, dc) = ((index / LOCAL_SIDE) as f32 - row, (index % LOCAL_SIDE) as f32 - col);
                let inside =
                    if round { dr * dr + dc * dc < long * long } else { dr.abs() < long && dc.abs() < wide };
                let own = ((index / LOCAL_SIDE) as f32 - 23.5).abs() < 4.0
                    && ((index % LOCAL_SIDE) as f32 - 13.5).abs() < 4.0;
                if inside && !own {
                    *cell = 1.0;
                }
            }
        }
        let blurred = blur(&blur(&plain));
        Self {
            cost: blurred.map(|value| (value * 255.0) as u8),
            goal: random.uniform(0.0, LOCAL_CELLS as f32) as usize % LOCAL_CELLS,
            from: Twist::new(random.uniform(0.0, 1.0), random.uniform(-1.5, 1.5)),
        }
    }

    /// Left and right exchanged.
    pub(crate) fn mirrored(&self) -> Self {
        let mirror = |index: usize| index / LOCAL_SIDE * LOCAL_SIDE + LOCAL_SIDE - 1 - index % LOCAL_SIDE;
        Self {
            cost: std::array::from_fn(|index| self.cost[mirror(index)]),
            goal: mirror(self.goal),
            from: self.from.mirrored(),
        }
    }
}

/// Mean over three by three cells.
fn blur(plain: &[f32; LOCAL_CELLS]) -> [f32; LOCAL_CELLS] {
    std::array::from_fn(|index| {
        let (row, col) = (index / LOCAL_SIDE, index % LOCAL_SIDE);
        let mut sum = 0.0;
        for (dr, dc) in (0..9).map(|k| (k / 3, k % 3)) {
            let (r, c) = ((row + dr).clamp(1, LOCAL_SIDE) - 1, (col + dc).clamp(1, LOCAL_SIDE) - 1);
            sum += plain[r * LOCAL_SIDE + c];
        }
        sum / 9.0
    })
}

//! Value iteration forward, keeping every V and which channel won, and backward along the winners.
//!
//! Vectors run over the cells of a row; each cell of a sum has its own lane until the end, so the bits do not depend
//! on the instruction set. Backward visits, per row, only the channels that won somewhere in it.

use sidestep_msgs::LOCAL_SIDE;
use sidestep_policy::{Lanes, ROW_CELLS as WIDTH, convolve, multiply_add, on_lanes};

/// Floats between rows of a padded plane: one zero left, five right.
const STRIDE: usize = 34;
/// Floats of a padded plane.
pub(crate) const PLANE: usize = (LOCAL_SIDE + 2) * STRIDE;
/// Winners of a round.
const WINNERS: usize = LOCAL_SIDE * WIDTH;

/// Index of a cell in a padded plane.
#[inline]
pub(crate) fn place(row: usize, col: usize) -> usize {
    (row + 1) * STRIDE + col + 1
}

/// The kernels, unpacked from the parameter vector.
#[derive(Debug, Clone)]
pub(crate) struct Kernels {
    pub(crate) reward: Vec<[f32; 9]>,
    pub(crate) bias: Vec<f32>,
    pub(crate) value: Vec<[f32; 9]>,
    pub(crate) rounds: usize,
}

/// What one sample keeps between forward and backward.
#[derive(Debug, Clone)]
pub(crate) struct Trace {
    /// m_r, padded.
    pub(crate) reward_map: Vec<f32>,
    /// V_0 to V_K, padded.
    planes: Vec<f32>,
    /// Winning channel per round and cell.
    winners: Vec<u8>,
}

/// Memory shared by all samples of a thread.
#[derive(Debug, Clone)]
pub(crate) struct PlaneScratch {
    reward: Vec<f32>,
    /// Gradient of rq.
    reward_gradient: Vec<f32>,
    /// Gradient of the value kernels, one sum per lane.
    sums: Vec<[f32; WIDTH]>,
    /// Per tap: gradient sent to that neighbour.
    sent: Vec<f32>,
    gradient: [Vec<f32>; 2],
}

impl Trace {
    pub(crate) fn new(rounds: usize) -> Self {
        Self {
            reward_map: vec![0.0; PLANE],
            planes: vec![0.0; (rounds + 1) * PLANE],
            winners: vec![0; rounds * WINNERS],
        }
    }

    /// V_K, padded.
    pub(crate) fn value(&self) -> &[f32] {
        &self.planes[self.planes.len() - PLANE..]
    }
}

impl PlaneScratch {
    pub(crate) fn new(channels: usize) -> Self {
        Self {
            reward: vec![0.0; channels * WINNERS],
            reward_gradient: vec![0.0; channels * WINNERS],
            sums: vec![[0.0; WIDTH]; channels * 9],
            sent: vec![0.0; 9 * PLANE],
            gradient: [vec![0.0; PLANE], vec![0.0; PLANE]],
        }
    }

    /// Where the gradient of V_K is put before [`backward`]: padded, zero where there is none.
    pub(crate) fn gradient(&mut self) -> &mut [f32] {
        &mut self.gradient[0]
    }
}

on_lanes! {
    /// Fills the trace of the `reward_map` that it holds.
    pub(crate) fn forward(kernels: &Kernels, trace: &mut Trace, scratch: &mut PlaneScratch) = forward_body
}

on_lanes! {
    /// Adds the gradient of reward kernels, their bias and value kernels to `out`, in this order.
    pub(crate) fn backward(
        kernels: &Kernels,
        trace: &Trace,
        scratch: &mut PlaneScratch,
        out: &mut [f32],
    ) = backward_body
}

#[inline(always)]
fn forward_body<const FUSED: bool>(kernels: &Kernels, trace: &mut Trace, scratch: &mut PlaneScratch) {
    for (channel, (kernel, bias)) in kernels.reward.iter().zip(&kernels.bias).enumerate() {
        for row in 0..LOCAL_SIDE {
            let sums = convolve::<FUSED, 1, STRIDE>(&[*kernel], [[*bias; WIDTH]], &trace.reward_map, row);
            scratch.reward[(channel * LOCAL_SIDE + row) * WIDTH..][..WIDTH].copy_from_slice(&sums[0]);
        }
    }
    let planes = trace.planes.chunks_exact_mut(PLANE);
    let mut from: Option<&[f32]> = None;
    for (plane, winners) in
        planes.zip(std::iter::once(None).chain(trace.winners.chunks_exact_mut(WINNERS).map(Some)))
    {
        if let (Some(from), Some(winners)) = (from, winners) {
            for row in 0..LOCAL_SIDE {
                forward_row::<FUSED>(
                    kernels,
                    &scratch.reward,
                    from,
                    row,
                    plane,
                    &mut winners[row * WIDTH..][..WIDTH],
                );
            }
        }
        from = Some(plane);
    }
}

#[inline(always)]
fn forward_row<const FUSED: bool>(
    kernels: &Kernels,
    reward: &[f32],
    from: &[f32],
    row: usize,
    to: &mut [f32],
    winners: &mut [u8],
) {
    let mut best = [f32::NEG_INFINITY; WIDTH];
    let mut winner = [0_u32; WIDTH];
    let mut take = |sum: &[f32; WIDTH], channel: usize| {
        for lane in 0..WIDTH {
            let higher = sum[lane] > best[lane];
            best[lane] = if higher { sum[lane] } else { best[lane] };
            winner[lane] = if higher { channel as u32 } else { winner[lane] };
        }
    };
    let start = |channel: usize| -> [f32; WIDTH] {
        let mut lanes = [0.0; WIDTH];
        lanes.copy_from_slice(&reward[(channel * LOCAL_SIDE + row) * WIDTH..][..WIDTH]);
        lanes
    };
    let mut channel = 0;
    let mut pairs = kernels.value.chunks_exact(2);
    for pair in &mut pairs {
        let sums = convolve::<FUSED, 2, STRIDE>(pair, [start(channel), start(channel + 1)], from, row);
        take(&sums[0], channel);
        take(&sums[1], channel + 1);
        channel += 2;
    }
    for single in pairs.remainder() {
        take(&convolve::<FUSED, 1, STRIDE>(&[*single], [start(channel)], from, row)[0], channel);
    }
    to[place(row, 0)..][..WIDTH].copy_from_slice(&best);
    to[place(row, LOCAL_SIDE)..][..WIDTH - LOCAL_SIDE].fill(0.0);
    for lane in 0..WIDTH {
        winners[lane] = winner[lane] as u8;
    }
}

#[inline(always)]
fn backward_body<const FUSED: bool>(
    kernels: &Kernels,
    trace: &Trace,
    scratch: &mut PlaneScratch,
    out: &mut [f32],
) {
    let channels = kernels.value.len();
    scratch.reward_gradient.fill(0.0);
    scratch.sums.fill([0.0; WIDTH]);
    let [mut gradient, mut before] = scratch.gradient.each_mut();
    for round in (0..kernels.rounds).rev() {
        let plane = &trace.planes[round * PLANE..][..PLANE];
        let winners = &trace.winners[round * WINNERS..][..WINNERS];
        for row in 0..LOCAL_SIDE {
            let mut own = [0.0; WIDTH];
            own[..LOCAL_SIDE].copy_from_slice(&gradient[place(row, 0)..][..LOCAL_SIDE]);
            let mut sent = [[0.0; WIDTH]; 9];
            let won = &winners[row * WIDTH..][..WIDTH];
            for channel in 0..channels {
                if !won.iter().fold(false, |any, winner| any | (usize::from(*winner) == channel)) {
                    continue;
                }
                let mut part = [0.0; WIDTH];
                for lane in 0..WIDTH {
                    part[lane] = if usize::from(won[lane]) == channel { own[lane] } else { 0.0 };
                }
                let sum = &mut scratch.reward_gradient[(channel * LOCAL_SIDE + row) * WIDTH..][..WIDTH];
                for lane in 0..WIDTH {
                    sum[lane] += part[lane];
                }
                for tap in 0..9 {
                    let cells = &plane[(row + tap / 3) * STRIDE + tap % 3..][..WIDTH];
                    let sums = &mut scratch.sums[channel * 9 + tap];
                    let weight = kernels.value[channel][tap];
                    for lane in 0..WIDTH {
                        sums[lane] = multiply_add::<FUSED>(part[lane], cells[lane], sums[lane]);
                        sent[tap][lane] = multiply_add::<FUSED>(part[lane], weight, sent[tap][lane]);
                    }
                }
            }
            for (tap, sent) in sent.iter().enumerate() {
                scratch.sent[tap * PLANE + place(row, 0)..][..WIDTH].copy_from_slice(sent);
            }
        }
        for row in 0..LOCAL_SIDE {
            let mut total = [0.0; WIDTH];
            for tap in 0..9 {
                // What the cell one tap back sent here.
                let from = tap * PLANE + (row + 2 - tap / 3) * STRIDE + 2 - tap % 3;
                for (total, sent) in total.iter_mut().zip(&scratch.sent[from..][..WIDTH]) {
                    *total += sent;
                }
            }
            before[place(row, 0)..][..WIDTH].copy_from_slice(&total);
            before[place(row, LOCAL_SIDE)..][..WIDTH - LOCAL_SIDE].fill(0.0);
        }
        std::mem::swap(&mut gradient, &mut before);
    }
    collect::<FUSED>(channels, trace, &scratch.reward_gradient, &scratch.sums, out);
}

/// Sums over lanes and over the reward map into the parameter gradient.
#[inline(always)]
fn collect<const FUSED: bool>(
    channels: usize,
    trace: &Trace,
    reward_gradient: &[f32],
    sums: &[[f32; WIDTH]],
    out: &mut [f32],
) {
    for channel in 0..channels {
        let mut taps = [[0.0; WIDTH]; 9];
        let mut bias = [0.0; WIDTH];
        for row in 0..LOCAL_SIDE {
            let own = &reward_gradient[(channel * LOCAL_SIDE + row) * WIDTH..][..WIDTH];
            for lane in 0..WIDTH {
                bias[lane] += own[lane];
            }
            for (tap, sums) in taps.iter_mut().enumerate() {
                let cells = &trace.reward_map[(row + tap / 3) * STRIDE + tap % 3..][..WIDTH];
                for lane in 0..WIDTH {
                    sums[lane] = multiply_add::<FUSED>(own[lane], cells[lane], sums[lane]);
                }
            }
        }
        for tap in 0..9 {
            out[channel * 9 + tap] += taps[tap].iter().sum::<f32>();
            out[channels * 10 + channel * 9 + tap] += sums[channel * 9 + tap].iter().sum::<f32>();
        }
        out[channels * 9 + channel] += bias.iter().sum::<f32>();
    }
}

/// The kernels that this machine runs on.
pub(crate) fn lanes() -> Lanes {
    Lanes::detect()
}

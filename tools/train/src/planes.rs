//! Value iteration forward, keeping every V and which channel won, and backward along the winners.
//!
//! Vectors run over the cells of a row; each cell of a sum has its own lane until the end, so the bits do not depend
//! on the instruction set. Backward visits, per row, only the channels that won somewhere in it.

use bytemuck::{Pod, Zeroable, cast_slice, cast_slice_mut};
use sidestep_msgs::LOCAL_SIDE;
use sidestep_policy::{Lanes, ROW_CELLS as WIDTH, convolve, multiply_add, on_lanes};

/// Floats between rows of a padded plane: one zero left, five right.
const STRIDE: usize = 34;
/// Floats of a padded plane.
pub(crate) const PLANE: usize = (LOCAL_SIDE + 2) * STRIDE;
/// Cells of half a row: one vector.
const HALF: usize = WIDTH / 2;
/// Winners of a round.
const WINNERS: usize = LOCAL_SIDE * WIDTH;
/// Lines of a row of what is sent to neighbours: one of zeros, of which first and last are read, and the cells.
const SENT_LINES: usize = 1 + WIDTH / HALF;
/// Floats of that row, and of the plane with a row of zeros above and below.
const SENT_STRIDE: usize = SENT_LINES * HALF;
const SENT_PLANE: usize = (LOCAL_SIDE + 2) * SENT_STRIDE;

/// Half a row on a cache line of its own: what is added to over and over must not straddle two (a store that does takes
/// twice as long).
#[repr(C, align(64))]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
struct Line([f32; HALF]);

/// `count` floats on whole lines, and one line of zeros to read beyond the last row.
fn lines(count: usize) -> Vec<Line> {
    vec![Line([0.0; HALF]); count.div_ceil(HALF) + 1]
}

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
    reward: Vec<Line>,
    /// Gradient of rq.
    reward_gradient: Vec<Line>,
    /// Gradient of the value kernels, one sum per lane.
    sums: Vec<[Line; 9]>,
    /// Per tap: gradient sent to that neighbour.
    sent: Vec<Line>,
    gradient: Vec<f32>,
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
            reward: lines(channels * WINNERS),
            reward_gradient: lines(channels * WINNERS),
            sums: vec![[Line([0.0; HALF]); 9]; channels],
            sent: lines(9 * SENT_PLANE),
            gradient: vec![0.0; PLANE],
        }
    }

    /// Where the gradient of V_K is put before [`backward`]: padded, zero where there is none.
    pub(crate) fn gradient(&mut self) -> &mut [f32] {
        &mut self.gradient
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
    let reward: &mut [f32] = cast_slice_mut(&mut scratch.reward);
    for (channel, (kernel, bias)) in kernels.reward.iter().zip(&kernels.bias).enumerate() {
        for row in 0..LOCAL_SIDE {
            let sums = convolve::<FUSED, 1, STRIDE>(&[*kernel], [[*bias; WIDTH]], &trace.reward_map, row);
            reward[(channel * LOCAL_SIDE + row) * WIDTH..][..WIDTH].copy_from_slice(&sums[0]);
        }
    }
    let planes = trace.planes.chunks_exact_mut(PLANE);
    let mut from: Option<&[f32]> = None;
    for (plane, winners) in
        planes.zip(std::iter::once(None).chain(trace.winners.chunks_exact_mut(WINNERS).map(Some)))
    {
        if let (Some(from), Some(winners)) = (from, winners) {
            for row in 0..LOCAL_SIDE {
                forward_row::<FUSED>(kernels, reward, from, row, plane, &mut winners[row * WIDTH..][..WIDTH]);
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
    // Padding wins what its neighbour wins, so that backward visits no channel for it.
    let (row, padding) = winners.split_at_mut(LOCAL_SIDE);
    padding.fill(row[LOCAL_SIDE - 1]);
}

#[inline(always)]
fn backward_body<const FUSED: bool>(
    kernels: &Kernels,
    trace: &Trace,
    scratch: &mut PlaneScratch,
    out: &mut [f32],
) {
    scratch.reward_gradient.fill(Line([0.0; HALF]));
    scratch.sums.fill([Line([0.0; HALF]); 9]);
    for round in (0..kernels.rounds).rev() {
        let plane = &trace.planes[round * PLANE..][..PLANE];
        let winners = &trace.winners[round * WINNERS..][..WINNERS];
        for half in 0..2 * LOCAL_SIDE {
            let sent = backward_half::<FUSED>(kernels, plane, winners, half, scratch);
            let line = (half / 2 + 1) * SENT_LINES + 1 + half % 2;
            for (tap, sent) in sent.iter().enumerate() {
                scratch.sent[tap * (SENT_PLANE / HALF) + line].0 = *sent;
            }
        }
        gather(cast_slice(&scratch.sent), &mut scratch.gradient);
    }
    collect::<FUSED>(kernels.value.len(), trace, cast_slice(&scratch.reward_gradient), &scratch.sums, out);
}

/// The first half row of a slice.
#[inline(always)]
fn load(cells: &[f32]) -> [f32; HALF] {
    let mut lanes = [0.0; HALF];
    lanes.copy_from_slice(&cells[..HALF]);
    lanes
}

#[inline(always)]
fn lanes_multiply_add<const FUSED: bool>(a: [f32; HALF], b: [f32; HALF], c: [f32; HALF]) -> [f32; HALF] {
    std::array::from_fn(|lane| multiply_add::<FUSED>(a[lane], b[lane], c[lane]))
}

/// Half a row: adds to the gradients of the channels that won in it, and returns what each cell sends to its neighbours.
#[inline(always)]
fn backward_half<const FUSED: bool>(
    kernels: &Kernels,
    plane: &[f32],
    winners: &[u8],
    half: usize,
    scratch: &mut PlaneScratch,
) -> [[f32; HALF]; 9] {
    let (row, col) = (half / 2, half % 2 * HALF);
    let own = load(&scratch.gradient[place(row, col)..]);
    let mut won = [0_u32; HALF];
    let mut present = 0_u32;
    for (won, winner) in won.iter_mut().zip(&winners[row * WIDTH + col..][..HALF]) {
        *won = u32::from(*winner);
        present |= 1 << *won;
    }
    let mut sent = [[0.0; HALF]; 9];
    while present != 0 {
        let channel = present.trailing_zeros();
        present &= present - 1;
        let mut part = [0.0; HALF];
        for lane in 0..HALF {
            part[lane] = if won[lane] == channel { own[lane] } else { 0.0 };
        }
        let channel = channel as usize;
        let Line(reward) = &mut scratch.reward_gradient[(channel * WINNERS + row * WIDTH + col) / HALF];
        for lane in 0..HALF {
            reward[lane] += part[lane];
        }
        let (weights, sums) = (&kernels.value[channel], &mut scratch.sums[channel]);
        for tap in 0..9 {
            let cells = load(&plane[(row + tap / 3) * STRIDE + col + tap % 3..]);
            sums[tap].0 = lanes_multiply_add::<FUSED>(part, cells, sums[tap].0);
            sent[tap] = lanes_multiply_add::<FUSED>(part, [weights[tap]; HALF], sent[tap]);
        }
    }
    sent
}

/// The gradient of the V before: what the neighbours sent to each cell.
#[inline(always)]
fn gather(sent: &[f32], gradient: &mut [f32]) {
    for row in 0..LOCAL_SIDE {
        let mut total = [0.0; WIDTH];
        for tap in 0..9 {
            // What the cell one tap back sent here.
            let from = tap * SENT_PLANE + (row + 2 - tap / 3) * SENT_STRIDE + HALF + 1 - tap % 3;
            for (total, sent) in total.iter_mut().zip(&sent[from..][..WIDTH]) {
                *total += sent;
            }
        }
        gradient[place(row, 0)..][..WIDTH].copy_from_slice(&total);
        gradient[place(row, LOCAL_SIDE)..][..WIDTH - LOCAL_SIDE].fill(0.0);
    }
}

/// Sums over lanes and over the reward map into the parameter gradient.
#[inline(always)]
fn collect<const FUSED: bool>(
    channels: usize,
    trace: &Trace,
    reward_gradient: &[f32],
    sums: &[[Line; 9]],
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
            out[channels * 10 + channel * 9 + tap] += sums[channel][tap].0.iter().sum::<f32>();
        }
        out[channels * 9 + channel] += bias.iter().sum::<f32>();
    }
}

/// The kernels that this machine runs on.
pub(crate) fn lanes() -> Lanes {
    Lanes::detect()
}

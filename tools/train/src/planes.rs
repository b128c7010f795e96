//! Value iteration forward, keeping every V and which channel won, and backward along the winners.
//!
//! Vectors run over the cells of half a row; each cell of a sum has its own lane until the end, so the bits do not depend
//! on the instruction set. Backward visits, per half row, only the channels that won somewhere in it.

use crate::line::{LANES, Line, lines};
use bytemuck::{cast_slice, cast_slice_mut};
use sidestep_msgs::LOCAL_SIDE;
use sidestep_policy::{ROW_CELLS as WIDTH, convolve, on_lanes};

/// Half rows of a row.
const HALVES: usize = WIDTH / LANES;
/// Half rows of all cells.
const CELL_LINES: usize = LOCAL_SIDE * HALVES;
/// Lanes of the second half that are cells; the others are zeros, the border of this row and of the next one.
const SECOND: usize = LOCAL_SIDE - LANES;
/// Lines of a padded plane: a row of zeros above and below, and a line beyond each, of which one number is read.
const PLANE_LINES: usize = (LOCAL_SIDE + 2) * HALVES + 2;
/// Line of the first cell.
const FIRST: usize = HALVES + 1;
/// Winners of a round.
const WINNERS: usize = CELL_LINES * LANES;
/// Channels computed at once: their sums, those of the best and the cells fill the registers of AVX-512.
const CHANNELS: usize = 5;

/// Rows from the one that sends to the one that gathers: a load waits for stores that it straddles, if they are fresh.
const LAG: usize = 3;

/// Index of a cell in a padded plane.
#[inline]
pub(crate) fn place(row: usize, col: usize) -> usize {
    FIRST * LANES + row * WIDTH + col
}

/// The kernels, unpacked from the parameter vector.
#[derive(Debug, Clone, Default)]
pub(crate) struct Kernels {
    pub(crate) reward: Vec<[f32; 9]>,
    pub(crate) bias: Vec<f32>,
    pub(crate) value: Vec<[f32; 9]>,
    pub(crate) rounds: usize,
}

/// What one sample keeps between forward and backward.
#[derive(Debug, Clone)]
pub(crate) struct Trace {
    /// m_r, then V_0 to V_K.
    reward_map: Plane,
    planes: Vec<Plane>,
    /// Winning channel per round and cell.
    winners: Vec<u8>,
    /// The channels that won, one bit each, per round and half row.
    present: Vec<u32>,
}

/// A padded plane.
type Plane = [Line; PLANE_LINES];

const EMPTY: Plane = [Line::ZERO; PLANE_LINES];

/// Memory shared by all samples of a thread.
#[derive(Debug, Clone)]
pub(crate) struct PlaneScratch {
    reward: Vec<Line>,
    /// Gradient of rq.
    reward_gradient: Vec<Line>,
    /// Gradient of the value kernels, one sum per lane.
    sums: Vec<[Line; 9]>,
    /// Winning channel per half row and lane, in the round that backward is at.
    winners: [[u32; LANES]; CELL_LINES],
    /// Per channel: the half rows in which it won, one bit each.
    won: Vec<u64>,
    /// Per tap: gradient sent to that neighbour.
    sent: [Plane; 9],
    gradient: Box<Plane>,
    /// Gradient of the V before.
    before: Box<Plane>,
}

impl Trace {
    pub(crate) fn new(rounds: usize) -> Self {
        Self {
            reward_map: EMPTY,
            planes: vec![EMPTY; rounds + 1],
            winners: vec![0; rounds * WINNERS],
            present: vec![0; rounds * CELL_LINES],
        }
    }

    /// m_r, padded.
    pub(crate) fn reward_map(&self) -> &[f32] {
        cast_slice(&self.reward_map)
    }

    /// Where m_r is put before [`forward`]: padded, zero where there is none.
    pub(crate) fn reward_map_mut(&mut self) -> &mut [f32] {
        cast_slice_mut(&mut self.reward_map)
    }

    /// V_K, padded.
    pub(crate) fn value(&self) -> &[f32] {
        self.planes.last().map_or(&[], |plane| cast_slice(plane))
    }
}

impl PlaneScratch {
    pub(crate) fn new(channels: usize) -> Self {
        Self {
            reward: lines(channels * WINNERS),
            reward_gradient: lines(channels * WINNERS),
            sums: vec![[Line::ZERO; 9]; channels],
            winners: [[0; LANES]; CELL_LINES],
            won: vec![0; channels],
            sent: [EMPTY; 9],
            gradient: Box::new(EMPTY),
            before: Box::new(EMPTY),
        }
    }

    /// Where the gradient of V_K is put before [`backward`]: padded, zero where there is none.
    pub(crate) fn gradient(&mut self) -> &mut [f32] {
        cast_slice_mut(&mut *self.gradient)
    }
}

on_lanes! {
    /// Fills the trace of the m_r that it holds.
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
            let sums =
                convolve::<FUSED, 1, WIDTH>(&[*kernel], [[*bias; WIDTH]], corner(&trace.reward_map), row);
            reward[channel * WINNERS + row * WIDTH..][..WIDTH].copy_from_slice(&sums[0]);
        }
    }
    let rounds = trace.winners.chunks_exact_mut(WINNERS).zip(trace.present.chunks_exact_mut(CELL_LINES));
    let mut planes = trace.planes.as_mut_slice();
    for (winners, present) in rounds {
        let (from, to) = planes.split_at_mut(1);
        for row in 0..LOCAL_SIDE {
            let best = best_of_row::<FUSED>(kernels, reward, &from[0], row);
            for (half, Best { value, winner }) in best.into_iter().enumerate() {
                let line = row * HALVES + half;
                to[0][FIRST + line] = value;
                let winners = &mut winners[line * LANES..][..LANES];
                for lane in 0..LANES {
                    winners[lane] = winner[lane] as u8;
                }
                // Backward visits no channel for what only padding won.
                let cells = if half == 0 { LANES } else { SECOND };
                present[line] = all_of(winner, cells);
            }
            to[0][FIRST + row * HALVES + 1].0[SECOND..].fill(0.0);
        }
        planes = to;
    }
}

/// The winners of the first `cells` cells, one bit each.
#[inline(always)]
fn all_of(winner: [u32; LANES], cells: usize) -> u32 {
    let mut bits = [0; LANES];
    for lane in 0..LANES {
        bits[lane] = 1 << (winner[lane] & 31);
    }
    bits[cells..].fill(0);
    let mut count = LANES;
    while count > 1 {
        count /= 2;
        for lane in 0..count {
            bits[lane] |= bits[lane + count];
        }
    }
    bits[0]
}

/// The cells of a plane from the neighbour of the first one on that [`convolve`] begins with.
#[inline(always)]
fn corner(plane: &Plane) -> &[f32] {
    &cast_slice(plane)[LANES - 1..]
}

/// The highest values of half a row so far, and the channels that have them.
#[derive(Clone, Copy)]
struct Best {
    value: Line,
    winner: [u32; LANES],
}

impl Best {
    const NONE: Self = Self { value: Line([f32::NEG_INFINITY; LANES]), winner: [0; LANES] };

    #[inline(always)]
    fn or(self, sums: &[f32], channel: usize) -> Self {
        let mut sum = [0.0; LANES];
        sum.copy_from_slice(sums);
        let mut best = self;
        for (lane, sum) in sum.into_iter().enumerate() {
            let higher = sum > self.value.0[lane];
            best.value.0[lane] = if higher { sum } else { self.value.0[lane] };
            best.winner[lane] = if higher { channel as u32 } else { self.winner[lane] };
        }
        best
    }
}

/// The best of all channels in both halves of a row.
#[inline(always)]
fn best_of_row<const FUSED: bool>(
    kernels: &Kernels,
    reward: &[f32],
    from: &Plane,
    row: usize,
) -> [Best; HALVES] {
    let (mut first, mut second) = (Best::NONE, Best::NONE);
    let mut channel = 0;
    let mut groups = kernels.value.chunks_exact(CHANNELS);
    for group in &mut groups {
        let mut sums = [[0.0; WIDTH]; CHANNELS];
        for (n, sums) in sums.iter_mut().enumerate() {
            sums.copy_from_slice(&reward[(channel + n) * WINNERS + row * WIDTH..][..WIDTH]);
        }
        let sums = convolve::<FUSED, CHANNELS, WIDTH>(group, sums, corner(from), row);
        for (n, sums) in sums.iter().enumerate() {
            first = first.or(&sums[..LANES], channel + n);
            second = second.or(&sums[LANES..], channel + n);
        }
        channel += CHANNELS;
    }
    for single in groups.remainder() {
        let mut sums = [[0.0; WIDTH]];
        sums[0].copy_from_slice(&reward[channel * WINNERS + row * WIDTH..][..WIDTH]);
        let [sums] = convolve::<FUSED, 1, WIDTH>(&[*single], sums, corner(from), row);
        first = first.or(&sums[..LANES], channel);
        second = second.or(&sums[LANES..], channel);
        channel += 1;
    }
    [first, second]
}

#[inline(always)]
fn backward_body<const FUSED: bool>(
    kernels: &Kernels,
    trace: &Trace,
    scratch: &mut PlaneScratch,
    out: &mut [f32],
) {
    scratch.reward_gradient.fill(Line::ZERO);
    scratch.sums.fill([Line::ZERO; 9]);
    for round in (0..kernels.rounds).rev() {
        let winners = &trace.winners[round * WINNERS..][..WINNERS];
        let present = &trace.present[round * CELL_LINES..][..CELL_LINES];
        scratch.won.fill(0);
        for row in 0..LOCAL_SIDE + LAG {
            for half in row * HALVES..(row + 1) * HALVES {
                let Some(present) = present.get(half) else { continue };
                scratch.winners[half] = winners_of(winners, half);
                let own = (scratch.gradient[FIRST + half], scratch.winners[half]);
                let sent = send::<FUSED>(kernels, own, half, *present, &mut scratch.won);
                for (plane, sent) in scratch.sent.iter_mut().zip(sent) {
                    plane[FIRST + half] = sent;
                }
            }
            if let Some(row) = row.checked_sub(LAG) {
                gather(&scratch.sent, row, &mut scratch.before);
            }
        }
        correlate::<FUSED>(&trace.planes[round], scratch);
        std::mem::swap(&mut scratch.gradient, &mut scratch.before);
    }
    collect::<FUSED>(&trace.reward_map, scratch, out);
}

/// The winners of half a row.
#[inline(always)]
fn winners_of(winners: &[u8], half: usize) -> [u32; LANES] {
    let mut won = [0; LANES];
    for (won, winner) in won.iter_mut().zip(&winners[half * LANES..][..LANES]) {
        *won = u32::from(*winner);
    }
    won
}

/// What of `line` belongs to cells that `channel` won.
#[inline(always)]
fn part_of(line: Line, winners: [u32; LANES], channel: usize) -> Line {
    let mut part = Line::ZERO;
    for (lane, winner) in winners.into_iter().enumerate() {
        part.0[lane] = if winner == channel as u32 { line.0[lane] } else { 0.0 };
    }
    part
}

/// What each cell of half a row sends to its neighbours; notes who won in it.
#[inline(always)]
fn send<const FUSED: bool>(
    kernels: &Kernels,
    (own, winners): (Line, [u32; LANES]),
    half: usize,
    mut present: u32,
    won: &mut [u64],
) -> [Line; 9] {
    let mut sent = [Line::ZERO; 9];
    while present != 0 {
        let channel = present.trailing_zeros() as usize;
        present &= present - 1;
        won[channel] |= 1 << half;
        let part = part_of(own, winners, channel);
        let weights = &kernels.value[channel];
        for tap in 0..9 {
            sent[tap] = sent[tap].plus_product::<FUSED>(part, Line([weights[tap]; LANES]));
        }
    }
    sent
}

/// Adds `part`, of half row `half`, times the neighbourhood of each cell.
#[inline(always)]
fn add_neighbours<const FUSED: bool>(part: Line, plane: &Plane, half: usize, sums: &mut [Line; 9]) {
    for (tap, sum) in sums.iter_mut().enumerate() {
        let from = half * LANES + tap / 3 * WIDTH + tap % 3;
        *sum = sum.plus_product::<FUSED>(part, Line::load(&corner(plane)[from..]));
    }
}

/// Adds to the gradients of rq and of the value kernels, channel by channel, so that its sums stay in registers.
#[inline(always)]
fn correlate<const FUSED: bool>(plane: &Plane, scratch: &mut PlaneScratch) {
    for (channel, won) in scratch.won.iter().enumerate() {
        let mut sums = scratch.sums[channel];
        let mut left = *won;
        while left != 0 {
            let half = left.trailing_zeros() as usize;
            left &= left - 1;
            let part = part_of(scratch.gradient[FIRST + half], scratch.winners[half], channel);
            let reward = &mut scratch.reward_gradient[channel * CELL_LINES + half];
            *reward = reward.plus(part);
            add_neighbours::<FUSED>(part, plane, half, &mut sums);
        }
        scratch.sums[channel] = sums;
    }
}

/// The gradient of a row of the V before: what the neighbours sent to each cell.
#[inline(always)]
fn gather(sent: &[Plane; 9], row: usize, before: &mut Plane) {
    let first = FIRST + row * HALVES;
    for (half, before) in before[first..][..HALVES].iter_mut().enumerate() {
        let mut total = Line::ZERO;
        for (tap, sent) in sent.iter().enumerate() {
            // What the cell one tap back sent here.
            let from = (first + half + HALVES - tap / 3 * HALVES) * LANES + 1 - tap % 3;
            let sent: &[f32] = cast_slice(sent);
            total = total.plus(Line::load(&sent[from..]));
        }
        *before = total;
    }
    before[first + 1].0[SECOND..].fill(0.0);
}

/// Sums over lanes and over m_r into the parameter gradient.
#[inline(always)]
fn collect<const FUSED: bool>(reward_map: &Plane, scratch: &PlaneScratch, out: &mut [f32]) {
    let channels = scratch.sums.len();
    for channel in 0..channels {
        let mut taps = [Line::ZERO; 9];
        let mut bias = Line::ZERO;
        for (half, part) in scratch.reward_gradient[channel * CELL_LINES..][..CELL_LINES].iter().enumerate() {
            bias = bias.plus(*part);
            add_neighbours::<FUSED>(*part, reward_map, half, &mut taps);
        }
        for tap in 0..9 {
            out[channel * 9 + tap] += taps[tap].total();
            out[channels * 10 + channel * 9 + tap] += scratch.sums[channel][tap].total();
        }
        out[channels * 9 + channel] += bias.total();
    }
}

//! A wave that spreads over places and headings: which of them a footprint comes to, and how.
//!
//! Of each heading only those blocks of rows are looked at that its front, or one next to it, has come to.

use crate::stencil::{
    Beginning, CELL_M, HEADINGS, Layer, PASSED, Place, Runs, SIDE, STEPS, Stencils, Window, direction,
    join_moved,
};

/// What a camera needs to see anything.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Eye {
    /// `[m]` ahead of the axle.
    pub(crate) forward_m: f32,
    /// `[m]` nearer than this it measures nothing.
    pub(crate) near_m: f32,
    pub(crate) half_view_rad: f32,
}

/// For each heading the cells, from the axle on, of three lines of sight that a camera is too near to.
#[derive(Debug, Clone)]
pub(crate) struct Blinders {
    lines: [[Vec<[i32; 2]>; 3]; HEADINGS],
}

impl Blinders {
    pub(crate) fn new(eye: &Eye) -> Self {
        let line = |heading: usize, side: f32| {
            let [cos, sin] = direction(heading);
            let (ray_sin, ray_cos) = libm::sincosf(side * eye.half_view_rad);
            let cell = |step: i32| {
                let range_m = step as f32 * CELL_M;
                let (x_m, y_m) = (eye.forward_m + range_m * ray_cos, range_m * ray_sin);
                [x_m * cos - y_m * sin, x_m * sin + y_m * cos].map(|m| libm::roundf(m / CELL_M) as i32)
            };
            let mut cells: Vec<_> = (1..=(eye.near_m / CELL_M) as i32).map(cell).collect();
            cells.dedup();
            cells
        };
        Self { lines: std::array::from_fn(|heading| [-1.0, 0.0, 1.0].map(|side| line(heading, side))) }
    }
}

/// How a place is come to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Step {
    Forward,
    Back,
    Left,
    Right,
}

const WAYS: [Step; 4] = [Step::Forward, Step::Back, Step::Left, Step::Right];

const NOWHERE: Layer = [[0; SIDE]; HEADINGS];

/// Rows of a block: as many at once as a loop over them takes registers.
const BLOCK: usize = 8;
const BLOCKS: usize = SIDE / BLOCK;
/// A bit for each block of a window's rows.
type Blocks = u8;
const _: () = assert!(BLOCKS == Blocks::BITS as usize && SIDE.is_multiple_of(BLOCK));
/// Rows outside the window that a step from its edge leads over.
const OUTSIDE: usize = 3;

/// The numbers of the blocks that are set.
fn numbers(mut blocks: Blocks) -> impl Iterator<Item = usize> {
    std::iter::from_fn(move || {
        let number = (blocks != 0).then(|| blocks.trailing_zeros() as usize)?;
        blocks &= blocks - 1;
        Some(number)
    })
}

/// The blocks that rows of some blocks come to by a step of so many rows.
fn stepped(blocks: Blocks, on: i32) -> Blocks {
    match on {
        0 => blocks,
        1.. => blocks | blocks << 1,
        _ => blocks | blocks >> 1,
    }
}

fn block(window: &Window, number: usize) -> &[u64] {
    &window[number * BLOCK..][..BLOCK]
}

fn block_mut(window: &mut Window, number: usize) -> &mut [u64] {
    &mut window[number * BLOCK..][..BLOCK]
}

/// Places that were come to at the same time.
#[derive(Debug, Clone)]
struct Front {
    /// With rows outside the window, in which there is nothing.
    places: [[u64; SIDE + 2 * OUTSIDE]; HEADINGS],
    /// In all others there is nothing.
    blocks: [Blocks; HEADINGS],
}

impl Front {
    fn new() -> Box<Self> {
        Box::new(Self { places: [[0; SIDE + 2 * OUTSIDE]; HEADINGS], blocks: [0; HEADINGS] })
    }

    /// The words of a block, or of the rows so many on from it.
    fn block(&self, heading: usize, number: usize, on: i32) -> &[u64] {
        let first = (number * BLOCK + OUTSIDE).saturating_add_signed(on as isize);
        &self.places[heading][first..][..BLOCK]
    }

    fn block_mut(&mut self, heading: usize, number: usize) -> &mut [u64] {
        &mut self.places[heading][number * BLOCK + OUTSIDE..][..BLOCK]
    }

    fn clear(&mut self) {
        for heading in 0..HEADINGS {
            let blocks = std::mem::take(&mut self.blocks[heading]);
            numbers(blocks).for_each(|number| self.block_mut(heading, number).fill(0));
        }
    }

    fn is_empty(&self) -> bool {
        self.blocks == [0; HEADINGS]
    }
}

/// Places that are asked for.
#[derive(Debug, Clone)]
pub(crate) struct Asked {
    places: Layer,
    blocks: [Blocks; HEADINGS],
}

impl Asked {
    pub(crate) fn new() -> Box<Self> {
        Box::new(Self { places: NOWHERE, blocks: [0; HEADINGS] })
    }

    /// Asks for what is filled in where nothing was.
    pub(crate) fn take(&mut self, fill: impl FnOnce(&mut Layer)) {
        self.places = NOWHERE;
        fill(&mut self.places);
        for (blocks, window) in self.blocks.iter_mut().zip(&self.places) {
            let is_any = |number: usize| block(window, number).iter().any(|word| *word != 0);
            *blocks = (0..BLOCKS).fold(0, |blocks, number| blocks | Blocks::from(is_any(number)) << number);
        }
    }
}

/// What was come to, and by which step.
#[derive(Debug, Clone)]
pub(crate) struct Wave {
    /// Free, and not come to yet.
    free: Layer,
    /// Turns from each heading to the next one to the left that are free.
    turns: Layer,
    /// In boxes, since they take turns.
    front: Box<Front>,
    /// The front before: a step back takes as long as two others.
    before: Box<Front>,
    /// Room for the next front.
    next: Box<Front>,
    /// Come to by a turn, and by the second of two steps: back, or to the right.
    turned: Layer,
    second: Layer,
    begun: Layer,
    /// Where a camera would see nothing.
    blind: Layer,
    passed: [Window; PASSED],
}

impl Wave {
    pub(crate) fn new() -> Box<Self> {
        Box::new(Self {
            free: NOWHERE,
            turns: NOWHERE,
            front: Front::new(),
            before: Front::new(),
            next: Front::new(),
            turned: NOWHERE,
            second: NOWHERE,
            begun: NOWHERE,
            blind: NOWHERE,
            passed: [[0; SIDE]; PASSED],
        })
    }

    /// Begins afresh.
    pub(crate) fn begin(&mut self, stencils: &Stencils, runs: &Runs, from: &Beginning) {
        for (number, passed) in self.passed.iter_mut().enumerate() {
            *passed = stencils.free(number, runs);
        }
        for heading in 0..HEADINGS {
            self.free[heading] = self.passed[2 * heading];
            let (between, next) = (&self.passed[2 * heading + 1], &self.passed[(2 * heading + 2) % PASSED]);
            let turns = |row: usize| self.free[heading][row] & between[row] & next[row];
            self.turns[heading] = std::array::from_fn(turns);
        }
        (self.turned, self.second, self.begun) = (NOWHERE, NOWHERE, NOWHERE);
        self.front.clear();
        self.before.clear();
        for (row, word) in (from.row..SIDE).zip(from.words).filter(|(_, word)| *word != 0) {
            self.front.block_mut(from.heading, row / BLOCK)[row % BLOCK] = word;
            self.front.blocks[from.heading] |= 1 << (row / BLOCK);
            self.begun[from.heading][row] = word;
            self.free[from.heading][row] &= !word;
        }
    }

    /// Has nothing turn or drive forward to where all that a camera sees is nearer than it can measure.
    pub(crate) fn shun(&mut self, stands: &Window, blinders: &Blinders) {
        for (blind, lines) in self.blind.iter_mut().zip(&blinders.lines) {
            *blind = [u64::MAX; SIDE];
            for line in lines {
                let mut hidden = [0; SIDE];
                line.iter()
                    .for_each(|[rows_on, bits_on]| join_moved(&mut hidden, stands, -rows_on, -bits_on));
                blind.iter_mut().zip(hidden).for_each(|(blind, hidden)| *blind &= hidden);
            }
        }
    }

    /// One step further in all directions; whether there is a next one.
    pub(crate) fn spread(&mut self) -> bool {
        let Self { front, before, next, .. } = self;
        next.clear();
        for (heading, &[on, bits_on]) in STEPS.iter().enumerate() {
            let (right, left) = ((heading + HEADINGS - 1) % HEADINGS, (heading + 1) % HEADINGS);
            let come_to = stepped(front.blocks[heading], on)
                | stepped(before.blocks[heading], -on)
                | front.blocks[right]
                | front.blocks[left];
            for number in numbers(come_to) {
                let come = Come {
                    ahead: front.block(heading, number, -on),
                    back: before.block(heading, number, on),
                    bits_on,
                    left: front.block(right, number, 0),
                    left_turns: block(&self.turns[right], number),
                    right: front.block(left, number, 0),
                    right_turns: block(&self.turns[heading], number),
                    blind: block(&self.blind[heading], number),
                };
                let is_any = come.to(
                    next.block_mut(heading, number),
                    block_mut(&mut self.free[heading], number),
                    block_mut(&mut self.turned[heading], number),
                    block_mut(&mut self.second[heading], number),
                );
                next.blocks[heading] |= Blocks::from(is_any) << number;
            }
        }
        std::mem::swap(before, front);
        std::mem::swap(front, next);
        !(front.is_empty() && before.is_empty())
    }

    /// Of the places of the front that are asked for the one that costs least.
    pub(crate) fn meets(&self, asked: &Asked, cost: impl Fn(&Place) -> f32) -> Option<Place> {
        let mut best: Option<(f32, Place)> = None;
        for (heading, places) in asked.places.iter().enumerate() {
            for number in numbers(self.front.blocks[heading] & asked.blocks[heading]) {
                let words = self.front.block(heading, number, 0).iter().zip(block(places, number));
                for (row, (front, asked)) in (number * BLOCK..).zip(words) {
                    let mut both = front & asked;
                    while both != 0 {
                        let place = Place { heading, row, bit: both.trailing_zeros() as usize };
                        both &= both - 1;
                        let cost = cost(&place);
                        if best.is_none_or(|(least, _)| cost < least) {
                            best = Some((cost, place));
                        }
                    }
                }
            }
        }
        best.map(|(_, place)| place)
    }

    /// The places on the way to one, the last one first, with the step that led to each; the first place has none.
    pub(crate) fn way(&self, to: Place) -> impl Iterator<Item = (Place, Option<Step>)> {
        let is = |layer: &Layer, place: &Place| layer[place.heading][place.row] >> place.bit & 1;
        let mut next = Some(to);
        std::iter::from_fn(move || {
            let place = next?;
            let by = WAYS[(2 * is(&self.turned, &place) + is(&self.second, &place)) as usize];
            let by = (is(&self.begun, &place) == 0).then_some(by);
            next = by.map(|by| before(place, by));
            Some((place, by))
        })
    }
}

/// From where the places of a block are come to.
struct Come<'a> {
    /// By a step forward, which leads so many bits on, and by a step back.
    ahead: &'a [u64],
    back: &'a [u64],
    bits_on: i32,
    /// By a turn to the left, and to the right, and which turns are free.
    left: &'a [u64],
    left_turns: &'a [u64],
    right: &'a [u64],
    right_turns: &'a [u64],
    blind: &'a [u64],
}

impl Come<'_> {
    /// Notes which free ones are reached, and how; whether any is.
    fn to(&self, reached: &mut [u64], free: &mut [u64], turned: &mut [u64], second: &mut [u64]) -> bool {
        let Self { ahead, back, bits_on, left, left_turns, right, right_turns, blind } = *self;
        let (up, down) = (bits_on.max(0), (-bits_on).max(0));
        let mut any = 0;
        for row in 0..BLOCK {
            let (open, seeing) = (free[row], free[row] & !blind[row]);
            let by_ahead = ahead[row] << up >> down & seeing;
            let by_back = back[row] >> up << down & open & !by_ahead;
            let others = seeing & !by_ahead & !by_back;
            let by_left = left[row] & left_turns[row] & others;
            let by_right = right[row] & right_turns[row] & others & !by_left;
            turned[row] |= by_left | by_right;
            second[row] |= by_back | by_right;
            reached[row] = by_ahead | by_back | by_left | by_right;
            free[row] = open & !reached[row];
            any |= reached[row];
        }
        any != 0
    }
}

/// Where a step to a place came from.
fn before(place: Place, by: Step) -> Place {
    let Place { heading, row, bit } = place;
    let [rows_on, bits_on] = STEPS[heading];
    let off = |sign: i32| Place {
        heading,
        row: row.saturating_add_signed((sign * rows_on) as isize),
        bit: bit.saturating_add_signed((sign * bits_on) as isize),
    };
    match by {
        Step::Forward => off(-1),
        Step::Back => off(1),
        Step::Left => Place { heading: (heading + HEADINGS - 1) % HEADINGS, ..place },
        Step::Right => Place { heading: (heading + 1) % HEADINGS, ..place },
    }
}

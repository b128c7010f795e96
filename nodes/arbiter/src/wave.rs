//! A wave that spreads over places and headings: which of them a footprint comes to, and how.

use crate::stencil::{
    Beginning, CELL_M, HEADINGS, Layer, PASSED, Place, SIDE, STEPS, Stencils, Window, direction, join, moved,
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

/// What was come to, and by which step.
#[derive(Debug, Clone)]
pub(crate) struct Wave {
    /// Free, and not come to yet.
    free: Layer,
    /// Turns from each heading to the next one to the left that are free.
    turns: Layer,
    front: Layer,
    /// The front before: a step back takes as long as two others.
    before: Layer,
    by: [Layer; 4],
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
            front: NOWHERE,
            before: NOWHERE,
            by: [NOWHERE; 4],
            begun: NOWHERE,
            blind: NOWHERE,
            passed: [[0; SIDE]; PASSED],
        })
    }

    /// Begins afresh.
    pub(crate) fn begin(&mut self, stencils: &Stencils, blocked: &Window, from: &Beginning) {
        for (number, passed) in self.passed.iter_mut().enumerate() {
            *passed = stencils.free(number, blocked);
        }
        for heading in 0..HEADINGS {
            self.free[heading] = self.passed[2 * heading];
            let (between, next) = (&self.passed[2 * heading + 1], &self.passed[(2 * heading + 2) % PASSED]);
            let turns = |row: usize| self.free[heading][row] & between[row] & next[row];
            self.turns[heading] = std::array::from_fn(turns);
        }
        (self.front, self.before, self.by, self.begun) = (NOWHERE, NOWHERE, [NOWHERE; 4], NOWHERE);
        for (index, word) in from.words.iter().enumerate() {
            if let Some(begun) = self.begun[from.heading].get_mut(from.row + index) {
                *begun = *word;
                self.front[from.heading][from.row + index] = *word;
                self.free[from.heading][from.row + index] &= !word;
            }
        }
    }

    /// Has nothing turn or drive forward to where all that a camera sees is nearer than it can measure.
    pub(crate) fn shun(&mut self, stands: &Window, camera: &Eye) {
        for (heading, blind) in self.blind.iter_mut().enumerate() {
            let [cos, sin] = direction(heading);
            *blind = [u64::MAX; SIDE];
            for (ray_cos, ray_sin) in [-1.0, 0.0, 1.0].map(|side| {
                let (sin, cos) = libm::sincosf(side * camera.half_view_rad);
                (cos, sin)
            }) {
                let mut hidden = [0; SIDE];
                for step in 1..=(camera.near_m / CELL_M) as i32 {
                    let range_m = step as f32 * CELL_M;
                    let (x_m, y_m) = (camera.forward_m + range_m * ray_cos, range_m * ray_sin);
                    let [rows_on, bits_on] = [x_m * cos - y_m * sin, x_m * sin + y_m * cos]
                        .map(|m| libm::roundf(m / CELL_M) as i32);
                    join(&mut hidden, &moved(stands, -rows_on, -bits_on));
                }
                blind.iter_mut().zip(hidden).for_each(|(blind, hidden)| *blind &= hidden);
            }
        }
    }

    /// One step further in all directions; whether there is a next one.
    pub(crate) fn spread(&mut self) -> bool {
        let mut reached = NOWHERE;
        let mut any = 0;
        for heading in 0..HEADINGS {
            let [rows_on, bits_on] = STEPS[heading];
            let (right, left) = ((heading + HEADINGS - 1) % HEADINGS, (heading + 1) % HEADINGS);
            let and = |a: &Window, b: &Window| -> Window { std::array::from_fn(|row| a[row] & b[row]) };
            let come = [
                moved(&self.front[heading], rows_on, bits_on),
                moved(&self.before[heading], -rows_on, -bits_on),
                and(&self.front[right], &self.turns[right]),
                and(&self.front[left], &self.turns[heading]),
            ];
            let (free, blind, reached) =
                (&mut self.free[heading], &self.blind[heading], &mut reached[heading]);
            for ((by, come), step) in self.by.iter_mut().zip(&come).zip(WAYS) {
                let by = &mut by[heading];
                for row in 0..SIDE {
                    let unseeing = if step == Step::Back { 0 } else { blind[row] };
                    let new = come[row] & free[row] & !unseeing;
                    by[row] |= new;
                    reached[row] |= new;
                    free[row] &= !new;
                }
            }
            any |= (0..SIDE).fold(0, |any, row| any | reached[row] | self.front[heading][row]);
        }
        self.before = std::mem::replace(&mut self.front, reached);
        any != 0
    }

    /// Of the places of the front that are asked for the one that costs least.
    pub(crate) fn meets(&self, asked: &Layer, cost: impl Fn(&Place) -> f32) -> Option<Place> {
        let mut best: Option<(f32, Place)> = None;
        for (heading, (front, asked)) in self.front.iter().zip(asked).enumerate() {
            for (row, (front, asked)) in front.iter().zip(asked).enumerate() {
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
        best.map(|(_, place)| place)
    }

    /// The places on the way to one, the last one first, with the step that led to each; the first place has none.
    pub(crate) fn way(&self, to: Place) -> impl Iterator<Item = (Place, Option<Step>)> {
        let is = |layer: &Layer, place: &Place| layer[place.heading][place.row] >> place.bit & 1 == 1;
        let mut next = Some(to);
        std::iter::from_fn(move || {
            let place = next?;
            let by = self.by.iter().position(|layer| is(layer, &place)).map(|by| WAYS[by]);
            let by = by.filter(|_| !is(&self.begun, &place));
            next = by.map(|by| before(place, by));
            Some((place, by))
        })
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

//! From counts to certainty: what a depth frame says about each cell it reaches.
//!
//! An obstacle needs the support of a small square facing the camera, so that the need falls with the square of the
//! distance as the pixels of a thin leg do. Free space needs a floor return in the cell; where an obstacle is stored, or
//! no floor is seen, it needs rays through the whole height band of the cell, each ending clearly behind it, and one to
//! just below its floor that ends before. A ray over or under a stored obstacle, or over a hole, therefore never clears it.
//! Round an obstacle, along the ray, nothing is cleared within two standard deviations of the stereo noise.

use crate::config::Config;
use crate::grid::{ALL_BANDS, BANDS, CELL_M, CELLS, Grid, OVERHANG, SIDE};
use crate::projection::{CLASSES, Columns, Counts, Lens, new_counts};
use sidestep_msgs::DepthFrame;

/// Support, in units of what is needed, that makes one sighting enough.
const STRONG: f32 = 4.0;
/// `[m]` step between the heights at which a ray is asked for.
const HEIGHT_STEP_M: f32 = 0.05;
/// `[m]` half a cell's diagonal: what ends nearer behind a cell's centre than this may lie in the cell.
const HALF_DIAGONAL_M: f32 = 0.036;
/// `[m]` height at which the depth of an obstacle's cell is taken.
const OBSTACLE_HEIGHT_M: f32 = 0.3;
/// Cells without a return are asked for rays in turn, one in this many per frame.
const ASK_EVERY: u32 = 4;

/// A cell with something in it.
#[derive(Debug, Clone, Copy)]
struct Sighting {
    cell: u32,
    delta: f32,
    bands: u8,
}

/// Working memory of a step; nothing in it outlives the step.
#[derive(Debug)]
pub(crate) struct Evidence {
    columns: Columns,
    counts: Box<Counts>,
    /// 1 where nothing may be cleared in this frame.
    guarded: Vec<u8>,
    obstacles: Vec<Sighting>,
    floors: Vec<u32>,
    silent: Vec<u32>,
    guards: Vec<u32>,
}

impl Evidence {
    pub(crate) fn new(columns: Columns) -> Self {
        Self {
            columns,
            counts: new_counts(),
            guarded: vec![0; CELLS],
            obstacles: Vec::with_capacity(CELLS),
            floors: Vec::with_capacity(CELLS),
            silent: Vec::with_capacity(CELLS),
            guards: Vec::with_capacity(8 * CELLS),
        }
    }

    /// Takes one frame, seen through `lens`, into the grid.
    pub(crate) fn take(&mut self, frame: &DepthFrame, lens: &Lens, config: &Config, grid: &mut Grid) {
        self.columns.count(frame, lens, config, &mut self.counts);
        self.sort(lens, config, grid);
        for guard in 0..self.obstacles.len() {
            self.guard(self.obstacles[guard].cell, lens);
        }
        for sighting in &self.obstacles {
            let (x, y) = place(sighting.cell);
            grid.add(grid.index(x, y), sighting.delta, sighting.bands, &lens.now);
        }
        for &cell in &self.floors {
            if self.guarded[cell as usize] != 0 {
                continue;
            }
            let (x, y) = place(cell);
            let index = grid.index(x, y);
            let clear = match grid.log_odds_now(index, &lens.now) {
                Some(log_odds) if log_odds > 0.0 || grid.bands[index] != 0 => {
                    looked_through(frame, lens, config, cell, grid.bands[index])
                }
                _ => true,
            };
            if clear {
                let trust = trust_at(lens, lens.depth_m(x as f32 + 0.5, y as f32 + 0.5, 0.0));
                grid.add(index, -config.miss_log_odds * trust, 0, &lens.now);
            }
        }
        self.clear_silent(frame, lens, config, grid);
        for guard in self.guards.drain(..) {
            self.guarded[guard as usize] = 0;
        }
    }

    /// Sorts the cells in reach by what was counted there, and sets the counters back to zero.
    fn sort(&mut self, lens: &Lens, config: &Config, grid: &Grid) {
        self.obstacles.clear();
        self.floors.clear();
        self.silent.clear();
        let [x_from, x_to, y_from, y_to] = lens.reach(config.far_m);
        let square_px = lens.pixels_at_1_m(config.support_side_m);
        let needed =
            |depth_m: f32| (square_px / (depth_m * depth_m).max(0.01)).max(config.support_min_px as f32);
        for y in y_from..y_to {
            let row = &mut self.counts[y * SIDE * CLASSES..][..SIDE * CLASSES];
            let cells = row.chunks_exact_mut(CLASSES).enumerate().take(x_to).skip(x_from);
            for (x, count) in cells {
                let cell = (y * SIDE + x) as u32;
                let bands = [count[1], count[2], count[3]];
                let solid = (bands[0] + bands[1] + bands[2]) as f32;
                let floor = count[0] as f32;
                if count[0] == 0 && solid < 1.0 {
                    let stored = grid.log_odds[grid.index(x, y)] > 0.0;
                    if stored || (x + 2 * y) as u32 % ASK_EVERY == lens.now.tick / 3 % ASK_EVERY {
                        self.silent.push(cell);
                    }
                    continue;
                }
                count.fill(0);
                let (x, y) = (x as f32 + 0.5, y as f32 + 0.5);
                let depth_m = lens.depth_m(x, y, OBSTACLE_HEIGHT_M);
                let needed_solid = needed(depth_m);
                if solid >= needed_solid {
                    let strong = solid >= STRONG * needed_solid;
                    let hit = if strong { config.strong_hit_log_odds } else { config.hit_log_odds };
                    let delta = hit * trust_at(lens, depth_m);
                    self.obstacles.push(Sighting { cell, delta, bands: seen_bands(bands, needed_solid) });
                } else if 2.0 * solid < needed_solid && floor >= needed(lens.depth_m(x, y, 0.0)) {
                    self.floors.push(cell);
                }
            }
        }
    }

    /// Marks the cells before and behind an obstacle that its noise may reach.
    fn guard(&mut self, cell: u32, lens: &Lens) {
        let (x, y) = place(cell);
        let (x, y) = (x as f32 + 0.5, y as f32 + 0.5);
        let depth_m = lens.depth_m(x, y, OBSTACLE_HEIGHT_M);
        let spread = 2.0 * lens.sigma_at_1_m * depth_m * depth_m / CELL_M as f32;
        let reach = (spread + 0.5).clamp(0.0, 4.0) as i32;
        let (along_x, along_y) = (x - lens.eye[0], y - lens.eye[1]);
        let length = (along_x * along_x + along_y * along_y).sqrt().max(1e-3);
        for step in -reach..=reach {
            let part = step as f32 / length;
            let (x, y) = (x + part * along_x, y + part * along_y);
            let side = SIDE as f32;
            if x >= 0.0 && x < side && y >= 0.0 && y < side {
                let cell = y as usize * SIDE + x as usize;
                self.guarded[cell] = 1;
                // At most nine per obstacle; beyond the room taken, the mark would never be removed.
                if self.guards.len() < self.guards.capacity() {
                    self.guards.push(cell as u32);
                } else {
                    self.guarded[cell] = 0;
                }
            }
        }
    }

    /// Clears cells without any return where rays pass through the whole band.
    fn clear_silent(&self, frame: &DepthFrame, lens: &Lens, config: &Config, grid: &mut Grid) {
        for &cell in &self.silent {
            if self.guarded[cell as usize] != 0 {
                continue;
            }
            let (x, y) = place(cell);
            let index = grid.index(x, y);
            let held = grid.log_odds_now(index, &lens.now).map_or(0, |_| grid.bands[index]);
            if looked_through(frame, lens, config, cell, held) && has_floor(frame, lens, config, cell) {
                let trust = trust_at(lens, lens.depth_m(x as f32 + 0.5, y as f32 + 0.5, 0.0));
                grid.add(index, -config.miss_log_odds * trust, 0, &lens.now);
            }
        }
    }
}

fn place(cell: u32) -> (usize, usize) {
    (cell as usize % SIDE, cell as usize / SIDE)
}

/// Part of a sighting that belongs to its own cell, when the noise is wider than the cell.
fn trust_at(lens: &Lens, depth_m: f32) -> f32 {
    let spread = 2.0 * lens.sigma_at_1_m * depth_m * depth_m / CELL_M as f32;
    1.0 / (1.0 + spread * spread).sqrt()
}

/// The height bands with support of their own, at least the strongest; an overhang where the lowest has none.
fn seen_bands(counts: [u32; BANDS], needed: f32) -> u8 {
    let most = counts.iter().copied().fold(0, u32::max);
    let mut bands = 0;
    for (band, &count) in counts.iter().enumerate() {
        if count == most || count as f32 >= needed {
            bands |= 1 << band;
        }
    }
    if bands & 1 == 0 { bands | OVERHANG } else { bands }
}

/// Whether the ray to a point just below the floor of a cell is measured to end before it, as it does at a floor. Over a
/// hole, or a stair that leads down, it goes on; what can be looked through is not yet something to stand on.
fn has_floor(frame: &DepthFrame, lens: &Lens, config: &Config, cell: u32) -> bool {
    let (x, y) = place(cell);
    let (x, y) = (x as f32 + 0.5, y as f32 + 0.5);
    let below_m = config.hole_cut_m + config.floor_cut_per_m * lens.depth_m(x, y, 0.0).max(0.0);
    lens.pixel(x, y, -below_m).is_some_and(|(pixel, depth_m)| {
        let raw = frame.pixels.get(pixel).copied().unwrap_or(0);
        raw != 0 && raw != u16::MAX && lens.metres(raw) < depth_m
    })
}

/// Whether rays pass through a cell at all heights from the floor cut up to the top of the bands held there (of the
/// whole band where none is held), each ending clearly behind it. A third of the pixels may be without measurement.
/// What stood on the floor is gone when its lower part is, so that its upper part may be out of view; an overhang may not.
fn looked_through(frame: &DepthFrame, lens: &Lens, config: &Config, cell: u32, bands: u8) -> bool {
    let (x, y) = place(cell);
    let (x, y) = (x as f32 + 0.5, y as f32 + 0.5);
    let highest = if bands == 0 { BANDS } else { 8 - (bands & ALL_BANDS).leading_zeros() as usize };
    let stood = bands & ALL_BANDS != 0 && bands & OVERHANG == 0;
    let third_m = config.band_top_m / BANDS as f32;
    let top_m = third_m * highest as f32;
    let depth_m = lens.depth_m(x, y, 0.0);
    if depth_m > config.far_m {
        return false;
    }
    let bottom_m = config.floor_cut_m + config.floor_cut_per_m * depth_m.max(0.0);
    let behind_m = HALF_DIAGONAL_M + 2.0 * lens.sigma_at_1_m * depth_m * depth_m;
    let steps = ((top_m - bottom_m) / HEIGHT_STEP_M).clamp(1.0, 100.0) as u32;
    let mut unmeasured = 0;
    for step in 0..=steps {
        let height_m = bottom_m + (top_m - bottom_m) * step as f32 / steps as f32;
        let Some((pixel, depth_m)) = lens.pixel(x, y, height_m) else {
            return stood && height_m > third_m;
        };
        let raw = frame.pixels.get(pixel).copied().unwrap_or(0);
        if raw == 0 || raw == u16::MAX {
            unmeasured += 1;
            if 3 * unmeasured > steps {
                return false;
            }
        } else if lens.metres(raw) < depth_m + behind_m {
            return false;
        }
    }
    true
}

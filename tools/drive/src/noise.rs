//! The mapper's errors on maps drawn from the world itself: cells before a surface that are taken, cells of it that are free.
//!
//! How often they come depends on the band that a cell lies in, before or behind the surface, and on its distance from the
//! robot. They stay with the place for as long as the mapper remembers; what lies before surfaces comes in runs along them.

use sidestep_msgs::{Grid, LOCAL_GRID, Pose2, Robot, SAFETY_CELLS, SAFETY_GRID};
use sidestep_sim::{Solid, draw, mix, near, seen_from};

/// `[m]` bands before surfaces: what stands there, grown by so much, touches a cell.
pub const GROWN_M: [f32; 5] = [0.15, 0.1, 0.05, 0.025, 0.01];
/// `[m]` bands from surfaces inward: what stands there, shrunk by so much, still touches a cell.
pub const SHRUNK_M: [f32; 4] = [0.0, -0.01, -0.025, -0.05];
/// Band of the cells that the footprint touches and nothing else does.
pub const UNDER: usize = GROWN_M.len() + 1;
/// Band of the cells that no camera sees into.
const DEEP: usize = BANDS - 1;
/// Bands: first the cells far from everything, then those of [`GROWN_M`], [`UNDER`], those of [`SHRUNK_M`].
pub const BANDS: usize = UNDER + 1 + SHRUNK_M.len();

/// `[m]` cells nearer to the robot than this have the first row of a table, those beyond the second: nearer, the camera
/// does not see the floor any more.
pub const NEAR_M: f64 = 1.2;

/// `[1]` share of the cells of each band that are taken, near and far.
type Chances = [[f32; BANDS]; 2];

/// Measured: `cargo run --release -p sidestep-navigate --example map_noise 9 120 30`, cells seen in the last 3 s by the mapper
/// behind a camera of 320x240 pixels. Far from everything nothing is taken, though there the maps of the mapper show one to
/// three cells in a thousand. Deeper than 5 cm everything is: no camera sees into a solid, and the mapper marks surfaces.
const OF_SAFETY: Chances = [
    [0.0, 0.0088, 0.0832, 0.2778, 0.5120, 0.8169, 0.0, 0.9296, 0.9591, 0.9834, 1.0],
    [0.0, 0.0889, 0.3932, 0.6867, 0.8199, 0.9433, 0.0, 0.9788, 0.9872, 0.9973, 1.0],
];
/// As [`OF_SAFETY`], of the larger cells of the local map.
const OF_LOCAL: Chances = [
    [0.0, 0.0245, 0.1734, 0.4190, 0.6411, 0.7734, 0.0, 0.8632, 0.9355, 0.9683, 1.0],
    [0.0, 0.1251, 0.3853, 0.6702, 0.8205, 0.9009, 0.0, 0.9403, 0.9753, 0.9896, 1.0],
];
/// `[m]` an error before a surface fills a square of the floor this wide: two cells 0.4 m apart agree in two thirds of
/// what chance would leave open (measured as [`OF_SAFETY`]).
const RUN_M: f64 = 1.0;
/// `[m]` an error of the surface itself is one cell. The measured ones come in short runs, but where a solid was only begun
/// to be seen and its other cells are unknown. Of the solids of which something is known the mapper hides, with every cell
/// known and free, six poles in ten thousand looks and hardly anything wider; cells drawn one by one, 22 poles near by and
/// nothing wider.
const SPOT_M: f64 = 0.05;
/// `[ns]` how long an error lasts: after 2 s, 19 of 20 are still there (measured as [`OF_SAFETY`]).
const SPAN_NS: u64 = 30_000_000_000;

/// What makes a cell free or taken: what stands round the robot, and the robot.
#[derive(Debug, Clone, Copy)]
pub struct Outlook<'a> {
    /// Whatever stands in the robot's way, in the world.
    pub solids: &'a [Solid],
    /// True pose in the world.
    pub pose: Pose2,
    /// The footprint in `base`, as [`body`] makes it.
    pub body: Solid,
}

impl Outlook<'_> {
    /// Fills `out` with the band of each cell of a map; `frame` is that of the map in `base`.
    pub fn bands(&self, frame: &Pose2, grid: &Grid, out: &mut [u8]) {
        let world = self.pose.compose(frame);
        let mut growth_m = [f32::INFINITY; SAFETY_CELLS];
        let growth_m = &mut growth_m[..out.len()];
        for solid in self.solids {
            near(&seen_from(solid, &world), f64::from(GROWN_M[0]), grid, growth_m);
        }
        out.fill(0);
        draw(&seen_from(&self.body, frame), grid, out);
        let is_near = |(band, growth_m): &(&mut u8, &mut f32)| **band > 0 || **growth_m < f32::INFINITY;
        for (band, growth_m) in out.iter_mut().zip(growth_m).filter(is_near) {
            let past = |edges_m: &[f32]| {
                edges_m.iter().map(|edge_m| usize::from(*growth_m <= *edge_m)).sum::<usize>()
            };
            let number = match *growth_m {
                ..=0.0 => UNDER + past(&SHRUNK_M),
                _ if *band > 0 => UNDER,
                _ => past(&GROWN_M),
            };
            *band = number as u8;
        }
    }
}

/// The errors of a drive: equal seeds err equally.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Noise(pub(crate) u64);

/// One of the two maps.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Sheet<'a> {
    pub(crate) grid: &'a Grid,
    /// Its frame in `odom`.
    pub(crate) frame: Pose2,
    /// Pose of the robot there.
    pub(crate) base: Pose2,
    /// How often its cells are taken.
    pub(crate) chances: &'a Chances,
}

impl Sheet<'_> {
    /// The local map round a pose.
    pub(crate) fn local(base: Pose2) -> Self {
        Self { grid: &LOCAL_GRID, frame: base, base, chances: &OF_LOCAL }
    }

    /// The safety map in a frame.
    pub(crate) fn safety(frame: Pose2, base: Pose2) -> Self {
        Self { grid: &SAFETY_GRID, frame, base, chances: &OF_SAFETY }
    }
}

impl Noise {
    /// Gives the errors of a time to a map without any.
    pub(crate) fn spoil(self, sheet: &Sheet<'_>, outlook: &Outlook<'_>, now_ns: u64, occupancy: &mut [u8]) {
        let Sheet { grid, frame, base, chances } = sheet;
        let mut bands = [0; SAFETY_CELLS];
        let bands = &mut bands[..occupancy.len()];
        outlook.bands(&base.relative(frame), grid, bands);
        let (sin, cos) = libm::sincos(frame.yaw_rad);
        for (index, (cell, band)) in occupancy.iter_mut().zip(bands).enumerate() {
            let band = usize::from(*band);
            // Nothing is drawn where the mapper does not err.
            if matches!(band, 0 | UNDER | DEEP) {
                continue;
            }
            let (x, y) = grid.centre(index / grid.side, index % grid.side);
            let (x, y) = (f64::from(x), f64::from(y));
            let place = [frame.x_m + cos * x - sin * y, frame.y_m + sin * x + cos * y];
            let (dx, dy) = (place[0] - base.x_m, place[1] - base.y_m);
            let far = dx * dx + dy * dy >= NEAR_M * NEAR_M;
            let side_m = if band < UNDER { RUN_M } else { SPOT_M };
            let taken = self.drawn(place, side_m, now_ns) < chances[usize::from(far)][band];
            *cell = if taken { u8::MAX } else { 0 };
        }
    }

    /// A number in [0, 1) that stays what it is in a square of the floor for a span; each square begins its spans when it
    /// will.
    fn drawn(self, place: [f64; 2], side_m: f64, now_ns: u64) -> f32 {
        let [x, y] = place.map(|part| libm::floor(part / side_m) as i32 as u32);
        let square = mix(self.0, u64::from(x) << 32 | u64::from(y));
        let spans = (now_ns + square % SPAN_NS) / SPAN_NS;
        (mix(square, spans) >> 40) as f32 / (1_u32 << 24) as f32
    }
}

/// The rectangle round the footprint, as a solid in `base`.
#[must_use]
pub fn body(robot: &Robot) -> Solid {
    let bounds = |part: usize| {
        let along = robot.footprint.polygon_m.iter().map(|corner| f64::from(corner[part]));
        along.fold((f64::INFINITY, f64::NEG_INFINITY), |(least, most), at| (least.min(at), most.max(at)))
    };
    let ((rear, front), (right, left)) = (bounds(0), bounds(1));
    Solid::block([0.5 * (rear + front), 0.5 * (right + left)], [front - rear, left - right], 0.0, [0.0, 1.0])
}

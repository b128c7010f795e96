//! What a stereo camera makes of exact depth: noise of the disparity, dropouts, fattened edges, limits, millimetres.
//!
//! The form is that of Keselman et al. 2017 for this family of cameras: sigma_z = z^2 sigma_d / (f B). Noise comes from
//! a fixed table read at an offset drawn per row and frame.

use crate::random::{Random, mix};
use crate::raster::View;
use sidestep_msgs::Camera;

/// `[m]` per unit of a pixel.
pub(crate) const UNIT_M: f32 = 0.001;
/// Entries of the table; a power of two.
const TABLE: usize = 1 << 15;
/// `[px]` most columns.
const WIDTH_MAX: usize = 640;
/// `[1]` of 256: pixels lost anywhere.
const LOST: f32 = 8.0;
/// `[1]` of 256, per unit of the tangent of incidence beyond [`GRAZING`]: pixels lost on grazing surfaces and edges.
const LOST_GRAZING: f32 = 6.0;
/// `[1]` tangent of incidence from which pixels are lost.
const GRAZING: f32 = 6.0;
/// `[1]` of 256: most pixels lost, at edges.
const LOST_MOST: f32 = 110.0;
/// `[1]` of 256, per metre beyond the range of use.
const LOST_FAR: f32 = 30.0;
/// `[1]` ratio of inverse depths from which a neighbour is another surface.
const EDGE: f32 = 1.06;
/// `[1]` a measurement is possible up to this multiple of the range of use.
pub(crate) const FAR_FACTOR: f32 = 2.0;

/// The camera's errors.
#[derive(Debug, Clone)]
pub(crate) struct Stereo {
    /// Standard normal, times the standard deviation of the inverse depth, neighbours correlated.
    noise: Vec<f32>,
    /// Uniform in [0, 256).
    chance: Vec<f32>,
    near_inverse: f32,
    far_inverse: f32,
    used_inverse: f32,
    seed: u64,
}

/// Rows that the measurement of one row needs.
struct Rows<'a> {
    above: &'a [f32],
    here: &'a [f32],
    below: &'a [f32],
}

impl Stereo {
    pub(crate) fn new(camera: &Camera, noise: bool, seed: u64) -> Self {
        let mut random = Random::new(mix(seed, 4));
        let sigma =
            if noise { camera.disparity_sigma_px / (camera.focal_px * camera.baseline_m) } else { 0.0 };
        let white: Vec<f32> = (0..TABLE).map(|_| random.normal() as f32).collect();
        // A matching window makes neighbours alike: half of the variance is shared over five pixels.
        let shared = |i: usize| (0..5).map(|k| white[(i + k + 997) % TABLE]).sum::<f32>() / libm::sqrtf(5.0);
        let mixed = |i: usize| sigma * libm::sqrtf(0.5) * (white[i] + shared(i));
        Self {
            noise: (0..TABLE).map(mixed).collect(),
            chance: (0..TABLE).map(|_| (256.0 * random.unit()) as f32).collect(),
            near_inverse: 1.0 / camera.near_m,
            far_inverse: 1.0 / (FAR_FACTOR * camera.far_m),
            used_inverse: 1.0 / camera.far_m,
            seed,
        }
    }

    /// Exact millimetres within the limits.
    pub(crate) fn exact(&self, inverse_m: &[f32], out: &mut [u16]) {
        for (pixel, inverse) in out.iter_mut().zip(inverse_m) {
            let seen = *inverse <= self.near_inverse && *inverse >= self.far_inverse;
            *pixel = units(if seen { 1.0 / (UNIT_M * inverse) } else { 0.0 });
        }
    }

    /// Noisy millimetres of frame `number`.
    pub(crate) fn measure(&self, inverse_m: &[f32], view: &View, number: u64, out: &mut [u16]) {
        let (width, height) = (view.width, view.height);
        let row_of = |row: usize| &inverse_m[row * width..(row + 1) * width];
        let mut random = Random::new(mix(self.seed, number.wrapping_add(1 << 32)));
        let mut fat = [0.0_f32; WIDTH_MAX];
        let mut lost = [0.0_f32; WIDTH_MAX];
        for (row, line) in out.chunks_exact_mut(width).enumerate().take(height) {
            let rows = Rows {
                above: row_of(row.saturating_sub(1)),
                here: row_of(row),
                below: row_of((row + 1).min(height - 1)),
            };
            fatten(rows.here, &mut fat[..width]);
            chance_of_loss(&rows, view.focal[0], &mut lost[..width]);
            let drawn = random.bits() as usize;
            let noise = &self.noise[drawn % (TABLE - WIDTH_MAX)..][..width];
            let chance = &self.chance[(drawn >> 20) % (TABLE - WIDTH_MAX)..][..width];
            self.row(&fat[..width], &lost[..width], noise, chance, line);
        }
    }

    fn row(&self, fat: &[f32], lost: &[f32], noise: &[f32], chance: &[f32], out: &mut [u16]) {
        let per_inverse_m = LOST_FAR / (self.used_inverse * self.used_inverse);
        for ((((pixel, inverse), lost), noise), chance) in
            out.iter_mut().zip(fat).zip(lost).zip(noise).zip(chance)
        {
            let far = (self.used_inverse - inverse).max(0.0) * per_inverse_m;
            let found = inverse + noise;
            let seen = (found <= self.near_inverse)
                & (found >= self.far_inverse)
                & (*inverse >= self.far_inverse)
                & (*chance >= lost + far);
            let depth = 1.0 / (UNIT_M * found.max(1e-3));
            *pixel = units(if seen { depth } else { 0.0 });
        }
    }
}

/// Rounds to the nearest whole unit: the lowest bits of a float just above 2^23 are an integer.
fn units(depth: f32) -> u16 {
    (depth + 8_388_608.0).to_bits() as u16
}

/// A nearer neighbour on either side grows over the pixel.
fn fatten(row: &[f32], out: &mut [f32]) {
    let last = row.len() - 1;
    out[0] = row[0];
    out[last] = row[last];
    for (window, out) in row.windows(3).zip(&mut out[1..last]) {
        let nearest = window[0].max(window[2]);
        *out = if nearest > EDGE * window[1] { nearest } else { window[1] };
    }
}

/// Of 256: how likely a pixel is lost, from the slope of the surface; an edge is a very steep slope.
fn chance_of_loss(rows: &Rows, focal: f32, out: &mut [f32]) {
    let last = rows.here.len() - 1;
    out[0] = LOST;
    out[last] = LOST;
    let half_focal = 0.5 * focal;
    let vertical = rows.above[1..last].iter().zip(&rows.below[1..last]);
    for ((window, (above, below)), out) in rows.here.windows(3).zip(vertical).zip(&mut out[1..last]) {
        let change = (window[2] - window[0]).abs().max((below - above).abs());
        let tangent = change * half_focal / window[1].max(1e-3);
        *out = (LOST + LOST_GRAZING * (tangent - GRAZING).max(0.0)).min(LOST_MOST);
    }
}

//! Box plots: quartiles, whiskers and outliers, as Tukey draws them.

use crate::axis::{Area, Axis};
use crate::canvas::{Canvas, Figure};
use crate::style::Ink;
use std::collections::BTreeSet;

/// Width of a figure of which two stand side by side.
pub(crate) const HALF_WIDTH: f64 = 470.0;
/// Steps of half a pixel at which outliers are told apart.
const OUTLIER_STEPS_PER_PX: f64 = 2.0;

/// What a box shows of its samples.
#[derive(Debug, Clone, PartialEq)]
pub struct Spread {
    /// Samples.
    pub count: usize,
    /// A quarter of them is at most this.
    pub lower: f64,
    /// Half of them is at most this.
    pub median: f64,
    /// Three quarters of them are at most this.
    pub upper: f64,
    /// The least and the largest within 1.5 box lengths of the box.
    pub whiskers: (f64, f64),
    /// Those beyond, by size.
    pub outliers: Vec<f64>,
}

impl Spread {
    /// The spread of the finite ones of these samples; `None` where there is none.
    #[must_use]
    pub fn of(samples: impl IntoIterator<Item = f64>) -> Option<Self> {
        let mut sorted: Vec<f64> = samples.into_iter().filter(|value| value.is_finite()).collect();
        sorted.sort_by(f64::total_cmp);
        let last = sorted.len().checked_sub(1)?;
        let at = |part: f64| {
            let place = part * last as f64;
            let below = place.floor() as usize;
            let above = (below + 1).min(last);
            sorted[below] + (place - below as f64) * (sorted[above] - sorted[below])
        };
        let (lower, median, upper) = (at(0.25), at(0.5), at(0.75));
        let reach = 1.5 * (upper - lower);
        let inside = |value: &&f64| (lower - reach..=upper + reach).contains(*value);
        let least = sorted.iter().find(inside).copied().unwrap_or(median);
        let most = sorted.iter().rev().find(inside).copied().unwrap_or(median);
        let outliers = sorted.iter().filter(|value| !inside(value)).copied().collect();
        Some(Self { count: sorted.len(), lower, median, upper, whiskers: (least, most), outliers })
    }
}

/// Boxes side by side over one axis.
#[derive(Debug, Clone, PartialEq)]
pub struct Boxes {
    /// What the plot shows.
    pub title: String,
    /// The axis at the left.
    pub y: Axis,
    /// Names, colours and what is known of the samples.
    pub boxes: Vec<(String, Ink, Spread)>,
    /// Values of y to mark, with their names.
    pub marks: Vec<(f64, String)>,
}

impl Boxes {
    /// Draws the plot.
    #[must_use]
    pub fn figure(&self) -> Figure {
        const HEIGHT: f64 = 330.0;
        let mut canvas = Canvas::default();
        let area = Area { left: 74.0, top: 38.0, right: HALF_WIDTH - 14.0, bottom: HEIGHT - 48.0 };
        let values = self.boxes.iter().flat_map(|(_, _, spread)| {
            spread.outliers.iter().copied().chain([spread.whiskers.0, spread.whiskers.1])
        });
        let marked = self.marks.iter().map(|mark| mark.0);
        let y = self.y.scale(values.chain(marked), (area.bottom, area.top));
        canvas.text(area.left, 20.0, "strong", &self.title);
        area.beside(&mut canvas, &y, &self.y.title(), 5);
        canvas.line((area.left, area.bottom), (area.right, area.bottom), "axis");
        for (value, name) in &self.marks {
            canvas.line((area.left, y.at(*value)), (area.right, y.at(*value)), "axis dash");
            canvas.text(area.right - 2.0, y.at(*value) - 5.0, "small soft e", name);
        }
        let room = (area.right - area.left) / self.boxes.len().max(1) as f64;
        for (index, (name, ink, spread)) in self.boxes.iter().enumerate() {
            let centre = area.left + (index as f64 + 0.5) * room;
            one(&mut canvas, &|value| y.at(value), (centre, (0.2 * room).min(34.0)), *ink, spread);
            canvas.text(centre, area.bottom + 19.0, "small m", name);
            canvas.text(centre, area.bottom + 36.0, "small soft m", &format!("{} samples", spread.count));
        }
        canvas.figure(&self.title, HALF_WIDTH, HEIGHT)
    }
}

fn one(canvas: &mut Canvas, at: &dyn Fn(f64) -> f64, place: (f64, f64), ink: Ink, spread: &Spread) {
    let (centre, half) = place;
    let (line, name) = (format!("line s-{}", ink.name()), ink.name());
    // Many outliers fall on the same pixels: each place is drawn once.
    let outliers: BTreeSet<i64> =
        spread.outliers.iter().map(|value| (at(*value) * OUTLIER_STEPS_PER_PX).round() as i64).collect();
    let dots: Vec<[(f64, f64); 1]> =
        outliers.iter().map(|step| [(centre, *step as f64 / OUTLIER_STEPS_PER_PX)]).collect();
    canvas.paths(dots.iter().map(<[_; 1]>::as_slice), &format!("dots s-{name}"));
    let (lower, upper) = (at(spread.lower), at(spread.upper));
    for (end, edge) in [(at(spread.whiskers.0), lower), (at(spread.whiskers.1), upper)] {
        canvas.line((centre, edge), (centre, end), &line);
        canvas.line((centre - 0.5 * half, end), (centre + 0.5 * half, end), &line);
    }
    let corners = [(-half, upper), (half, upper), (half, lower), (-half, lower)];
    let corners = corners.map(|(dx, y)| (centre + dx, y));
    canvas.polygon(&corners, &format!("f-{name} s-{name}"), "fill-opacity:.22;stroke-width:1.6");
    let median = at(spread.median);
    canvas.line((centre - half, median), (centre + half, median), &format!("{line} median"));
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_spread_is_that_of_tukey() {
        let spread = Spread::of((1..=9).map(f64::from).chain([40.0, f64::NAN])).unwrap();
        assert_eq!(spread.count, 10);
        assert!((spread.median - 5.5).abs() < 1e-9 && (spread.lower - 3.25).abs() < 1e-9);
        assert!((spread.upper - 7.75).abs() < 1e-9 && (spread.whiskers.1 - 9.0).abs() < 1e-9);
        assert_eq!(spread.outliers.len(), 1);
        assert_eq!(Spread::of([f64::NAN]), None);
    }
}

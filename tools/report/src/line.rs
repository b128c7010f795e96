//! Lines over time, thinned to what the picture can show.

use crate::axis::{Area, Axis};
use crate::canvas::{Canvas, Figure};
use crate::style::Ink;

/// Width of every wide figure.
pub(crate) const WIDTH: f64 = 960.0;
/// Columns of pixels in which a line keeps its least and largest value.
const COLUMNS: usize = 480;

/// One line.
#[derive(Debug, Clone, PartialEq)]
pub struct Series {
    /// Its name.
    pub name: String,
    /// Its colour.
    pub ink: Ink,
    /// Points by rising x; a y that is not finite breaks the line.
    pub points: Vec<(f64, f64)>,
}

/// Lines over a common axis.
#[derive(Debug, Clone, PartialEq)]
pub struct LinePlot {
    /// What the plot shows.
    pub title: String,
    /// The axis below.
    pub x: Axis,
    /// The axis at the left.
    pub y: Axis,
    /// The lines; the last one lies on top.
    pub series: Vec<Series>,
    /// Values of y to mark, with their names.
    pub marks: Vec<(f64, String)>,
    /// A step of x larger than this breaks a line.
    pub gap: f64,
    /// Height of the whole figure, for a width of 960.
    pub height: f64,
}

impl LinePlot {
    /// A plot without lines.
    #[must_use]
    pub fn new(title: &str, x: Axis, y: Axis) -> Self {
        let (series, marks) = (Vec::new(), Vec::new());
        Self { title: title.into(), x, y, series, marks, gap: f64::INFINITY, height: 260.0 }
    }

    /// This plot with one more line.
    #[must_use]
    pub fn series(mut self, name: &str, ink: Ink, points: Vec<(f64, f64)>) -> Self {
        self.series.push(Series { name: name.into(), ink, points });
        self
    }

    /// This plot with a value of y marked.
    #[must_use]
    pub fn mark(mut self, y: f64, name: &str) -> Self {
        self.marks.push((y, name.into()));
        self
    }

    /// Draws the plot.
    #[must_use]
    pub fn figure(&self) -> Figure {
        let mut canvas = Canvas::default();
        let area = Area { left: 74.0, top: 38.0, right: WIDTH - 18.0, bottom: self.height - 48.0 };
        let all = || self.series.iter().flat_map(|series| &series.points);
        let x = self.x.scale(all().map(|point| point.0), (area.left, area.right));
        let marked = self.marks.iter().map(|mark| mark.0);
        let y = self.y.scale(all().map(|point| point.1).chain(marked), (area.bottom, area.top));
        canvas.text(area.left, 20.0, "strong", &self.title);
        if self.series.len() > 1 {
            let names: Vec<_> = self.series.iter().map(|series| (series.name.as_str(), series.ink)).collect();
            let width: usize = names.iter().map(|(name, _)| 38 + 7 * name.chars().count()).sum();
            canvas.legend(area.right - width as f64, 20.0, &names);
        }
        area.below(&mut canvas, &x, &self.x.title(), 10);
        area.beside(&mut canvas, &y, &self.y.title(), 4);
        for (value, name) in &self.marks {
            canvas.line((area.left, y.at(*value)), (area.right, y.at(*value)), "axis dash");
            canvas.text(area.right - 4.0, y.at(*value) - 5.0, "small soft e", name);
        }
        for series in &self.series {
            let place = |(a, b): &(f64, f64)| (x.at(*a), y.at(*b));
            let lines: Vec<Vec<_>> = pieces(&series.points, self.gap, (x.low, x.high))
                .iter()
                .map(|piece| piece.iter().map(place).collect())
                .collect();
            canvas.paths(lines.iter().map(Vec::as_slice), &format!("line s-{}", series.ink.name()));
        }
        canvas.figure(&self.title, WIDTH, self.height)
    }
}

/// The unbroken pieces of a line within the range, each column reduced to first, least, largest and last.
fn pieces(points: &[(f64, f64)], gap: f64, (low, high): (f64, f64)) -> Vec<Vec<(f64, f64)>> {
    let column = |x: f64| ((x - low) / (high - low) * COLUMNS as f64) as usize;
    let mut pieces: Vec<Vec<(f64, f64)>> = Vec::new();
    let mut piece: Vec<(f64, f64)> = Vec::new();
    let mut held: Vec<(f64, f64)> = Vec::new();
    let mut last_x = f64::NEG_INFINITY;
    for &(x, y) in points.iter().filter(|(x, _)| (low..=high).contains(x)) {
        let broken = !y.is_finite() || x - last_x > gap;
        if broken || held.last().is_some_and(|last| column(last.0) != column(x)) {
            piece.extend(reduced(&held));
            held.clear();
        }
        if broken && !piece.is_empty() {
            pieces.push(std::mem::take(&mut piece));
        }
        last_x = x;
        if y.is_finite() {
            held.push((x, y));
        }
    }
    piece.extend(reduced(&held));
    if !piece.is_empty() {
        pieces.push(piece);
    }
    pieces
}

/// First, least, largest and last point, in their order and each once.
fn reduced(points: &[(f64, f64)]) -> Vec<(f64, f64)> {
    if points.len() <= 2 {
        return points.to_vec();
    }
    let by = |a: &usize, b: &usize| points[*a].1.total_cmp(&points[*b].1);
    let least = (0..points.len()).min_by(by).unwrap_or(0);
    let most = (0..points.len()).max_by(by).unwrap_or(0);
    let mut kept = [0, least, most, points.len() - 1];
    kept.sort_unstable();
    let mut reduced: Vec<_> = kept.iter().map(|&index| points[index]).collect();
    reduced.dedup();
    reduced
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn thinning_keeps_every_peak() {
        let mut points: Vec<_> = (0..100_000).map(|i| (f64::from(i), f64::from(i % 7) * 0.1)).collect();
        points[54_321].1 = 9.0;
        points[77_777].1 = -9.0;
        let kept = pieces(&points, f64::INFINITY, (0.0, 100_000.0));
        assert_eq!(kept.len(), 1);
        assert!(kept[0].len() <= 4 * (COLUMNS + 1), "{}", kept[0].len());
        assert!(kept[0].contains(&(54_321.0, 9.0)) && kept[0].contains(&(77_777.0, -9.0)));
    }

    #[test]
    fn a_gap_and_a_value_that_is_none_break_the_line() {
        let points = [(0.0, 1.0), (1.0, 1.0), (2.0, f64::NAN), (3.0, 1.0), (9.0, 1.0)];
        assert_eq!(pieces(&points, 2.0, (0.0, 10.0)).len(), 3);
    }
}

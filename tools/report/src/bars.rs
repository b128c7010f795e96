//! Bars: amounts by name, or how often values fall into each of some ranges.

use crate::axis::{Area, Axis};
use crate::boxes::HALF_WIDTH;
use crate::canvas::{Canvas, Figure, number};
use crate::style::Ink;

/// Bars that lie, one below the other, each with its name and its amount; or a histogram that stands.
#[derive(Debug, Clone, PartialEq)]
pub struct Bars {
    /// What the plot shows.
    pub title: String,
    /// What the bars measure.
    pub amount: Axis,
    /// Names, colours and amounts.
    pub bars: Vec<(String, Ink, f64)>,
}

impl Bars {
    /// Draws named bars.
    #[must_use]
    pub fn figure(&self) -> Figure {
        const ROW: f64 = 28.0;
        let longest = self.bars.iter().map(|bar| bar.0.chars().count()).max().unwrap_or(0);
        let left = (16.0 + 7.0 * longest as f64).min(330.0);
        let bottom = 36.0 + ROW * self.bars.len() as f64;
        let area = Area { left, top: 32.0, right: 860.0, bottom };
        let mut canvas = Canvas::default();
        canvas.text(4.0, 20.0, "strong", &self.title);
        let x = self.amount.scale(self.bars.iter().map(|bar| bar.2).chain([0.0]), (area.left, area.right));
        area.below(&mut canvas, &x, &self.amount.title(), 8);
        for (index, (name, ink, amount)) in self.bars.iter().enumerate() {
            let top = area.top + 6.0 + ROW * index as f64;
            canvas.text(left - 8.0, top + 14.5, "small e", name);
            let end = x.at(*amount);
            canvas.rect((left, top), (end - left, ROW - 9.0), &format!("f-{}", ink.name()));
            canvas.text(end + 6.0, top + 14.5, "small", &number(*amount, 2));
        }
        canvas.figure(&self.title, 960.0, bottom + 46.0)
    }

    /// Draws how often the finite ones of `values` fall into each of `count` equal ranges.
    #[must_use]
    pub fn histogram(title: &str, values: &[f64], x: &Axis, count: usize, ink: Ink) -> Figure {
        const HEIGHT: f64 = 300.0;
        let area = Area { left: 74.0, top: 38.0, right: HALF_WIDTH - 14.0, bottom: HEIGHT - 48.0 };
        let scale = x.scale(values.iter().copied(), (area.left, area.right));
        let mut counts = vec![0_u64; count.max(1)];
        let width = (scale.high - scale.low) / counts.len() as f64;
        for value in values.iter().filter(|value| value.is_finite()) {
            let place = ((value - scale.low) / width).clamp(0.0, counts.len() as f64 - 1.0) as usize;
            counts[place] += 1;
        }
        let most = counts.iter().copied().max().unwrap_or(0).max(1) as f64;
        let y = Axis::new("samples", "").scale([0.0, most].into_iter(), (area.bottom, area.top));
        let mut canvas = Canvas::default();
        canvas.text(area.left, 20.0, "strong", title);
        area.below(&mut canvas, &scale, &x.title(), 6);
        area.beside(&mut canvas, &y, "samples", 4);
        for (index, samples) in counts.iter().enumerate().filter(|(_, samples)| **samples > 0) {
            let from = scale.at(scale.low + index as f64 * width);
            let to = scale.at(scale.low + (index + 1) as f64 * width);
            let top = y.at(*samples as f64);
            let size = ((to - from - 1.0).max(0.6), area.bottom - top);
            canvas.rect((from, top), size, &format!("f-{}", ink.name()));
        }
        canvas.figure(title, HALF_WIDTH, HEIGHT)
    }
}

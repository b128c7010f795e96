//! Axes: what is shown, in which unit, over which range, with round ticks.

use crate::canvas::{Canvas, number};

/// An axis.
#[derive(Debug, Clone, PartialEq)]
pub struct Axis {
    /// What is shown.
    pub label: String,
    /// Its unit, such as m/s; empty for none.
    pub unit: String,
    /// Smallest and largest value shown; `None` = those of the data.
    pub range: Option<(f64, f64)>,
}

impl Axis {
    /// An axis over the range of its data.
    #[must_use]
    pub fn new(label: &str, unit: &str) -> Self {
        Self { label: label.into(), unit: unit.into(), range: None }
    }

    /// This axis over a range of one's own.
    #[must_use]
    pub fn over(mut self, least: f64, most: f64) -> Self {
        self.range = Some((least, most));
        self
    }

    /// Label with unit.
    pub(crate) fn title(&self) -> String {
        if self.unit.is_empty() { self.label.clone() } else { format!("{} [{}]", self.label, self.unit) }
    }

    /// The scale from values to pixels; not-finite values do not count.
    pub(crate) fn scale(&self, values: impl Iterator<Item = f64>, pixels: (f64, f64)) -> Scale {
        let (low, high) = self.range.unwrap_or_else(|| {
            let bounds = values
                .filter(|value| value.is_finite())
                .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), value| {
                    (low.min(value), high.max(value))
                });
            let (low, high) = if bounds.0 <= bounds.1 { bounds } else { (0.0, 1.0) };
            let step = step((high - low).max(1e-9), 5);
            let wide = high - low > 1e-9;
            if wide {
                ((low / step).floor() * step, (high / step).ceil() * step)
            } else {
                (low - 0.5, high + 0.5)
            }
        });
        let high = if high > low { high } else { low + 1.0 };
        Scale { low, high, pixels }
    }
}

/// 1, 2 or 5 times a power of ten, so that `span` has about `count` steps.
fn step(span: f64, count: usize) -> f64 {
    let rough = span / count.max(1) as f64;
    let power = decade(rough);
    let part = rough / power;
    power
        * if part < 1.5 {
            1.0
        } else if part < 3.5 {
            2.0
        } else if part < 7.5 {
            5.0
        } else {
            10.0
        }
}

/// The largest power of ten that is not above a positive value.
fn decade(value: f64) -> f64 {
    let mut power = 1.0;
    while power > value && power > 1e-12 {
        power *= 0.1;
    }
    while power * 10.0 <= value && power < 1e12 {
        power *= 10.0;
    }
    power
}

/// From values to pixels.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Scale {
    pub(crate) low: f64,
    pub(crate) high: f64,
    pub(crate) pixels: (f64, f64),
}

impl Scale {
    pub(crate) fn at(&self, value: f64) -> f64 {
        let part = ((value - self.low) / (self.high - self.low)).clamp(-0.02, 1.02);
        self.pixels.0 + part * (self.pixels.1 - self.pixels.0)
    }

    /// Round values within the range, with their texts.
    pub(crate) fn ticks(&self, count: usize) -> Vec<(f64, String)> {
        let step = step(self.high - self.low, count);
        let digits = (0..9).find(|digits| step * 10_f64.powi(*digits) > 0.999).unwrap_or(9) as usize;
        let (first, last) =
            ((self.low / step - 1e-6).ceil() as i64, (self.high / step + 1e-6).floor() as i64);
        (first..=last.min(first + 40))
            .map(|tick| tick as f64 * step)
            .map(|value| (value, number(value, digits)))
            .collect()
    }
}

/// The area that a plot draws into.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Area {
    pub(crate) left: f64,
    pub(crate) top: f64,
    pub(crate) right: f64,
    pub(crate) bottom: f64,
}

impl Area {
    /// Grid, ticks and title of the axis below.
    pub(crate) fn below(&self, canvas: &mut Canvas, scale: &Scale, title: &str, count: usize) {
        for (value, text) in scale.ticks(count) {
            let x = scale.at(value);
            canvas.line((x, self.top), (x, self.bottom), "grid");
            canvas.text(x, self.bottom + 18.0, "small soft m", &text);
        }
        canvas.line((self.left, self.bottom), (self.right, self.bottom), "axis");
        canvas.text(0.5 * (self.left + self.right), self.bottom + 37.0, "small m", title);
    }

    /// Grid, ticks and title of the axis at the left.
    pub(crate) fn beside(&self, canvas: &mut Canvas, scale: &Scale, title: &str, count: usize) {
        for (value, text) in scale.ticks(count) {
            let y = scale.at(value);
            canvas.line((self.left, y), (self.right, y), "grid");
            canvas.text(self.left - 8.0, y + 4.5, "small soft e", &text);
        }
        canvas.upward(self.left - 50.0, 0.5 * (self.top + self.bottom), "small m", title);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ticks_are_round_and_within_the_range() {
        let scale = Axis::new("speed", "m/s").scale([-0.13, 0.52].into_iter(), (0.0, 100.0));
        let texts: Vec<_> = scale.ticks(5).into_iter().map(|(_, text)| text).collect();
        assert_eq!(texts, ["-0.2", "0", "0.2", "0.4", "0.6"]);
        let bounds = Axis::new("", "").scale([f64::NAN].into_iter(), (0.0, 1.0));
        assert!(bounds.low < bounds.high);
    }
}

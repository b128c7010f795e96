//! Bands over time: who drove, and why.

use crate::axis::{Area, Axis};
use crate::canvas::{Canvas, Figure};
use crate::line::WIDTH;
use crate::style::Ink;
use std::collections::BTreeMap;

/// `[px]` a band is at least this wide, so that a short one is seen.
const LEAST_PX: f64 = 1.2;

/// One band.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Span {
    /// Where it begins.
    pub from: f64,
    /// Where it ends.
    pub to: f64,
    /// Its colour.
    pub ink: Ink,
}

/// Rows of bands over a common axis.
#[derive(Debug, Clone, PartialEq)]
pub struct Strip {
    /// What the plot shows.
    pub title: String,
    /// The axis below.
    pub x: Axis,
    /// Names of the rows, and their bands by rising `from`.
    pub rows: Vec<(String, Vec<Span>)>,
    /// What the colours mean.
    pub meanings: Vec<(String, Ink)>,
}

impl Strip {
    /// Draws the rows.
    #[must_use]
    pub fn figure(&self) -> Figure {
        const ROW: f64 = 30.0;
        let longest = self.rows.iter().map(|row| row.0.chars().count()).max().unwrap_or(0);
        let left = (18.0 + 7.0 * longest as f64).clamp(74.0, 260.0);
        let bottom = 38.0 + ROW * self.rows.len() as f64;
        let area = Area { left, top: 34.0, right: WIDTH - 18.0, bottom };
        let spans = self.rows.iter().flat_map(|row| &row.1);
        let x = self.x.scale(spans.flat_map(|span| [span.from, span.to]), (area.left, area.right));
        let mut canvas = Canvas::default();
        canvas.text(left, 20.0, "strong", &self.title);
        let names: Vec<_> = self.meanings.iter().map(|(name, ink)| (name.as_str(), *ink)).collect();
        let width: usize = names.iter().map(|(name, _)| 38 + 7 * name.chars().count()).sum();
        canvas.legend(area.right - width as f64, 20.0, &names);
        area.below(&mut canvas, &x, &self.x.title(), 10);
        for (index, (name, spans)) in self.rows.iter().enumerate() {
            let top = area.top + 4.0 + ROW * index as f64;
            canvas.text(left - 8.0, top + 16.0, "small e", name);
            let shown = spans.iter().filter(|span| span.to >= x.low && span.from <= x.high);
            let (wide, narrow): (Vec<_>, Vec<_>) =
                shown.partition(|span| x.at(span.to) - x.at(span.from) >= LEAST_PX);
            // A short band lies on top, where it is seen, and once for each place and colour.
            let places: BTreeMap<(i64, Ink), &Span> = narrow
                .into_iter()
                .map(|span: &Span| (((x.at(span.from) / (0.5 * LEAST_PX)) as i64, span.ink), span))
                .collect();
            for span in wide.into_iter().chain(places.into_values()) {
                let (from, to) = (x.at(span.from), x.at(span.to).max(x.at(span.from) + LEAST_PX));
                canvas.rect((from, top), (to - from, ROW - 7.0), &format!("f-{}", span.ink.name()));
            }
        }
        canvas.figure(&self.title, WIDTH, bottom + 46.0)
    }
}

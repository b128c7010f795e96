//! Points in a plane; many on one place are drawn once.

use crate::axis::{Area, Axis, Scale};
use crate::boxes::HALF_WIDTH;
use crate::canvas::{Canvas, Figure};
use crate::style::Ink;
use std::collections::BTreeSet;

/// `[px]` points closer than this are one.
const CELL_PX: f64 = 3.0;
/// `[px]` places of a joined line are told apart at this distance.
const STEP_PX: f64 = 1.0;
/// Places of a joined line; of a longer one every second, third and so on is kept.
const PLACES: usize = 6000;

/// So few points are drawn large.
const FEW: usize = 60;

/// Points of one kind.
#[derive(Debug, Clone, PartialEq)]
pub struct Cloud {
    /// Its name.
    pub name: String,
    /// Its colour.
    pub ink: Ink,
    /// The points.
    pub points: Vec<(f64, f64)>,
    /// Whether the points are joined in their order.
    pub joined: bool,
}

/// Points in a plane.
#[derive(Debug, Clone, PartialEq)]
pub struct Scatter {
    /// What the plot shows.
    pub title: String,
    /// The axis below.
    pub x: Axis,
    /// The axis at the left.
    pub y: Axis,
    /// The points; the last cloud lies on top.
    pub clouds: Vec<Cloud>,
    /// A line of one's own over the points, with its name.
    pub guide: Option<(Vec<(f64, f64)>, String)>,
    /// Whether a unit is as long on both axes, as on a map; the figure is then as wide as the page.
    pub equal: bool,
}

impl Scatter {
    /// Draws the plot.
    #[must_use]
    pub fn figure(&self) -> Figure {
        let (width, mut height) = if self.equal { (960.0, 0.0) } else { (HALF_WIDTH, 330.0) };
        let mut area = Area { left: 74.0, top: 38.0, right: width - 14.0, bottom: height - 48.0 };
        let all = || self.clouds.iter().flat_map(|cloud| &cloud.points);
        let x = self.x.scale(all().map(|point| point.0), (area.left, area.right));
        let mut y = self.y.scale(all().map(|point| point.1), (area.bottom, area.top));
        let mut x = x;
        if self.equal {
            let wanted = (area.right - area.left) * (y.high - y.low) / (x.high - x.low);
            let tall = wanted.clamp(160.0, 520.0);
            if wanted > tall {
                let part = tall / wanted;
                area.right = area.left + (area.right - area.left) * part;
                x.pixels.1 = area.right;
            } else {
                // The picture is lower than its least height: more of y is shown.
                let more = 0.5 * (y.high - y.low) * (tall / wanted - 1.0);
                (y.low, y.high) = (y.low - more, y.high + more);
            }
            area.bottom = area.top + tall;
            y.pixels = (area.bottom, area.top);
            height = area.bottom + 48.0;
        }
        let mut canvas = Canvas::default();
        canvas.text(area.left, 20.0, "strong", &self.title);
        if self.clouds.len() > 1 {
            let names: Vec<_> = self.clouds.iter().map(|cloud| (cloud.name.as_str(), cloud.ink)).collect();
            let long: usize = names.iter().map(|(name, _)| 38 + 7 * name.chars().count()).sum();
            canvas.legend((width - 14.0 - long as f64).max(area.left), 20.0, &names);
        }
        area.below(&mut canvas, &x, &self.x.title(), 6);
        area.beside(&mut canvas, &y, &self.y.title(), 5);
        if let Some((points, name)) = &self.guide {
            let points: Vec<_> = points.iter().map(|(a, b)| (x.at(*a), y.at(*b))).collect();
            canvas.path(&points, "axis dash");
            if let Some((right, top)) = points.last() {
                canvas.text(right - 6.0, top + 16.0, "small soft e", name);
            }
        }
        self.clouds.iter().for_each(|cloud| draw(&mut canvas, cloud, &x, &y));
        canvas.figure(&self.title, width, height)
    }
}

fn draw(canvas: &mut Canvas, cloud: &Cloud, x: &Scale, y: &Scale) {
    let inside = |scale: &Scale, value: f64| (scale.low..=scale.high).contains(&value);
    let shown = cloud.points.iter().filter(|(a, b)| inside(x, *a) && inside(y, *b));
    let step_px = if cloud.joined { STEP_PX } else { CELL_PX };
    let cell = |value: f64| (value / step_px).round() as i64;
    let cells = shown.map(|(a, b)| (cell(x.at(*a)), cell(y.at(*b))));
    let centre = |(a, b): (i64, i64)| (a as f64 * step_px, b as f64 * step_px);
    let name = cloud.ink.name();
    if cloud.joined {
        let mut line: Vec<_> = cells.collect();
        line.dedup();
        let stride = line.len().div_ceil(PLACES).max(1);
        let line: Vec<_> = line.into_iter().step_by(stride).map(centre).collect();
        canvas.path(&line, &format!("line s-{name}"));
    } else if cloud.points.len() <= FEW {
        cells.for_each(|place| canvas.circle(centre(place), 6.0, &format!("mark f-{name}")));
    } else {
        let cells: BTreeSet<_> = cells.collect();
        let dots: Vec<[(f64, f64); 1]> = cells.into_iter().map(|place| [centre(place)]).collect();
        canvas.paths(dots.iter().map(<[_; 1]>::as_slice), &format!("dots s-{name}"));
    }
}

//! A map seen from above: cells as one small picture, and what moves drawn over it. x is up, y is left.

use crate::canvas::{Canvas, Figure, number};
use crate::page::ReportError;
use crate::picture::{data_uri, image};
use crate::style::Ink;

/// `[px]` width and height of the map within its figure.
const SIDE_PX: f64 = 272.0;
/// `[px]` room left of the map and above it.
const LEFT_PX: f64 = 44.0;
const TOP_PX: f64 = 46.0;

/// What a cell looks like.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Shade {
    /// Nobody saw it.
    Unknown,
    /// `[0, 1]` how full it is, or how dear.
    Filled(f32),
}

impl Shade {
    /// Cells above the limit of `sharp` are told apart from those below at a glance.
    fn rgba(self, sharp: f32) -> [u8; 4] {
        let blend = |from: [f32; 3], to: [f32; 3], part: f32| -> [u8; 4] {
            let mix = |i: usize| (from[i] + (to[i] - from[i]) * part.clamp(0.0, 1.0)).round() as u8;
            [mix(0), mix(1), mix(2), 255]
        };
        match self {
            Self::Unknown => [216, 222, 230, 255],
            Self::Filled(value) if value <= sharp => {
                blend([253.0, 252.0, 249.0], [236.0, 205.0, 155.0], value / sharp.max(1e-6))
            }
            Self::Filled(value) => {
                blend([160.0, 122.0, 88.0], [74.0, 78.0, 88.0], (value - sharp) / (1.0 - sharp).max(1e-6))
            }
        }
    }
}

/// The cells of a map: row 0 farthest ahead, column 0 farthest left.
#[derive(Debug, Clone, PartialEq)]
pub struct Cells {
    /// Cells along a side.
    pub side: usize,
    /// `[m]` side of a cell.
    pub cell_m: f64,
    /// `[m]` x of the rear edge.
    pub rear_m: f64,
    /// `[m]` y of the right edge.
    pub right_m: f64,
    /// `[0, 1]` cells above this are drawn dark.
    pub limit: f32,
    /// The cells, row by row.
    pub shades: Vec<Shade>,
}

/// Something drawn over a map; points in metres, x ahead, y left.
#[derive(Debug, Clone, PartialEq)]
pub enum Overlay {
    /// A place to go to.
    Goal(f64, f64),
    /// A line through points, dashed or not.
    Line(Vec<(f64, f64)>, Ink, bool),
    /// A line through points that ends in a head, of this width in pixels; a dot where it has no length.
    Arrow(Vec<(f64, f64)>, Ink, f64),
    /// The outline of the robot.
    Footprint(Vec<(f64, f64)>),
}

/// A map with what is drawn over it.
#[derive(Debug, Clone, PartialEq)]
pub struct MapPicture {
    /// What it shows.
    pub title: String,
    /// A second line, smaller.
    pub subtitle: String,
    /// The cells.
    pub cells: Cells,
    /// What lies over them, the last on top.
    pub overlays: Vec<Overlay>,
    /// Lines below the map, each with the ink that it is about.
    pub notes: Vec<(Ink, String)>,
}

impl MapPicture {
    /// Draws the map.
    ///
    /// # Errors
    /// [`ReportError::Pixels`] where the number of cells is not the square of the side.
    pub fn figure(&self) -> Result<Figure, ReportError> {
        let cells = &self.cells;
        let rgba: Vec<u8> = cells.shades.iter().flat_map(|shade| shade.rgba(cells.limit)).collect();
        let uri = data_uri(cells.side as u32, cells.side as u32, &rgba)?;
        let mut canvas = Canvas::default();
        canvas.text(LEFT_PX, 18.0, "strong", &self.title);
        canvas.text(LEFT_PX, 36.0, "small soft", &self.subtitle);
        let extent_m = cells.side as f64 * cells.cell_m;
        let px_per_m = SIDE_PX / extent_m;
        let (front_m, left_m) = (cells.rear_m + extent_m, cells.right_m + extent_m);
        let place = |&(x_m, y_m): &(f64, f64)| {
            (LEFT_PX + (left_m - y_m) * px_per_m, TOP_PX + (front_m - x_m) * px_per_m)
        };
        for metre in cells.rear_m.ceil() as i64..=front_m.floor() as i64 {
            let (_, y) = place(&(metre as f64, 0.0));
            canvas.text(LEFT_PX - 6.0, y + 4.5, "small soft e", &number(metre as f64, 0));
        }
        for metre in cells.right_m.ceil() as i64..=left_m.floor() as i64 {
            let (x, _) = place(&(0.0, metre as f64));
            canvas.text(x, TOP_PX + SIDE_PX + 17.0, "small soft m", &number(metre as f64, 0));
        }
        canvas.text(LEFT_PX - 6.0, TOP_PX + 10.0, "small soft e", "x [m]");
        canvas.text(LEFT_PX + SIDE_PX + 12.0, TOP_PX + SIDE_PX + 17.0, "small soft e", "y [m]");
        canvas.raw(&format!(
            "<g class=\"map\">\n<svg x=\"{LEFT_PX}\" y=\"{TOP_PX}\" width=\"{SIDE_PX}\" height=\"{SIDE_PX}\" \
             viewBox=\"{LEFT_PX} {TOP_PX} {SIDE_PX} {SIDE_PX}\">\n"
        ));
        canvas.raw(&image(&uri, LEFT_PX, TOP_PX, SIDE_PX, SIDE_PX));
        for overlay in &self.overlays {
            draw(&mut canvas, overlay, &place);
        }
        canvas.raw("</svg>\n");
        canvas.rect((LEFT_PX, TOP_PX), (SIDE_PX, SIDE_PX), "grid");
        canvas.raw("</g>\n");
        let mut bottom = TOP_PX + SIDE_PX + 26.0;
        for (ink, note) in &self.notes {
            bottom += 19.0;
            canvas.rect((LEFT_PX, bottom - 14.5), (14.0, 9.0), &format!("f-{}", ink.name()));
            canvas.text(LEFT_PX + 20.0, bottom - 6.0, "small", note);
        }
        Ok(canvas.figure(&self.title, LEFT_PX + SIDE_PX + 14.0, bottom))
    }
}

fn draw(canvas: &mut Canvas, overlay: &Overlay, place: &impl Fn(&(f64, f64)) -> (f64, f64)) {
    match overlay {
        Overlay::Goal(x_m, y_m) => {
            let centre = place(&(*x_m, *y_m));
            canvas.circle(centre, 9.0, "halo goal-ring");
            canvas.raw(&format!(
                "<g transform=\"translate({} {})\"><path d=\"M0 -9L2.6 -2.8 9 -2.8 4 1.6 5.8 8 0 4.2 -5.8 8 -4 1.6 -9 -2.8 -2.6 -2.8Z\" \
                 class=\"f-purple\" stroke=\"#fff\" stroke-width=\"1.2\"/></g>\n",
                number(centre.0, 1),
                number(centre.1, 1)
            ));
        }
        Overlay::Line(points, ink, dashed) => {
            let points: Vec<_> = points.iter().map(place).collect();
            canvas.path(&points, "halo line");
            let dash = if *dashed { " dash" } else { "" };
            canvas.path(&points, &format!("line s-{}{dash}", ink.name()));
        }
        Overlay::Footprint(points) => {
            let points: Vec<_> = points.iter().map(place).collect();
            canvas.polygon(&points, "s-text", "fill:#fff;fill-opacity:.75;stroke-width:1.4");
        }
        Overlay::Arrow(points, ink, width_px) => {
            let points: Vec<_> = points.iter().map(place).collect();
            arrow(canvas, &points, *ink, *width_px);
        }
    }
}

/// A line with a head at its end, in pixels.
fn arrow(canvas: &mut Canvas, points: &[(f64, f64)], ink: Ink, width_px: f64) {
    let (Some(&first), Some(&tip)) = (points.first(), points.last()) else { return };
    let name = ink.name();
    let length = points.windows(2).map(|pair| distance(pair[0], pair[1])).sum::<f64>();
    if length < 3.0 {
        canvas.circle(first, 3.0 + width_px, &format!("f-{name}"));
        return;
    }
    // The head points from where the line was some pixels before its end.
    let back = points.iter().rev().find(|point| distance(**point, tip) > 4.0).copied().unwrap_or(first);
    let gap = distance(back, tip).max(1e-9);
    let (along_x, along_y) = ((tip.0 - back.0) / gap, (tip.1 - back.1) / gap);
    let corner = |along: f64, across: f64| {
        (tip.0 + along * along_x - across * along_y, tip.1 + along * along_y + across * along_x)
    };
    let (long, wide) = (3.5 + 1.4 * width_px, 2.6 + 1.3 * width_px);
    let head = [corner(long, 0.0), corner(-3.0, wide), corner(-3.0, -wide)];
    canvas.raw(&format!("<g style=\"stroke-width:{}\">", number(width_px + 2.0, 1)));
    canvas.path(points, "halo");
    canvas.raw(&format!("</g><g style=\"stroke-width:{}\">", number(width_px, 1)));
    canvas.path(points, &format!("stem s-{name}\" style=\"stroke-width:inherit"));
    canvas.raw("</g>");
    canvas.polygon(&head, &format!("f-{name}"), "stroke:#fff;stroke-width:1");
}

fn distance(a: (f64, f64), b: (f64, f64)) -> f64 {
    ((a.0 - b.0) * (a.0 - b.0) + (a.1 - b.1) * (a.1 - b.1)).sqrt()
}

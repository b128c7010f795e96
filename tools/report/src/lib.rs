//! The one report writer: a self-contained HTML file with inline SVG, and the numbers as JSON within and beside it.
//!
//! [`Report`] takes headings, paragraphs, tables and figures in reading order. A figure is one of [`LinePlot`],
//! [`Boxes`], [`Bars`], [`Scatter`], [`Strip`] or [`MapPicture`]; each can also stand alone as an SVG file. No script,
//! no network, no font file; light and dark by the reader's system; colours of Okabe and Ito, which colour-blind readers
//! tell apart. The same input gives the same bytes, and long series are thinned to what the picture can show.

mod axis;
mod bars;
mod boxes;
mod canvas;
mod line;
mod local;
mod map;
mod page;
mod picture;
mod proportion;
mod scatter;
mod strip;
mod style;
mod table;

#[cfg(test)]
mod tests;

pub use axis::Axis;
pub use bars::Bars;
pub use boxes::{Boxes, Spread};
pub use canvas::Figure;
pub use line::{LinePlot, Series};
pub use map::{Cells, MapPicture, Overlay, Shade};
pub use page::{Report, ReportError};
pub use picture::{Picture, data_uri};
pub use proportion::{Proportion, rate_at_most};
pub use scatter::{Cloud, Scatter};
pub use strip::{Span, Strip};
pub use style::Ink;
pub use table::Table;

//! SVG text: shapes with classes instead of colours, coordinates with one digit, everything escaped.

use crate::style::{Ink, figure_sheet};
use std::fmt::Write as _;

/// A number as short as it can be at this many digits after the point.
pub(crate) fn number(value: f64, digits: usize) -> String {
    let text = format!("{value:.digits$}");
    let short = if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.') } else { &text };
    if short == "-0" { "0".into() } else { short.into() }
}

/// Text for HTML and SVG.
pub(crate) fn escaped(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    for letter in text.chars() {
        match letter {
            '&' => out.push_str("&amp;"),
            '<' => out.push_str("&lt;"),
            '>' => out.push_str("&gt;"),
            '"' => out.push_str("&quot;"),
            // Not allowed in XML at all.
            control if control.is_control() && control != '\n' && control != '\t' => out.push(' '),
            other => out.push(other),
        }
    }
    out
}

/// A finished figure: part of a page, or a file of its own.
#[derive(Debug, Clone, PartialEq)]
pub struct Figure {
    pub(crate) title: String,
    pub(crate) caption: String,
    pub(crate) width: f64,
    pub(crate) height: f64,
    pub(crate) body: String,
}

impl Figure {
    /// This figure with a line of text below it.
    #[must_use]
    pub fn caption(mut self, text: impl Into<String>) -> Self {
        self.caption = text.into();
        self
    }

    /// As an SVG file.
    #[must_use]
    pub fn svg(&self) -> String {
        let (width, height) = (number(self.width, 1), number(self.height, 1));
        format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {width} {height}\" role=\"img\">\
             <title>{}</title>\n<style>{}</style>\n<rect class=\"card\" width=\"{width}\" height=\"{height}\"/>\n{}</svg>\n",
            escaped(&self.title),
            figure_sheet(),
            self.body
        )
    }

    /// As part of a page, whose style sheet it uses.
    pub(crate) fn inline(&self) -> String {
        format!(
            "<svg viewBox=\"0 0 {} {}\" role=\"img\" aria-label=\"{}\">\n{}</svg>",
            number(self.width, 1),
            number(self.height, 1),
            escaped(&self.title),
            self.body
        )
    }

    /// Figures one below the other as one.
    #[must_use]
    pub fn stack(title: &str, figures: &[Self]) -> Self {
        let mut canvas = Canvas::default();
        let (mut top, mut width) = (0.0, 0.0_f64);
        for figure in figures {
            canvas.group(0.0, top, &figure.body);
            top += figure.height + 8.0;
            width = width.max(figure.width);
        }
        canvas.figure(title, width, top)
    }

    /// Figures side by side as one, in rows of `columns`, below a title.
    #[must_use]
    pub fn sheet(title: &str, figures: &[Self], columns: usize) -> Self {
        const GAP: f64 = 16.0;
        let columns = columns.max(1);
        let mut widths = vec![0.0_f64; columns.min(figures.len().max(1))];
        for (index, figure) in figures.iter().enumerate() {
            widths[index % columns] = widths[index % columns].max(figure.width);
        }
        let mut canvas = Canvas::default();
        canvas.text(GAP, 28.0, "strong", title);
        let (mut top, mut bottom) = (40.0, 40.0_f64);
        for row in figures.chunks(columns) {
            let mut left = GAP;
            for (figure, width) in row.iter().zip(&widths) {
                canvas.group(left, top, &figure.body);
                left += width + GAP;
                bottom = bottom.max(top + figure.height);
            }
            top = bottom + GAP;
        }
        let across: f64 = widths.iter().map(|width| width + GAP).sum();
        canvas.figure(title, GAP + across, bottom + GAP)
    }
}

/// Shapes in the order in which they are drawn.
#[derive(Debug, Default)]
pub(crate) struct Canvas(String);

impl Canvas {
    // A text in memory cannot fail to take more text, so the results of `write!` carry nothing.
    pub(crate) fn raw(&mut self, text: &str) {
        self.0.push_str(text);
    }

    pub(crate) fn group(&mut self, left: f64, top: f64, body: &str) {
        let (left, top) = (number(left, 1), number(top, 1));
        let _ = write!(self.0, "<g transform=\"translate({left} {top})\">\n{body}</g>\n");
    }

    pub(crate) fn text(&mut self, x: f64, y: f64, class: &str, text: &str) {
        let (x, y) = (number(x, 1), number(y, 1));
        let _ = writeln!(self.0, "<text x=\"{x}\" y=\"{y}\" class=\"{class}\">{}</text>", escaped(text));
    }

    /// Text that reads upward, its middle at this point.
    pub(crate) fn upward(&mut self, x: f64, y: f64, class: &str, text: &str) {
        let (x, y) = (number(x, 1), number(y, 1));
        let _ = writeln!(
            self.0,
            "<text transform=\"translate({x} {y}) rotate(-90)\" class=\"{class}\">{}</text>",
            escaped(text)
        );
    }

    pub(crate) fn line(&mut self, from: (f64, f64), to: (f64, f64), class: &str) {
        self.path(&[from, to], class);
    }

    pub(crate) fn rect(&mut self, corner: (f64, f64), size: (f64, f64), class: &str) {
        let [x, y, width, height] =
            [corner.0, corner.1, size.0.max(0.0), size.1.max(0.0)].map(|n| number(n, 1));
        let _ = writeln!(
            self.0,
            "<rect x=\"{x}\" y=\"{y}\" width=\"{width}\" height=\"{height}\" class=\"{class}\"/>"
        );
    }

    pub(crate) fn circle(&mut self, centre: (f64, f64), radius: f64, class: &str) {
        let [x, y, radius] = [centre.0, centre.1, radius].map(|n| number(n, 1));
        let _ = writeln!(self.0, "<circle cx=\"{x}\" cy=\"{y}\" r=\"{radius}\" class=\"{class}\"/>");
    }

    /// A line through points.
    pub(crate) fn path(&mut self, points: &[(f64, f64)], class: &str) {
        self.paths(std::iter::once(points), class);
    }

    /// Lines as one element.
    pub(crate) fn paths<'a>(&mut self, lines: impl Iterator<Item = &'a [(f64, f64)]>, class: &str) {
        let mut data = String::new();
        for points in lines {
            for (index, (x, y)) in points.iter().enumerate() {
                let step = if index == 0 { "M" } else { "L" };
                let _ = write!(data, "{step}{} {}", number(*x, 1), number(*y, 1));
            }
            if points.len() == 1 {
                // A line without length and with round ends is a dot.
                data.push_str("h0");
            }
        }
        if !data.is_empty() {
            let _ = writeln!(self.0, "<path class=\"{class}\" d=\"{data}\"/>");
        }
    }

    /// A filled outline; `style` is written as it is.
    pub(crate) fn polygon(&mut self, points: &[(f64, f64)], class: &str, style: &str) {
        let points: Vec<_> =
            points.iter().map(|(x, y)| format!("{},{}", number(*x, 1), number(*y, 1))).collect();
        let _ = writeln!(
            self.0,
            "<polygon points=\"{}\" class=\"{class}\" style=\"{style}\"/>",
            points.join(" ")
        );
    }

    /// Names with their inks, from the left; returns nothing where there is one name or none.
    pub(crate) fn legend(&mut self, left: f64, baseline: f64, entries: &[(&str, Ink)]) {
        let mut x = left;
        for (name, ink) in entries {
            self.rect((x, baseline - 9.5), (14.0, 9.0), &format!("f-{}", ink.name()));
            self.text(x + 20.0, baseline, "small", name);
            x += 38.0 + 7.0 * name.chars().count() as f64;
        }
    }

    pub(crate) fn figure(self, title: &str, width: f64, height: f64) -> Figure {
        Figure { title: title.into(), caption: String::new(), width, height, body: self.0 }
    }
}

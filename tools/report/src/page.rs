//! The page: elements in reading order, the numbers within, nothing from outside.

use crate::canvas::{Figure, escaped};
use crate::style::page_sheet;
use crate::table::Table;
use serde_json::Value;
use std::fmt::Write as _;

/// Why a report cannot be made.
#[derive(Debug, thiserror::Error)]
pub enum ReportError {
    /// A picture whose pixels do not fill it.
    #[error("report: {found} bytes for a picture of {width} x {height} pixels of 4 bytes; {detail}")]
    Pixels {
        /// Columns.
        width: u32,
        /// Rows.
        height: u32,
        /// Bytes given.
        found: usize,
        /// What is wrong.
        detail: String,
    },
}

/// A report: what is said, shown and measured, in reading order.
#[derive(Debug, Clone, PartialEq)]
pub struct Report {
    title: String,
    body: String,
    data: Value,
}

impl Report {
    /// A report that says its title, what it is about, and carries `data` for machines.
    #[must_use]
    pub fn new(title: &str, subtitle: &str, data: Value) -> Self {
        let body = format!("<h1>{}</h1>\n<p class=\"sub\">{}</p>\n", escaped(title), escaped(subtitle));
        Self { title: title.into(), body, data }
    }

    /// Adds a heading.
    pub fn heading(&mut self, text: &str) {
        let _ = writeln!(self.body, "<h2>{}</h2>", escaped(text));
    }

    /// Adds a paragraph.
    pub fn paragraph(&mut self, text: &str) {
        let _ = writeln!(self.body, "<p>{}</p>", escaped(text));
    }

    /// Adds a paragraph that must not be missed.
    pub fn warning(&mut self, text: &str) {
        let _ = writeln!(self.body, "<p class=\"warn\">{}</p>", escaped(text));
    }

    /// Adds figures of a few numbers: large, each with what it is.
    pub fn tiles(&mut self, tiles: &[(String, String)]) {
        self.body.push_str("<div class=\"tiles\">");
        for (value, name) in tiles {
            let _ = write!(
                self.body,
                "<div class=\"tile\"><b>{}</b><span>{}</span></div>",
                escaped(value),
                escaped(name)
            );
        }
        self.body.push_str("</div>\n");
    }

    /// Adds a table.
    pub fn table(&mut self, table: &Table) {
        self.body.push_str(&table.html());
    }

    /// Adds a figure.
    pub fn figure(&mut self, figure: &Figure) {
        let svg = figure.inline();
        let caption = if figure.caption.is_empty() {
            String::new()
        } else {
            format!("<figcaption>{}</figcaption>", escaped(&figure.caption))
        };
        let _ = writeln!(self.body, "<figure>{svg}{caption}</figure>");
    }

    /// Adds figures side by side, two or three in a row.
    pub fn figures(&mut self, figures: &[Figure], columns: usize) {
        let _ = writeln!(self.body, "<div class=\"row c{}\">", columns.clamp(2, 3));
        figures.iter().for_each(|figure| self.figure(figure));
        self.body.push_str("</div>\n");
    }

    /// The page.
    #[must_use]
    pub fn html(&self) -> String {
        // Within a script element only its own end needs care; `<\/` is the same text to JSON.
        let data = self.data.to_string().replace("</", "<\\/").replace("<!--", "<\\u0021--");
        format!(
            "<!doctype html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n\
             <meta name=\"viewport\" content=\"width=device-width,initial-scale=1\">\n<title>{}</title>\n\
             <style>{}</style>\n</head>\n<body>\n<main>\n{}</main>\n\
             <script type=\"application/json\" id=\"data\">{data}</script>\n</body>\n</html>\n",
            escaped(&self.title),
            page_sheet(),
            self.body
        )
    }

    /// The numbers.
    #[must_use]
    pub fn json(&self) -> String {
        format!("{:#}\n", self.data)
    }
}

//! Tables with units.

use crate::canvas::escaped;
use std::fmt::Write as _;

/// A table.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Table {
    /// What it shows; may be empty.
    pub caption: String,
    /// Names and units of the columns; an empty unit for none.
    pub columns: Vec<(String, String)>,
    /// Its rows.
    pub rows: Vec<Vec<String>>,
}

impl Table {
    /// A table without rows.
    #[must_use]
    pub fn new(caption: &str, columns: &[(&str, &str)]) -> Self {
        let columns = columns.iter().map(|(name, unit)| ((*name).into(), (*unit).into())).collect();
        Self { caption: caption.into(), columns, rows: Vec::new() }
    }

    /// Adds a row.
    pub fn row<T: Into<String>>(&mut self, cells: impl IntoIterator<Item = T>) {
        self.rows.push(cells.into_iter().map(Into::into).collect());
    }

    /// As HTML; columns of numbers stand at the right.
    pub(crate) fn html(&self) -> String {
        let is_number = |text: &String| {
            let first = text.trim_start_matches(['-', '+', '<']).chars().next();
            text == "-" || first.is_some_and(|letter| letter.is_ascii_digit())
        };
        let class = |column: usize| {
            let mut cells =
                self.rows.iter().filter_map(|row| row.get(column)).filter(|cell| !cell.is_empty());
            let numbers = column > 0 && cells.clone().next().is_some() && cells.all(is_number);
            if numbers { " class=\"n\"" } else { "" }
        };
        let classes: Vec<_> = (0..self.columns.len()).map(class).collect();
        let mut html = String::from("<div class=\"scroll\"><table>");
        if !self.caption.is_empty() {
            let _ = write!(html, "<caption>{}</caption>", escaped(&self.caption));
        }
        html.push_str("<thead><tr>");
        for ((name, unit), class) in self.columns.iter().zip(&classes) {
            let unit =
                if unit.is_empty() { String::new() } else { format!(" <span>[{}]</span>", escaped(unit)) };
            let _ = write!(html, "<th{class}>{}{unit}</th>", escaped(name));
        }
        html.push_str("</tr></thead><tbody>\n");
        for row in &self.rows {
            html.push_str("<tr>");
            for (cell, class) in row.iter().zip(&classes) {
                let _ = write!(html, "<td{class}>{}</td>", escaped(cell));
            }
            html.push_str("</tr>\n");
        }
        html.push_str("</tbody></table></div>\n");
        html
    }
}

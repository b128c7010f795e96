//! Results go to standard output, everything else to standard error.

use std::io::{IsTerminal, Write};

/// A line of results; a closed pipe ends the output quietly.
pub(crate) fn line(text: &str) {
    let _ = writeln!(std::io::stdout().lock(), "{text}");
}

/// A page that replaces the last one on a terminal, and follows it elsewhere.
pub(crate) fn screen(text: &str) {
    let mut out = std::io::stdout().lock();
    if out.is_terminal() {
        let _ = write!(out, "\x1b[2J\x1b[H");
    }
    let _ = writeln!(out, "{text}");
    let _ = out.flush();
}

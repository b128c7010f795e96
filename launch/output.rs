//! Results go to standard output, everything else to standard error.

use crate::failure::Failure;
use std::io::{IsTerminal, Write};
use std::path::Path;

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

/// Results for a machine, in a file.
///
/// # Errors
/// Exit code 3 where the file cannot be written.
pub(crate) fn json(path: &Path, value: &serde_json::Value) -> Result<(), Failure> {
    let text = format!("{value:#}\n");
    std::fs::write(path, text).map_err(|error| Failure::io(format!("{}: {error}", path.display())))
}

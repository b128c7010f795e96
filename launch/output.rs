//! Results go to standard output, everything else to standard error.

use crate::failure::Failure;
use std::io::{IsTerminal, Write};
use std::path::Path;
use std::sync::OnceLock;
use std::sync::mpsc::{SyncSender, sync_channel};
use std::time::Duration;

/// Lines that may wait for a slow reader of standard error; what comes beyond is dropped.
const LINES_MOST: usize = 1024;
/// Time that the last lines have at the end.
const LAST_LINES: Duration = Duration::from_millis(200);

enum Line {
    Text(String),
    Flush(SyncSender<()>),
}

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

fn lines() -> &'static SyncSender<Line> {
    static LINES: OnceLock<SyncSender<Line>> = OnceLock::new();
    LINES.get_or_init(|| {
        let (sender, receiver) = sync_channel(LINES_MOST);
        std::thread::spawn(move || {
            for line in receiver {
                match line {
                    Line::Text(text) => {
                        let _ = writeln!(std::io::stderr().lock(), "{text}");
                    }
                    Line::Flush(done) => {
                        let _ = done.try_send(());
                    }
                }
            }
        });
        sender
    })
}

/// A line about the run; whoever reads standard error too slowly loses lines, and never holds up the supervisor.
pub(crate) fn note(text: String) {
    let _ = lines().try_send(Line::Text(text));
}

/// Gives the last lines a moment to be written.
pub(crate) fn flush() {
    let (done, written) = sync_channel(1);
    if lines().try_send(Line::Flush(done)).is_ok() {
        let _ = written.recv_timeout(LAST_LINES);
    }
}

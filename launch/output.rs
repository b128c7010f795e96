//! Results go to standard output, everything else to standard error.

use crate::failure::Failure;
use std::io::{IsTerminal, Read, Write};
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

/// Refuses a place for results that would cost a recording, or where no file can be: before the work, not after it.
///
/// # Errors
/// Exit code 2 with what is there and what to do.
pub(crate) fn may_write(path: &Path) -> Result<(), Failure> {
    let refused = |found: &str| Failure::usage(format!("{}: {found}; name another file", path.display()));
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty());
    if folder.is_some_and(|folder| !folder.is_dir()) {
        return Err(refused("its folder does not exist"));
    }
    if path.is_dir() {
        return Err(refused("is a folder"));
    }
    let mut first = [0; 5];
    let read = std::fs::File::open(path).and_then(|mut file| file.read_exact(&mut first));
    if read.is_ok() && first == *b"\x89MCAP" {
        return Err(refused("is a recording, and is not overwritten"));
    }
    Ok(())
}

/// Refuses to write over, or in silence beside, what an earlier command made.
///
/// # Errors
/// Exit code 2 with the name.
pub(crate) fn refuse_existing(path: &Path) -> Result<(), Failure> {
    if !path.exists() {
        return Ok(());
    }
    Err(Failure::usage(format!("{}: exists and is not overwritten; name another file", path.display())))
}

/// Results in a file.
///
/// # Errors
/// Exit code 2 where [`may_write`] refuses, 3 where the file cannot be written.
pub(crate) fn file(path: &Path, text: &str) -> Result<(), Failure> {
    may_write(path)?;
    let failed = |error| Failure::io(format!("{}: {error}; name a file that can be written", path.display()));
    std::fs::write(path, text).map_err(failed)
}

/// Results for a machine, in a file.
///
/// # Errors
/// As [`file()`].
pub(crate) fn json(path: &Path, value: &serde_json::Value) -> Result<(), Failure> {
    file(path, &format!("{value:#}\n"))
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

//! The file in which an emergency stop and a hold outlive a crash of the arbiter.

use crate::operator::Standing;
use std::path::{Path, PathBuf};

/// Line of the file for a hold. Every other file, an empty or spoilt one too, means a latched emergency stop.
const HELD: &str = "held";
/// Line of the file for a latched emergency stop.
const LATCHED: &str = "latched";

/// A file that exists while an order stands: a line for each.
#[derive(Debug)]
pub(crate) struct StandingFile {
    path: PathBuf,
    orders: Standing,
}

impl StandingFile {
    /// The orders as an earlier life left them, in the named file or, where none is named, in the folder of the run.
    pub(crate) fn at(named: &str, folder: &Path, run: &str) -> Self {
        let path = if named.is_empty() { folder.join(format!("{run}.estop")) } else { PathBuf::from(named) };
        let orders = if path.exists() { read(&path) } else { Standing::default() };
        Self { path, orders }
    }

    pub(crate) fn orders(&self) -> Standing {
        self.orders
    }

    /// Writes a change down, before it is acted on; a disk that refuses does not stop the stop.
    pub(crate) fn keep(&mut self, orders: Standing) {
        if self.orders == orders {
            return;
        }
        self.orders = orders;
        let lines = [(orders.latched, LATCHED), (orders.held, HELD)];
        let text: String =
            lines.iter().filter(|(stands, _)| *stands).map(|(_, line)| format!("{line}\n")).collect();
        let kept =
            if text.is_empty() { std::fs::remove_file(&self.path) } else { std::fs::write(&self.path, text) };
        if let Err(error) = kept {
            eprintln!(
                "arbiter: {}: {error}; the emergency stop or the hold will not outlive a crash",
                self.path.display()
            );
        }
    }
}

fn read(path: &Path) -> Standing {
    let text = std::fs::read_to_string(path).unwrap_or_default();
    Standing { latched: text.trim() != HELD, held: text.lines().any(|line| line == HELD) }
}

#[cfg(test)]
mod tests {
    use super::*;

    const LATCH: Standing = Standing { latched: true, held: false };
    const HOLD: Standing = Standing { latched: false, held: true };
    const BOTH: Standing = Standing { latched: true, held: true };
    const NONE: Standing = Standing { latched: false, held: false };

    #[test]
    fn orders_outlive_the_one_who_wrote_them_until_they_are_released() {
        let (folder, run) = (std::env::temp_dir(), format!("sidestep-orders-{}", std::process::id()));
        for orders in [LATCH, BOTH, HOLD, NONE, HOLD, LATCH, NONE] {
            StandingFile::at("", &folder, &run).keep(orders);
            assert_eq!(StandingFile::at("", &folder, &run).orders(), orders);
        }
        assert!(!folder.join(format!("{run}.estop")).exists());
    }

    #[test]
    fn a_spoilt_file_is_an_emergency_stop() {
        let file = std::env::temp_dir().join(format!("sidestep-spoilt-orders-{}", std::process::id()));
        let named = file.to_string_lossy().into_owned();
        for bytes in [&b""[..], b"hel", b"\xff\xfe", b"latched"] {
            std::fs::write(&file, bytes).unwrap();
            assert_eq!(StandingFile::at(&named, Path::new("/nowhere"), "run").orders(), LATCH, "{bytes:?}");
        }
        std::fs::remove_file(&file).unwrap();
    }

    #[test]
    fn a_named_file_is_used_instead_and_touched_only_by_a_change() {
        let file = std::env::temp_dir().join(format!("sidestep-named-orders-{}", std::process::id()));
        let named = file.to_string_lossy().into_owned();
        let mut standing = StandingFile::at(&named, Path::new("/nowhere"), "run");
        standing.keep(NONE);
        assert!(standing.orders() == NONE && !file.exists());
        standing.keep(LATCH);
        assert!(standing.orders() == LATCH && file.exists());
        std::fs::remove_file(&file).unwrap();
        standing.keep(LATCH);
        assert!(!file.exists(), "nothing changed, nothing is written");
        // A disk that refuses does not stop the stop.
        let mut refused = StandingFile::at("/nowhere/at/all", Path::new("/"), "run");
        refused.keep(LATCH);
        assert_eq!(refused.orders(), LATCH);
    }
}

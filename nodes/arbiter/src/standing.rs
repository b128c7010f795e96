//! The file in which an emergency stop and a hold outlive a crash of the arbiter.

use crate::operator::Standing;
use std::path::{Path, PathBuf};

/// Name of the file in the folder of the run, where the graph names no other.
const STANDING_FILE: &str = "arbiter.orders";

const BOTH: &str = "latched\nheld\n";
const LATCHED: &str = "latched\n";
const HELD: &str = "held\n";

/// A file that exists while an order stands: a line for each.
#[derive(Debug)]
pub(crate) struct StandingFile {
    path: PathBuf,
    orders: Standing,
}

impl StandingFile {
    /// The orders as an earlier life left them, in the named file or, where none is named, in the folder of the run.
    pub(crate) fn at(named: &str, folder: &Path) -> Self {
        let path = if named.is_empty() { folder.join(STANDING_FILE) } else { PathBuf::from(named) };
        let orders = read(&path);
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
        let text = match (orders.latched, orders.held) {
            (true, true) => BOTH,
            (true, false) => LATCHED,
            (false, true) => HELD,
            (false, false) => return self.clear(),
        };
        if let Err(error) = std::fs::write(&self.path, text) {
            let path = self.path.display();
            eprintln!(
                "arbiter: {path}: {error}; the emergency stop or the hold will not outlive a crash: latch_file must be \
                 where it may be written"
            );
        }
    }

    fn clear(&self) {
        if let Err(error) = std::fs::remove_file(&self.path) {
            let path = self.path.display();
            eprintln!(
                "arbiter: {path}: {error}; after a crash the orders released now will stand again: remove it"
            );
        }
    }
}

/// What a file orders: nothing where there is none; both where it cannot be read or is spoilt.
fn read(path: &Path) -> Standing {
    match std::fs::read_to_string(path).as_deref() {
        Ok(LATCHED) => Standing { latched: true, held: false },
        Ok(HELD) => Standing { latched: false, held: true },
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => Standing::default(),
        _ => Standing { latched: true, held: true },
    }
}

/// Takes the orders of a run along into another folder, where it goes on; what cannot be read stands.
///
/// # Errors
/// The disk refuses the copy.
pub fn carry_orders(from: &Path, to: &Path) -> std::io::Result<()> {
    let orders = read(&from.join(STANDING_FILE));
    let mut file = StandingFile::at("", to);
    file.keep(orders);
    if read(&file.path) == orders { Ok(()) } else { Err(std::io::Error::other(STANDING_FILE)) }
}

#[cfg(test)]
mod tests {
    use super::*;

    const LATCH: Standing = Standing { latched: true, held: false };
    const HOLD: Standing = Standing { latched: false, held: true };
    const ALL: Standing = Standing { latched: true, held: true };
    const NONE: Standing = Standing { latched: false, held: false };

    /// A folder of its own, gone with the test.
    struct Folder(PathBuf);

    impl Folder {
        fn new(name: &str) -> Self {
            let path = std::env::temp_dir().join(format!("sidestep-{name}-{}", std::process::id()));
            std::fs::create_dir_all(&path).unwrap();
            Self(path)
        }
    }

    impl Drop for Folder {
        fn drop(&mut self) {
            let _ = std::fs::remove_dir_all(&self.0);
        }
    }

    #[test]
    fn orders_outlive_the_one_who_wrote_them_until_they_are_released() {
        let Folder(folder) = &Folder::new("orders");
        for orders in [LATCH, ALL, HOLD, NONE, HOLD, LATCH, NONE] {
            StandingFile::at("", folder).keep(orders);
            assert_eq!(StandingFile::at("", folder).orders(), orders);
        }
        assert!(!folder.join(STANDING_FILE).exists());
    }

    #[test]
    fn what_cannot_be_understood_stands_all_of_it() {
        let Folder(folder) = &Folder::new("spoilt-orders");
        for bytes in [&b""[..], b"hel", b"\xff\xfe", b"latched", b"latched\nheld\n", b"held\nlatched\n"] {
            std::fs::write(folder.join(STANDING_FILE), bytes).unwrap();
            assert_eq!(StandingFile::at("", folder).orders(), ALL, "{bytes:?}");
        }
        // A folder in the place of the file cannot be read.
        assert_eq!(StandingFile::at(&folder.to_string_lossy(), folder).orders(), ALL);
    }

    #[test]
    fn a_named_file_is_used_instead_and_touched_only_by_a_change() {
        let Folder(folder) = &Folder::new("named-orders");
        let file = folder.join("named");
        let mut standing = StandingFile::at(&file.to_string_lossy(), Path::new("/nowhere"));
        standing.keep(NONE);
        assert!(standing.orders() == NONE && !file.exists());
        standing.keep(LATCH);
        assert!(standing.orders() == LATCH && file.exists());
        std::fs::remove_file(&file).unwrap();
        standing.keep(LATCH);
        assert!(!file.exists(), "nothing changed, nothing is written");
        // A disk that refuses does not stop the stop.
        let mut refused = StandingFile::at("/nowhere/at/all", Path::new("/"));
        refused.keep(LATCH);
        assert_eq!(refused.orders(), LATCH);
    }

    #[test]
    fn orders_move_with_the_run() {
        let (Folder(from), Folder(to)) = (&Folder::new("old-run"), &Folder::new("new-run"));
        for orders in [NONE, HOLD, LATCH, ALL] {
            StandingFile::at("", from).keep(orders);
            let _ = std::fs::remove_file(to.join(STANDING_FILE));
            carry_orders(from, to).unwrap();
            assert_eq!(StandingFile::at("", to).orders(), orders);
        }
        assert!(carry_orders(from, Path::new("/nowhere")).is_err());
    }
}

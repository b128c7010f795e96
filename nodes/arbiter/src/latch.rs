//! The file in which an emergency stop outlives a crash of the arbiter.

use std::path::{Path, PathBuf};

/// A file that exists while the emergency stop is latched.
#[derive(Debug)]
pub(crate) struct LatchFile {
    path: PathBuf,
    latched: bool,
}

impl LatchFile {
    /// The latch as an earlier life left it, in the named file or, where none is named, in the folder of the run.
    pub(crate) fn at(named: &str, folder: &Path, run: &str) -> Self {
        let path = if named.is_empty() { folder.join(format!("{run}.estop")) } else { PathBuf::from(named) };
        let latched = path.exists();
        Self { path, latched }
    }

    pub(crate) fn is_latched(&self) -> bool {
        self.latched
    }

    /// Writes a change down, before it is acted on; a disk that refuses does not stop the stop.
    pub(crate) fn keep(&mut self, latched: bool) {
        if self.latched == latched {
            return;
        }
        self.latched = latched;
        let kept =
            if latched { std::fs::write(&self.path, "latched\n") } else { std::fs::remove_file(&self.path) };
        if let Err(error) = kept {
            eprintln!(
                "arbiter: {}: {error}; the emergency stop will not outlive a crash",
                self.path.display()
            );
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_latch_outlives_the_one_who_wrote_it_until_it_is_released() {
        let (folder, run) = (std::env::temp_dir(), format!("sidestep-latch-{}", std::process::id()));
        LatchFile::at("", &folder, &run).keep(true);
        let mut next = LatchFile::at("", &folder, &run);
        assert!(next.is_latched());
        next.keep(false);
        assert!(!LatchFile::at("", &folder, &run).is_latched());
    }

    #[test]
    fn a_named_file_is_used_instead_and_touched_only_by_a_change() {
        let file = std::env::temp_dir().join(format!("sidestep-named-latch-{}", std::process::id()));
        let named = file.to_string_lossy().into_owned();
        let mut latch = LatchFile::at(&named, Path::new("/nowhere"), "run");
        latch.keep(false);
        assert!(!latch.is_latched() && !file.exists());
        latch.keep(true);
        assert!(latch.is_latched() && file.exists());
        std::fs::remove_file(&file).unwrap();
        latch.keep(true);
        assert!(!file.exists(), "nothing changed, nothing is written");
        // A disk that refuses does not stop the stop.
        let mut refused = LatchFile::at("/nowhere/at/all", Path::new("/"), "run");
        refused.keep(true);
        assert!(refused.is_latched());
    }
}

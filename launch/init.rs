//! `sidestep init`: the files with which a new robot begins.

use crate::failure::Failure;
use crate::interface::{self, Language};
use crate::manifest::{GRAPHS, ROBOTS};
use std::os::unix::fs::OpenOptionsExt;
use std::path::{Path, PathBuf};

/// The driver that travels in the binary: a robot in an empty hall.
const DRIVER: &str = include_str!("../tools/driver/driver.py");

/// Where a new robot begins.
#[derive(Debug, clap::Args)]
pub(crate) struct InitArguments {
    /// Folder for the files; made where there is none.
    #[arg(default_value = ".")]
    folder: PathBuf,
    /// Adds a driver in Python: a robot in an empty hall, to put your sensors and wheels into.
    #[arg(long)]
    python: bool,
}

fn named<'a>(texts: &[(&str, &'a str)], name: &str) -> &'a str {
    texts.iter().find(|(key, _)| *key == name).map_or("", |(_, text)| text)
}

/// Writes the files, or none of them.
///
/// # Errors
/// Exit code 2 where a file is there already, 3 where the folder cannot be written.
pub(crate) fn run(arguments: &InitArguments) -> Result<(), Failure> {
    let program = if arguments.python { "./driver.py" } else { "./driver" };
    let graph = named(GRAPHS, "robot")
        .replace("robot = \"loomo\"", "robot = \"robot.toml\"")
        .replace("/usr/local/lib/sidestep/driver", program);
    let mut files =
        vec![("graph.toml", graph, 0o644), ("robot.toml", named(ROBOTS, "loomo").to_owned(), 0o644)];
    if arguments.python {
        files.push(("driver.py", DRIVER.to_owned(), 0o755));
        files.push(("sidestep.py", interface::print(Language::Python), 0o644));
    }
    let folder = &arguments.folder;
    if let Some(path) = files.iter().map(|(name, ..)| folder.join(name)).find(|path| path.exists()) {
        return Err(Failure::usage(format!(
            "{} is there already and is kept; name another folder, or move it away",
            path.display()
        )));
    }
    let failed = |path: &Path, error| Failure::io(format!("{}: {error}", path.display()));
    std::fs::create_dir_all(folder).map_err(|error| failed(folder, error))?;
    for (name, text, mode) in files {
        let path = folder.join(name);
        let file = std::fs::OpenOptions::new().write(true).create_new(true).mode(mode).open(&path);
        file.and_then(|mut file| std::io::Write::write_all(&mut file, text.as_bytes()))
            .map_err(|error| failed(&path, error))?;
        crate::output::line(&format!("wrote {}", path.display()));
    }
    let graph = folder.join("graph.toml");
    crate::output::line(&format!("next: robot.toml's values, then `sidestep run {}`", graph.display()));
    Ok(())
}

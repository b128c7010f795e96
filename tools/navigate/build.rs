//! Gathers the arbiter's code without comments and tests, so that kilometres of one arbiter are not counted for another.

use std::io::{Error, Write};
use std::path::{Path, PathBuf};

const ARBITER: &str = "../../nodes/arbiter/src";

fn main() -> Result<(), Error> {
    writeln!(std::io::stdout(), "cargo:rerun-if-changed={ARBITER}")?;
    let paths: Result<Vec<PathBuf>, Error> =
        std::fs::read_dir(ARBITER)?.map(|entry| entry.map(|entry| entry.path())).collect();
    let mut paths = paths?;
    paths.retain(|path| path.extension().is_some_and(|extension| extension == "rs"));
    paths.sort();
    let mut code = String::new();
    for path in paths {
        let text = std::fs::read_to_string(path)?;
        let lines = text.lines().map(str::trim).take_while(|line| *line != "mod tests {");
        for line in lines.filter(|line| !line.starts_with("//")) {
            code.push_str(line);
            code.push('\n');
        }
    }
    let folder = std::env::var("OUT_DIR").map_err(Error::other)?;
    std::fs::write(Path::new(&folder).join("arbiter.txt"), code)
}

//! Gathers the code of arbiter and mapper, and that of the errors of drawn maps, without comments and tests, so that kilometres
//! of one are not counted for another.

use std::io::{Error, Write};
use std::path::{Path, PathBuf};

const NODES: [&str; 2] = ["../../nodes/arbiter/src", "../../nodes/mapper/src"];
const NOISE: &str = "../drive/src/noise.rs";

fn main() -> Result<(), Error> {
    let mut paths = Vec::new();
    for node in NODES {
        writeln!(std::io::stdout(), "cargo:rerun-if-changed={node}")?;
        for entry in std::fs::read_dir(node)? {
            paths.push(entry?.path());
        }
    }
    paths.retain(|path| path.extension().is_some_and(|extension| extension == "rs"));
    paths.sort();
    writeln!(std::io::stdout(), "cargo:rerun-if-changed={NOISE}")?;
    gather(&paths, "nodes.txt")?;
    gather(&[PathBuf::from(NOISE)], "noise.txt")
}

/// Writes the code of some files into one.
fn gather(paths: &[PathBuf], name: &str) -> Result<(), Error> {
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
    std::fs::write(Path::new(&folder).join(name), code)
}

//! Which files a bag consists of, and what is a bag of another kind.

use crate::error::BagError;
use sidestep_import::ImportError;
use std::ffi::OsStr;
use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};

const METADATA: &str = "metadata.yaml";
const SQLITE_MAGIC: &[u8] = b"SQLite format 3\0";
const ROS1_MAGIC: &[u8] = b"#ROSBAG V";
const MCAP_NEEDED: &str = "a ROS 2 bag in MCAP files";
const CONVERT: &str = "convert it where ROS 2 is installed: `ros2 bag convert -i BAG -o out.yaml` with `output_bags: \
     [{uri: NAME, storage_id: mcap, all_topics: true}]` in out.yaml";

/// Whether `import` should take this as a bag: anything that is not a folder of images.
#[must_use]
pub fn is_bag(source: &Path) -> bool {
    let bag_file = |path: &Path| ["mcap", "db3", "zstd", "bag"].iter().any(|end| has_end(path, end));
    if !source.is_dir() {
        return source.is_file() || bag_file(source);
    }
    source.join(METADATA).is_file()
        || std::fs::read_dir(source)
            .is_ok_and(|entries| entries.flatten().any(|entry| bag_file(&entry.path())))
}

fn has_end(path: &Path, end: &str) -> bool {
    path.extension() == Some(OsStr::new(end))
}

/// The MCAP files of a bag, in the order of its listing.
pub(crate) fn files(source: &Path) -> Result<Vec<PathBuf>, BagError> {
    let files = if source.is_dir() { folder_files(source)? } else { vec![source.to_path_buf()] };
    for file in &files {
        check_kind(file)?;
    }
    Ok(files)
}

fn folder_files(folder: &Path) -> Result<Vec<PathBuf>, BagError> {
    let fault = |source| {
        let remedy = "give an .mcap file or the folder of a bag";
        BagError::Import(ImportError::Read { path: folder.to_path_buf(), source, remedy })
    };
    let listing = folder.join(METADATA);
    if listing.is_file() {
        return listed(folder, &std::fs::read_to_string(&listing).map_err(fault)?);
    }
    let mut found = Vec::new();
    for entry in std::fs::read_dir(folder).map_err(fault)? {
        let path = entry.map_err(fault)?.path();
        if has_end(&path, "db3") {
            return Err(sqlite(&path));
        }
        if has_end(&path, "bag") {
            return Err(ros1(&path));
        }
        if has_end(&path, "zstd") {
            return Err(compressed(&path, "compressed whole"));
        }
        if has_end(&path, "mcap") {
            found.push(path);
        }
    }
    // NAME_10 comes after NAME_9.
    found.sort_by_key(|path| (file_number(path), path.clone()));
    Ok(found)
}

/// N of `NAME_N.mcap`.
fn file_number(path: &Path) -> u64 {
    let stem = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
    stem.rsplit('_').next().and_then(|number| number.parse().ok()).unwrap_or(0)
}

/// The files that `metadata.yaml` names; three of its keys matter, and each stands on a line of its own.
fn listed(folder: &Path, text: &str) -> Result<Vec<PathBuf>, BagError> {
    let plain = |value: &str| value.trim().trim_matches(['"', '\'']).to_owned();
    let value = |key: &str| {
        let line = text.lines().find_map(|line| line.trim_start().strip_prefix(key)?.strip_prefix(':'));
        line.map(plain).unwrap_or_default()
    };
    if value("storage_identifier") == "sqlite3" {
        return Err(sqlite(folder));
    }
    let compression = value("compression_mode");
    if !["", "none"].contains(&compression.to_lowercase().as_str()) {
        return Err(compressed(folder, &format!("compression_mode {compression}")));
    }
    let names: Vec<String> = text
        .lines()
        .map(str::trim)
        .skip_while(|line| *line != "relative_file_paths:")
        .skip(1)
        .map_while(|line| line.strip_prefix("- "))
        .map(plain)
        .collect();
    if names.is_empty() {
        let remedy =
            "restore it with `ros2 bag reindex FOLDER`, or delete it: then all .mcap files are taken";
        return Err(BagError::content(
            &folder.join(METADATA),
            "no relative_file_paths",
            "the list of the files",
            remedy,
        ));
    }
    let mut files = Vec::new();
    for name in names {
        // Older listings name the folder too; nothing outside of it is ever meant.
        let file = Path::new(&name).file_name().map(|name| folder.join(name)).unwrap_or_default();
        if !file.is_file() {
            let remedy =
                "copy the missing file beside metadata.yaml, or delete metadata.yaml to take what is there";
            return Err(BagError::content(
                folder,
                format!("no file {name}"),
                "every file of the listing",
                remedy,
            ));
        }
        files.push(file);
    }
    Ok(files)
}

fn sqlite(path: &Path) -> BagError {
    let remedy = format!("{CONVERT}; or `mcap convert IN.db3 OUT.mcap`");
    BagError::content(path, "a ROS 2 bag in sqlite3", MCAP_NEEDED, remedy)
}

fn ros1(path: &Path) -> BagError {
    let remedy = "convert it with `rosbags-convert --src IN.bag --dst OUT --dst-storage mcap` (PyPI rosbags)";
    BagError::content(path, "a ROS 1 bag", MCAP_NEEDED, remedy)
}

fn compressed(path: &Path, found: &str) -> BagError {
    let needed = "files that are compressed within, as MCAP does by itself";
    BagError::content(path, found, needed, format!("unpack the files with `zstd -d`, or {CONVERT}"))
}

fn check_kind(file: &Path) -> Result<(), BagError> {
    let mut first = Vec::new();
    let read = File::open(file).and_then(|file| file.take(16).read_to_end(&mut first));
    read.map_err(|source| {
        let remedy = "give an .mcap file or the folder of a bag";
        BagError::Import(ImportError::Read { path: file.to_path_buf(), source, remedy })
    })?;
    if first.starts_with(SQLITE_MAGIC) || has_end(file, "db3") {
        return Err(sqlite(file));
    }
    if first.starts_with(ROS1_MAGIC) || has_end(file, "bag") {
        return Err(ros1(file));
    }
    if has_end(file, "zstd") {
        return Err(compressed(file, "a file that is compressed whole"));
    }
    Ok(())
}

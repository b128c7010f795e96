//! The rules of the house (ARCHITECTURE.md, invariants), read from the text of the tree.

use std::path::{Path, PathBuf};

const ROOT: &str = env!("CARGO_MANIFEST_DIR");

/// All files below a folder that belong to the project.
pub(crate) fn files(folder: &Path) -> Vec<PathBuf> {
    let skip = ["target", ".git", "recordings", "models"];
    let mut found = Vec::new();
    for entry in std::fs::read_dir(folder).unwrap().flatten() {
        let (path, name) = (entry.path(), entry.file_name().to_string_lossy().into_owned());
        if path.is_dir() && !skip.contains(&name.as_str()) {
            found.extend(files(&path));
        } else if path.is_file() {
            found.push(path);
        }
    }
    found.sort();
    found
}

fn with_extension(extension: &str) -> Vec<(String, String)> {
    let matching =
        files(Path::new(ROOT)).into_iter().filter(|path| path.extension().is_some_and(|e| e == extension));
    matching.map(|path| (relative(&path), std::fs::read_to_string(&path).unwrap())).collect()
}

fn relative(path: &Path) -> String {
    path.strip_prefix(ROOT).unwrap().to_string_lossy().into_owned()
}

/// Fails with every place that breaks a rule.
fn report(rule: &str, places: Vec<String>) {
    assert!(places.is_empty(), "{rule}:\n  {}", places.join("\n  "));
}

/// Code without comments, so that prose may name what code may not.
fn code_lines(text: &str) -> impl Iterator<Item = (usize, &str)> {
    text.lines().enumerate().filter(|(_, line)| !line.trim_start().starts_with("//"))
}

#[test]
fn each_outside_library_has_its_rooms() {
    // I1: whoever wants another transport, network runtime or file format knows where to look.
    let rules: &[(&str, &[&str])] = &[
        ("iceoryx2", &["msgs/", "nodes/bus/"]),
        ("tract_onnx", &["nodes/policy/"]),
        ("mcap", &["nodes/recorder/", "nodes/player/"]),
    ];
    let mut places = Vec::new();
    for (path, text) in with_extension("rs") {
        for (library, rooms) in rules {
            let uses = |line: &str| {
                line.contains(&format!("use {library}")) || line.contains(&format!("{library}::"))
            };
            let allowed = rooms.iter().any(|room| path.starts_with(room)) || path == "tests/tidy.rs";
            let found = code_lines(&text).filter(|(_, line)| !allowed && uses(line));
            places.extend(found.map(|(number, line)| format!("{path}:{}: {}", number + 1, line.trim())));
        }
    }
    report("library outside its rooms", places);
}

#[test]
fn only_the_node_file_of_a_node_knows_the_bus() {
    // I2: every other file of a node is a function of its arguments.
    let mut places = Vec::new();
    for (path, text) in with_extension("rs") {
        let node = path.starts_with("nodes/") && !path.starts_with("nodes/bus/");
        let speaks = path.ends_with("/node.rs") || path.contains("/src/node/");
        if node && !speaks && text.contains("sidestep_bus") {
            places.push(path);
        }
    }
    report("sidestep_bus outside node.rs", places);
}

#[test]
fn nodes_never_import_nodes() {
    // I3: a node knows the vocabulary and the bus, and no other node.
    let mut places = Vec::new();
    for (path, text) in with_extension("toml") {
        if !path.starts_with("nodes/") || !path.ends_with("Cargo.toml") {
            continue;
        }
        let dependencies = text.split("[dev-dependencies]").next().unwrap();
        for line in dependencies.lines().filter(|line| line.starts_with("sidestep-")) {
            if !line.starts_with("sidestep-msgs") && !line.starts_with("sidestep-bus") {
                places.push(format!("{path}: {line}"));
            }
        }
    }
    report("node imports node", places);
}

#[test]
fn one_file_reads_clocks_and_sleeps() {
    // I4: time is an argument; whoever looks for a clock finds it in one place.
    let words = ["Instant::now", "SystemTime::now", "thread::sleep", "clock_gettime"];
    let mut places = Vec::new();
    for (path, text) in with_extension("rs") {
        if path == "nodes/bus/src/clock.rs" || path == "tests/tidy.rs" {
            continue;
        }
        let found = code_lines(&text).filter(|(_, line)| words.iter().any(|word| line.contains(word)));
        places.extend(found.map(|(number, _)| format!("{path}:{}", number + 1)));
    }
    report("clock outside nodes/bus/src/clock.rs", places);
}

#[test]
fn every_file_is_named_after_its_subject() {
    // I5: a room called "common" collects what nobody wants to place.
    let banned =
        ["common", "util", "utils", "helper", "helpers", "core", "misc", "types", "types2", "new", "old"];
    let named = files(Path::new(ROOT)).into_iter().filter(|path| {
        let stem = path.file_stem().map(|stem| stem.to_string_lossy().into_owned()).unwrap_or_default();
        banned.contains(&stem.as_str())
    });
    report("file without a subject", named.map(|path| relative(&path)).collect());
}

#[test]
fn every_number_of_a_message_names_its_unit() {
    // I9: a unit decided late is a unit decided twice.
    let mut places = Vec::new();
    for (path, text) in with_extension("rs").into_iter().filter(|(path, _)| path.starts_with("msgs/src/")) {
        let lines: Vec<_> = text.lines().collect();
        for (number, line) in lines.iter().enumerate() {
            let line = line.trim();
            let field = line.starts_with("pub ")
                && line.ends_with(',')
                && !line.contains("fn ")
                && !line.contains("const ");
            let number_type =
                [": f32", ": f64", ": [f32", ": [f64", ": [[f32"].iter().any(|text| line.contains(text));
            if !field || !number_type {
                continue;
            }
            let mut above = number;
            while above > 0
                && (lines[above - 1].trim().starts_with("///") || lines[above - 1].trim().starts_with("#["))
            {
                above -= 1;
            }
            if !lines[above..number].iter().any(|comment| comment.trim().starts_with("/// `[")) {
                places.push(format!("{path}:{}: {line}", number + 1));
            }
        }
    }
    report("number without a [unit]", places);
}

#[test]
fn files_fit_a_sitting() {
    let limit = |path: &str| match path {
        _ if path.ends_with("/node.rs") || path.contains("/src/node/") => 120,
        _ if path.starts_with("nodes/") && path.ends_with("/lib.rs") => 50,
        _ => 500,
    };
    let long = with_extension("rs").into_iter().filter(|(path, text)| text.lines().count() > limit(path));
    report(
        "file too long",
        long.map(|(path, text)| format!("{path}: {} lines", text.lines().count())).collect(),
    );
}

#[test]
fn documents_describe_the_present_and_stay_short() {
    let mut places = Vec::new();
    for (path, text) in with_extension("md") {
        let lines = text.lines().count();
        let limit = match path.as_str() {
            "README.md" | "ARCHITECTURE.md" => 200,
            "CHANGELOG.md" => 400,
            _ if (path.starts_with("nodes/") || path.starts_with("tools/"))
                && path.ends_with("/README.md") =>
            {
                60
            }
            _ if path.starts_with("tests/data/") && path.ends_with("README.md") => 60,
            _ => 0,
        };
        if lines > limit {
            places.push(format!("{path}: {lines} lines, at most {limit}"));
        }
    }
    report("document too long, or not one of the documents", places);
}

#[test]
fn every_node_has_the_same_rooms() {
    let mut places = Vec::new();
    for node in ["mapper", "guard", "goal", "policy", "expert", "arbiter", "sim", "recorder", "player"] {
        for file in ["README.md", "src/lib.rs", "src/config.rs", "src/node.rs"] {
            let path = format!("nodes/{node}/{file}");
            if !Path::new(ROOT).join(&path).exists() {
                places.push(path);
            }
        }
    }
    report("missing", places);
}

#[test]
fn nothing_is_left_open_or_unreachable() {
    let marks = ["TODO", "FIXME", "unimplemented!", "todo!", "#[ignore"];
    let sources = with_extension("rs");
    let mut places = Vec::new();
    for (path, text) in &sources {
        if path != "tests/tidy.rs" {
            let open =
                text.lines().enumerate().filter(|(_, line)| marks.iter().any(|mark| line.contains(mark)));
            places.extend(open.map(|(number, _)| format!("{path}:{}: left open", number + 1)));
        }
        // `x/mod.rs` is declared as `mod x;`, one folder up.
        let place = Path::new(path.strip_suffix("/mod.rs").unwrap_or(path));
        let stem = place.file_stem().unwrap().to_string_lossy().into_owned();
        let folder = place.parent().unwrap().to_string_lossy().into_owned();
        let root = ["lib", "main", "build"].contains(&stem.as_str())
            || folder.ends_with("benches")
            || folder.ends_with("examples");
        let own_binary = folder.ends_with("/tests");
        let declared = |text: &str| {
            text.contains(&format!("mod {stem};")) || text.contains(&format!("#[path = \"{stem}.rs\"]"))
        };
        if !root && !own_binary && !sources.iter().any(|(other, text)| other != path && declared(text)) {
            places.push(format!("{path}: no module declares it"));
        }
    }
    report("left open or unreachable", places);
}

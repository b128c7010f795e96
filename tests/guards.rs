//! Guards taken away one by one: a test must miss each of them.

use crate::tidy::files;
use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::time::Duration;

const ROOT: &str = env!("CARGO_MANIFEST_DIR");
const ARBITER: &str = "nodes/arbiter/src";
/// Tests that say nothing for this long hang, which is a failure too.
const HANGS: Duration = Duration::from_secs(300);

/// A guard: what it is for, its file, the text with it and without.
struct Guard {
    purpose: String,
    file: String,
    with: String,
    without: String,
}

fn guards() -> Vec<Guard> {
    let list = include_str!("guards/removed.txt");
    let mut guards = Vec::new();
    for part in list.split("\n# ").skip(1) {
        let mut lines = part.lines();
        let (purpose, file) = (lines.next().unwrap(), lines.next().unwrap().strip_prefix("@ ").unwrap());
        let of = |sign: char| {
            let marked = part.lines().skip(2).filter_map(|line| line.strip_prefix(sign));
            marked.collect::<Vec<_>>().join("\n")
        };
        guards.push(Guard { purpose: purpose.into(), file: file.into(), with: of('-'), without: of('+') });
    }
    guards
}

#[test]
fn every_guard_of_the_list_stands_in_the_arbiter_once() {
    let guards = guards();
    for guard in &guards {
        let text = std::fs::read_to_string(Path::new(ROOT).join(ARBITER).join(&guard.file)).unwrap();
        let count = text.matches(&guard.with).count();
        assert_eq!(
            count, 1,
            "{}: {}: tests/guards/removed.txt must follow the code",
            guard.file, guard.purpose
        );
    }
    println!("{} guards", guards.len());
}

/// A copy of the tree, in which the arbiter may be spoilt.
fn copy() -> PathBuf {
    let to = Path::new(env!("CARGO_TARGET_TMPDIR")).join("guards");
    for path in files(Path::new(ROOT)) {
        let place = to.join(path.strip_prefix(ROOT).unwrap());
        std::fs::create_dir_all(place.parent().unwrap()).unwrap();
        let text = std::fs::read(&path).unwrap();
        // What is as it was is not compiled again.
        if std::fs::read(&place).ok().as_ref() != Some(&text) {
            std::fs::write(&place, text).unwrap();
        }
    }
    to
}

/// The first test of the arbiter that fails, or hangs.
fn failing(tree: &Path) -> Option<String> {
    let mut cargo = Command::new(env!("CARGO"));
    cargo.args(["test", "--release", "-p", "sidestep-arbiter", "--lib", "--no-run"]);
    cargo.current_dir(tree).env("CARGO_TARGET_DIR", tree.join("target"));
    let built = cargo.output().unwrap();
    let said = String::from_utf8_lossy(&built.stderr);
    assert!(built.status.success(), "{said}");
    let program = said.split_once("Executable ").and_then(|(_, rest)| rest.split(['(', ')']).nth(1)).unwrap();
    let program = tree.join(program);
    let mut tests = Command::new(program);
    let mut child = tests.current_dir(tree).stdout(Stdio::piped()).stderr(Stdio::null()).spawn().unwrap();
    let lines = BufReader::new(child.stdout.take().unwrap()).lines();
    let (to, from) = channel();
    let reader = std::thread::spawn(move || lines.map_while(Result::ok).try_for_each(|line| to.send(line)));
    let found = loop {
        match from.recv_timeout(HANGS) {
            Ok(line) if line.starts_with("test ") && line.ends_with("FAILED") => break Some(line),
            Ok(_) => {}
            Err(RecvTimeoutError::Timeout) => break Some("a test hangs".into()),
            Err(RecvTimeoutError::Disconnected) => break None,
        }
    };
    if found.is_some() {
        let _ = child.kill();
    }
    let status = child.wait().unwrap();
    drop(from);
    let _ = reader.join();
    found.or_else(|| (!status.success()).then(|| status.to_string()))
}

/// Numbers in the list: `3,10..20`; `None` where it is something else.
fn chosen(text: &str) -> Option<Vec<usize>> {
    let mut numbers = Vec::new();
    for part in text.split(',') {
        let (first, end) = match part.split_once("..") {
            Some((first, end)) => (first.parse().ok()?, end.parse().ok()?),
            None => (part.parse().ok()?, part.parse::<usize>().ok()? + 1),
        };
        numbers.extend(first..end);
    }
    Some(numbers)
}

/// Takes about 20 s for each guard: with `SIDESTEP_GUARDS=0..200`, numbers in the list, or a part of it.
#[test]
fn every_guard_taken_away_is_missed_by_a_test() {
    let Ok(text) = std::env::var("SIDESTEP_GUARDS") else {
        println!("skipped: no guard is taken away without SIDESTEP_GUARDS=0..200, or 3,10..20");
        return;
    };
    let count = guards().len();
    let numbers = chosen(&text).filter(|numbers| numbers.iter().any(|number| *number < count));
    let numbers =
        numbers.unwrap_or_else(|| panic!("SIDESTEP_GUARDS={text}: numbers below {count} are needed"));
    let tree = copy();
    assert_eq!(failing(&tree), None, "with all guards");
    let mut unmissed = Vec::new();
    for (number, guard) in guards().into_iter().enumerate().filter(|(number, _)| numbers.contains(number)) {
        let path = tree.join(ARBITER).join(&guard.file);
        let text = std::fs::read_to_string(&path).unwrap();
        std::fs::write(&path, text.replacen(&guard.with, &guard.without, 1)).unwrap();
        let found = failing(&tree);
        std::fs::write(&path, text).unwrap();
        println!(
            "{number} {}: {}: {}",
            guard.file,
            guard.purpose,
            found.as_deref().unwrap_or("MISSED BY NONE")
        );
        unmissed.extend(found.is_none().then(|| format!("{number} {}: {}", guard.file, guard.purpose)));
    }
    assert!(unmissed.is_empty(), "no test misses:\n  {}", unmissed.join("\n  "));
}

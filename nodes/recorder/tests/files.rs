//! What the recorder writes, the player reads: each file of a split, a snapshot, a recording that ended before a full disk.
#![allow(clippy::unwrap_used, clippy::panic, missing_docs, reason = "a test says what it expects by failing")]

mod drive;

use drive::{SECOND_NS, Said, drive};
use sidestep_msgs::{COMMAND, Command, Reason, SNAPSHOT, TOPICS, TRUTH, Truth};
use sidestep_player::{Entry, Info, Messages, attachment};
use sidestep_recorder::{Config, Files, Filter, Lost, Origin, RecordError, Report, Sink};
use std::path::{Path, PathBuf};

const WALL_NS: u64 = 1_782_907_199 * SECOND_NS;

/// A folder of its own that goes when the test ends.
struct Folder(PathBuf);

impl Folder {
    fn new(name: &str) -> Self {
        let folder = std::env::temp_dir().join(format!("sidestep-files-{}-{name}", std::process::id()));
        let _ = std::fs::remove_dir_all(&folder);
        Self(folder)
    }

    fn names(&self) -> Vec<String> {
        let entries = std::fs::read_dir(&self.0).unwrap().flatten();
        let mut names: Vec<_> = entries.map(|entry| entry.file_name().into_string().unwrap()).collect();
        names.sort();
        names
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir_all(&self.0);
    }
}

fn config(folder: &Folder) -> Config {
    Config { queue_small: 64, queue_large: 2, view: false, ..Config::plain(folder.0.clone()) }
}

fn origin() -> Origin {
    Origin {
        mono_to_wall_ns: WALL_NS as i64,
        metadata: vec![("version".into(), "test".into())],
        attachments: vec![("robot.toml".into(), b"name = \"loomo\"".to_vec())],
        flush_period_ns: SECOND_NS / 2,
        view: sidestep_recorder::ViewSettings::default(),
    }
}

fn begin(config: &Config) -> Files {
    config.check().unwrap();
    let filter = Filter::of(&config.topics, &config.exclude).unwrap();
    Files::begin(config, filter, origin(), WALL_NS).unwrap()
}

fn take(files: &mut Files, said: &Said) -> Result<(), RecordError> {
    files.take(said.row, &said.record(), said.received_ns, &Lost::default())
}

/// Records all that was said.
fn record(config: &Config, said: &[Said]) -> Report {
    let mut files = begin(config);
    said.iter().try_for_each(|said| take(&mut files, said)).unwrap();
    files.end(&Lost::default()).unwrap()
}

/// All messages of a file that must be complete, its index and its content of one mind.
fn read(path: &Path) -> Vec<Entry> {
    let info = Info::read(path).unwrap();
    assert!(info.complete && info.damage.is_none(), "{info:?}");
    let entries: Vec<_> = Messages::open(path).unwrap().map(Result::unwrap).collect();
    for row in TOPICS {
        let in_index = info.channels.iter().find(|channel| channel.topic == row.name).map_or(0, |c| c.count);
        let in_file = entries.iter().filter(|entry| entry.topic == row.index).count() as u64;
        assert_eq!(in_index, in_file, "{}", row.name);
    }
    assert_eq!(attachment(path, "robot.toml").unwrap(), b"name = \"loomo\"");
    assert_eq!(info.metadata["sidestep"]["version"], "test");
    entries
}

fn is(entry: &Entry, said: &Said) -> bool {
    entry.topic == said.row.index && entry.header == said.header && entry.message == said.message
}

/// Which part of the drive the end of a file is, exactly; what stands before was said anew.
fn place(entries: &[Entry], said: &[Said]) -> std::ops::Range<usize> {
    let last = said.iter().rposition(|said| is(entries.last().unwrap(), said)).unwrap();
    let mut length = 0;
    while length < entries.len()
        && length <= last
        && is(&entries[entries.len() - 1 - length], &said[last - length])
    {
        length += 1;
    }
    last + 1 - length..last + 1
}

#[test]
fn files_of_a_split_hold_the_whole_drive_and_each_begins_with_what_still_holds() {
    let folder = Folder::new("split");
    let said = drive(1, 30);
    let report = record(&Config { split_s: 12.0, ..config(&folder) }, &said);
    let names: Vec<_> = (0..3).map(|number| format!("drive-20260701-115959_{number}.mcap")).collect();
    assert_eq!(folder.names(), names);
    assert_eq!((report.written, &report.path), (said.len() as u64, &folder.0.join(&names[2])));
    let mut next = 0;
    for (number, name) in names.iter().enumerate() {
        let entries = read(&folder.0.join(name));
        let place = place(&entries, &said);
        assert_eq!(place.start, next, "{name} goes on where the file before ended");
        next = place.end;
        let anew = &entries[..entries.len() - place.len()];
        let mut topics: Vec<_> = anew.iter().map(|entry| entry.row().name).collect();
        topics.sort_unstable();
        let expected: &[&str] = if number == 0 { &[] } else { &["clock", "path", "state/goal"] };
        assert_eq!(topics, expected, "{name}");
        for entry in anew {
            let newest = said[..place.start].iter().rev().find(|said| said.row.index == entry.topic).unwrap();
            assert!(is(entry, newest), "{name}: {} is not the newest", entry.row().name);
            // A viewer shows the file from its own beginning.
            assert!(entry.logged_ns.abs_diff(entries[anew.len()].logged_ns) < SECOND_NS, "{name}");
        }
    }
    assert_eq!(next, said.len());
}

#[test]
fn a_file_of_the_wanted_size_is_followed_by_the_next() {
    let folder = Folder::new("size");
    let said = drive(2, 30);
    record(&Config { split_mb: 1, ..config(&folder) }, &said);
    let sizes: Vec<_> =
        folder.names().iter().map(|name| folder.0.join(name).metadata().unwrap().len()).collect();
    assert!(sizes.len() >= 3, "{sizes:?}");
    // A chunk more, and the index.
    assert!(sizes[..sizes.len() - 1].iter().all(|&size| (1_000_000..2_500_000).contains(&size)), "{sizes:?}");
}

/// A request for a snapshot.
fn asked(token: u64, received_ns: u64) -> Said {
    Said::new(SNAPSHOT.row(), token, token.to_le_bytes().to_vec(), received_ns)
}

#[test]
fn a_snapshot_is_the_end_of_the_drive_so_far_and_costs_the_running_file_nothing() {
    let folder = Folder::new("snapshot");
    let mut said = drive(3, 40);
    let at = said.iter().position(|said| said.received_ns > 30 * SECOND_NS).unwrap();
    said.insert(at, asked(77, said[at].received_ns));
    let mut files = begin(&Config { black_box_mb: 2, ..config(&folder) });
    let progress = files.progress();
    said.iter().try_for_each(|said| take(&mut files, said)).unwrap();
    files.end(&Lost::default()).unwrap();
    let (count, token, path) = progress.snapshots();
    assert_eq!((count, token), (1, 77));
    let path = path.unwrap();
    let drive_file = folder.0.join("drive-20260701-115959.mcap");
    assert_eq!(place(&read(&drive_file), &said), 0..said.len());
    let entries = read(&path);
    let place = place(&entries, &said);
    assert_eq!(place.end, at + 1, "up to the request");
    let held_s = (said[at].received_ns - said[place.start].received_ns) as f64 * 1e-9;
    assert!(place.start > 0 && held_s > 5.0, "from {} on, {held_s} s", place.start);
    let stated: f64 = Info::read(&path).unwrap().metadata["sidestep"]["held_s"].parse().unwrap();
    assert!(
        (stated - held_s).abs() < 0.2 && (f64::from(progress.held_s()) - held_s).abs() < 2.0,
        "{stated} {held_s}"
    );
    assert!(path.metadata().unwrap().len() < 2_200_000, "the ring and an index");
    // The path was sent once, long before: it stands at the head.
    let standing: Vec<_> =
        entries[..entries.len() - place.len()].iter().map(|entry| entry.row().name).collect();
    assert!(standing.contains(&"path") && standing.contains(&"clock"), "{standing:?}");
    assert!(standing.iter().all(|name| !name.starts_with("state/")), "{standing:?}");
}

fn command(reason: Reason, received_ns: u64) -> Said {
    let command = Command { reason: reason as u32, ..bytemuck::Zeroable::zeroed() };
    Said::new(COMMAND.row(), 1, bytemuck::bytes_of(&command).to_vec(), received_ns)
}

#[test]
fn a_fault_and_a_contact_are_kept_with_what_follows_them_also_without_the_drive() {
    let folder = Folder::new("fault");
    let mut said = drive(4, 60);
    let contact = Truth { contact: 1, ..bytemuck::Zeroable::zeroed() };
    let touch = |at_ns| Said::new(TRUTH.row(), 1, bytemuck::bytes_of(&contact).to_vec(), at_ns);
    said.push(command(Reason::StaleMap, 20 * SECOND_NS));
    said.push(command(Reason::StaleOdometry, 21 * SECOND_NS));
    said.push(touch(50 * SECOND_NS));
    said.sort_by_key(|said| said.received_ns);
    // What drives the decision is seen, though it is not recorded.
    let exclude = vec!["command".into(), "truth".into()];
    record(&Config { black_box_mb: 8, whole_drive: false, exclude, ..config(&folder) }, &said);
    let names = folder.names();
    assert_eq!(names.len(), 2, "{names:?}");
    for (name, (cause, at_s)) in names.iter().zip([("map too old", 20), ("contact", 50)]) {
        let path = folder.0.join(name);
        let entries = read(&path);
        assert_eq!(Info::read(&path).unwrap().metadata["sidestep"]["snapshot"], cause);
        let last_ns = entries.last().unwrap().logged_ns - WALL_NS;
        let expected_ns = (at_s + 1) * SECOND_NS;
        assert!((expected_ns..expected_ns + SECOND_NS).contains(&last_ns), "{name} ends at {last_ns} ns");
        assert!(entries.iter().all(|entry| entry.topic != COMMAND.index && entry.topic != TRUTH.index));
    }
}

#[test]
fn only_what_the_filter_takes_is_in_the_file() {
    let folder = Folder::new("filter");
    let (topics, exclude) = (vec!["state/*".into(), "odometry".into(), "path".into()], vec!["pa?h".into()]);
    record(&Config { topics, exclude, ..config(&folder) }, &drive(5, 5));
    let entries = read(&folder.0.join("drive-20260701-115959.mcap"));
    let mut names: Vec<_> = entries.iter().map(|entry| entry.row().name).collect();
    names.sort_unstable();
    names.dedup();
    assert_eq!(names, ["odometry", "state/goal"]);
}

#[test]
fn a_disk_with_too_little_room_refuses_the_recording_with_found_and_needed() {
    let folder = Folder::new("room");
    let config = Config { free_mb_least: 1_000_000_000, ..config(&folder) };
    let filter = Filter::of(&[], &[]).unwrap();
    let error = Files::begin(&config, filter, origin(), WALL_NS).unwrap_err();
    let text = error.to_string();
    assert!(matches!(error, RecordError::Space { .. }) && text.contains("1000000000 MB"), "{text}");
    assert!(text.contains("MB free") && text.contains("free_mb_least"), "{text}");
    assert!(folder.names().is_empty(), "nothing was begun");
}

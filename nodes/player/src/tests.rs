//! What the recorder wrote, the player reads: exactly, in order, and as far as a damaged file goes.

mod conformance;
mod hostile;
mod recovery;

use crate::{Entry, Feed, Info, Messages, Next, Ordered, Played, PlayerError, Selection, attachment};
use sidestep_msgs::{DEPTH, DEPTH_REST_BYTES, DepthFrame, Header, Message, TOPICS, TopicRow, topic_named};
use sidestep_recorder::{Origin, Writer};
use std::collections::BTreeMap;
use std::path::PathBuf;

const MILLISECOND_NS: u64 = 1_000_000;

/// SplitMix64.
fn draw(seed: &mut u64) -> u64 {
    *seed = seed.wrapping_add(0x9e37_79b9_7f4a_7c15);
    let mut z = *seed;
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

fn header(sequence: u64, now_ns: u64) -> Header {
    Header { run: 7, sequence, now_ns, source_frame: sequence / 2, ..Header::default() }
}

/// The bytes of a depth frame of this size; `tail` is written beyond its pixels.
fn depth(width: u32, height: u32, tail: u16, seed: u64) -> Vec<u8> {
    let mut frame: Box<DepthFrame> = bytemuck::allocation::zeroed_box();
    frame.capture_ns = 123_456_789_012;
    (frame.width, frame.height, frame.metres_per_unit) = (width, height, 0.001);
    let used = (width as usize * height as usize).min(frame.pixels.len());
    for (i, pixel) in frame.pixels[..used].iter_mut().enumerate() {
        *pixel = 1000 + (i as u64 % 97 + seed) as u16;
    }
    if let Some(last) = frame.pixels.last_mut() {
        *last = tail;
    }
    bytemuck::bytes_of(&*frame).to_vec()
}

/// (topic, header, message, received) of half a minute's worth of everything, in order of receipt.
fn drive(count: u64) -> Vec<(&'static TopicRow, Header, Vec<u8>, u64)> {
    let mut seed = 1;
    let mut made = Vec::new();
    for i in 1..=count {
        let row = &TOPICS[i as usize % TOPICS.len()];
        let message = if row.index == DEPTH.index {
            depth(64, 48, 0, i)
        } else {
            let noise = draw(&mut seed) as u8;
            (0..row.size).map(|k| (k as u8) & noise).collect()
        };
        let now_ns = i * 20 * MILLISECOND_NS;
        made.push((row, header(i, now_ns), message, now_ns + 3));
    }
    made
}

fn origin() -> Origin {
    Origin {
        mono_to_wall_ns: 5,
        metadata: vec![("version".into(), "test".into())],
        attachments: vec![("robot.toml".into(), b"name = \"loomo\"".to_vec())],
        flush_period_ns: 1_000_000_000,
        ..Origin::default()
    }
}

/// A file that goes when the test ends.
struct Scratch(PathBuf);

impl Scratch {
    fn new(name: &str, bytes: &[u8]) -> Self {
        let path = std::env::temp_dir().join(format!("sidestep-player-{}-{name}.mcap", std::process::id()));
        std::fs::write(&path, bytes).unwrap();
        Self(path)
    }
}

impl Drop for Scratch {
    fn drop(&mut self) {
        let _ = std::fs::remove_file(&self.0);
    }
}

fn record(made: &[(&'static TopicRow, Header, Vec<u8>, u64)], lost: &[u64]) -> Vec<u8> {
    let mut writer = Writer::new(Vec::new(), "memory", &origin()).unwrap();
    for (row, header, message, received_ns) in made {
        writer.write(row, header, message, *received_ns).unwrap();
    }
    writer.finish(lost).unwrap()
}

fn is(entry: &Entry, made: &(&'static TopicRow, Header, Vec<u8>, u64)) -> bool {
    entry.topic == made.0.index
        && bytemuck::bytes_of(&entry.header) == bytemuck::bytes_of(&made.1)
        && entry.message == made.2
        && entry.logged_ns == made.3 + 5
}

#[test]
fn every_message_of_every_topic_comes_back_byte_for_byte() {
    let made = drive(200);
    let file = Scratch::new("exact", &record(&made, &[]));
    let entries: Vec<Entry> = Messages::open(&file.0).unwrap().map(Result::unwrap).collect();
    assert_eq!(entries.len(), made.len());
    for (entry, made) in entries.iter().zip(&made) {
        assert!(is(entry, made), "{} differs", made.0.name);
    }
}

#[test]
fn a_depth_frame_comes_back_exactly_even_where_it_breaks_its_own_rules() {
    // Usual sizes, a size that cannot be, and a used pixel where none should be.
    let sizes = [
        (640, 480, 0),
        (540, 360, 0),
        (16, 16, 0),
        (0, 0, 0),
        (9999, 9999, 0),
        (320, 240, 77),
        (640, 480, 5),
    ];
    let made: Vec<_> = sizes
        .iter()
        .zip(1..)
        .map(|(&(width, height, tail), i)| (DEPTH.row(), header(i, i), depth(width, height, tail, i), i))
        .collect();
    let bytes = record(&made, &[]);
    let file = Scratch::new("depth", &bytes);
    let entries: Vec<Entry> = Messages::open(&file.0).unwrap().map(Result::unwrap).collect();
    for (entry, made) in entries.iter().zip(&made) {
        assert!(is(entry, made), "{:?}", &made.2[8..16]);
        let mut frame: Box<DepthFrame> = bytemuck::allocation::zeroed_box();
        assert!(entry.read_into(DEPTH, &mut frame));
        assert_eq!(bytemuck::bytes_of(&*frame), made.2);
    }
    assert_eq!(entries.len(), sizes.len());
    assert!(entries[3].message[DEPTH_REST_BYTES..].iter().all(|&byte| byte == 0));
}

#[test]
fn a_file_cut_anywhere_is_read_without_error_up_to_the_cut() {
    let made = drive(150);
    let bytes = record(&made, &[]);
    let mut before = 0;
    for cut in (8..bytes.len()).step_by(997).chain([bytes.len() - 9, bytes.len() - 1]) {
        let file = Scratch::new("cut", &bytes[..cut]);
        let entries: Vec<_> = Messages::open(&file.0).unwrap().map_while(Result::ok).collect();
        assert!(entries.iter().zip(&made).all(|(entry, made)| is(entry, made)), "cut at {cut}");
        assert!(entries.len() >= before, "cut at {cut}: {} messages, {before} before", entries.len());
        before = entries.len();
        let info = Info::read(&file.0).unwrap();
        assert!(!info.complete && info.damage.is_some(), "cut at {cut}: {info:?}");
    }
    assert_eq!(before, made.len());
}

/// A stream that remembers how much of it the system has.
#[derive(Clone, Default)]
struct Power(std::rc::Rc<std::cell::RefCell<(Vec<u8>, usize)>>);

impl std::io::Write for Power {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        self.0.borrow_mut().0.extend_from_slice(bytes);
        Ok(bytes.len())
    }

    fn flush(&mut self) -> std::io::Result<()> {
        let mut inner = self.0.borrow_mut();
        inner.1 = inner.0.len();
        Ok(())
    }
}

#[test]
fn a_kill_at_any_message_loses_at_most_the_last_second() {
    let made = drive(300);
    let power = Power::default();
    let mut writer = Writer::new(power.clone(), "memory", &origin()).unwrap();
    for (i, (row, header, message, received_ns)) in made.iter().enumerate() {
        writer.write(row, header, message, *received_ns).unwrap();
        if i % 29 != 0 {
            continue;
        }
        let system_has = {
            let inner = power.0.borrow();
            inner.0[..inner.1].to_vec()
        };
        let file = Scratch::new("kill", &system_has);
        let kept = Messages::open(&file.0).unwrap().map_while(Result::ok).count();
        let kept_ns = kept.checked_sub(1).map_or(made[0].3, |last| made[last].3);
        assert!(received_ns - kept_ns <= 1_000_000_000, "after message {i}: {kept} kept");
    }
}

#[test]
fn damaged_bytes_end_in_a_clear_error_or_early_and_never_in_a_wrong_message() {
    let made = drive(60);
    let bytes = record(&made, &[]);
    let mut seed = 3;
    for _ in 0..300 {
        let (place, bit) = (draw(&mut seed) as usize % bytes.len(), draw(&mut seed) % 8);
        let mut damaged = bytes.clone();
        damaged[place] ^= 1 << bit;
        let file = Scratch::new("flip", &damaged);
        let Ok(messages) = Messages::open(&file.0) else { continue };
        for (entry, made) in messages.map_while(Result::ok).zip(&made) {
            assert!(is(&entry, made), "bit {bit} of byte {place}");
        }
        let _ = Info::read(&file.0).map(|info| info.text());
    }
}

#[test]
fn order_is_graph_time_then_the_topic_table_then_sequence() {
    let row = |name| topic_named(name).unwrap();
    let made: Vec<_> =
        [("command", 4, 10), ("odometry", 9, 10), ("odometry", 8, 10), ("depth", 1, 5), ("clock", 2, 10)]
            .iter()
            .zip(1..)
            .map(|(&(name, sequence, now_ns), i)| {
                (row(name), header(sequence, now_ns), vec![0; row(name).size], i)
            })
            .collect();
    let file = Scratch::new("order", &record(&made, &[]));
    let order: Vec<_> = Ordered::open(&file.0)
        .unwrap()
        .map(|entry| entry.map(|e| (e.row().name, e.header.sequence)).unwrap())
        .collect();
    assert_eq!(order, [("depth", 1), ("clock", 2), ("odometry", 8), ("odometry", 9), ("command", 4)]);
}

#[test]
fn info_says_the_same_of_a_complete_file_and_of_one_without_its_summary() {
    let made = drive(120);
    let mut lost = vec![0; TOPICS.len()];
    lost[DEPTH.index] = 4;
    let bytes = record(&made, &lost);
    let whole = Scratch::new("info", &bytes);
    let cut = Scratch::new("info-cut", &bytes[..bytes.len() - 8]);
    let (whole, mut other) = (Info::read(&whole.0).unwrap(), Info::read(&cut.0).unwrap());
    assert!(whole.complete && !other.complete);
    (other.path, other.size_bytes, other.complete, other.damage) =
        (whole.path.clone(), whole.size_bytes, true, None);
    assert_eq!(whole, other);
    assert_eq!(whole.lost(), BTreeMap::from([("depth".into(), 4)]));
    assert_eq!(whole.attachments["robot.toml"], 14);
    let text = whole.text();
    for needed in ["complete", "odometry", "sidestep.version = test", "lost:", "depth/raw"] {
        assert!(text.contains(needed), "{needed} is missing in\n{text}");
    }
    assert_eq!(attachment(&cut.0, "robot.toml").unwrap(), b"name = \"loomo\"");
}

#[test]
fn what_is_no_recording_is_refused_by_name() {
    let missing = Messages::open(std::path::Path::new("/nowhere/drive.mcap")).unwrap_err();
    assert!(missing.to_string().contains("/nowhere/drive.mcap"), "{missing}");
    let text = Scratch::new("text", b"hello, this is text");
    let error = Info::read(&text.0).unwrap_err();
    assert!(matches!(error, PlayerError::NotMcap { .. }), "{error}");
    let short = Scratch::new("short", b"\x89MC");
    assert!(matches!(Messages::open(&short.0), Err(PlayerError::NotMcap { .. })));
}

#[test]
fn a_recording_of_another_layout_is_refused_with_found_and_needed() {
    let mut writer = mcap::WriteOptions::new().create(std::io::Cursor::new(Vec::new())).unwrap();
    let metadata = BTreeMap::from([("layout_hash".into(), "0123456789abcdef".into())]);
    writer.add_channel(0, "odometry", "sidestep.raw", &metadata).unwrap();
    writer.finish().unwrap();
    let file = Scratch::new("layout", writer.into_inner().get_ref());
    let error = Messages::open(&file.0).unwrap().next().unwrap().unwrap_err().to_string();
    let needed = format!("{:016x}", <sidestep_msgs::Odometry as Message>::LAYOUT_HASH);
    assert!(error.contains("0123456789abcdef") && error.contains(&needed), "{error}");
}

#[test]
fn playback_gives_the_drivers_topics_from_the_start_and_the_path_that_held_there() {
    let row = |name| topic_named(name).unwrap();
    let send =
        |name, sequence, now_ns| (row(name), header(sequence, now_ns), vec![0; row(name).size], now_ns);
    let made = [
        send("path", 1, 100),
        send("path", 2, 110),
        send("odometry", 1, 120),
        send("command", 1, 150),
        send("odometry", 2, 160),
        send("truth", 1, 170),
        send("odometry", 3, 180),
    ];
    let file = Scratch::new("played", &record(&made, &[]));
    let from = |offset_ns| -> Vec<_> {
        let played =
            Played::open(&file.0, &Selection::part(offset_ns, u64::MAX)).unwrap().map(Result::unwrap);
        played.map(|entry| (entry.row().name, entry.header.sequence, entry.header.now_ns)).collect()
    };
    // From the first steady message on: a path may have been said anew at the head of a file, however old it is.
    assert_eq!(from(40), [("path", 2, 160), ("odometry", 2, 160), ("odometry", 3, 180)]);
    assert_eq!(from(0).len(), 4);
    let short: Vec<_> = Played::open(&file.0, &Selection::part(0, 40)).unwrap().map(Result::unwrap).collect();
    assert_eq!(short.iter().map(|entry| entry.header.now_ns).collect::<Vec<_>>(), [120, 120]);
    let mut feed = Feed::start(&file.0, &Selection::part(40, u64::MAX), true).unwrap();
    let mut jumps = 0;
    for _ in 0..12 {
        feed.peek().unwrap().unwrap();
        jumps += u32::from(matches!(feed.take(), Some(Next::Jump)));
    }
    assert_eq!(jumps, 3, "each pass of one jump and three messages");
}

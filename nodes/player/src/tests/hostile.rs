//! Files that lie: no length is believed before its bytes are there, and no byte anywhere makes a reader fall.

use super::recovery::recover;
use super::{Scratch, depth, draw, drive, header, origin, record};
use crate::{Info, Messages, Ordered, attachment};
use mcap::records::op;
use sidestep_msgs::DEPTH;
use sidestep_recorder::Writer;
use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;
use std::path::Path;

/// Counts what each thread holds, and the most that it held.
struct Counting;

thread_local! {
    static HELD: Cell<isize> = const { Cell::new(0) };
    static MOST: Cell<isize> = const { Cell::new(0) };
}

fn count(bytes: isize) {
    // Gone at the end of a thread: what is freed then needs no count.
    let _ = HELD.try_with(|held| {
        held.set(held.get() + bytes);
        let _ = MOST.try_with(|most| most.set(most.get().max(held.get())));
    });
}

#[allow(unsafe_code, reason = "only an allocator sees what is allocated")]
// SAFETY: every call goes to the system's allocator as it came.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        count(layout.size() as isize);
        unsafe { System.alloc(layout) }
    }

    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        count(layout.size() as isize);
        unsafe { System.alloc_zeroed(layout) }
    }

    unsafe fn realloc(&self, place: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        count(size as isize - layout.size() as isize);
        unsafe { System.realloc(place, layout, size) }
    }

    unsafe fn dealloc(&self, place: *mut u8, layout: Layout) {
        count(-(layout.size() as isize));
        unsafe { System.dealloc(place, layout) }
    }
}

#[global_allocator]
static COUNTING: Counting = Counting;

/// `[byte]` the most that was held at once during `work`, beyond what was held before.
fn most_held(work: impl FnOnce()) -> isize {
    let before = HELD.with(Cell::get);
    MOST.with(|most| most.set(before));
    work();
    MOST.with(Cell::get) - before
}

/// Every reader there is, on one file; what they find is not the question.
fn read_all(path: &Path) {
    let _ = Info::read(path).map(|info| (info.text(), info.lost()));
    let _ = attachment(path, "robot.toml");
    if let Ok(messages) = Messages::open(path) {
        let _ = messages.map_while(Result::ok).count();
    }
    if let Ok(ordered) = Ordered::open(path) {
        let _ = ordered.map_while(Result::ok).count();
    }
    let _ = recover(path);
}

fn framed(opcode: u8, length: u64, body: &[u8]) -> Vec<u8> {
    [&b"\x89MCAP0\r\n"[..], &[opcode], &length.to_le_bytes(), body].concat()
}

/// A whole record of this body.
fn whole(opcode: u8, body: &[u8]) -> Vec<u8> {
    framed(opcode, body.len() as u64, body)
}

fn text(text: &[u8]) -> Vec<u8> {
    [&(text.len() as u32).to_le_bytes()[..], text].concat()
}

/// Body of a chunk that claims these sizes.
fn chunk(unpacked: u64, compression: &[u8], packed: u64, records: &[u8]) -> Vec<u8> {
    let sizes = [&[0; 16][..], &unpacked.to_le_bytes(), &7_u32.to_le_bytes()].concat();
    [&sizes[..], &text(compression), &packed.to_le_bytes(), records].concat()
}

/// Files whose lengths are forged, by name.
fn forged() -> Vec<(&'static str, Vec<u8>)> {
    let huge = 1_u64 << 60;
    let big = 60 << 20;
    let four_g = u32::MAX.to_le_bytes();
    let mut files = vec![
        ("a record of an exabyte", framed(op::METADATA, huge, b"abc")),
        ("a record of 60 MiB that is not there", framed(op::SCHEMA, big, b"abc")),
        ("a header of 60 MiB that is not there", framed(op::HEADER, big, b"abc")),
        ("a private record", framed(0x80, u64::MAX, b"")),
        ("a chunk that unpacks to an exabyte", whole(op::CHUNK, &chunk(huge, b"lz4", 3, b"abc"))),
        ("a chunk that unpacks to 60 MiB", whole(op::CHUNK, &chunk(big, b"lz4", 3, b"abc"))),
        ("zstd that unpacks to 60 MiB", whole(op::CHUNK, &chunk(big, b"zstd", 3, b"abc"))),
        ("a plain chunk of an exabyte", whole(op::CHUNK, &chunk(huge, b"", huge, b"abc"))),
        ("a chunk whose compression has a long name", whole(op::CHUNK, &[&[0; 28][..], &four_g].concat())),
        ("a chunk of nothing", whole(op::CHUNK, b"")),
        ("a header whose profile is 4 GiB", whole(op::HEADER, &four_g)),
        ("a schema whose name is 4 GiB", whole(op::SCHEMA, &[&[1, 0][..], &four_g].concat())),
        (
            "a schema whose data are 4 GiB",
            whole(op::SCHEMA, &[&[1, 0][..], &text(b"a"), &text(b"b"), &four_g].concat()),
        ),
        (
            "a channel whose map is 4 GiB",
            whole(op::CHANNEL, &[&[1, 0, 0, 0][..], &text(b"a"), &text(b"b"), &four_g].concat()),
        ),
        (
            "a map whose key is 4 GiB",
            whole(op::METADATA, &[&text(b"a")[..], &90_u32.to_le_bytes(), &four_g].concat()),
        ),
        (
            "a map that ends within a pair, before 4 GiB",
            whole(op::METADATA, &[&text(b"a")[..], &5_u32.to_le_bytes(), &text(b"k"), &four_g].concat()),
        ),
        ("an attachment that is too short", whole(op::ATTACHMENT, &[0; 3])),
        ("an attachment without its sum", whole(op::ATTACHMENT, &[0; 33])),
        (
            "an attachment of an exabyte",
            whole(
                op::ATTACHMENT,
                &[&[0; 16][..], &text(b"a"), &text(b""), &huge.to_le_bytes(), &[0; 4]].concat(),
            ),
        ),
    ];
    // A record within a chunk that is longer than the chunk.
    let long = [&[op::MESSAGE][..], &big.to_le_bytes(), b"abc"].concat();
    files.push(("a record longer than its chunk", whole(op::CHUNK, &chunk(12, b"", 12, &long))));
    // The end of a file that sends a reader somewhere.
    for start in [0, 8, 17, huge, u64::MAX] {
        let footer = [&start.to_le_bytes()[..], &[0; 12]].concat();
        let mut file = whole(op::FOOTER, &footer);
        file.extend_from_slice(b"\x89MCAP0\r\n");
        files.push(("a summary elsewhere", file));
    }
    files
}

#[test]
fn a_forged_length_never_costs_memory() {
    for (name, bytes) in forged() {
        let file = Scratch::new("forged", &bytes);
        let held = most_held(|| read_all(&file.0));
        // Buffers of files, decoders and the copy that `recover` writes take some hundred kilobytes.
        assert!(held < 4 << 20, "{name}: {held} bytes were held at once");
        let info = Info::read(&file.0).unwrap();
        assert!(!info.complete || name == "a summary elsewhere", "{name}: {info:?}");
    }
}

#[test]
fn an_image_of_a_forged_size_is_refused_and_costs_no_memory() {
    // The image is 64 x 48; its size, its step and the length of its data are forged in the encoded bytes.
    for (width, height) in [(u32::MAX, u32::MAX), (1 << 31, 1), (0, 0), (64, 49), (1 << 16, 1 << 16)] {
        let image = foxglove::messages::RawImage {
            width,
            height,
            encoding: "16UC1".into(),
            step: u32::MAX,
            data: vec![1; 2 * 64 * 48].into(),
            ..Default::default()
        };
        for forge_length in [false, true] {
            let mut bytes = Vec::new();
            foxglove::Encode::encode(&image, &mut bytes).unwrap();
            if forge_length {
                let length = bytes.len();
                bytes.truncate(length - 2 * 64 * 48);
            }
            let mut file = mcap::WriteOptions::new().create(std::io::Cursor::new(Vec::new())).unwrap();
            let channel = file.add_channel(0, "depth", "protobuf", &Default::default()).unwrap();
            let stamps = mcap::records::MessageHeader {
                channel_id: channel,
                sequence: 1,
                log_time: 1,
                publish_time: 1,
            };
            file.write_to_known_channel(&stamps, &bytes).unwrap();
            file.finish().unwrap();
            let file = Scratch::new("image", file.into_inner().get_ref());
            let held = most_held(|| {
                let outcome = Messages::open(&file.0).unwrap().next().unwrap();
                let error = outcome.unwrap_err().to_string();
                assert!(error.contains("image of depth"), "{width} x {height}: {error}");
            });
            assert!(held < 1 << 20, "{width} x {height}: {held} bytes were held at once");
        }
    }
}

#[test]
fn messages_that_all_claim_one_moment_do_not_fill_the_memory() {
    // 700 frames of 640 x 480 received at one time: 430 MB, were they all held.
    let mut writer = Writer::new(Vec::new(), "memory", &origin()).unwrap();
    let frame = depth(640, 480, 0, 1);
    for i in 1..=700 {
        writer.write(DEPTH.row(), &header(i, i), &frame, 5).unwrap();
    }
    let file = Scratch::new("moment", &writer.finish(&[]).unwrap());
    let mut frames = 0;
    let held = most_held(|| frames = Ordered::open(&file.0).unwrap().map_while(Result::ok).count());
    assert_eq!(frames, 700);
    assert!(held < 300 << 20, "{held} bytes were held at once");
}

/// One change of some bytes: a bit, a byte, a length, a piece gone, doubled or from elsewhere.
fn mutate(bytes: &mut Vec<u8>, seed: &mut u64) {
    let length = bytes.len() as u64;
    let place = (draw(seed) % length) as usize;
    let span = ((draw(seed) % 64) as usize + 1).min(bytes.len() - place);
    match draw(seed) % 7 {
        0 => bytes[place] ^= 1 << (draw(seed) % 8),
        1 => bytes[place] = draw(seed) as u8,
        2 => {
            let odd = [0, 1, u64::MAX, 1 << 60, 1 << 31, length, length - 1, draw(seed)];
            let value = odd[(draw(seed) % 8) as usize].to_le_bytes();
            let end = (place + 8).min(bytes.len());
            bytes[place..end].copy_from_slice(&value[..end - place]);
        }
        3 => {
            bytes.drain(place..place + span);
        }
        4 => {
            let piece = bytes[place..place + span].to_vec();
            bytes.splice(place..place, piece);
        }
        5 => bytes.truncate(place.max(8)),
        _ => {
            let from = (draw(seed) % (length - span as u64 + 1)) as usize;
            bytes.copy_within(from..from + span, place);
        }
    }
    if bytes.len() < 16 {
        bytes.resize(16, 0);
    }
}

/// Files to begin with: of the suite, ours, and forged ones.
fn seeds() -> Vec<Vec<u8>> {
    let shipped = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/data/mcap");
    let paths = std::fs::read_dir(shipped).unwrap().map(|entry| entry.unwrap().path());
    let suite = paths.filter(|path| path.extension().is_some_and(|end| end == "mcap"));
    let mut paths: Vec<_> = suite.collect();
    paths.sort();
    let mut seeds: Vec<_> = paths.iter().map(|path| std::fs::read(path).unwrap()).collect();
    seeds.extend(forged().into_iter().map(|(_, bytes)| bytes));
    let small: Vec<_> = drive(400).into_iter().filter(|made| made.0.size < 4000).take(12).collect();
    seeds.push(record(&small, &[]));
    let frames: Vec<_> = (1..=2).map(|i| (DEPTH.row(), header(i, i), depth(16, 12, 0, i), i)).collect();
    seeds.push(record(&frames, &[]));
    seeds
}

/// Readers of changed files end, in an error or in less; the seed of a failure is printed with it.
#[test]
fn no_change_of_a_file_makes_a_reader_fall_or_take_much_memory() {
    let number = |name: &str, otherwise: u64| {
        std::env::var(name).ok().and_then(|text| text.parse().ok()).unwrap_or(otherwise)
    };
    let (time_s, first) = (number("SIDESTEP_FUZZ_S", 60), number("SIDESTEP_FUZZ_SEED", 1));
    let seeds = seeds();
    // A thread that waits for what never comes says when the time is over.
    let (never, comes) = std::sync::mpsc::channel::<()>();
    let waiting =
        std::thread::spawn(move || comes.recv_timeout(std::time::Duration::from_secs(time_s)).is_err());
    let mut files = 0;
    while !waiting.is_finished() {
        let seed = first + files;
        let mut state = seed;
        let mut bytes = seeds[(draw(&mut state) as usize) % seeds.len()].clone();
        for _ in 0..=draw(&mut state) % 4 {
            mutate(&mut bytes, &mut state);
        }
        let file = Scratch::new("fuzz", &bytes);
        let mut held = 0;
        let outcome = std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| {
            held = most_held(|| read_all(&file.0));
        }));
        assert!(outcome.is_ok(), "SIDESTEP_FUZZ_SEED={seed}: a reader panicked");
        // What a chunk may unpack to, twice, and the copy.
        assert!(held < 200 << 20, "SIDESTEP_FUZZ_SEED={seed}: {held} bytes were held at once");
        files += 1;
    }
    drop(never);
    println!("{files} changed files in {time_s} s, seeds {first} to {}", first + files);
    assert!(files > 50, "{files} files");
}

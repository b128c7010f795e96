//! Cost of the writer thread: a second of 640 x 480 at 30 Hz with odometry and commands, with and without black box.

#[path = "../tests/drive/mod.rs"]
#[allow(dead_code, reason = "the tests use more of it")]
mod drive;

use divan::Bencher;
use drive::{SECOND_NS, Said, depth};
use sidestep_msgs::{COMMAND, Command, DEPTH, ODOMETRY, Odometry};
use sidestep_recorder::{Config, Files, Filter, Lost, Origin, Sink};

fn main() {
    divan::main();
}

/// One second, to be repeated.
fn second() -> Vec<Said> {
    let mut seed = 1;
    let mut said = Vec::new();
    for tick in 0..130 {
        let at_ns = tick * SECOND_NS / 130;
        said.push(Said::new(COMMAND.row(), tick + 1, vec![0; size_of::<Command>()], at_ns));
        said.push(Said::new(ODOMETRY.row(), tick + 1, vec![tick as u8; size_of::<Odometry>()], at_ns));
    }
    for frame in 0..30 {
        said.push(Said::new(DEPTH.row(), frame + 1, depth(640, 480, &mut seed), frame * SECOND_NS / 30));
    }
    said.sort_by_key(|said| said.received_ns);
    said
}

#[divan::bench(args = [0, 64, 256], sample_count = 30, sample_size = 1)]
fn second_with_black_box_mb(bencher: Bencher, black_box_mb: u64) {
    let folder = std::env::temp_dir().join(format!("sidestep-bench-{}", std::process::id()));
    let config = Config { free_mb_least: 500, black_box_mb, ..Config::plain(folder.clone()) };
    let filter = Filter::of(&[], &[]).unwrap_or_else(|error| unreachable!("{error}"));
    let origin = Origin { flush_period_ns: SECOND_NS / 2, ..Origin::default() };
    let files = Files::begin(&config, filter, origin, 0).unwrap_or_else(|error| unreachable!("{error}"));
    let files = std::cell::RefCell::new(files);
    let said: Vec<_> = second().into_iter().map(|said| (said.row, said.record(), said.received_ns)).collect();
    let (lost, begun_ns) = (Lost::default(), std::cell::Cell::new(0));
    bencher.bench_local(|| {
        let begin_ns = begun_ns.replace(begun_ns.get() + SECOND_NS);
        for (row, record, received_ns) in &said {
            let taken = files.borrow_mut().take(row, record, begin_ns + received_ns, &lost);
            taken.unwrap_or_else(|error| unreachable!("{error}"));
        }
    });
    drop(files);
    let _ = std::fs::remove_dir_all(folder);
}

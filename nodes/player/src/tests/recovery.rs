//! What is saved of a file that was cut or damaged: everything before, byte for byte.

use super::{Scratch, draw, drive, record};
use crate::scan::{Extent, Scan};
use crate::{Info, PlayerError, Salvage, salvage};
use mcap::records::Record;
use sidestep_recorder::{Copying, RecordError};
use std::hash::{DefaultHasher, Hash, Hasher};
use std::path::Path;

/// Why a test's copy failed.
#[derive(Debug)]
#[allow(dead_code, reason = "read by whoever reads the failure of a test")]
pub(super) enum Failed {
    Read(PlayerError),
    Write(RecordError),
}

impl From<PlayerError> for Failed {
    fn from(error: PlayerError) -> Self {
        Self::Read(error)
    }
}

/// Saves a file into memory, as `sidestep recover` does into another file.
pub(super) fn recover(path: &Path) -> Result<(Salvage, Vec<u8>), Failed> {
    let mut copy = Copying::new(Vec::new(), "memory");
    let saved = salvage(path, |record| copy.write(record).map_err(Failed::Write))?;
    Ok((saved, copy.finish().map_err(Failed::Write)?))
}

fn sum(data: &[u8]) -> u64 {
    let mut hasher = DefaultHasher::new();
    data.hash(&mut hasher);
    hasher.finish()
}

/// What must not change: everything but sums and indices. Schemas and channels, which a file may repeat, come apart.
fn content(path: &Path, extent: Extent) -> (Vec<String>, Vec<String>) {
    let mut scan = Scan::through(path, extent).unwrap();
    let (mut declared, mut said): (Vec<String>, Vec<String>) = Default::default();
    while let Some(outcome) = scan.next(|record| match record {
        Record::Schema { .. } | Record::Channel(_) => declared.push(format!("{record:?}")),
        Record::Metadata(_) => said.push(format!("{record:?}")),
        Record::Message { header, data } => said.push(format!("{header:?} {:x}", sum(data))),
        Record::Attachment { header, data, .. } => said.push(format!("{header:?} {:x}", sum(data))),
        _ => {}
    }) {
        outcome.unwrap();
    }
    declared.sort();
    declared.dedup();
    (declared, said)
}

#[test]
fn everything_before_a_cut_is_saved_and_nothing_else() {
    let bytes = record(&drive(150), &[]);
    let whole = Scratch::new("whole", &bytes);
    let (_, intact) = content(&whole.0, Extent::Data);
    let seed = 7;
    let (mut state, mut before, mut cuts) = (seed, 0, 0);
    println!("seed {seed}");
    for place in (8..bytes.len()).step_by(977) {
        // The place itself moves a little, so that heads, lengths and bodies are all cut.
        let cut = (place + draw(&mut state) as usize % 31).min(bytes.len() - 1);
        let file = Scratch::new("recover-cut", &bytes[..cut]);
        let (saved, copy) = recover(&file.0).unwrap();
        let copy = Scratch::new("recovered", &copy);
        let info = Info::read(&copy.0).unwrap();
        assert!(info.complete && info.messages == saved.messages, "cut at {cut}: {saved:?}");
        let (_, kept) = content(&copy.0, Extent::Data);
        assert_eq!(kept, intact[..kept.len()], "cut at {cut}");
        // At least what a reader of whole chunks finds, and never less than before an earlier cut.
        let readable = content(&file.0, Extent::Data).1.len();
        assert!(kept.len() >= readable.max(before), "cut at {cut}: {} of {readable}, {before}", kept.len());
        assert!(!saved.complete && saved.damage.is_some(), "cut at {cut}: {saved:?}");
        before = kept.len();
        cuts += 1;
    }
    assert!(cuts > 100 && before == intact.len(), "{cuts} cuts, {before} of {}", intact.len());
}

#[test]
fn a_chunk_that_is_damaged_costs_itself_and_what_follows_is_saved() {
    let bytes = record(&drive(400), &[]);
    let whole = Scratch::new("damaged-whole", &bytes);
    let (_, intact) = content(&whole.0, Extent::Data);
    let mut damaged = bytes.clone();
    let middle = bytes.len() / 2;
    damaged[middle..middle + 8].fill(0xa5);
    let file = Scratch::new("damaged", &damaged);
    let (saved, copy) = recover(&file.0).unwrap();
    let copy = Scratch::new("damaged-copy", &copy);
    let (_, kept) = content(&copy.0, Extent::Data);
    assert!(saved.is_lossy() && saved.passed_over == 1, "{saved:?}");
    let lost = intact.len() - kept.len();
    assert_eq!(saved.missing, Some(lost as u64));
    assert!(lost > 0 && kept.last() == intact.last(), "{lost} lost: {saved:?}");
    assert!(content(&file.0, Extent::Data).1.len() < kept.len());
}

#[test]
fn a_complete_file_is_saved_whole_and_counts_no_loss() {
    let bytes = record(&drive(60), &[]);
    let file = Scratch::new("complete", &bytes);
    let (saved, copy) = recover(&file.0).unwrap();
    assert!(saved.complete && !saved.is_lossy() && saved.missing == Some(0), "{saved:?}");
    let copy = Scratch::new("complete-copy", &copy);
    assert_eq!(content(&file.0, Extent::Data), content(&copy.0, Extent::Data));
    // What lacks only its end has lost nothing that the file holds.
    let data = Scan::open(&file.0).map(|mut scan| {
        while scan.next(|_| ()).is_some() {}
        scan.offset()
    });
    let short = Scratch::new("no-end", &bytes[..data.unwrap() as usize - 13]);
    let (saved, _) = recover(&short.0).unwrap();
    assert!(!saved.complete && !saved.is_lossy(), "{saved:?}");
}

#[test]
fn files_of_the_standards_suite_are_saved_as_they_are() {
    let shipped = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/data/mcap");
    let mut files = 0;
    for path in std::fs::read_dir(shipped).unwrap().map(|entry| entry.unwrap().path()) {
        if path.extension().is_none_or(|end| end != "mcap") {
            continue;
        }
        let (saved, copy) = recover(&path).unwrap();
        let copy = Scratch::new("suite-copy", &copy);
        assert!(saved.complete && !saved.is_lossy(), "{}: {saved:?}", path.display());
        assert_eq!(content(&path, Extent::Data), content(&copy.0, Extent::Data), "{}", path.display());
        files += 1;
    }
    assert_eq!(files, 6);
}

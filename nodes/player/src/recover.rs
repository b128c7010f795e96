//! What can be saved of a recording that was cut or damaged: any MCAP file, record by record.
//!
//! Only reading is here; whoever writes the records again is told each of them once, in the order of the file.

use crate::error::PlayerError;
use crate::info::Info;
use crate::scan::{Extent, Scan};
use mcap::records::Record;
use serde::Serialize;
use std::path::Path;

/// What was saved of a file, and what was not.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct Salvage {
    /// Messages saved.
    pub messages: u64,
    /// Of these, messages of a chunk that was cut: nobody could check its sum.
    pub unverified: u64,
    /// `[s]` from the first message saved to the last.
    pub duration_s: f64,
    /// Files within that were saved.
    pub attachments: u64,
    /// Whether the file was ended in order.
    pub complete: bool,
    /// The first damage.
    pub damage: Option<String>,
    /// Chunks and records passed over.
    pub passed_over: u64,
    /// `[byte]` at the end of the file that could not be read.
    pub unread_bytes: u64,
    /// Messages that the summary of the file counts and that were not saved; `None` without a summary.
    pub missing: Option<u64>,
}

impl Salvage {
    /// Whether anything that the file holds was not saved. An end mark that is missing is no loss.
    #[must_use]
    pub fn is_lossy(&self) -> bool {
        self.passed_over > 0 || self.unread_bytes > 0 || self.missing.is_some_and(|count| count > 0)
    }
}

/// Times and counts while records are read.
#[derive(Default)]
struct Watch {
    salvage: Salvage,
    bounds: Option<(u64, u64)>,
}

impl Watch {
    fn kept(&mut self, record: &Record) {
        match record {
            Record::Message { header, .. } => {
                self.salvage.messages += 1;
                let (start, end) = self.bounds.unwrap_or((header.log_time, header.log_time));
                self.bounds = Some((start.min(header.log_time), end.max(header.log_time)));
            }
            Record::Attachment { .. } => self.salvage.attachments += 1,
            _ => {}
        }
    }
}

/// Reads whatever can be read of a file and hands each record to `write`, which says whether it could use it.
///
/// # Errors
/// What `write` returns, [`PlayerError::Read`], or [`PlayerError::NotMcap`].
pub fn salvage<E: From<PlayerError>>(
    path: &Path,
    mut write: impl FnMut(&Record) -> Result<bool, E>,
) -> Result<Salvage, E> {
    let size_bytes = std::fs::metadata(path).map_err(|source| PlayerError::read(path, source))?.len();
    let mut scan = Scan::through(path, Extent::Salvage)?;
    let mut watch = Watch::default();
    let mut refused = 0;
    loop {
        let before = watch.salvage.messages;
        let shown = scan.next(|record| {
            let kept = write(record)?;
            kept.then(|| watch.kept(record));
            Ok::<_, E>(kept)
        });
        let Some(outcome) = shown else { break };
        refused += u64::from(!outcome??);
        watch.salvage.unverified += if scan.is_unverified() { watch.salvage.messages - before } else { 0 };
    }
    let mut salvage = watch.salvage;
    let (start_ns, end_ns) = watch.bounds.unwrap_or_default();
    salvage.duration_s = end_ns.saturating_sub(start_ns) as f64 * 1e-9;
    salvage.complete = scan.is_complete();
    salvage.damage = scan.damage().map(str::to_owned);
    salvage.passed_over = scan.passed_over() + refused;
    if !scan.is_after_data() {
        salvage.unread_bytes = size_bytes.saturating_sub(scan.offset());
    }
    salvage.missing = Info::counted(path).map(|count| count.saturating_sub(salvage.messages));
    Ok(salvage)
}

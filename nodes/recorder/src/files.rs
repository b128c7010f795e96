//! The files of a drive, one after the other, each complete in itself, and the black box beside them.

use crate::black_box::BlackBox;
use crate::config::Config;
use crate::error::RecordError;
use crate::file::DiskFile;
use crate::filter::Filter;
use crate::name::date_time;
use crate::progress::Progress;
use crate::queue::{Lost, Report, Sink};
use crate::ring::Rare;
use crate::space::Space;
use crate::stream::{Onlooker, Stream};
use crate::writer::{Origin, Writer};
use sidestep_msgs::{TOPICS, TopicRow};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::thread::JoinHandle;

/// `[Hz]` a topic that is at most this frequent and reaches late readers is said anew at the head of each file.
const RARE_HZ: f32 = 1.0;
/// `[ns]` without files, the writer begins anew after this, so that its index stays small.
const NOWHERE_NS: u64 = 600_000_000_000;

fn is_rare(row: &TopicRow) -> bool {
    row.history > 0 && row.rate_hz <= RARE_HZ
}

/// A file, or the stream to nowhere, that is being written.
struct Current {
    writer: Writer<Stream>,
    onlooker: Onlooker,
    /// `[ns]` host time of the first message after its head.
    began_ns: Option<u64>,
    /// By topic of the table, before this file.
    lost_before: Vec<u64>,
}

/// When a file is long enough.
#[derive(Debug, Clone, Copy)]
struct Split {
    bytes: u64,
    span_ns: u64,
}

/// Writes records into files as the settings say.
pub struct Files {
    origin: Origin,
    filter: Filter,
    split: Split,
    /// Files without their number and ending; `None` where only the black box is kept.
    base: Option<PathBuf>,
    number: u64,
    path: PathBuf,
    space: Space,
    current: Option<Current>,
    /// Newest record of each rare topic.
    rare: Vec<Option<Arc<[u8]>>>,
    /// Rare records since the black box last took chunks.
    rare_since: Vec<Rare>,
    black_box: Option<BlackBox>,
    closing: Option<JoinHandle<Result<PathBuf, RecordError>>>,
    progress: Arc<Progress>,
    written: u64,
    now_ns: u64,
}

impl std::fmt::Debug for Files {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Files").field("path", &self.path).field("written", &self.written).finish()
    }
}

impl Files {
    /// Begins the first file, named after a wall time; channels, origin and attachments are in it when this returns.
    ///
    /// # Errors
    /// [`RecordError`] where it cannot be made or the disk has too little room.
    pub fn begin(config: &Config, filter: Filter, origin: Origin, wall_ns: u64) -> Result<Self, RecordError> {
        let base = config.folder.join(format!("drive-{}", date_time(wall_ns)));
        let split = Split { bytes: config.split_mb * 1_000_000, span_ns: (config.split_s * 1e9) as u64 };
        let progress = Arc::new(Progress::default());
        let space = Space::new(&config.folder, config.free_mb_least);
        std::fs::create_dir_all(&config.folder)
            .map_err(|source| RecordError::Create { path: config.folder.clone(), source })?;
        let black_box = (config.black_box_mb > 0).then(|| {
            let (origin, space) = (origin.clone(), space.clone());
            BlackBox::new(config.black_box_mb, &config.folder, origin, space, progress.clone())
        });
        let mut files = Self {
            origin,
            filter,
            split,
            base: config.whole_drive.then_some(base),
            number: 0,
            path: PathBuf::new(),
            space,
            current: None,
            rare: vec![None; TOPICS.len()],
            rare_since: Vec::new(),
            black_box,
            closing: None,
            progress,
            written: 0,
            now_ns: 0,
        };
        files.space.has_room_for(0, &config.folder)?;
        files.next(0, &vec![0; TOPICS.len()])?;
        Ok(files)
    }

    /// The file in work; empty where there is none.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// What the recorder may tell others, seen from another thread.
    #[must_use]
    pub fn progress(&self) -> Arc<Progress> {
        self.progress.clone()
    }

    fn name(&self, base: &Path) -> PathBuf {
        let is_split = self.split.bytes > 0 || self.split.span_ns > 0;
        let number = if is_split { format!("_{}", self.number) } else { String::new() };
        PathBuf::from(format!("{}{number}.mcap", base.display()))
    }

    /// Begins the next file: the newest rare messages stand at its head.
    fn next(&mut self, now_ns: u64, lost: &[u64]) -> Result<(), RecordError> {
        let file = self.base.as_ref().map(|base| DiskFile::create(&self.name(base))).transpose()?;
        let onlooker = Onlooker::default();
        self.path = file.as_ref().map(|file| file.path().to_path_buf()).unwrap_or_default();
        let name = file.as_ref().map_or("black box".into(), |file| file.active().display().to_string());
        let stream = Stream { file, onlooker: onlooker.clone() };
        let mut writer = Writer::new(stream, &name, &self.origin)?;
        for (row, record) in TOPICS.iter().zip(&self.rare) {
            if let Some(record) = record {
                writer.write_record(row, record, now_ns)?;
            }
        }
        writer.flush()?;
        if self.black_box.is_some() {
            onlooker.copy();
        }
        self.current = Some(Current { writer, onlooker, began_ns: None, lost_before: lost.to_vec() });
        self.number += 1;
        if self.base.is_some() {
            self.progress.begin_file();
        }
        Ok(())
    }

    /// Ends the file in work: its index now, its way to the disk and its name in a thread of its own.
    fn end_current(&mut self, lost: &[u64]) -> Result<(), RecordError> {
        let Some(Current { mut writer, onlooker, lost_before, .. }) = self.current.take() else {
            return Ok(());
        };
        writer.flush()?;
        self.keep(&onlooker);
        let lost: Vec<_> = lost.iter().zip(&lost_before).map(|(now, before)| now - before).collect();
        let stream = writer.finish(&lost)?;
        self.join()?;
        let Some(file) = stream.file else { return Ok(()) };
        let thread = std::thread::Builder::new().name("recorder-closer".into());
        let closing = thread.spawn(move || file.complete());
        self.closing = Some(closing.map_err(|error| RecordError::Thread(error.to_string()))?);
        Ok(())
    }

    /// Waits until the file before has its name.
    fn join(&mut self) -> Result<(), RecordError> {
        let Some(closing) = self.closing.take() else { return Ok(()) };
        self.path = closing.join().map_err(|_| RecordError::Thread("ended by a panic".into()))??;
        Ok(())
    }

    fn is_full(&mut self) -> bool {
        let now_ns = self.now_ns;
        let Some(current) = &mut self.current else { return false };
        let age_ns = now_ns - *current.began_ns.get_or_insert(now_ns);
        let Split { bytes, span_ns } =
            if self.base.is_some() { self.split } else { Split { bytes: 0, span_ns: NOWHERE_NS } };
        (span_ns > 0 && age_ns >= span_ns) || (bytes > 0 && current.onlooker.bytes() >= bytes)
    }

    fn keep(&mut self, onlooker: &Onlooker) {
        if let Some(black_box) = &mut self.black_box {
            black_box.keep(onlooker.take_chunks(), &mut self.rare_since);
        }
    }

    fn write(&mut self, row: &'static TopicRow, record: &[u8], received_ns: u64) -> Result<(), RecordError> {
        let Some(current) = &mut self.current else { return Ok(()) };
        current.writer.write_record(row, record, received_ns)?;
        self.written += 1;
        if is_rare(row) {
            let record: Arc<[u8]> = record.into();
            // An old state is of no use to a snapshot: the steps that follow it are gone.
            if self.black_box.is_some() && !row.name.starts_with("state/") {
                self.rare_since.push((row.index, record.clone()));
            }
            self.rare[row.index] = Some(record);
        }
        let onlooker = current.onlooker.clone();
        self.keep(&onlooker);
        Ok(())
    }

    /// Writes the black box down where that is due.
    fn keep_due(&mut self) -> Result<(), RecordError> {
        let due = self.black_box.as_ref().is_some_and(|black_box| black_box.is_due(self.now_ns));
        let Some(current) = self.current.as_mut().filter(|_| due) else { return Ok(()) };
        current.writer.flush()?;
        let onlooker = current.onlooker.clone();
        self.keep(&onlooker);
        self.black_box.as_mut().into_iter().for_each(BlackBox::write_due);
        Ok(())
    }
}

impl Sink for Files {
    fn take(
        &mut self,
        row: &'static TopicRow,
        record: &[u8],
        received_ns: u64,
        lost: &Lost,
    ) -> Result<(), RecordError> {
        self.now_ns = self.now_ns.max(received_ns);
        if self.is_full() {
            let lost = lost.now();
            self.end_current(&lost)?;
            self.next(self.now_ns, &lost)?;
        }
        let written = self.current.as_ref().map_or(0, |current| current.onlooker.bytes());
        if let Err(full) = self.space.look(self.now_ns, written, &self.path) {
            self.end_current(&lost.now())?;
            self.join()?;
            // What cannot be kept for want of room is said by the error that follows.
            let _ = self.black_box.take().map(BlackBox::end);
            return Err(full);
        }
        if let Some(black_box) = &mut self.black_box {
            black_box.see(row.index, record, received_ns);
        }
        if self.filter.takes(row.index) {
            self.write(row, record, received_ns)?;
        }
        self.keep_due()
    }

    fn idle(&mut self, span_ns: u64) -> Result<(), RecordError> {
        self.now_ns += span_ns;
        if let Some(current) = &mut self.current {
            current.writer.flush()?;
        }
        self.keep_due()
    }

    fn end(mut self, lost: &Lost) -> Result<Report, RecordError> {
        let ended = self.end_current(&lost.now()).and_then(|()| self.join());
        let kept = self.black_box.take().map_or(Ok(()), BlackBox::end);
        ended.and(kept)?;
        Ok(lost.report(self.path, self.written))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use sidestep_msgs::{Header, ODOMETRY, Odometry};
    use std::sync::atomic::{AtomicU64, Ordering};

    /// `[byte]` what the disk of the test has left.
    static FREE: AtomicU64 = AtomicU64::new(0);

    #[test]
    fn a_recording_ends_in_order_before_the_disk_is_full() {
        let folder = std::env::temp_dir().join(format!("sidestep-recorder-{}-space", std::process::id()));
        let config = Config { free_mb_least: 1, ..Config::plain(folder.clone()) };
        let filter = Filter::of(&[], &[]).unwrap();
        let mut files = Files::begin(&config, filter, Origin::default(), 0).unwrap();
        files.space.free = |_| Ok(FREE.fetch_sub(400_000, Ordering::Relaxed));
        FREE.store(2_000_000, Ordering::Relaxed);
        let record = vec![0; size_of::<Header>() + size_of::<Odometry>()];
        let mut take = |tick: u64| files.take(ODOMETRY.row(), &record, tick * 100_000_000, &Lost::default());
        // Looked at once a second: at 2.0, 1.6, 1.2 and 0.8 MB.
        let (taken, error) = (0..).find_map(|tick| take(tick).err().map(|error| (tick, error))).unwrap();
        assert_eq!(taken, 30);
        let text = error.to_string();
        assert!(text.contains("0 MB free, needed: 1 MB; free space"), "{text}");
        let names: Vec<_> = std::fs::read_dir(&folder).unwrap().map(|entry| entry.unwrap().path()).collect();
        assert_eq!(names.len(), 1);
        assert!(text.contains(&names[0].display().to_string()), "{text} names {names:?}");
        let bytes = std::fs::read(&names[0]).unwrap();
        assert_eq!(mcap::MessageStream::new(&bytes).unwrap().count(), 30);
        assert!(mcap::Summary::read(&bytes).unwrap().is_some(), "complete with its index");
        std::fs::remove_dir_all(folder).unwrap();
    }
}

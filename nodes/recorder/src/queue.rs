//! Between the thread that empties the inboxes and the thread that writes: a queue of recycled buffers.
//!
//! Compressing and writing a chunk can take tens of milliseconds, a disk seconds; the inboxes hold less. All memory is
//! taken at the start. When the writer falls too far behind, messages are counted as lost; nobody ever waits for it.

use crate::error::RecordError;
use crossbeam::channel::{Receiver, RecvTimeoutError, Sender, bounded};
use sidestep_msgs::{Header, TOPICS, TopicRow};
use std::path::PathBuf;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, OnceLock};
use std::thread::JoinHandle;
use std::time::Duration;

/// `[byte]` messages up to this size take a small buffer.
const SMALL_BYTES: usize = 16 * 1024;
/// Without messages for this long the writer closes its chunk.
const IDLE: Duration = Duration::from_secs(1);

/// How many messages may wait for the disk.
#[derive(Debug, Clone, Copy)]
pub struct QueueRoom {
    /// Messages of at most 16 KiB.
    pub small: usize,
    /// Larger ones: depth frames and states.
    pub large: usize,
}

/// One message on its way to the disk.
struct Waiting {
    topic: usize,
    received_ns: u64,
    /// Header and message.
    bytes: Vec<u8>,
}

/// What a finished recording tells.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Report {
    /// The last file; empty where there was none.
    pub path: PathBuf,
    /// Messages written.
    pub written: u64,
    /// Messages that are missing, by topic of the table.
    pub lost: Vec<u64>,
    /// Those of them that the disk was too slow for.
    pub dropped: Vec<u64>,
}

fn named(counts: &[u64]) -> Option<String> {
    let some = TOPICS.iter().zip(counts).filter(|(_, count)| **count > 0);
    let texts: Vec<_> = some.map(|(row, count)| format!("{} {count}", row.name)).collect();
    (!texts.is_empty()).then(|| texts.join(", "))
}

impl Report {
    /// Topics and counts of what is missing, where anything is.
    #[must_use]
    pub fn missing(&self) -> Option<String> {
        named(&self.lost)
    }

    /// Nothing where the disk was fast enough.
    ///
    /// # Errors
    /// [`RecordError::Lost`] with topics and counts.
    pub fn check(&self) -> Result<(), RecordError> {
        let path = self.path.clone();
        named(&self.dropped).map_or(Ok(()), |detail| Err(RecordError::Lost { path, detail }))
    }
}

/// Messages that never reached the disk, by topic of the table.
#[derive(Debug, Clone)]
pub struct Lost {
    all: Arc<[AtomicU64]>,
    dropped: Arc<[AtomicU64]>,
}

impl Default for Lost {
    fn default() -> Self {
        let zeros = || TOPICS.iter().map(|_| AtomicU64::new(0)).collect();
        Self { all: zeros(), dropped: zeros() }
    }
}

fn counts(lost: &[AtomicU64]) -> Vec<u64> {
    lost.iter().map(|count| count.load(Ordering::Acquire)).collect()
}

impl Lost {
    /// `gap` messages were gone before they could be offered, `dropped` found no room.
    fn add(&self, topic: usize, gap: u64, dropped: u64) {
        self.all[topic].fetch_add(gap + dropped, Ordering::AcqRel);
        self.dropped[topic].fetch_add(dropped, Ordering::AcqRel);
    }

    /// The counts up to now.
    #[must_use]
    pub fn now(&self) -> Vec<u64> {
        counts(&self.all)
    }

    /// What becomes of a recording that ended in order.
    #[must_use]
    pub fn report(&self, path: PathBuf, written: u64) -> Report {
        Report { path, written, lost: self.now(), dropped: counts(&self.dropped) }
    }
}

/// What the writer thread works for: files, or in tests a stream.
pub trait Sink: Send + 'static {
    /// Writes a record (header and message), received at host time `received_ns`.
    ///
    /// # Errors
    /// [`RecordError`]; the recording is over, and what can be read stays.
    fn take(
        &mut self,
        row: &'static TopicRow,
        record: &[u8],
        received_ns: u64,
        lost: &Lost,
    ) -> Result<(), RecordError>;

    /// Nothing came for a span of host time: what was taken goes to the system.
    ///
    /// # Errors
    /// As [`Sink::take`].
    fn idle(&mut self, span_ns: u64) -> Result<(), RecordError>;

    /// Ends the recording in order and says what became of it.
    ///
    /// # Errors
    /// [`RecordError`].
    fn end(self, lost: &Lost) -> Result<Report, RecordError>;
}

type Free = (Sender<Vec<u8>>, Receiver<Vec<u8>>);

/// Hands messages to a writer thread without ever waiting for it.
#[derive(Debug)]
pub struct Queue {
    waiting: Sender<Waiting>,
    small: Free,
    large: Free,
    /// The writer thread puts it into each file at its end.
    lost: Lost,
    /// Incarnation and sequence of the last message offered, by topic.
    last: Vec<Option<(u32, u64)>>,
    /// Why the recording ended early.
    failure: Arc<OnceLock<String>>,
    thread: JoinHandle<Result<Report, RecordError>>,
}

fn pool(count: usize, bytes: usize) -> Free {
    let (give, take) = bounded(count);
    for _ in 0..count {
        // A pool of `count` takes `count` buffers.
        let _ = give.send(Vec::with_capacity(bytes));
    }
    (give, take)
}

/// `[byte]` the largest record of the table.
fn largest_record() -> usize {
    size_of::<Header>() + TOPICS.iter().map(|row| row.size).max().unwrap_or(0)
}

/// The writer thread: writes until the queue closes or a write fails, giving each buffer back.
fn write_all(
    sink: &mut impl Sink,
    waiting: &Receiver<Waiting>,
    small: &Sender<Vec<u8>>,
    large: &Sender<Vec<u8>>,
    lost: &Lost,
) -> Result<(), RecordError> {
    loop {
        match waiting.recv_timeout(IDLE) {
            Ok(message) => {
                sink.take(&TOPICS[message.topic], &message.bytes, message.received_ns, lost)?;
                let home = if message.bytes.capacity() <= SMALL_BYTES { small } else { large };
                // The pool has room for each buffer it gave.
                let _ = home.try_send(message.bytes);
            }
            Err(RecvTimeoutError::Timeout) => sink.idle(IDLE.as_nanos() as u64)?,
            Err(RecvTimeoutError::Disconnected) => return Ok(()),
        }
    }
}

impl Queue {
    /// Starts the writer thread.
    ///
    /// # Errors
    /// [`RecordError::Thread`] when the system has no thread to give.
    pub fn start(mut sink: impl Sink, room: QueueRoom) -> Result<Self, RecordError> {
        let (waiting, taken) = bounded::<Waiting>(room.small + room.large);
        let (small, large) = (pool(room.small, SMALL_BYTES), pool(room.large, largest_record()));
        let (small_home, large_home) = (small.0.clone(), large.0.clone());
        let (failure, lost) = (Arc::new(OnceLock::new()), Lost::default());
        let (failure_said, lost_in_all) = (Arc::clone(&failure), lost.clone());
        let thread = std::thread::Builder::new().name("recorder-writer".into()).spawn(move || {
            let outcome = write_all(&mut sink, &taken, &small_home, &large_home, &lost_in_all);
            if let Err(error) = outcome {
                let _ = failure_said.set(error.to_string());
                return Err(error);
            }
            sink.end(&lost_in_all)
        });
        let thread = thread.map_err(|error| RecordError::Thread(error.to_string()))?;
        let last = vec![None; TOPICS.len()];
        Ok(Self { waiting, small, large, lost, last, failure, thread })
    }

    /// Takes a message for the disk; `false` where it is lost because too many wait or the recording has ended.
    pub fn offer(&mut self, row: &TopicRow, header: &Header, message: &[u8], received_ns: u64) -> bool {
        assert_eq!(message.len(), row.size, "a message of {} has another size", row.name);
        let pool = if size_of::<Header>() + message.len() <= SMALL_BYTES { &self.small } else { &self.large };
        let taken = !self.has_failed()
            && pool.1.try_recv().is_ok_and(|mut bytes| {
                bytes.clear();
                bytes.extend_from_slice(bytemuck::bytes_of(header));
                bytes.extend_from_slice(message);
                self.waiting.try_send(Waiting { topic: row.index, received_ns, bytes }).is_ok()
            });
        let gap = self.gap(row, header);
        self.lost.add(row.index, gap, u64::from(!taken));
        taken
    }

    /// Messages of a topic between the last one offered and this one, gone before they could be offered.
    fn gap(&mut self, row: &TopicRow, header: &Header) -> u64 {
        let place = (header.incarnation, header.sequence);
        let (incarnation, sequence) = self.last[row.index].replace(place).unwrap_or(place);
        if incarnation == header.incarnation { header.sequence.saturating_sub(sequence + 1) } else { 0 }
    }

    /// Messages lost so far, by topic of the table.
    #[must_use]
    pub fn lost(&self) -> Vec<u64> {
        self.lost.now()
    }

    /// Whether at least half of the room is free, or nothing is written any more: for a driver that can wait.
    #[must_use]
    pub fn has_room(&self) -> bool {
        let free = |(_, pool): &Free| pool.len() >= pool.capacity().unwrap_or(0) / 2;
        self.has_failed() || free(&self.small) && free(&self.large)
    }

    /// Whether a write failed, so that all further messages are lost.
    #[must_use]
    pub fn has_failed(&self) -> bool {
        self.failure.get().is_some()
    }

    /// Why the recording ended early, where it did.
    #[must_use]
    pub fn failure(&self) -> Option<&str> {
        self.failure.get().map(String::as_str)
    }

    /// Writes what waits, ends the recording in order and says what became of it.
    ///
    /// # Errors
    /// The error that ended the recording early.
    pub fn stop(self) -> Result<Report, RecordError> {
        drop(self.waiting);
        self.thread.join().map_err(|_| RecordError::Thread("ended by a panic".into()))?
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::writer::{Origin, Writer};
    use sidestep_msgs::{DEPTH, ODOMETRY, topic_named};
    use std::io::Write;
    use std::sync::Mutex;

    /// A disk of a given size that can be held still.
    #[derive(Clone)]
    struct Disk {
        free_bytes: usize,
        gate: Arc<Mutex<()>>,
    }

    impl Write for Disk {
        fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
            let _open = self.gate.lock().unwrap();
            let taken = bytes.len().min(self.free_bytes);
            self.free_bytes -= taken;
            if taken == 0 { Err(std::io::ErrorKind::StorageFull.into()) } else { Ok(taken) }
        }

        fn flush(&mut self) -> std::io::Result<()> {
            Ok(())
        }
    }

    impl Sink for Writer<Disk> {
        fn take(
            &mut self,
            row: &'static TopicRow,
            record: &[u8],
            at_ns: u64,
            _: &Lost,
        ) -> Result<(), RecordError> {
            self.write_record(row, record, at_ns)
        }

        fn idle(&mut self, _: u64) -> Result<(), RecordError> {
            self.flush()
        }

        fn end(self, lost: &Lost) -> Result<Report, RecordError> {
            let written = self.written();
            self.finish(&lost.now())?;
            Ok(lost.report("disk".into(), written))
        }
    }

    fn disk(free_bytes: usize) -> Disk {
        Disk { free_bytes, gate: Arc::default() }
    }

    fn queue(disk: Disk) -> Queue {
        let origin = Origin { flush_period_ns: 1, ..Origin::default() };
        Queue::start(Writer::new(disk, "disk", &origin).unwrap(), QueueRoom { small: 8, large: 2 }).unwrap()
    }

    #[test]
    fn a_full_disk_ends_the_recording_with_a_message_and_never_the_one_who_offers() {
        let mut queue = queue(disk(100_000));
        let noise: Vec<u8> =
            (0..DEPTH.row().size as u32).map(|i| (i.wrapping_mul(2_654_435_761) >> 13) as u8).collect();
        while !queue.has_failed() {
            queue.offer(DEPTH.row(), &Header::default(), &noise, 1);
        }
        assert!(!queue.offer(
            ODOMETRY.row(),
            &Header::default(),
            &[0; size_of::<sidestep_msgs::Odometry>()],
            2
        ));
        assert_eq!(queue.lost()[ODOMETRY.index], 1);
        let error = queue.stop().unwrap_err();
        let text = error.to_string();
        assert!(matches!(error, RecordError::Write { .. }) && text.contains("disk"), "{text}");
        assert!(text.contains("no storage space") && text.contains("free space"), "{text}");
    }

    #[test]
    fn a_gap_in_the_sequence_counts_as_lost_and_a_restart_does_not() {
        let mut queue = queue(disk(usize::MAX));
        let row = topic_named("command").unwrap();
        for (incarnation, sequence) in [(0, 5), (0, 6), (0, 9), (1, 1), (1, 2)] {
            let header = Header { incarnation, sequence, ..Header::default() };
            queue.offer(row, &header, &vec![0; row.size], 1);
        }
        assert_eq!(queue.lost()[row.index], 2);
        let report = queue.stop().unwrap();
        assert!(report.check().is_ok(), "the disk was fast enough");
        assert_eq!(report.missing().as_deref(), Some("command 2"));
    }

    #[test]
    fn a_disk_that_stands_still_costs_messages_and_they_are_counted() {
        let disk = disk(usize::MAX);
        let gate = Arc::clone(&disk.gate);
        let mut queue = queue(disk);
        let held = gate.lock().unwrap();
        let row = topic_named("command").unwrap();
        let offered = 50;
        let taken =
            (0..offered).filter(|_| queue.offer(row, &Header::default(), &vec![0; row.size], 1)).count();
        // Eight wait, and the writer may hold one.
        assert!((8..=9).contains(&taken), "{taken} taken");
        drop(held);
        assert_eq!(queue.lost()[row.index], offered - taken as u64);
        let report = queue.stop().unwrap();
        assert_eq!(report.written, taken as u64);
        let text = report.check().unwrap_err().to_string();
        assert!(text.contains(&format!("command {}", offered - taken as u64)), "{text}");
        assert!(text.contains("disk") && text.contains("queue_small"), "{text}");
    }
}

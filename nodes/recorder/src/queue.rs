//! Between the thread that empties the inboxes and the thread that writes: a queue of recycled buffers.
//!
//! Compressing and writing a chunk can take tens of milliseconds, a disk seconds; the inboxes hold less. All memory is
//! taken at the start. When the writer falls too far behind, messages are counted as lost; nobody ever waits for it.

use crate::error::RecordError;
use crate::file::DiskFile;
use crate::writer::Writer;
use crossbeam::channel::{Receiver, RecvTimeoutError, Sender, bounded};
use sidestep_msgs::{Header, TOPICS, TopicRow};
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
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
    /// The file.
    pub path: PathBuf,
    /// Messages written.
    pub written: u64,
}

/// Where a writer thread ends: a file that gets its name, or in tests a stream.
pub trait Finish: Sized {
    /// Ends the recording in order and says where it lies.
    ///
    /// # Errors
    /// [`RecordError`].
    fn end(self, lost: &[u64]) -> Result<PathBuf, RecordError>;
}

impl Finish for Writer<DiskFile> {
    fn end(self, lost: &[u64]) -> Result<PathBuf, RecordError> {
        self.complete(lost)
    }
}

type Free = (Sender<Vec<u8>>, Receiver<Vec<u8>>);

/// Hands messages to a writer thread without ever waiting for it.
#[derive(Debug)]
pub struct Queue {
    waiting: Sender<Waiting>,
    small: Free,
    large: Free,
    /// By topic of the table; the writer thread puts it into the file at the end.
    lost: Arc<[AtomicU64]>,
    /// Incarnation and sequence of the last message offered, by topic.
    last: Vec<Option<(u32, u64)>>,
    broken: Arc<AtomicBool>,
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

fn counts(lost: &[AtomicU64]) -> Vec<u64> {
    lost.iter().map(|count| count.load(Ordering::Acquire)).collect()
}

/// `[byte]` the largest record of the table.
fn largest_record() -> usize {
    size_of::<Header>() + TOPICS.iter().map(|row| row.size).max().unwrap_or(0)
}

/// The writer thread: writes until the queue closes or a write fails, giving each buffer back.
fn write_all<W: std::io::Write>(
    writer: &mut Writer<W>,
    waiting: &Receiver<Waiting>,
    small: &Sender<Vec<u8>>,
    large: &Sender<Vec<u8>>,
) -> Result<u64, RecordError> {
    loop {
        match waiting.recv_timeout(IDLE) {
            Ok(message) => {
                writer.write_record(&TOPICS[message.topic], &message.bytes, message.received_ns)?;
                let home = if message.bytes.capacity() <= SMALL_BYTES { small } else { large };
                // The pool has room for each buffer it gave.
                let _ = home.try_send(message.bytes);
            }
            Err(RecvTimeoutError::Timeout) => writer.flush()?,
            Err(RecvTimeoutError::Disconnected) => return Ok(writer.written()),
        }
    }
}

impl Queue {
    /// Starts the writer thread.
    ///
    /// # Errors
    /// [`RecordError::Thread`] when the system has no thread to give.
    pub fn start<W>(mut writer: Writer<W>, room: QueueRoom) -> Result<Self, RecordError>
    where
        W: std::io::Write + Send + 'static,
        Writer<W>: Finish,
    {
        let (waiting, taken) = bounded::<Waiting>(room.small + room.large);
        let (small, large) = (pool(room.small, SMALL_BYTES), pool(room.large, largest_record()));
        let (small_home, large_home) = (small.0.clone(), large.0.clone());
        let broken = Arc::new(AtomicBool::new(false));
        let lost: Arc<[AtomicU64]> = TOPICS.iter().map(|_| AtomicU64::new(0)).collect();
        let (broken_by_thread, lost_in_all) = (Arc::clone(&broken), Arc::clone(&lost));
        let thread = std::thread::Builder::new().name("recorder-writer".into()).spawn(move || {
            let outcome = write_all(&mut writer, &taken, &small_home, &large_home);
            broken_by_thread.store(outcome.is_err(), Ordering::Release);
            let written = outcome?;
            let path = writer.end(&counts(&lost_in_all))?;
            Ok(Report { path, written })
        });
        let thread = thread.map_err(|error| RecordError::Thread(error.to_string()))?;
        let last = vec![None; TOPICS.len()];
        Ok(Self { waiting, small, large, lost, last, broken, thread })
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
        self.lost[row.index].fetch_add(gap + u64::from(!taken), Ordering::Relaxed);
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
        counts(&self.lost)
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
        self.broken.load(Ordering::Acquire)
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
    use crate::writer::Origin;
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

    impl Finish for Writer<Disk> {
        fn end(self, lost: &[u64]) -> Result<PathBuf, RecordError> {
            self.finish(lost).map(|_| PathBuf::from("disk"))
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
        assert!(queue.stop().is_ok());
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
        assert_eq!(queue.stop().unwrap().written, taken as u64);
    }
}

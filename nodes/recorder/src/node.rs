//! Empties the inbox of every topic into the queue to the disk, until asked to stop.

use crate::{Config, Origin, Queue, QueueRoom, RecordError, Writer, file_name, kernel_class};
use sidestep_bus::{Bookmark, Boot, Inbox, Keep, Link, NodeError, Step, host_ns, wall_ns};
use sidestep_msgs::{COMMAND, Message, Topic, TopicVisitor, visit_topics};

/// An inbox of any topic.
trait Source {
    fn drain(&mut self, step: &mut Step, queue: &mut Queue) -> Result<(), NodeError>;
}

struct Tap<M: Message> {
    topic: Topic<M>,
    inbox: Inbox<M>,
}

impl<M: Message> Source for Tap<M> {
    fn drain(&mut self, step: &mut Step, queue: &mut Queue) -> Result<(), NodeError> {
        self.inbox.each(step, |message, header| {
            queue.offer(self.topic.row(), header, bytemuck::bytes_of(message), host_ns());
        })
    }
}

/// Opens an inbox per topic.
struct Taps<'a> {
    link: &'a Link,
    sources: Vec<Box<dyn Source>>,
}

impl TopicVisitor for Taps<'_> {
    type Error = NodeError;

    fn visit<M: Message>(&mut self, topic: Topic<M>) -> Result<(), NodeError> {
        let inbox = self.link.inbox(topic, Keep::All)?;
        self.sources.push(Box::new(Tap { topic, inbox }));
        Ok(())
    }
}

fn lost(error: &RecordError) -> NodeError {
    NodeError::Lost(error.to_string())
}

/// What the recording says of the run, with the files of the run within.
fn origin(boot: &Boot, config: &Config) -> Result<Origin, NodeError> {
    let mut attachments = boot.files()?;
    for path in &config.attach {
        let bytes = std::fs::read(path).map_err(|source| NodeError::File {
            path: path.display().to_string(),
            source,
            remedy: "name files that exist in recorder.attach",
        })?;
        let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        attachments.push((name, bytes));
    }
    let metadata = [
        ("version", env!("CARGO_PKG_VERSION").into()),
        ("run", boot.run.to_string()),
        ("incarnation", boot.incarnation.to_string()),
        ("kernel_class", kernel_class().into()),
        ("machine", std::env::consts::ARCH.into()),
    ];
    Ok(Origin {
        mono_to_wall_ns: wall_ns().saturating_sub(host_ns()) as i64,
        metadata: metadata.map(|(key, value): (&str, String)| (key.into(), value)).into(),
        attachments,
        flush_period_ns: config.flush_period_ns(),
    })
}

/// Records every topic of the run that this process belongs to.
///
/// # Errors
/// [`NodeError::Lost`] where the recording could not begin or ended early; the drive never waits for it.
pub fn run(boot: &Boot) -> Result<(), NodeError> {
    let config: Config = boot.config()?;
    config.check().map_err(NodeError::Configuration)?;
    let path = config.folder.join(file_name(wall_ns()));
    let writer = Writer::create(&path, &origin(boot, &config)?).map_err(|error| lost(&error))?;
    let word = boot.domain.root.join("recording");
    let _ = std::fs::write(word, writer.path().display().to_string());
    let room = QueueRoom { small: config.queue_small, large: config.queue_large };
    let mut queue = Queue::start(writer, room).map_err(|error| lost(&error))?;

    let mut link = Link::open(boot)?;
    let mut taps = Taps { link: &link, sources: Vec::new() };
    visit_topics(&mut taps)?;
    let mut sources = taps.sources;
    // Not woken by the frame itself: whoever turns it into a command goes first, and the rings hold it meanwhile.
    link.wake_on(COMMAND)?;
    let bookmark = boot.is_lockstep()?.then(|| Bookmark::write(boot));
    let mut told = false;
    link.run(|step| {
        sources.iter_mut().try_for_each(|source| source.drain(step, &mut queue))?;
        // A driver that moves time waits while the queue has no room for what would follow.
        bookmark
            .iter()
            .filter(|_| queue.has_room())
            .for_each(|bookmark| bookmark.tell(step.clock_sequence()));
        if queue.has_failed() && !told {
            told = true;
            eprintln!("the recording ended early, the drive goes on; the reason follows at the end");
        }
        Ok(())
    })?;
    // What was sent while this node was asked to stop.
    let mut last = Step::new();
    sources.iter_mut().try_for_each(|source| source.drain(&mut last, &mut queue))?;
    queue.stop().map(|_| ()).map_err(|error| lost(&error))
}

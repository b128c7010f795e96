//! The shared memory of one run: its name, its services, its end.
//!
//! One domain (prefix and folder) per run: two runs never meet, and whatever a killed process leaves behind is gone
//! when the domain is wiped. The launcher creates and holds every service, nodes only open: a process killed while it
//! creates a service would leave that service unusable (measured with iceoryx2 0.10: one early kill in four).

use crate::clock::wall_ns;
use crate::error::NodeError;
use crate::inbox::Keep;
use iceoryx2::node::CleanupState;
use iceoryx2::port::listener::Listener;
use iceoryx2::port::notifier::Notifier;
use iceoryx2::port::publisher::Publisher;
use iceoryx2::port::subscriber::Subscriber;
use iceoryx2::prelude::{
    AttributeSpecifier, AttributeVerifier, Config, FileName, LogLevel, Node, NodeBuilder, Path as IoxPath,
    SemanticString, ServiceName, SignalHandlingMode, ipc, set_log_level,
};
use iceoryx2::service::port_factory::{event, publish_subscribe};
use sidestep_msgs::{Header, Message, Topic, TopicVisitor, visit_topics};
use std::any::Any;
use std::fs;
use std::os::fd::AsRawFd;
use std::os::unix::fs::{DirBuilderExt, PermissionsExt};
use std::path::{Path, PathBuf};
use std::rc::Rc;

/// Most processes in a domain: nodes, tools, operators.
const PROCESSES_MAX: usize = 32;
/// `[ns]` an empty shared-memory file older than this belongs to nobody alive.
const LITTER_AGE_NS: u64 = 100_000_000;
const SHARED_MEMORY: &str = "/dev/shm";

/// The writing side of a topic: messages, and the wake-up of its readers.
pub(crate) type Writer<M> = (Publisher<ipc::Service, M, Header>, Notifier<ipc::Service>);
type PubSub<M> = publish_subscribe::PortFactory<ipc::Service, M, Header>;

/// Where a run lives.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct DomainName {
    /// Prefix of its shared-memory objects.
    pub prefix: String,
    /// Its folder; only the starting user can read it.
    pub root: PathBuf,
}

/// What the launcher leaves in the folder of a run.
const RUN_FILES: [&str; 4] = ["graph.toml", "robot.toml", "model.toml", "model.onnx"];

impl DomainName {
    /// The files of the run by name: the resolved graph, the robot, which model drives, and that model where no binary
    /// holds it.
    #[must_use]
    pub fn files(&self) -> Vec<(String, Vec<u8>)> {
        let read = |name: &str| fs::read(self.root.join(name)).map(|bytes| (name.to_owned(), bytes));
        RUN_FILES.iter().filter_map(|name| read(name).ok()).collect()
    }

    fn config(&self) -> Result<Config, NodeError> {
        let refused = |detail: &dyn std::fmt::Debug| NodeError::transport("domain", "name it", detail);
        let mut config = Config::default();
        config.global.prefix = FileName::new(self.prefix.as_bytes()).map_err(|error| refused(&error))?;
        let root = IoxPath::new(self.root.as_os_str().as_encoded_bytes()).map_err(|error| refused(&error))?;
        config.global.set_root_path(&root);
        // Only the sweeper cleans up after the dead: a cleaner inside a node would stall its loop.
        config.global.node.cleanup_dead_nodes_on_creation = false;
        config.global.node.cleanup_dead_nodes_on_destruction = false;
        config.global.service.cleanup_dead_nodes_on_open = false;
        Ok(config)
    }

    /// Joins the domain under a name.
    pub(crate) fn node(&self, name: &str) -> Result<Node<ipc::Service>, NodeError> {
        set_log_level(LogLevel::Fatal);
        let refused = |detail: &dyn std::fmt::Debug| NodeError::transport("domain", "join it", detail);
        NodeBuilder::new()
            .name(&name.try_into().map_err(|error| refused(&error))?)
            .config(&self.config()?)
            .signal_handling_mode(SignalHandlingMode::Disabled)
            .create()
            .map_err(|error| refused(&error))
    }

    fn lock_path(&self) -> PathBuf {
        self.root.join("lock")
    }

    /// Removes every trace of the domain.
    fn wipe(&self) {
        for path in shared_memory(&self.prefix) {
            let _ = fs::remove_file(path);
        }
        let _ = fs::remove_dir_all(&self.root);
    }
}

/// The services of a domain, opened one by one.
#[derive(Debug)]
pub struct Services {
    node: Rc<Node<ipc::Service>>,
}

fn service_name(topic: &str) -> Result<ServiceName, NodeError> {
    format!("sidestep/{topic}")
        .as_str()
        .try_into()
        .map_err(|error| NodeError::transport(topic, "name the service", error))
}

fn layout_text<M: Message>() -> String {
    format!("{:016x}", M::LAYOUT_HASH)
}

impl Services {
    pub(crate) fn of(node: Rc<Node<ipc::Service>>) -> Self {
        Self { node }
    }

    fn create<M: Message>(
        &self,
        topic: Topic<M>,
    ) -> Result<(PubSub<M>, event::PortFactory<ipc::Service>), NodeError> {
        let row = topic.row();
        let refused =
            |detail: &dyn std::fmt::Debug| NodeError::transport(row.name, "create the service", detail);
        let layout = AttributeSpecifier::new()
            .define(
                &"layout".try_into().map_err(|error| refused(&error))?,
                &layout_text::<M>().as_str().try_into().map_err(|error| refused(&error))?,
            )
            .map_err(|error| refused(&error))?;
        let messages = self
            .node
            .service_builder(&service_name(row.name)?)
            .publish_subscribe::<M>()
            .user_header::<Header>()
            .max_publishers(1)
            .max_subscribers(row.readers)
            .subscriber_max_buffer_size(row.buffer)
            .subscriber_max_borrowed_samples(row.borrow)
            .history_size(row.history)
            .max_nodes(PROCESSES_MAX)
            .enable_safe_overflow(true)
            .create_with_attributes(&layout)
            .map_err(|error| refused(&error))?;
        let wakes = self
            .node
            .service_builder(&service_name(row.name)?)
            .event()
            .max_nodes(PROCESSES_MAX)
            .create()
            .map_err(|error| refused(&error))?;
        Ok((messages, wakes))
    }

    fn open<M: Message>(&self, topic: Topic<M>) -> Result<PubSub<M>, NodeError> {
        let row = topic.row();
        let refused =
            |detail: &dyn std::fmt::Debug| NodeError::transport(row.name, "open the service", detail);
        let layout = AttributeVerifier::new()
            .require(
                &"layout".try_into().map_err(|error| refused(&error))?,
                &layout_text::<M>().as_str().try_into().map_err(|error| refused(&error))?,
            )
            .map_err(|error| refused(&error))?;
        self.node
            .service_builder(&service_name(row.name)?)
            .publish_subscribe::<M>()
            .user_header::<Header>()
            .open_with_attributes(&layout)
            .map_err(|error| refused(&error))
    }

    fn open_event(&self, topic: &str) -> Result<event::PortFactory<ipc::Service>, NodeError> {
        self.node
            .service_builder(&service_name(topic)?)
            .event()
            .open()
            .map_err(|error| NodeError::transport(topic, "open the event", error))
    }

    pub(crate) fn subscriber<M: Message>(
        &self,
        topic: Topic<M>,
        keep: Keep,
    ) -> Result<Subscriber<ipc::Service, M, Header>, NodeError> {
        let buffer = if keep == Keep::All { topic.row().buffer } else { 1 };
        self.open(topic)?
            .subscriber_builder()
            .buffer_size(buffer)
            .create()
            .map_err(|error| NodeError::transport(topic.row().name, "read it", error))
    }

    pub(crate) fn publisher<M: Message>(&self, topic: Topic<M>) -> Result<Writer<M>, NodeError> {
        let name = topic.row().name;
        let publisher = self
            .open(topic)?
            .publisher_builder()
            .max_loaned_samples(1)
            .create()
            .map_err(|error| NodeError::transport(name, "write it", error))?;
        let notifier = self
            .open_event(name)?
            .notifier_builder()
            .create()
            .map_err(|error| NodeError::transport(name, "wake its readers", error))?;
        Ok((publisher, notifier))
    }

    pub(crate) fn listener(&self, topic: &str) -> Result<Listener<ipc::Service>, NodeError> {
        self.open_event(topic)?
            .listener_builder()
            .create()
            .map_err(|error| NodeError::transport(topic, "wait for it", error))
    }
}

/// A domain that this process made and holds; wiped when dropped.
pub struct Domain {
    /// Its name.
    pub name: DomainName,
    // Services are dropped before the node, the node before the wipe.
    held: Vec<Box<dyn Any>>,
    node: Option<Rc<Node<ipc::Service>>>,
    _lock: fs::File,
}

struct Creator {
    services: Services,
    held: Vec<Box<dyn Any>>,
}

impl TopicVisitor for Creator {
    type Error = NodeError;
    fn visit<M: Message>(&mut self, topic: Topic<M>) -> Result<(), NodeError> {
        let (messages, wakes) = self.services.create(topic)?;
        self.held.push(Box::new(messages));
        self.held.push(Box::new(wakes));
        Ok(())
    }
}

impl Domain {
    /// Makes a domain with all services of the topic table, after wiping domains whose launcher is gone.
    ///
    /// # Errors
    /// [`NodeError::File`] where the folder cannot be made, [`NodeError::Transport`] where shared memory refuses.
    pub fn create(run: u64) -> Result<Self, NodeError> {
        let base = runtime_root();
        let failed = |path: &Path, source| NodeError::File {
            path: path.display().to_string(),
            source,
            remedy: "the folder of runs must be writable; set XDG_RUNTIME_DIR to one that is",
        };
        fs::DirBuilder::new()
            .recursive(true)
            .mode(0o700)
            .create(&base)
            .map_err(|error| failed(&base, error))?;
        wipe_dead_domains(&base);
        let prefix = format!("sd{run:x}_");
        let root = base.join(format!("{run:x}"));
        fs::DirBuilder::new().mode(0o700).create(&root).map_err(|error| failed(&root, error))?;
        let name = DomainName { prefix, root };
        let lock = fs::File::create(name.lock_path()).map_err(|error| failed(&name.root, error))?;
        if !lock_exclusively(&lock) {
            return Err(failed(&name.root, std::io::Error::from(std::io::ErrorKind::ResourceBusy)));
        }
        let node = Rc::new(name.node("launcher")?);
        let mut creator = Creator { services: Services::of(node.clone()), held: Vec::new() };
        visit_topics(&mut creator)?;
        Ok(Self { name, held: creator.held, node: Some(node), _lock: lock })
    }
}

impl Drop for Domain {
    fn drop(&mut self) {
        // Files and shared memory are removed by name below: running iceoryx2's own clean-up could hang on what a
        // killed node left half made, and there is nothing that it would save.
        std::mem::forget(std::mem::take(&mut self.held));
        if let Some(node) = self.node.take() {
            std::mem::forget(node);
        }
        self.name.wipe();
    }
}

/// Longest XDG_RUNTIME_DIR that is used: a socket's path has at most 107 bytes, of which `/sidestep/RUN` takes 22 and the
/// name of the socket 60.
const RUNTIME_DIR_MOST: usize = 25;

/// The folder of all runs of this user.
#[must_use]
pub fn runtime_root() -> PathBuf {
    // SAFETY: geteuid has no preconditions and cannot fail.
    #[allow(unsafe_code, reason = "the user's number names the folder; std does not offer it")]
    let user = unsafe { libc::geteuid() };
    let base = std::env::var_os("XDG_RUNTIME_DIR")
        .map(PathBuf::from)
        .filter(|path| path.is_dir() && path.as_os_str().len() <= RUNTIME_DIR_MOST);
    base.map_or_else(|| PathBuf::from(format!("/tmp/sidestep-{user}")), |path| path.join("sidestep"))
}

fn lock_exclusively(file: &fs::File) -> bool {
    // SAFETY: the descriptor is open for the length of the call.
    #[allow(unsafe_code, reason = "a lock that dies with its process is how a stale domain is known")]
    let result = unsafe { libc::flock(file.as_raw_fd(), libc::LOCK_EX | libc::LOCK_NB) };
    result == 0
}

fn shared_memory(prefix: &str) -> Vec<PathBuf> {
    let entries = fs::read_dir(SHARED_MEMORY).into_iter().flatten().flatten();
    entries
        .filter(|entry| entry.file_name().to_string_lossy().starts_with(prefix))
        .map(|entry| entry.path())
        .collect()
}

fn domains(base: &Path) -> Vec<DomainName> {
    let entries = fs::read_dir(base).into_iter().flatten().flatten();
    let name = |entry: fs::DirEntry| {
        let run = u64::from_str_radix(&entry.file_name().to_string_lossy(), 16).ok()?;
        Some(DomainName { prefix: format!("sd{run:x}_"), root: entry.path() })
    };
    entries.filter_map(name).collect()
}

fn is_live(domain: &DomainName) -> bool {
    // A lock that can be taken is held by nobody.
    fs::File::open(domain.lock_path()).is_ok_and(|lock| !lock_exclusively(&lock))
}

fn wipe_dead_domains(base: &Path) {
    for domain in domains(base) {
        // A folder without a lock may be a run that is just being made: left alone until it is a second old.
        let young = age_ns(&domain.root).is_none_or(|age| age < 1_000_000_000);
        if !young && !is_live(&domain) {
            domain.wipe();
        }
    }
}

/// Domains of this user whose launcher lives, newest first.
#[must_use]
pub fn live_domains() -> Vec<DomainName> {
    let mut live: Vec<_> = domains(&runtime_root()).into_iter().filter(is_live).collect();
    live.sort_by_key(|domain| {
        std::cmp::Reverse(fs::metadata(&domain.root).and_then(|data| data.modified()).ok())
    });
    live
}

fn age_ns(path: &Path) -> Option<u64> {
    let modified = fs::metadata(path).ok()?.modified().ok()?;
    let since = modified.duration_since(std::time::UNIX_EPOCH).ok()?;
    Some(wall_ns().saturating_sub(since.as_nanos() as u64))
}

/// Cleans up after killed nodes; runs in a process of its own that the launcher can kill, since it may hang.
///
/// A process killed between creating and sizing a shared-memory object leaves an empty file on which iceoryx2 0.10
/// spins for ever as root; such litter is removed first.
///
/// # Errors
/// [`NodeError::Transport`] where something could not be cleaned.
pub fn sweep(domain: &DomainName) -> Result<(), NodeError> {
    set_log_level(LogLevel::Fatal);
    for path in shared_memory(&domain.prefix) {
        let empty = fs::metadata(&path).is_ok_and(|data| data.len() == 0);
        if empty && age_ns(&path).is_some_and(|age| age > LITTER_AGE_NS) {
            let _ = fs::set_permissions(&path, fs::Permissions::from_mode(0o600));
            let _ = fs::remove_file(&path);
        }
    }
    let node = domain.node("sweeper")?;
    let CleanupState { failed_cleanups, .. } = node.try_cleanup_dead_nodes();
    if failed_cleanups == 0 {
        return Ok(());
    }
    Err(NodeError::transport("domain", "clean up after a killed node", failed_cleanups))
}

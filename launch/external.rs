//! Nodes of other programs: found, checked, and heard when they first speak.

use crate::failure::Failure;
use crate::manifest::{Graph, NodePlan, Restart};
use serde::Deserialize;
use sidestep_bus::{Inbox, Keep, Link, NodeError, Step};
use sidestep_msgs::{Message, TOPICS, Topic, TopicRow, TopicVisitor, topic_named, visit_topics};
use std::convert::Infallible;
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};

/// A node of another program that speaks the topics.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct External {
    restart: Restart,
    #[serde(default)]
    cpus: Vec<usize>,
    #[serde(default)]
    priority: u8,
    #[serde(default)]
    nice: u8,
    /// Program and arguments.
    command: Vec<String>,
    /// Topics that it writes; empty = those that the table of topics gives to a node of its name, else those of a driver.
    #[serde(default)]
    writes: Vec<String>,
}

impl External {
    /// How to start it.
    ///
    /// # Errors
    /// Exit code 2 with what was found and what is needed.
    pub(crate) fn plan(&self, name: &str, origin: &str) -> Result<NodePlan, Failure> {
        let wrong = |why: String| Failure::usage(format!("graph {origin}: external.{name}.{why}"));
        let Some((program, arguments)) = self.command.split_first() else {
            return Err(wrong("command is empty; give a program".to_owned()));
        };
        let row = |topic: &String| {
            topic_named(topic).ok_or_else(|| {
                wrong(format!("writes: no topic is named {topic}; `sidestep topic list` names them"))
            })
        };
        Ok(NodePlan {
            name: name.to_owned(),
            command: [beside(origin, program)].into_iter().chain(arguments.iter().cloned()).collect(),
            restart: self.restart,
            cpus: self.cpus.clone(),
            priority: self.priority,
            nice: self.nice,
            lock_memory: false,
            moves_time: false,
            writes: match self.writes.as_slice() {
                [] => written_by(name),
                named => named.iter().map(row).collect::<Result<_, _>>()?,
            },
        })
    }
}

/// What a node of this name writes by the table, its heartbeat aside.
fn written_by(name: &str) -> Vec<&'static TopicRow> {
    let of = |writer: &str| -> Vec<_> {
        TOPICS.iter().filter(|row| row.writer == writer && !row.name.starts_with("health/")).collect()
    };
    let own = of(name);
    if own.is_empty() { of("driver") } else { own }
}

/// A relative path of a graph file is meant beside that file, where there is one of that name; else it stays as it is.
pub(crate) fn beside(origin: &str, path: &str) -> String {
    let neighbour = Path::new(origin).parent().unwrap_or(Path::new("")).join(path);
    // A bare name is a program of PATH or a built-in robot, unless a file of that name says otherwise by its ending.
    let named = path.contains('/') || Path::new(path).extension().is_some();
    let Some(found) = (named && neighbour.is_file()).then(|| std::path::absolute(&neighbour).ok()).flatten()
    else {
        return path.to_owned();
    };
    found.display().to_string()
}

/// Checks that the programs of a graph can be started, before anything is.
///
/// # Errors
/// Exit code 2 with the program and the remedy.
pub(crate) fn find_programs(graph: &Graph) -> Result<(), Failure> {
    for plan in &graph.nodes {
        if let Some(program) = plan.command.first() {
            find(program).map_err(|why| {
                Failure::usage(format!(
                    "graph {}: external.{}.command: program {program} {why}",
                    graph.origin, plan.name
                ))
            })?;
        }
    }
    Ok(())
}

fn find(program: &str) -> Result<(), String> {
    let places: Vec<PathBuf> = if program.contains('/') {
        vec![program.into()]
    } else {
        let path = std::env::var_os("PATH").unwrap_or_default();
        std::env::split_paths(&path).map(|folder| folder.join(program)).collect()
    };
    let files: Vec<_> = places.iter().filter_map(|place| std::fs::metadata(place).ok()).collect();
    if files.iter().any(|file| file.is_file() && file.permissions().mode() & 0o111 != 0) {
        return Ok(());
    }
    Err(if files.is_empty() {
        "is not found; needed: a path, also relative to the graph file, or a name in PATH".to_owned()
    } else {
        format!("is not executable; `chmod +x {program}`, or name its interpreter first")
    })
}

trait Ear {
    fn hears(&mut self, step: &mut Step) -> Result<bool, NodeError>;
}

impl<M: Message> Ear for Inbox<M> {
    fn hears(&mut self, step: &mut Step) -> Result<bool, NodeError> {
        Ok(self.newest(step)?.is_some())
    }
}

/// Listens for the first message of a program that has just been started; whoever wrote before is dead.
pub(crate) struct FirstWord(Vec<Box<dyn Ear>>);

impl std::fmt::Debug for FirstWord {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(formatter, "FirstWord of {} topics", self.0.len())
    }
}

struct Opener<'a> {
    link: &'a Link,
    wanted: &'a [&'static TopicRow],
    ears: Vec<Box<dyn Ear>>,
}

impl TopicVisitor for Opener<'_> {
    type Error = Infallible;
    fn visit<M: Message>(&mut self, topic: Topic<M>) -> Result<(), Infallible> {
        // A topic whose readers are all taken, by tools, has other topics beside it.
        if self.wanted.iter().any(|row| row.index == topic.index)
            && let Ok(inbox) = self.link.inbox(topic, Keep::Newest)
        {
            self.ears.push(Box::new(inbox));
        }
        Ok(())
    }
}

impl FirstWord {
    /// Listens on these topics.
    pub(crate) fn listen(link: &Link, topics: &[&'static TopicRow]) -> Self {
        let mut opener = Opener { link, wanted: topics, ears: Vec::new() };
        let Ok(()) = visit_topics(&mut opener);
        Self(opener.ears)
    }

    /// Whether a message has come.
    ///
    /// # Errors
    /// [`NodeError::Transport`].
    pub(crate) fn is_spoken(&mut self, step: &mut Step) -> Result<bool, NodeError> {
        for ear in &mut self.0 {
            if ear.hears(step)? {
                return Ok(true);
            }
        }
        Ok(false)
    }
}

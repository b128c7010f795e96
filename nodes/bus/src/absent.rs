//! Who has not spoken yet: a driver begins when every node of the graph is there.

use crate::boot::Boot;
use crate::error::NodeError;
use crate::inbox::{Inbox, Keep};
use crate::link::Link;
use crate::step::Step;
use sidestep_msgs::{Health, health_topic};

/// Whoever must beat before a driver begins, as far as the graph has them.
const AWAITED: &[&str] = &["mapper", "guard", "goal", "policy", "expert", "arbiter", "recorder"];

/// Nodes of the graph that did not beat yet.
#[derive(Debug)]
pub struct Absent(Vec<Inbox<Health>>);

impl Absent {
    /// Listens for the hearts of the graph.
    ///
    /// # Errors
    /// [`NodeError::Transport`], or what the boot says of the graph file.
    pub fn open(link: &Link, boot: &Boot) -> Result<Self, NodeError> {
        let mut absent = Vec::new();
        for node in AWAITED {
            if let Some(topic) = health_topic(node).filter(|_| boot.has_node(node).unwrap_or(false)) {
                absent.push(link.inbox(topic, Keep::Newest)?);
            }
        }
        Ok(Self(absent))
    }

    /// Whether every node has said that it is ready.
    ///
    /// # Errors
    /// [`NodeError::Transport`].
    pub fn are_none(&mut self) -> Result<bool, NodeError> {
        let mut error = None;
        // Heartbeats are of host time, and no input of what follows.
        let mut aside = Step::new();
        self.0.retain_mut(|inbox| match inbox.newest(&mut aside) {
            Ok(beat) => beat.is_none(),
            Err(found) => {
                error = Some(found);
                true
            }
        });
        error.map_or(Ok(self.0.is_empty()), Err)
    }
}

//! The only door to the outside of a node: shared memory, clock, signals, heartbeat.
//!
//! A node opens a [`Link`], its [`Inbox`]es and [`Outbox`]es, says what wakes it, and hands [`Link::run`] a closure
//! that is called once per wake with a [`Step`]: the one time of the step, and the record of what the step took.
//! Reads only what arrived, never waits inside the closure, and sends one output per output topic and step.
//!
//! ```ignore
//! let mut link = Link::open(boot)?;
//! let mut depth = link.inbox(DEPTH, Keep::Newest)?;
//! let mut maps = link.outbox(LOCAL_MAP)?;
//! link.wake_on(DEPTH)?;
//! link.run(|step| {
//!     if let Some(frame) = depth.newest(step)? {
//!         step.follow(frame.header(), Stage::Mapper);
//!         step.status(mapper.depth(&frame));
//!         maps.send(step, |map| mapper.write_local(map))?;
//!     }
//!     Ok(())
//! })
//! ```

mod absent;
mod answers;
mod bookmark;
mod boot;
mod clock;
mod domain;
mod error;
mod graph_file;
mod inbox;
mod keepsake;
mod link;
mod outbox;
mod step;

pub use absent::Absent;
pub use answers::{Answers, Question};
pub use bookmark::Bookmark;
pub use boot::{Boot, environment};
pub use clock::{host_ns, pause, wall_ns};
pub use domain::{Domain, DomainName, Services, live_domains, runtime_root, sweep};
pub use error::NodeError;
pub use graph_file::GraphFile;
pub use inbox::{Inbox, Keep, Received};
pub use keepsake::Keepsake;
pub use link::{Counters, Link};
pub use outbox::Outbox;
pub use step::Step;

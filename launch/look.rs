//! Looking into a run from outside: `sidestep topic` and `sidestep top`.

use crate::failure::Failure;
use sidestep_bus::{
    DomainName, Inbox, Keep, Link, NodeError, Step, environment, host_ns, live_domains, pause,
};
use sidestep_msgs::{
    COMMAND, Code, Command, Health, Message, NodeState, Reason, TOPICS, Topic, TopicVisitor, Winner,
    health_topic, topic_named, visit_topics,
};
use std::time::Duration;

/// The run named by the environment, as a node's own tools find it, else all runs of this user, newest first.
///
/// # Errors
/// Exit code 3 where no run lives.
pub(crate) fn runs() -> Result<Vec<DomainName>, Failure> {
    if let (Ok(prefix), Ok(root)) = (std::env::var(environment::DOMAIN), std::env::var(environment::ROOT)) {
        return Ok(vec![DomainName { prefix, root: root.into() }]);
    }
    let live = live_domains();
    if live.is_empty() {
        return Err(Failure::io("no run is alive; start one with `sidestep run`"));
    }
    Ok(live)
}

/// The one run that an operator can mean.
///
/// # Errors
/// Exit code 2 where several live, 3 where none does.
pub(crate) fn only_run() -> Result<DomainName, Failure> {
    let mut live = runs()?;
    if live.len() > 1 {
        let (domain, root) = (environment::DOMAIN, environment::ROOT);
        let name = |run: &DomainName| format!("{domain}={} {root}={}", run.prefix, run.root.display());
        let names: Vec<_> = live.iter().map(name).collect();
        let why = format!("{} runs are alive; say which, as one of:\n  {}", live.len(), names.join("\n  "));
        return Err(Failure::usage(why));
    }
    Ok(live.remove(0))
}

/// Joins a run as a tool.
///
/// # Errors
/// Exit code 3 where it was made by another version.
pub(crate) fn join(run: &DomainName, tool: &str) -> Result<Link, Failure> {
    Ok(Link::attach(run, &format!("{tool}-{}", std::process::id()), 0, 0)?)
}

/// The table of topics as text.
pub(crate) fn list() -> String {
    let mut text = format!("{:<16} {:<24} {:<9} {:>7} {:>9}\n", "topic", "type", "writer", "Hz", "bytes");
    for row in TOPICS {
        let line = format!(
            "{:<16} {:<24} {:<9} {:>7.1} {:>9}\n",
            row.name, row.type_name, row.writer, row.rate_hz, row.size
        );
        text.push_str(&line);
    }
    text
}

/// Counts or prints what arrives on one topic.
struct Listener<'a> {
    link: &'a mut Link,
    name: &'static str,
    echo: bool,
    until_ns: u64,
    count_most: u64,
    received: u64,
}

impl Listener<'_> {
    fn listen<M: Message>(&mut self, topic: Topic<M>) -> Result<(), NodeError> {
        let mut inbox = self.link.inbox(topic, Keep::All)?;
        let mut step = Step::new();
        while host_ns() < self.until_ns && self.received < self.count_most {
            self.link.look(&mut step)?;
            while let Some(message) = inbox.next(&mut step)? {
                self.received += 1;
                if self.echo {
                    let header = message.header();
                    let lead = format!(
                        "sequence {} frame {} now {}",
                        header.sequence, header.source_frame, header.now_ns
                    );
                    crate::output::line(&format!("{lead}: {}", brief(&format!("{:?}", *message))));
                }
                if self.received >= self.count_most {
                    break;
                }
            }
            pause(Duration::from_millis(2));
        }
        Ok(())
    }
}

/// A message's debug text with long arrays cut.
fn brief(text: &str) -> String {
    const LONG: usize = 16;
    let mut out = String::new();
    let mut rest = text;
    while let Some(open) = rest.find('[') {
        let close = rest[open..].find(']').map_or(rest.len(), |offset| open + offset);
        let inside = &rest[open + 1..close];
        out.push_str(&rest[..=open]);
        if !inside.contains('[') && inside.split(',').count() > LONG {
            let first: Vec<_> = inside.split(',').take(LONG).collect();
            out.push_str(&format!("{}, ..", first.join(",")));
        } else {
            out.push_str(inside);
        }
        rest = &rest[close..];
    }
    out.push_str(rest);
    out
}

impl TopicVisitor for Listener<'_> {
    type Error = NodeError;
    fn visit<M: Message>(&mut self, topic: Topic<M>) -> Result<(), NodeError> {
        if topic.row().name == self.name { self.listen(topic) } else { Ok(()) }
    }
}

/// Listens to a topic of the newest run; returns how many messages came.
///
/// # Errors
/// Exit code 2 for a name that is no topic, 3 where no run lives.
pub(crate) fn listen(name: &str, echo: bool, time: Duration, count_most: u64) -> Result<u64, Failure> {
    let row = topic_named(name).ok_or_else(|| {
        Failure::usage(format!("no topic is named {name}; `sidestep topic list` shows them all"))
    })?;
    let mut link = join(&runs()?[0], "topic")?;
    let until_ns = host_ns() + time.as_nanos() as u64;
    let mut listener = Listener { link: &mut link, name: row.name, echo, until_ns, count_most, received: 0 };
    visit_topics(&mut listener)?;
    Ok(listener.received)
}

/// A node as its heartbeat shows it.
struct Heart {
    name: &'static str,
    inbox: Inbox<Health>,
    /// The newest beat, and the host time at which it was seen.
    newest: Option<(Health, u64)>,
}

/// One line per node and the newest command, refreshed until the run ends or the time is over.
///
/// # Errors
/// Exit code 3 where no run lives.
pub(crate) fn top(time: Option<Duration>, every: Duration) -> Result<(), Failure> {
    let run = runs()?.remove(0);
    let mut link = join(&run, "top")?;
    let names: Vec<_> = TOPICS.iter().filter_map(|row| row.name.strip_prefix("health/")).collect();
    let mut inboxes: Vec<Heart> = Vec::new();
    for name in names {
        if let Some(topic) = health_topic(name) {
            inboxes.push(Heart { name, inbox: link.inbox(topic, Keep::Newest)?, newest: None });
        }
    }
    let mut commands = link.inbox(COMMAND, Keep::Newest)?;
    let mut command: Option<Command> = None;
    let mut step = Step::new();
    let until_ns = time.map_or(u64::MAX, |time| host_ns() + time.as_nanos() as u64);
    while host_ns() < until_ns && live_domains().contains(&run) {
        pause(every);
        link.look(&mut step)?;
        for heart in &mut inboxes {
            if let Some(message) = heart.inbox.newest(&mut step)? {
                heart.newest = Some((*message, host_ns()));
            }
        }
        if let Some(message) = commands.newest(&mut step)? {
            command = Some(*message);
        }
        crate::output::screen(&page(&inboxes, command.as_ref()));
    }
    Ok(())
}

fn page(nodes: &[Heart], command: Option<&Command>) -> String {
    let head = ["node", "state", "steps", "frame", "mean ms", "worst ms", "misses", "lost", "skipped"];
    let [node, state, steps, frame, mean, worst, misses, lost, skipped] = head;
    let mut text = format!(
        "{node:<9} {state:<9} {steps:>9} {frame:>8} {mean:>9} {worst:>9} {misses:>7} {lost:>6} {skipped:>8}\n"
    );
    for Heart { name, newest, .. } in nodes {
        let Some((health, seen_ns)) = newest else { continue };
        let silent = host_ns().saturating_sub(*seen_ns) > 500_000_000;
        let state =
            if silent { "silent" } else { NodeState::from_code(health.state).map_or("?", NodeState::label) };
        let sum = |counts: &[u64]| counts.iter().sum::<u64>();
        text.push_str(&format!(
            "{name:<9} {state:<9} {:>9} {:>8} {:>9.3} {:>9.3} {:>7} {:>6} {:>8}\n",
            health.cycles,
            health.last_frame,
            f64::from(health.mean_step_s) * 1e3,
            f64::from(health.worst_step_s) * 1e3,
            health.misses,
            sum(&health.lost),
            sum(&health.skipped),
        ));
    }
    if let Some(command) = command {
        let winner = Winner::from_code(command.winner).map_or("?", Winner::label);
        let reason = Reason::from_code(command.reason).map_or("?", Reason::label);
        text.push_str(&format!(
            "\ncommand {:+.2} m/s {:+.2} rad/s, {winner} drives at scale {:.2}: {reason}\n",
            command.twist.v_m_s, command.twist.w_rad_s, command.scale
        ));
    }
    text
}

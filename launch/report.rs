//! The summary of a run, as text and as JSON.

use crate::failure::Failure;
use crate::manifest::{Graph, Time};
use crate::monitor::Monitor;
use crate::run::{End, Options};
use crate::supervisor::Supervisor;
use crate::watched::Event;
use serde_json::{Value, json};
use sidestep_msgs::TOPICS;
use std::fmt::Write;

struct NodeLine {
    name: String,
    restarts: u32,
    exit: String,
    exit_code: Option<i32>,
    cpu_s: f64,
    pss_mb: f64,
}

/// What this process itself has used.
fn launcher() -> NodeLine {
    let usage = crate::child::usage(std::process::id());
    NodeLine {
        name: "launcher".to_owned(),
        restarts: 0,
        exit: "-".to_owned(),
        exit_code: None,
        cpu_s: usage.cpu_s,
        pss_mb: usage.pss_mb,
    }
}

/// All figures of a run.
pub(crate) struct Summary<'a> {
    monitor: &'a Monitor,
    nodes: Vec<NodeLine>,
    topics: Vec<(&'static str, [u64; 3])>,
    events: &'a [Event],
    duration_s: f64,
    origin: String,
    lead: String,
    given_up: Option<(String, String, Option<i32>)>,
    recording: Option<String>,
}

impl<'a> Summary<'a> {
    /// Gathers the figures.
    pub(crate) fn of(graph: &Graph, supervisor: &'a Supervisor, monitor: &'a Monitor, end: &End) -> Self {
        let node = |node: &crate::watched::Watched| NodeLine {
            name: node.plan.name.clone(),
            restarts: node.incarnation,
            exit: node.exit.clone().unwrap_or_else(|| "killed at the end".to_owned()),
            exit_code: node.exit_code,
            cpu_s: node.usage().cpu_s,
            pss_mb: node.usage().pss_mb,
        };
        let topic = |row: &'static sidestep_msgs::TopicRow| {
            let mut sum = [0; 3];
            for watched in &supervisor.nodes {
                let counts = watched.counts(row.index);
                sum.iter_mut().zip(counts).for_each(|(total, count)| *total += count);
            }
            (row.name, sum)
        };
        let given_up = match end {
            End::GivenUp { node, ending, code } => Some((node.clone(), ending.clone(), *code)),
            End::Time | End::User | End::SourceEnded => None,
        };
        Self {
            monitor,
            nodes: supervisor.nodes.iter().map(node).chain([launcher()]).collect(),
            topics: TOPICS
                .iter()
                .map(topic)
                .filter(|(_, counts)| counts.iter().any(|&count| count > 0))
                .collect(),
            events: &supervisor.events,
            duration_s: match graph.time {
                Time::Lockstep => monitor.graph_time().as_secs_f64(),
                Time::Real => monitor.host_time_s(),
            },
            origin: graph.origin.clone(),
            lead: format!("{:?}", graph.lead).to_lowercase(),
            given_up,
            recording: supervisor.recording(),
        }
    }

    /// The summary for a person.
    pub(crate) fn text(&self) -> String {
        let mut text = format!("\n{:.1} s of graph {}, lead {}\n\n", self.duration_s, self.origin, self.lead);
        self.write_drive(&mut text);
        text.push_str(&self.monitor.latency.table());
        let _ = writeln!(text, "\n{:<9} {:>8} {:>9} {:>8}  exit", "node", "restarts", "cpu s", "PSS MB");
        for node in &self.nodes {
            let _ = writeln!(
                text,
                "{:<9} {:>8} {:>9.2} {:>8.1}  {}",
                node.name, node.restarts, node.cpu_s, node.pss_mb, node.exit
            );
        }
        let lost: Vec<_> = self.topics.iter().filter(|(_, counts)| counts[1] > 0).collect();
        for (name, counts) in lost {
            let _ = writeln!(text, "topic {name}: {} of {} lost by a reader of all", counts[1], counts[0]);
        }
        if let Some(path) = &self.recording {
            let _ = writeln!(text, "\nrecording: {path}");
        }
        text
    }

    fn write_drive(&self, text: &mut String) {
        let monitor = self.monitor;
        if let Some(truth) = &monitor.truth {
            let _ = writeln!(
                text,
                "drive: {:.1} m, {} goals reached, {} contacts, nearest {:.2} m",
                truth.distance_m, truth.arrivals, truth.collisions, truth.min_clearance_m
            );
        }
        if monitor.open_loop {
            let _ = writeln!(text, "open loop: the sensors are a recording that no command changes");
        }
        let share = |count: u64| 100.0 * count as f64 / monitor.ticks.max(1) as f64;
        let _ =
            writeln!(text, "arbiter: {} commands, {:.1} % modified", monitor.ticks, share(monitor.modified));
        let mut reasons: Vec<_> = monitor.reasons.iter().collect();
        reasons.sort_by_key(|(_, count)| std::cmp::Reverse(**count));
        for (reason, &count) in reasons {
            let _ = writeln!(text, "  {:>5.1} %  {reason}", share(count));
        }
        text.push('\n');
    }

    /// The summary for a machine (SPEC section 8).
    pub(crate) fn json(&self) -> Value {
        let monitor = self.monitor;
        let topics: serde_json::Map<_, _> = self
            .topics
            .iter()
            .map(|(name, [sent, lost, skipped])| {
                ((*name).to_owned(), json!({ "sent": sent, "lost": lost, "skipped": skipped }))
            })
            .collect();
        let nodes: serde_json::Map<_, _> = self
            .nodes
            .iter()
            .map(|node| {
                let value =
                    json!({ "restarts": node.restarts, "exit": node.exit, "cpu_s": node.cpu_s, "pss_mb": node.pss_mb });
                (node.name.clone(), value)
            })
            .collect();
        let began_ns = monitor.began_ns.unwrap_or(0);
        let events: Vec<_> = self
            .events
            .iter()
            .map(|event| {
                let at_s = (event.host_ns as f64 - began_ns as f64) * 1e-9;
                json!({ "at_s": at_s, "node": event.node, "what": event.what })
            })
            .collect();
        let mut value = json!({
            "duration_s": self.duration_s,
            "graph": self.origin,
            "lead": self.lead,
            "topics": topics,
            "latency_ms": monitor.latency.json(),
            "nodes": nodes,
            "arbiter": {
                "ticks": monitor.ticks,
                "modified": monitor.modified,
                "stops": monitor.stops,
                "reasons": monitor.reasons,
                "winners": monitor.winners,
            },
            "events": events,
            "recording": self.recording,
            "open_loop": monitor.open_loop,
        });
        if let Some(truth) = &monitor.truth {
            value["drive"] = json!({
                "distance_m": truth.distance_m,
                "collisions": truth.collisions,
                "arrived": truth.arrivals,
                "min_clearance_m": truth.min_clearance_m,
            });
        }
        value
    }

    /// The exit code of the run.
    ///
    /// # Errors
    /// Exit code 1 where what was asked did not hold, 2 where a node refused its configuration, 3 where data was lost.
    pub(crate) fn verdict(&self, options: &Options) -> Result<(), Failure> {
        if let Some((node, ending, code)) = &self.given_up {
            let message = format!("{node} was given up: {ending}; its own lines above say why");
            return Err(match code {
                Some(2) => Failure::usage(message),
                Some(3) => Failure::io(message),
                _ => Failure::unmet(message),
            });
        }
        if let Some(truth) = &self.monitor.truth {
            if truth.collisions > 0 {
                return Err(Failure::unmet(format!("{} contacts", truth.collisions)));
            }
            if options.must_arrive && truth.arrivals == 0 {
                return Err(Failure::unmet("no goal was reached".to_owned()));
            }
        }
        if let Some(node) = self.nodes.iter().find(|node| node.exit_code == Some(3)) {
            return Err(Failure::io(format!(
                "{} lost input or output; its own lines above say why",
                node.name
            )));
        }
        if options.gate_latency && self.monitor.latency.misses() > 0 {
            return Err(Failure::unmet("latency budgets were missed; the table above says where".to_owned()));
        }
        Ok(())
    }
}

//! A drive as a trace for Perfetto (ui.perfetto.dev): one track per stage, arrows along each frame.

use crate::collector::Passed;
use serde_json::{Value, json};
use sidestep_msgs::{Code, Stage};
use std::io::Write;

/// The steps of a drive.
#[derive(Debug, Clone, Default)]
pub struct Trace {
    steps: Vec<Passed>,
}

/// `[us]` as the format wants times.
fn microseconds(time_ns: u64, first_ns: u64) -> f64 {
    time_ns.saturating_sub(first_ns) as f64 * 1e-3
}

/// What begins or ends the arrows at a stage: `s` begins, `t` passes, `f` ends.
fn flow_phase(stage: Stage) -> &'static str {
    match stage {
        Stage::Depth => "s",
        Stage::Arbiter => "f",
        Stage::Mapper | Stage::Goal | Stage::Policy | Stage::Expert => "t",
    }
}

impl Trace {
    pub(crate) fn add(&mut self, step: Passed) {
        self.steps.push(step);
    }

    /// Steps held.
    #[must_use]
    pub fn len(&self) -> usize {
        self.steps.len()
    }

    /// Whether there is none.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.steps.is_empty()
    }

    /// Writes the Chrome JSON form, which Perfetto reads.
    ///
    /// # Errors
    /// What `out` says.
    pub fn write(&self, out: &mut impl Write) -> std::io::Result<()> {
        let first_ns = self.steps.iter().map(start_ns).min().unwrap_or(0);
        write!(out, "{{\"displayTimeUnit\":\"ms\",\"traceEvents\":[")?;
        let mut separator = "\n";
        let mut event = |value: Value| {
            let outcome = write!(out, "{separator}{value}");
            separator = ",\n";
            outcome
        };
        for &stage in Stage::ALL {
            let pid = stage as u32 + 1;
            let args = json!({ "name": stage.label() });
            event(json!({ "ph": "M", "name": "process_name", "pid": pid, "tid": pid, "args": args }))?;
            let args = json!({ "sort_index": pid });
            event(json!({ "ph": "M", "name": "process_sort_index", "pid": pid, "tid": pid, "args": args }))?;
        }
        for step in &self.steps {
            let pid = step.stage as u32 + 1;
            let start = microseconds(start_ns(step), first_ns);
            let spent = microseconds(step.stamp.send_ns, start_ns(step)).max(1.0);
            let name = format!("frame {}", step.frame);
            let args = json!({ "frame": step.frame });
            let (label, phase) = (step.stage.label(), flow_phase(step.stage));
            event(
                json!({ "ph": "X", "name": name, "cat": label, "pid": pid, "tid": pid, "ts": start, "dur": spent, "args": args }),
            )?;
            let mut flow = json!({ "ph": phase, "name": "frame", "cat": "frame", "id": step.frame, "pid": pid, "tid": pid, "ts": start + 0.5 * spent });
            if phase == "f" {
                flow["bp"] = "e".into();
            }
            event(flow)?;
        }
        writeln!(out, "\n]}}")
    }
}

/// `[ns]` beginning of a step; a driver's may have no stamp of receipt.
fn start_ns(step: &Passed) -> u64 {
    if step.stamp.receive_ns == 0 {
        step.stamp.send_ns
    } else {
        step.stamp.receive_ns.min(step.stamp.send_ns)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use sidestep_msgs::StageStamp;

    #[test]
    fn every_step_is_an_event_on_the_track_of_its_stage_and_a_frame_is_one_flow() {
        let mut trace = Trace::default();
        for (place, &stage) in Stage::ALL.iter().enumerate() {
            let receive_ns = 1_000_000 * (place as u64 + 5);
            trace.add(Passed {
                stage,
                frame: 7,
                stamp: StageStamp { receive_ns, send_ns: receive_ns + 250_000 },
            });
        }
        let mut bytes = Vec::new();
        trace.write(&mut bytes).unwrap();
        let value: Value = serde_json::from_slice(&bytes).unwrap();
        let events = value["traceEvents"].as_array().unwrap();
        let of = |phase: &str| events.iter().filter(|event| event["ph"] == phase).count();
        assert_eq!((of("X"), of("s"), of("t"), of("f")), (6, 1, 4, 1));
        assert!(events.iter().filter(|event| event["ph"] == "X").all(|event| event["dur"] == 250.0));
        let first = events.iter().find(|event| event["ph"] == "X").unwrap();
        assert_eq!((&first["ts"], &first["pid"]), (&json!(0.0), &json!(1)));
    }
}

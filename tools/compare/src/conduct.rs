//! What the arbiter made of it: who drove, what it changed and why, where it stood, and what came of it.

use serde::Serialize;
use sidestep_msgs::{Code, Command, Reason, Truth, Winner};
use std::collections::BTreeMap;

/// `[s]` a command counts at most this long: what the base obeys it for.
const HOLDS_S: f64 = sidestep_msgs::VALID_FOR_NS as f64 * 1e-9;
/// Moments named per reason.
const FIRST: usize = 3;

/// A stretch of commands alike.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Stretch {
    pub(crate) from_s: f64,
    pub(crate) to_s: f64,
    pub(crate) code: u32,
}

/// Stretches of one kind, summed.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct Episodes {
    /// How many.
    pub count: u64,
    /// `[s]` together.
    pub total_s: f64,
    /// `[s]` the longest.
    pub longest_s: f64,
    /// `[s]` when the first ones began.
    pub first_s: Vec<f64>,
}

/// Another winner than before.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Takeover {
    /// Who drove before.
    pub from: &'static str,
    /// Who drives from here.
    pub to: &'static str,
    /// The reason of the first command.
    pub reason: &'static str,
    /// How often.
    pub count: u64,
    /// `[s]` when it first happened.
    pub first_s: f64,
}

/// What the simulator knows at the end.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize)]
pub struct Outcome {
    /// Contacts begun while moving.
    pub contacts: u32,
    /// Goals reached.
    pub arrivals: u32,
    /// `[m]` driven.
    pub distance_m: f64,
    /// `[m]` smallest gap to anything.
    pub min_clearance_m: f32,
}

/// What the arbiter did over a recording.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct Conduct {
    /// Commands.
    pub commands: u64,
    /// `[s]` time under command.
    pub total_s: f64,
    /// Time by winner.
    pub winners: BTreeMap<&'static str, Episodes>,
    /// Time by reason, the clear ones too.
    pub reasons: BTreeMap<&'static str, Episodes>,
    /// Changes of the winner.
    pub takeovers: Vec<Takeover>,
    /// `[s]` ages of the policy's proposal when a frame was answered, sorted.
    #[serde(skip)]
    pub(crate) policy_ages_s: Vec<f64>,
    /// `[s]` ages of the expert's proposal when a frame was answered, sorted.
    #[serde(skip)]
    pub(crate) expert_ages_s: Vec<f64>,
    /// Stretches by winner.
    #[serde(skip)]
    pub(crate) by_winner: Vec<Stretch>,
    /// Stretches by reason.
    #[serde(skip)]
    pub(crate) by_reason: Vec<Stretch>,
    /// In simulation, what is true at the end.
    pub outcome: Option<Outcome>,
}

impl Conduct {
    /// Takes a command at its time; commands come in their order.
    pub(crate) fn command(&mut self, command: &Command, time_s: f64) {
        self.commands += 1;
        self.note_takeover(command, time_s);
        extend(&mut self.by_winner, command.winner, time_s);
        extend(&mut self.by_reason, command.reason, time_s);
        if command.answers == 1 {
            let ages = [
                (&mut self.policy_ages_s, command.policy_age_s),
                (&mut self.expert_ages_s, command.expert_age_s),
            ];
            ages.into_iter()
                .filter(|(_, age_s)| age_s.is_finite())
                .for_each(|(all, age_s)| all.push(age_s.into()));
        }
    }

    /// Takes what the simulator knows.
    pub(crate) fn truth(&mut self, truth: &Truth) {
        self.outcome = Some(Outcome {
            contacts: truth.collisions,
            arrivals: truth.arrivals,
            distance_m: truth.distance_m,
            min_clearance_m: truth.min_clearance_m,
        });
    }

    fn note_takeover(&mut self, command: &Command, time_s: f64) {
        let Some(last) = self.by_winner.last().filter(|last| last.code != command.winner) else { return };
        let name = |code| Winner::from_code(code).map_or("unknown", Winner::label);
        let (from, to) = (name(last.code), name(command.winner));
        let reason = reason_label(command.reason);
        let same = |known: &&mut Takeover| (known.from, known.to, known.reason) == (from, to, reason);
        match self.takeovers.iter_mut().find(same) {
            Some(known) => known.count += 1,
            None => self.takeovers.push(Takeover { from, to, reason, count: 1, first_s: time_s }),
        }
    }

    /// Sums everything up.
    pub(crate) fn finish(&mut self) {
        self.total_s = self.by_winner.iter().map(|stretch| stretch.to_s - stretch.from_s).sum();
        self.winners = sums(&self.by_winner, |code| Winner::from_code(code).map_or("unknown", Winner::label));
        self.reasons = sums(&self.by_reason, reason_label);
        self.policy_ages_s.sort_by(f64::total_cmp);
        self.expert_ages_s.sort_by(f64::total_cmp);
        self.takeovers.sort_by(|a, b| b.count.cmp(&a.count).then(a.first_s.total_cmp(&b.first_s)));
    }

    /// `[s]` time in which a wish did not pass unchanged.
    #[must_use]
    pub fn changed_s(&self) -> f64 {
        let unchanged = [Reason::Clear.label(), Reason::Arrived.label(), Reason::NoGoal.label()];
        self.reasons
            .iter()
            .filter(|(reason, _)| !unchanged.contains(reason))
            .map(|(_, episodes)| episodes.total_s)
            .sum()
    }

    /// How often the winner changed.
    #[must_use]
    pub fn takeover_count(&self) -> u64 {
        self.takeovers.iter().map(|takeover| takeover.count).sum()
    }
}

pub(crate) fn reason_label(code: u32) -> &'static str {
    Reason::from_code(code).map_or("unknown", Reason::label)
}

/// Lengthens the last stretch up to this command, and begins another where its code differs.
fn extend(stretches: &mut Vec<Stretch>, code: u32, time_s: f64) {
    if let Some(last) = stretches.last_mut() {
        let silent = time_s - last.to_s > HOLDS_S;
        if !silent {
            last.to_s = last.to_s.max(time_s);
            if last.code == code {
                return;
            }
        }
    }
    stretches.push(Stretch { from_s: time_s, to_s: time_s, code });
}

fn sums(stretches: &[Stretch], label: impl Fn(u32) -> &'static str) -> BTreeMap<&'static str, Episodes> {
    let mut sums: BTreeMap<&'static str, Episodes> = BTreeMap::new();
    for stretch in stretches {
        let length_s = stretch.to_s - stretch.from_s;
        let episodes = sums.entry(label(stretch.code)).or_default();
        episodes.count += 1;
        episodes.total_s += length_s;
        episodes.longest_s = episodes.longest_s.max(length_s);
        if episodes.first_s.len() < FIRST {
            episodes.first_s.push(stretch.from_s);
        }
    }
    sums
}

#[cfg(test)]
mod tests {
    use super::*;

    fn command(winner: Winner, reason: Reason) -> Command {
        Command { winner: winner.code(), reason: reason.code(), ..Command::default() }
    }

    #[test]
    fn episodes_takeovers_and_silence_are_counted_as_they_happened() {
        let mut conduct = Conduct::default();
        // 1 s of policy, 0.5 s of expert, half a second of nothing, 0.3 s of policy, slowed.
        (0..100).for_each(|i| conduct.command(&command(Winner::Policy, Reason::Clear), f64::from(i) * 0.01));
        (100..150).for_each(|i| {
            conduct.command(&command(Winner::Expert, Reason::OtherProposal), f64::from(i) * 0.01)
        });
        (200..231)
            .for_each(|i| conduct.command(&command(Winner::Policy, Reason::Slowed), f64::from(i) * 0.01));
        conduct.finish();
        let near = |a: f64, b: f64| (a - b).abs() < 1e-6;
        let policy = &conduct.winners["policy"];
        assert_eq!(policy.count, 2);
        assert!(near(policy.total_s, 1.0 + 0.3) && near(policy.longest_s, 1.0), "{policy:?}");
        assert!(near(conduct.winners["expert"].total_s, 0.49), "{conduct:?}");
        assert_eq!(conduct.takeovers.len(), 2);
        assert_eq!(conduct.takeovers[0].reason, Reason::OtherProposal.label());
        assert!(near(conduct.takeovers[0].first_s, 1.0) && near(conduct.changed_s(), 0.79));
    }
}

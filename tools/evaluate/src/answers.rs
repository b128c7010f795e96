//! A model asked about records.

use crate::error::EvaluateError;
use sidestep_msgs::Twist;
use sidestep_policy::{ModelError, Policy};
use sidestep_train::{Mixture, Random, Record};

/// A record with what the model says of it.
#[derive(Debug, Clone)]
pub(crate) struct Answered {
    pub(crate) record: Record,
    /// What the model wishes, before any window.
    pub(crate) wish: Twist,
    /// `[m/s, rad/s]` the error that it expects.
    pub(crate) doubt: [f32; 2],
}

impl Answered {
    /// The label of 734 candidates.
    pub(crate) fn plain(&self) -> Twist {
        Twist::new(self.record.label_734[0], self.record.label_734[1])
    }

    /// The solved label.
    pub(crate) fn solved(&self) -> Twist {
        Twist::new(self.record.label_solved[0], self.record.label_solved[1])
    }
}

/// Which records of a mixture to ask about.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Split {
    /// Those that training sees.
    Trained,
    /// Those that training leaves out, from the same worlds.
    HeldOut,
    /// All of them: files of other worlds.
    All,
}

/// Asks about up to `count` records, spread evenly over the files by a seed.
pub(crate) fn ask(
    policy: &mut Policy,
    data: &Mixture,
    split: Split,
    count: u64,
) -> Result<Vec<Answered>, EvaluateError> {
    let wanted = |index: &u64| match split {
        Split::Trained => !data.is_held_out(*index),
        Split::HeldOut => data.is_held_out(*index),
        Split::All => true,
    };
    let mut indices: Vec<u64> = (0..data.count()).filter(wanted).collect();
    let mut random = Random::new(0x4556_414c, split as u64);
    let count = indices.len().min(count as usize);
    for place in 0..count {
        let other = place + random.below(indices.len() - place);
        indices.swap(place, other);
    }
    indices.truncate(count);
    indices.sort_unstable();
    indices.into_iter().map(|index| answer(policy, data.read(index)?)).collect()
}

fn answer(policy: &mut Policy, record: Record) -> Result<Answered, EvaluateError> {
    let answer = policy
        .infer(&record.planning_cost, usize::from(record.goal_cell), record.twist())
        .map_err(|detail| ModelError::Engine { model: "evaluated".into(), detail })?;
    Ok(Answered { record, wish: Twist::new(answer.command[0], answer.command[1]), doubt: answer.doubt })
}

//! Table I: how far the model is from the expert, by split, label and window.

use crate::answers::Answered;
use serde::Serialize;
use sidestep_msgs::{Limits, Twist};
use sidestep_train::{Difference, Errors, Source, WINDOWS_S, within_window};

/// Nearer than this to the edge of the window a label counts as saturated, as part of the window.
const EDGE: f32 = 1e-3;

/// One window.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize)]
pub struct Windowed {
    /// `[s]` commands lie within u' +- acceleration x this.
    pub window_s: f32,
    /// The model against the label.
    #[serde(flatten)]
    pub errors: Errors,
    /// Keeping u' against the label: what knowing nothing gives.
    pub keep: Errors,
    /// `[1]` part of that error (norm) that the model takes away.
    pub skill: f64,
    /// `[1]` part of the labels at an edge of the window, of v and of w.
    pub saturated: [f64; 2],
}

/// One kind of label, by window.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct Labels {
    /// Windows of [`WINDOWS_S`].
    pub windows: Vec<Windowed>,
}

/// One set of records.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct SetTable {
    /// Records.
    pub samples: u64,
    /// Those that are made-up maps.
    pub artificial: u64,
    /// Against the 734-candidate label.
    pub plain: Labels,
    /// Against the solved label.
    pub solved: Labels,
    /// The 734-candidate label against the solved one: the noise of that label, by window.
    pub label_noise: Vec<Errors>,
    /// Against the solved label, window 0.1 s: made-up maps and drives apart.
    pub by_source: [Errors; 2],
}

pub(crate) fn set_table(answers: &[Answered], limits: &Limits) -> SetTable {
    let source = |wanted: Source| {
        let of = answers.iter().filter(move |answer| answer.record.source == wanted as u8);
        difference(of, limits, WINDOWS_S[0], |answer| answer.solved(), |answer| answer.wish)
    };
    let artificial = answers.iter().filter(|answer| answer.record.source == Source::Artificial as u8).count();
    SetTable {
        samples: answers.len() as u64,
        artificial: artificial as u64,
        plain: labels(answers, limits, Answered::plain),
        solved: labels(answers, limits, Answered::solved),
        label_noise: WINDOWS_S
            .iter()
            .map(|window| difference(answers.iter(), limits, *window, Answered::solved, Answered::plain))
            .collect(),
        by_source: [source(Source::Artificial), source(Source::Demonstration)],
    }
}

fn labels(answers: &[Answered], limits: &Limits, label: fn(&Answered) -> Twist) -> Labels {
    let windowed = |window: &f32| {
        let errors = difference(answers.iter(), limits, *window, label, |answer| answer.wish);
        let keep = difference(answers.iter(), limits, *window, label, |answer| answer.record.twist());
        Windowed {
            window_s: *window,
            errors,
            keep,
            skill: 1.0 - errors.l2_mean / keep.l2_mean.max(1e-12),
            saturated: saturated(answers, limits, *window, label),
        }
    };
    Labels { windows: WINDOWS_S.iter().map(windowed).collect() }
}

fn difference<'a>(
    answers: impl Iterator<Item = &'a Answered>,
    limits: &Limits,
    window_s: f32,
    one: impl Fn(&Answered) -> Twist,
    other: impl Fn(&Answered) -> Twist,
) -> Errors {
    let mut difference = Difference::default();
    for answer in answers {
        let within = |twist| within_window(twist, answer.record.twist(), limits, window_s);
        difference.add(within(one(answer)), within(other(answer)));
    }
    difference.errors()
}

fn saturated(
    answers: &[Answered],
    limits: &Limits,
    window_s: f32,
    label: fn(&Answered) -> Twist,
) -> [f64; 2] {
    let reach = [limits.accelerate_m_s2 * window_s, limits.turn_accelerate_rad_s2 * window_s];
    let mut counts = [0.0; 2];
    for answer in answers {
        let (from, to) = (answer.record.twist(), label(answer));
        let moved = [to.v_m_s - from.v_m_s, to.w_rad_s - from.w_rad_s];
        for axis in 0..2 {
            counts[axis] += f64::from(u8::from(moved[axis].abs() >= reach[axis] * (1.0 - EDGE)));
        }
    }
    counts.map(|count| count / answers.len().max(1) as f64)
}

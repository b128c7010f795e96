//! How well a base holds what it was told: the difference in steady motion.

use crate::edge::Axis;
use crate::series::Series;

/// `[ns]` a constant command before the base is taken to have settled.
const SETTLE_NS: u64 = 800_000_000;
/// `[ns]` shortest steady stretch that counts.
const STRETCH_NS: u64 = 200_000_000;

/// Mean absolute difference between command and motion, for each stretch of steady motion of one axis.
pub(crate) fn differences(series: &Series, axis: Axis) -> Vec<f64> {
    let commands = series.commands();
    let mut found = Vec::new();
    let mut begin = 0;
    for index in 1..=commands.len() {
        let goes_on = commands.get(index).is_some_and(|sent| {
            let change = axis.commanded(sent) - axis.commanded(&commands[begin]);
            change.abs() < axis.still() && sent.sent_ns < commands[index - 1].valid_until_ns
        });
        if !goes_on {
            found.extend(stretch(series, axis, begin, index - 1));
            begin = index;
        }
    }
    found
}

/// The difference of one stretch, from its first to its last command.
fn stretch(series: &Series, axis: Axis, begin: usize, last: usize) -> Option<f64> {
    let commands = series.commands();
    let command = axis.commanded(&commands[begin]);
    let (from_ns, to_ns) = (commands[begin].sent_ns + SETTLE_NS, commands[last].sent_ns);
    if to_ns < from_ns + STRETCH_NS || command.abs() < 10.0 * axis.still() {
        return None;
    }
    let motion = series.moved_within(from_ns, to_ns);
    let used: Vec<_> = motion.iter().filter(|moved| !moved.slip).collect();
    let sum: f64 = used.iter().map(|moved| (axis.measured(moved) - command).abs()).sum();
    (!used.is_empty()).then(|| sum / used.len() as f64)
}

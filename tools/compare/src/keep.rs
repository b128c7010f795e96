//! The frames worth a look: the few of highest score, in bounded memory.

use std::cmp::Ordering;
use std::collections::BinaryHeap;

/// Something with a score; the least is on top of a heap, the earliest the largest of equals.
#[derive(Debug)]
struct Scored<T> {
    score: f32,
    place: u64,
    value: T,
}

impl<T> PartialEq for Scored<T> {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other) == Ordering::Equal
    }
}

impl<T> Eq for Scored<T> {}

impl<T> PartialOrd for Scored<T> {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl<T> Ord for Scored<T> {
    fn cmp(&self, other: &Self) -> Ordering {
        other.score.total_cmp(&self.score).then(self.place.cmp(&other.place))
    }
}

/// The `count` values of highest score.
#[derive(Debug)]
pub(crate) struct Highest<T> {
    count: usize,
    taken: u64,
    heap: BinaryHeap<Scored<T>>,
}

impl<T> Highest<T> {
    pub(crate) fn new(count: usize) -> Self {
        Self { count, taken: 0, heap: BinaryHeap::new() }
    }

    /// Takes a value, made only where it is kept.
    pub(crate) fn offer(&mut self, score: f32, value: impl FnOnce() -> T) {
        self.taken += 1;
        let low = self.heap.peek().is_some_and(|least| least.score >= score);
        if self.count == 0 || !score.is_finite() || (self.heap.len() >= self.count && low) {
            return;
        }
        self.heap.push(Scored { score, place: self.taken, value: value() });
        if self.heap.len() > self.count {
            self.heap.pop();
        }
    }

    /// What was kept, the highest first.
    pub(crate) fn into_sorted(self) -> Vec<T> {
        self.heap.into_sorted_vec().into_iter().map(|scored| scored.value).collect()
    }
}

/// As [`Highest`], each at least a second from all others, so that one bad moment does not fill the page.
#[derive(Debug)]
pub(crate) struct HighestApart<T> {
    count: usize,
    highest: Highest<(f64, T)>,
    second: Option<(i64, f32, f64, T)>,
}

impl<T> HighestApart<T> {
    pub(crate) fn new(count: usize) -> Self {
        // The best of two neighbouring seconds may be the same moment: one more is held for each side.
        Self { count, highest: Highest::new(3 * count), second: None }
    }

    pub(crate) fn offer(&mut self, time_s: f64, score: f32, value: impl FnOnce() -> T) {
        let slot = time_s.floor() as i64;
        match &mut self.second {
            Some((known, best, at_s, held)) if *known == slot => {
                if score > *best {
                    (*best, *at_s, *held) = (score, time_s, value());
                }
            }
            _ => {
                self.flush();
                self.second = Some((slot, score, time_s, value()));
            }
        }
    }

    fn flush(&mut self) {
        if let Some((_, score, time_s, value)) = self.second.take() {
            self.highest.offer(score, || (time_s, value));
        }
    }

    pub(crate) fn into_sorted(mut self) -> Vec<T> {
        self.flush();
        let mut kept: Vec<(f64, T)> = Vec::new();
        for (time_s, value) in self.highest.into_sorted() {
            if kept.len() < self.count && kept.iter().all(|(other_s, _)| (other_s - time_s).abs() >= 1.0) {
                kept.push((time_s, value));
            }
        }
        kept.into_iter().map(|(_, value)| value).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_highest_are_kept_in_order_and_garbage_is_not() {
        let mut highest = Highest::new(3);
        for (index, score) in [0.1, 5.0, f32::NAN, 2.0, 5.0, 0.3, 4.0].into_iter().enumerate() {
            highest.offer(score, || index);
        }
        assert_eq!(highest.into_sorted(), [1, 4, 6]);
    }

    #[test]
    fn one_moment_counts_once() {
        let mut apart = HighestApart::new(2);
        for i in 0..300 {
            // The highest scores all lie in second 2, that of second 1 ends where second 2 begins.
            let score = if i == 105 { 150.0 } else { i as f32 };
            apart.offer(f64::from(i) * 0.01, score, || i);
        }
        assert_eq!(apart.into_sorted(), [299, 199]);
        let mut close = HighestApart::new(3);
        for (time_s, score) in [(0.2, 1.0), (1.98, 5.0), (2.02, 9.0), (4.0, 2.0)] {
            close.offer(time_s, score, || time_s);
        }
        assert_eq!(close.into_sorted(), [2.02, 4.0, 0.2]);
    }
}

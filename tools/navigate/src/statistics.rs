//! Intervals and tests that are exact: no normal approximation, whatever the counts.

use serde::Serialize;

/// Halvings of the search for a bound: to 1e-12.
const HALVINGS: usize = 40;

/// A count of how many, with the 95 % interval of Clopper and Pearson.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Proportion {
    /// How many.
    pub count: u64,
    /// Of how many.
    pub of: u64,
    /// `[1]` lower bound of the share.
    pub low: f64,
    /// `[1]` upper bound of the share.
    pub high: f64,
}

impl Proportion {
    /// `count` of `of`; of nothing the interval is everything.
    #[must_use]
    pub fn new(count: u64, of: u64) -> Self {
        let count = count.min(of);
        // P(X >= count) rises with the share, P(X <= count) falls.
        let low = if count == 0 { 0.0 } else { bound(|p| 1.0 - at_most(count - 1, of, p) < 0.025) };
        let high = if count == of { 1.0 } else { bound(|p| at_most(count, of, p) > 0.025) };
        Self { count, of, low, high }
    }

    /// `[1]` the share.
    #[must_use]
    pub fn share(&self) -> f64 {
        self.count as f64 / self.of.max(1) as f64
    }

    /// For a cell of a table.
    #[must_use]
    pub fn text(&self) -> String {
        format!(
            "{:.1} % ({} of {}; {:.1} to {:.1})",
            100.0 * self.share(),
            self.count,
            self.of,
            100.0 * self.low,
            100.0 * self.high
        )
    }
}

/// The share at which `is_below` turns false.
fn bound(is_below: impl Fn(f64) -> bool) -> f64 {
    let (mut low, mut high) = (0.0, 1.0);
    for _ in 0..HALVINGS {
        let middle = 0.5 * (low + high);
        if is_below(middle) { low = middle } else { high = middle }
    }
    0.5 * (low + high)
}

/// P(X <= count) of a binomial distribution.
fn at_most(count: u64, of: u64, share: f64) -> f64 {
    let (mut log_choose, mut sum) = (0.0, 0.0);
    let (log_p, log_q) = (libm::log(share), libm::log1p(-share));
    for k in 0..=count {
        if k > 0 {
            log_choose += libm::log((of - k + 1) as f64 / k as f64);
        }
        sum += libm::exp(log_choose + k as f64 * log_p + (of - k) as f64 * log_q);
    }
    sum.min(1.0)
}

/// `[1]` exact two-sided probability that the sum of paired differences is as far from 0 as found, or farther, if each
/// difference had either sign with equal chance.
#[must_use]
pub fn sign_flip_test(differences: &[i64]) -> f64 {
    let reach: i64 = differences.iter().map(|difference| difference.abs()).sum();
    let room = 2 * reach as usize + 1;
    let mut chance = vec![0.0_f64; room];
    chance[reach as usize] = 1.0;
    for difference in differences {
        let shift = difference.unsigned_abs() as usize;
        let mut next = vec![0.0; room];
        for (place, share) in chance.iter().enumerate().filter(|(_, share)| **share > 0.0) {
            next[place - shift] += 0.5 * share;
            next[place + shift] += 0.5 * share;
        }
        chance = next;
    }
    let found = differences.iter().sum::<i64>().abs();
    let far = |place: usize| (place as i64 - reach).abs() >= found;
    chance.iter().enumerate().filter(|(place, _)| far(*place)).map(|(_, share)| share).sum::<f64>().min(1.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Compared with the tables of Clopper and Pearson (1934) and R's `binom.test`.
    #[test]
    fn intervals_are_those_of_the_tables() {
        for (count, of, low, high) in [
            (0, 300, 0.0, 0.012_221),
            (300, 300, 0.987_779, 1.0),
            (5, 10, 0.187_086, 0.812_914),
            (297, 300, 0.971_049, 0.997_933),
        ] {
            let found = Proportion::new(count, of);
            assert!((found.low - low).abs() < 2e-5 && (found.high - high).abs() < 2e-5, "{found:?}");
        }
        assert_eq!((Proportion::new(0, 0).low, Proportion::new(0, 0).high), (0.0, 1.0));
    }

    /// Counted by hand: of the 8 signs of (3, 1, 1) two reach 5, of the 4 of (2, -2) all reach 0.
    #[test]
    fn the_test_counts_every_choice_of_signs() {
        assert!((sign_flip_test(&[3, 1, 1]) - 0.25).abs() < 1e-12);
        assert!((sign_flip_test(&[2, -2]) - 1.0).abs() < 1e-12);
        assert!((sign_flip_test(&[1; 10]) - 2.0 / 1024.0).abs() < 1e-12);
        assert!((sign_flip_test(&[]) - 1.0).abs() < 1e-12);
    }
}

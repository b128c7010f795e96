//! How many of how many, with an interval that is exact: no normal approximation, whatever the counts.

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

/// Largest mean of a Poisson distribution that shows at most `count` with a chance of 5 % or more: the exact one-sided
/// bound of 95 % (Garwood 1936).
#[must_use]
pub fn rate_at_most(count: u64) -> f64 {
    let chance = |mean: f64| {
        let mut term = libm::exp(-mean);
        let mut sum = term;
        for number in 1..=count {
            term *= mean / number as f64;
            sum += term;
        }
        sum
    };
    let most = 3.0 * count as f64 + 10.0;
    most * bound(|part| chance(most * part) > 0.05)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Garwood's table: 2.996 for none, 4.744 for one, 9.154 for four.
    #[test]
    fn the_bound_is_that_of_the_table() {
        for (count, bound) in [(0, 2.9957), (1, 4.7439), (4, 9.1535)] {
            assert!((rate_at_most(count) - bound).abs() < 1e-3, "{count}: {}", rate_at_most(count));
        }
    }

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
}

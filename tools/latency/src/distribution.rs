//! Times of one kind, and what they come to.

use hdrhistogram::Histogram;
use serde::Serialize;

/// `[ns]` the range that is told apart; longer times count as the longest.
const LONGEST_NS: u64 = 10_000_000_000;
/// Significant digits kept.
const DIGITS: u8 = 3;

/// Times of one kind.
#[derive(Debug, Clone)]
pub struct Distribution {
    histogram: Option<Histogram<u64>>,
    budget_ns: Option<u64>,
    misses: u64,
}

/// What a [`Distribution`] comes to, in milliseconds; percentiles are `null` without a sample.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Figures {
    /// Samples.
    pub count: u64,
    /// `[ms]` median.
    pub p50: Option<f64>,
    /// `[ms]` nine of ten are at most this.
    pub p90: Option<f64>,
    /// `[ms]` 99 of 100 are at most this.
    pub p99: Option<f64>,
    /// `[ms]` 999 of 1000 are at most this.
    pub p999: Option<f64>,
    /// `[ms]` the longest.
    pub max: Option<f64>,
    /// `[ms]` what it may take.
    pub budget: Option<f64>,
    /// Samples above the budget.
    pub misses: u64,
}

impl Distribution {
    /// No sample yet; `budget_ms` is what one may take.
    #[must_use]
    pub fn new(budget_ms: Option<f64>) -> Self {
        let histogram = Histogram::new_with_bounds(1, LONGEST_NS, DIGITS).ok();
        Self { histogram, budget_ns: budget_ms.map(|ms| (ms * 1e6) as u64), misses: 0 }
    }

    /// Adds a sample.
    pub fn add(&mut self, time_ns: u64) {
        if let Some(histogram) = &mut self.histogram {
            histogram.saturating_record(time_ns);
        }
        self.misses += u64::from(self.budget_ns.is_some_and(|budget_ns| time_ns > budget_ns));
    }

    /// What the samples come to.
    #[must_use]
    pub fn figures(&self) -> Figures {
        let histogram = self.histogram.as_ref().filter(|histogram| !histogram.is_empty());
        let at = |part: f64| histogram.map(|histogram| histogram.value_at_quantile(part) as f64 * 1e-6);
        Figures {
            count: histogram.map_or(0, Histogram::len),
            p50: at(0.5),
            p90: at(0.9),
            p99: at(0.99),
            p999: at(0.999),
            max: histogram.map(|histogram| histogram.max() as f64 * 1e-6),
            budget: self.budget_ns.map(|budget_ns| budget_ns as f64 * 1e-6),
            misses: self.misses,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn percentiles_are_those_of_the_samples_and_misses_those_above_the_budget() {
        let mut times = Distribution::new(Some(0.9));
        for microseconds in 1..=1000 {
            times.add(microseconds * 1000);
        }
        let figures = times.figures();
        let close = |found: Option<f64>, needed: f64| (found.unwrap() / needed - 1.0).abs() < 2e-3;
        assert!(
            close(figures.p50, 0.5) && close(figures.p99, 0.99) && close(figures.max, 1.0),
            "{figures:?}"
        );
        assert_eq!((figures.count, figures.misses), (1000, 100));
    }

    #[test]
    fn without_a_sample_there_is_no_percentile() {
        let figures = Distribution::new(None).figures();
        assert_eq!((figures.count, figures.p50, figures.budget), (0, None, None));
    }
}

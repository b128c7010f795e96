//! Adam with a clipped gradient and a schedule that counts samples, so that a loaded machine learns the same.

/// How fast to learn.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Schedule {
    /// Learning rate after the warm-up.
    pub rate: f32,
    /// Steps of the warm-up.
    pub warm_up_steps: u64,
    /// Samples in all; the rate falls to a hundredth along a half cosine.
    pub samples: u64,
}

impl Schedule {
    /// Learning rate of step `step`, when `seen` samples have been seen.
    #[must_use]
    pub fn rate_at(&self, step: u64, seen: u64) -> f32 {
        let part = (seen as f64 / self.samples.max(1) as f64).min(1.0);
        let cosine = 0.505 + 0.495 * libm::cos(std::f64::consts::PI * part);
        let warm = ((step + 1) as f64 / self.warm_up_steps.max(1) as f64).min(1.0);
        (f64::from(self.rate) * cosine * warm) as f32
    }
}

/// First and second moments of the gradient.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Adam {
    pub(crate) first: Vec<f32>,
    pub(crate) second: Vec<f32>,
    pub(crate) steps: u64,
}

const DECAY_FIRST: f32 = 0.9;
const DECAY_SECOND: f32 = 0.999;
/// Largest norm of a gradient: perturbed value kernels of gain above one make slopes of 1e7.
const NORM_MAX: f32 = 0.5;

impl Adam {
    pub(crate) fn new(count: usize) -> Self {
        Self { first: vec![0.0; count], second: vec![0.0; count], steps: 0 }
    }

    /// One step against the mean gradient; returns its norm before clipping.
    pub(crate) fn step(&mut self, parameters: &mut [f32], gradient: &[f32], rate: f32) -> f32 {
        self.steps += 1;
        let norm = norm(gradient);
        let clip = if norm > NORM_MAX { NORM_MAX / norm } else { 1.0 };
        let correction = |decay: f32| 1.0 - libm::pow(f64::from(decay), self.steps as f64) as f32;
        let rate = rate * correction(DECAY_SECOND).sqrt() / correction(DECAY_FIRST);
        let moments = self.first.iter_mut().zip(&mut self.second);
        for ((value, gradient), (first, second)) in parameters.iter_mut().zip(gradient).zip(moments) {
            let g = gradient * clip;
            *first = DECAY_FIRST * *first + (1.0 - DECAY_FIRST) * g;
            *second = DECAY_SECOND * *second + (1.0 - DECAY_SECOND) * g * g;
            *value -= rate * *first / (second.sqrt() + 1e-8);
        }
        norm
    }
}

/// The length of a gradient, in several sums side by side: one alone would wait for each addition.
fn norm(gradient: &[f32]) -> f32 {
    let mut sums = [0.0_f64; 16];
    for part in gradient.chunks(sums.len()) {
        for (sum, g) in sums.iter_mut().zip(part) {
            *sum += f64::from(*g) * f64::from(*g);
        }
    }
    sums.iter().sum::<f64>().sqrt() as f32
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_rate_warms_up_and_falls_to_a_hundredth() {
        let schedule = Schedule { rate: 2e-3, warm_up_steps: 100, samples: 1000 };
        assert!(schedule.rate_at(0, 0) < 3e-5);
        assert!((schedule.rate_at(99, 0) - 2e-3).abs() < 1e-6);
        assert!((schedule.rate_at(500, 1000) - 2e-5).abs() < 1e-7);
    }

    #[test]
    fn adam_finds_the_bottom_of_a_bowl() {
        let mut adam = Adam::new(2);
        let mut x = [3.0, -2.0];
        for _ in 0..3000 {
            let gradient = [x[0] - 1.0, 10.0 * (x[1] - 0.5)];
            adam.step(&mut x, &gradient, 5e-3);
        }
        assert!((x[0] - 1.0).abs() < 1e-2 && (x[1] - 0.5).abs() < 1e-2, "{x:?}");
    }
}

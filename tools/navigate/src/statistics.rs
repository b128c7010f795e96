//! A test that is exact: no normal approximation, whatever the counts.

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

    /// Counted by hand: of the 8 signs of (3, 1, 1) two reach 5, of the 4 of (2, -2) all reach 0.
    #[test]
    fn the_test_counts_every_choice_of_signs() {
        assert!((sign_flip_test(&[3, 1, 1]) - 0.25).abs() < 1e-12);
        assert!((sign_flip_test(&[2, -2]) - 1.0).abs() < 1e-12);
        assert!((sign_flip_test(&[1; 10]) - 2.0 / 1024.0).abs() < 1e-12);
        assert!((sign_flip_test(&[]) - 1.0).abs() < 1e-12);
    }
}

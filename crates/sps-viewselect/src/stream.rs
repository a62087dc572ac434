//! Named random streams: every draw comes from a ChaCha stream keyed by (seed, purpose, index), so
//! that a draw added in one place moves none elsewhere.

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{RngCore, SeedableRng};

/// What the draws are for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Purpose {
    RandomSets = 1,
    Relations = 2,
    PolicySamples = 3,
    ValueInit = 4,
    ValueBatches = 5,
    ValueStarts = 6,
    GreedyStarts = 7,
}

/// One stream of draws.
pub(crate) struct Stream(ChaCha8Rng);

impl Stream {
    pub(crate) fn new(seed: u64, purpose: Purpose, index: u64) -> Self {
        let mut key = [0; 32];
        key[..8].copy_from_slice(&seed.to_le_bytes());
        key[8] = purpose as u8;
        let mut rng = ChaCha8Rng::from_seed(key);
        rng.set_stream(index);
        Self(rng)
    }

    /// Uniform in [0, 1), 53 bits.
    pub(crate) fn unit(&mut self) -> f64 {
        (self.0.next_u64() >> 11) as f64 / (1_u64 << 53) as f64
    }

    /// Uniform below `bound`, which is at least 1, without bias: the high half of a product, and
    /// the few low halves that would favour some values are drawn again (Lemire 2019).
    pub(crate) fn below(&mut self, bound: usize) -> usize {
        let bound = bound as u64;
        let threshold = bound.wrapping_neg() % bound;
        loop {
            let product = u128::from(self.0.next_u64()) * u128::from(bound);
            if product as u64 >= threshold {
                return (product >> 64) as usize;
            }
        }
    }

    /// `count` distinct numbers below `bound`, every ordered choice equally likely. `count` is at
    /// most `bound`.
    pub(crate) fn distinct_below(&mut self, bound: usize, count: usize) -> Vec<usize> {
        let mut drawn = Vec::with_capacity(count);
        while drawn.len() < count {
            // The k-th of the numbers not drawn yet: no rejection, also where count is bound.
            let mut sorted = drawn.clone();
            sorted.sort_unstable();
            let rank = self.below(bound - drawn.len());
            let number = sorted
                .iter()
                .fold(rank, |number, &taken| number + usize::from(taken <= number));
            drawn.push(number);
        }
        drawn
    }

    /// A set of `picks` of `views` views, every one equally likely.
    pub(crate) fn set(&mut self, views: usize, picks: usize, distinct: bool) -> Vec<usize> {
        if distinct {
            self.distinct_below(views, picks)
        } else {
            (0..picks).map(|_| self.below(views)).collect()
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_part_of_the_name_changes_the_stream() {
        let first = |seed, purpose, index| Stream::new(seed, purpose, index).unit();
        let base = first(1, Purpose::RandomSets, 0);
        assert_eq!(base, first(1, Purpose::RandomSets, 0));
        assert_ne!(base, first(2, Purpose::RandomSets, 0));
        assert_ne!(base, first(1, Purpose::Relations, 0));
        assert_ne!(base, first(1, Purpose::RandomSets, 1));
    }

    #[test]
    fn ordered_choices_are_equally_likely() {
        // 24 ordered choices of 3 of 4; chi-square with 23 degrees of freedom is below 49.7 with
        // probability 0.999.
        let mut stream = Stream::new(3, Purpose::RandomSets, 0);
        let mut counts = std::collections::BTreeMap::<_, f64>::new();
        let draws = 24_000.0;
        for _ in 0..24_000 {
            *counts.entry(stream.distinct_below(4, 3)).or_default() += 1.0;
        }
        assert_eq!(counts.len(), 24);
        let expected = draws / 24.0;
        let chi_square: f64 = counts
            .values()
            .map(|count| (count - expected).powi(2) / expected)
            .sum();
        assert!(chi_square < 49.7, "{chi_square}");
    }
}

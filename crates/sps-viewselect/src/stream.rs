//! Named random streams: every draw comes from a ChaCha stream keyed by (seed, purpose, index), so
//! that a draw added in one place moves none elsewhere.

use sps_base::streams::{self, ChaCha8Rng, RngCore};

use crate::problem::Problem;

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
        let mut name = [0; 24];
        name[0] = purpose as u8;
        Self(streams::stream(seed, name, index))
    }

    /// Uniform in [0, 1), 53 bits.
    pub(crate) fn unit(&mut self) -> f64 {
        (self.0.next_u64() >> 11) as f64 / (1_u64 << 53) as f64
    }

    /// Uniform below `bound`, which is at least 1, without bias.
    pub(crate) fn below(&mut self, bound: usize) -> usize {
        streams::below(&mut self.0, bound as u64) as usize
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
            let skip = |number, &taken: &usize| number + usize::from(taken <= number);
            drawn.push(sorted.iter().fold(rank, skip));
        }
        drawn
    }

    /// A set of views, every one equally likely.
    pub(crate) fn set(&mut self, problem: &Problem<'_>) -> Vec<usize> {
        let (views, picks) = (problem.views(), problem.picks());
        if problem.is_distinct() {
            self.distinct_below(views, picks)
        } else {
            (0..picks).map(|_| self.below(views)).collect()
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// As drawn before this crate shared its streams with others: picks depend on them.
    #[test]
    fn a_stream_draws_what_it_always_drew() {
        let mut stream = Stream::new(7, Purpose::PolicySamples, 3);
        assert_eq!(
            [0; 6].map(|_| stream.below(1000)),
            [619, 353, 291, 605, 793, 371]
        );
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
        let terms = counts.values().map(|count| (count - expected).powi(2));
        let chi_square = terms.sum::<f64>() / expected;
        assert!(chi_square < 49.7, "{chi_square}");
    }
}

//! Named random streams: every draw is fixed by (seed, purpose, index) and moves no other.

use sps_base::streams::{ChaCha8Rng, below, hashed_stream};

/// The ChaCha stream of one purpose.
pub(crate) struct Stream(ChaCha8Rng);

impl Stream {
    /// `index` tells streams of one purpose apart: the rerun, the fold.
    pub(crate) fn new(seed: u64, purpose: &str, index: u64) -> Self {
        let (seed, index) = (seed.to_le_bytes(), index.to_le_bytes());
        let name = [&seed, &index, purpose.as_bytes()];
        Self(hashed_stream("sps-dataset 0.1 random stream", name))
    }

    /// Every order equally likely (Fisher and Yates).
    pub(crate) fn shuffle<T>(&mut self, items: &mut [T]) {
        for last in (1..items.len()).rev() {
            let chosen = below(&mut self.0, last as u64 + 1) as usize;
            items.swap(last, chosen);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn streams_differ_by_seed_purpose_and_index_and_repeat_themselves() {
        let draw = |seed, purpose, index| below(&mut Stream::new(seed, purpose, index).0, u64::MAX);
        let first = draw(1, "split", 0);
        assert_eq!(first, draw(1, "split", 0));
        for other in [draw(2, "split", 0), draw(1, "fold", 0), draw(1, "split", 1)] {
            assert_ne!(first, other);
        }
    }

    /// As drawn before this crate shared its streams with others: every split depends on them.
    #[test]
    fn an_order_is_what_it_always_was() {
        let mut items = [0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11];
        Stream::new(7, "split", 3).shuffle(&mut items);
        assert_eq!(items, [6, 3, 7, 1, 9, 2, 5, 11, 10, 0, 8, 4]);
    }

    /// Chi-squared over the 24 orders of four items; 60 exceeds the 99.99 % point for 23 degrees.
    #[test]
    fn every_order_is_equally_likely() {
        let draws = 24_000;
        let mut counts = std::collections::BTreeMap::new();
        for index in 0..draws {
            let mut items = [0, 1, 2, 3];
            Stream::new(7, "orders", index).shuffle(&mut items);
            *counts.entry(items).or_insert(0.0) += 1.0;
        }
        assert_eq!(counts.len(), 24);
        let expected = draws as f64 / 24.0;
        let chi2: f64 = counts
            .values()
            .map(|n: &f64| (n - expected).powi(2) / expected)
            .sum();
        assert!(chi2 < 60.0, "{chi2}");
    }
}

use sps_base::streams::{ChaCha8Rng, SeedableRng, below_u32, key};

/// How often each unit occurs in each resample: one stream per resample, so that none depends
/// on how many others are drawn, in which order, or by which thread.
pub(super) struct Draws {
    key: [u8; 32],
}

impl Draws {
    pub(super) fn new(seed: u64) -> Self {
        Self {
            key: key(seed, *b"sps-metrics bootstrap v1"),
        }
    }

    /// Draws as many units as there are, with replacement, and counts each.
    pub(super) fn fill(&self, resample: u64, counts: &mut [u32], units: u32) {
        let mut stream = ChaCha8Rng::from_seed(self.key);
        stream.set_stream(resample);
        counts.fill(0);
        for _ in 0..units {
            counts[below_u32(&mut stream, units) as usize] += 1;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Pearson's statistic of 10 000 resamples of seven has six degrees of freedom: above 27.9 once
    /// in ten thousand.
    #[test]
    fn units_are_equally_likely() {
        const RESAMPLES: u64 = 10_000;
        let draws = Draws::new(1);
        let (mut counts, mut totals) = ([0; 7], [0_u32; 7]);
        for resample in 0..RESAMPLES {
            draws.fill(resample, &mut counts, 7);
            assert_eq!(counts.iter().sum::<u32>(), 7);
            for (total, count) in totals.iter_mut().zip(counts) {
                *total += count;
            }
        }
        let expected = RESAMPLES as f64;
        let off = totals.map(|total| (f64::from(total) - expected).powi(2) / expected);
        assert!(off.iter().sum::<f64>() < 27.9, "{totals:?}");
    }

    /// As drawn before this crate shared its streams with others: an interval depends on them.
    #[test]
    fn a_resample_is_what_it_always_was() {
        let mut counts = [0; 20];
        Draws::new(7).fill(3, &mut counts, 20);
        assert_eq!(
            counts,
            [0, 1, 2, 1, 1, 0, 0, 0, 0, 2, 0, 2, 2, 0, 1, 0, 1, 3, 3, 1]
        );
    }

    #[test]
    fn a_resample_depends_on_its_seed_and_number_alone() {
        let drawn = |seed, order: &[u64]| {
            let draws = Draws::new(seed);
            let mut counts = vec![0; 50];
            let each = order.iter().map(|&resample| {
                draws.fill(resample, &mut counts, 50);
                (resample, counts.clone())
            });
            each.collect::<std::collections::BTreeMap<_, _>>()
        };
        assert_eq!(drawn(1, &[0, 1, 2]), drawn(1, &[2, 0, 1]));
        assert_ne!(drawn(1, &[0]), drawn(2, &[0]));
        assert_ne!(drawn(1, &[0])[&0], drawn(1, &[1])[&1]);
    }
}

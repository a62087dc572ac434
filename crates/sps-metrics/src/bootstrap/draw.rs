use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{RngCore, SeedableRng};

/// How often each unit occurs in each resample: one stream per resample, so that none depends
/// on how many others are drawn, in which order, or by which thread.
pub(super) struct Draws {
    key: [u8; 32],
}

impl Draws {
    const PURPOSE: &'static [u8; 24] = b"sps-metrics bootstrap v1";

    pub(super) fn new(seed: u64) -> Self {
        let mut key = [0; 32];
        let (seed_bytes, purpose) = key.split_at_mut(8);
        seed_bytes.copy_from_slice(&seed.to_le_bytes());
        purpose.copy_from_slice(Self::PURPOSE);
        Self { key }
    }

    /// Draws as many units as there are, with replacement, and counts each.
    pub(super) fn fill(&self, resample: u64, counts: &mut [u32], units: u32) {
        let mut stream = ChaCha8Rng::from_seed(self.key);
        stream.set_stream(resample);
        counts.fill(0);
        for _ in 0..units {
            counts[below(&mut stream, units) as usize] += 1;
        }
    }
}

/// A uniform draw from `0..bound` (Lemire, "Fast random integer generation in an interval", 2019).
fn below(stream: &mut ChaCha8Rng, bound: u32) -> u32 {
    let mut product = u64::from(stream.next_u32()) * u64::from(bound);
    if (product as u32) < bound {
        let threshold = bound.wrapping_neg() % bound;
        while (product as u32) < threshold {
            product = u64::from(stream.next_u32()) * u64::from(bound);
        }
    }
    (product >> 32) as u32
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

    /// Of 2^32 numbers and this bound, multiples of three would come from two each and the rest
    /// from one, if none were drawn again.
    #[test]
    fn no_residue_is_favoured() {
        const DRAWS: usize = 20_000;
        let mut stream = ChaCha8Rng::from_seed([7; 32]);
        let multiples = (0..DRAWS).filter(|_| below(&mut stream, 3 << 30).is_multiple_of(3));
        let share = multiples.count() as f64 / DRAWS as f64;
        assert!((share - 1.0 / 3.0).abs() < 0.015, "{share}");
    }
}

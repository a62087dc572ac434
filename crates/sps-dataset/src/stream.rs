use sps_base::streams::{below, hashed_stream};

/// Puts `items` in a random order, every order equally likely (Fisher and Yates). It is fixed by
/// seed, purpose and `index` (the rerun, the fold) and moves no other.
pub(crate) fn shuffle<T>(items: &mut [T], seed: u64, purpose: &str, index: u64) {
    let (seed, index) = (seed.to_le_bytes(), index.to_le_bytes());
    let name = [&seed, &index, purpose.as_bytes()];
    let mut stream = hashed_stream("sps-dataset 0.1 random stream", name);
    for last in (1..items.len()).rev() {
        let chosen = below(&mut stream, last as u64 + 1) as usize;
        items.swap(last, chosen);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn order(seed: u64, purpose: &str, index: u64) -> [u8; 12] {
        let mut items = std::array::from_fn(|item| item as u8);
        shuffle(&mut items, seed, purpose, index);
        items
    }

    #[test]
    fn orders_differ_by_seed_purpose_and_index_and_repeat_themselves() {
        let first = order(1, "split", 0);
        assert_eq!(first, order(1, "split", 0));
        for other in [
            order(2, "split", 0),
            order(1, "fold", 0),
            order(1, "split", 1),
        ] {
            assert_ne!(first, other);
        }
    }

    /// As drawn before this crate shared its streams with others: every split depends on them.
    #[test]
    fn an_order_is_what_it_always_was() {
        let drawn = [6, 3, 7, 1, 9, 2, 5, 11, 10, 0, 8, 4];
        assert_eq!(order(7, "split", 3), drawn);
    }

    /// Chi-squared over the 24 orders of four items; 60 exceeds the 99.99 % point for 23 degrees.
    #[test]
    fn every_order_is_equally_likely() {
        let draws = 24_000;
        let mut counts = std::collections::BTreeMap::new();
        for index in 0..draws {
            let mut items = [0, 1, 2, 3];
            shuffle(&mut items, 7, "orders", index);
            *counts.entry(items).or_insert(0.0) += 1.0;
        }
        assert_eq!(counts.len(), 24);
        let expected = draws as f64 / 24.0;
        let squares = counts.values().map(|n: &f64| (n - expected).powi(2));
        let chi2 = squares.sum::<f64>() / expected;
        assert!(chi2 < 60.0, "{chi2}");
    }
}

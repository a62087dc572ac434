//! How many digits numbers are shown with.

/// Decimals that show so wide a spread with three significant digits, six at most: 30.2, 0.213. One where
/// there is no spread.
pub(crate) fn decimals(spread: f64) -> usize {
    const MOST: i32 = 6;
    if !(spread.is_finite() && spread > 0.0) {
        return 1;
    }
    let leading = spread.log10().floor() as i32;
    (2 - leading).clamp(0, MOST) as usize
}

#[cfg(test)]
mod tests {
    use super::decimals;

    #[test]
    fn three_digits_of_the_spread_are_shown() {
        for (spread, expected) in [
            (1234.0, 0),
            (100.0, 0),
            (99.0, 1),
            (20.0, 1),
            (1.5, 2),
            (0.2, 3),
            (1e-3, 5),
            (1e-300, 6),
        ] {
            assert_eq!(decimals(spread), expected, "{spread}");
        }
    }

    #[test]
    fn hard_cases() {
        for spread in [0.0, -1.0, f64::NAN, f64::INFINITY] {
            assert_eq!(decimals(spread), 1);
        }
    }
}

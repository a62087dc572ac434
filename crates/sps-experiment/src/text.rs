//! Numbers, counts and columns as text.

/// Decimals that show so wide a spread with three significant digits, six at most: 30.2, 0.213. One where
/// there is no spread.
pub fn decimals(spread: f64) -> usize {
    const MOST: i32 = 6;
    if !(spread.is_finite() && spread > 0.0) {
        return 1;
    }
    let leading = spread.log10().floor() as i32;
    (2 - leading).clamp(0, MOST) as usize
}

/// What stands where a value could not be computed.
const MISSING: &str = "–";

/// A number with so many decimals.
pub fn number(value: Option<f64>, decimals: usize) -> String {
    let Some(value) = value else {
        return MISSING.to_owned();
    };
    let text = format!("{value:.decimals$}");
    match text.strip_prefix('-') {
        Some(zero) if zero.chars().all(|c| matches!(c, '0' | '.')) => zero.to_owned(),
        _ => text,
    }
}

/// So many of what `noun` names in the singular.
pub fn counted(count: usize, noun: &str) -> String {
    let plural = if count == 1 { "" } else { "s" };
    format!("{count} {noun}{plural}")
}

/// Lines of cells below one another, two spaces from the left.
pub fn aligned(lines: &[Vec<String>], is_left: impl Fn(usize) -> bool) -> String {
    let columns = lines.iter().map(Vec::len).max().unwrap_or_default();
    let width = |at: usize| {
        let cells = lines.iter().filter_map(|cells| cells.get(at));
        let widths = cells.map(|cell| cell.chars().count());
        widths.max().unwrap_or_default()
    };
    let widths: Vec<usize> = (0..columns).map(width).collect();
    let line = |cells: &Vec<String>| {
        let cells = cells.iter().zip(&widths).enumerate();
        let cells = cells.map(|(at, (cell, &width))| {
            if is_left(at) {
                format!("  {cell:<width$}")
            } else {
                format!("  {cell:>width$}")
            }
        });
        format!("{}\n", cells.collect::<String>().trim_end())
    };
    lines.iter().map(line).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_rounded_and_zero_has_no_sign() {
        assert_eq!(number(Some(0.456), 2), "0.46");
        assert_eq!(number(Some(-0.004), 2), "0.00");
        assert_eq!(number(Some(-0.006), 2), "-0.01");
        assert_eq!(number(None, 2), "–");
    }

    #[test]
    fn three_digits_of_the_spread_are_shown() {
        for (spread, expected) in [
            // One decimal where there is no spread.
            (0.0, 1),
            (-1.0, 1),
            (f64::NAN, 1),
            (f64::INFINITY, 1),
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
}

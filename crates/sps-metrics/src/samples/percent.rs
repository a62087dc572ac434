use crate::outcome::{Outcome, Quantity, Score, Undefined, in_range};
use crate::samples::Pair;
use crate::screen::Screen;

/// The median percentage error of samples.
pub(crate) fn median_percent_error(pairs: impl Iterator<Item = Pair>) -> Outcome {
    let mut screen = Screen::default();
    let admitted = pairs.filter(|Pair { truth, estimate }| {
        screen.admit([(Quantity::Truth, *truth), (Quantity::Estimate, *estimate)])
    });
    let mut errors: Vec<f64> = admitted.filter_map(percent_error).collect();
    let seen = screen.samples()?;
    let median = median(&mut errors).ok_or(Undefined::AllTruthsZero { samples: seen })?;
    Ok(Score {
        value: in_range(median)?,
        samples: errors.len(),
        zero_truths: seen - errors.len(),
    })
}

/// 100 |t - t̂| / |t|, which a truth of zero has not. Infinite where it overflows.
pub(crate) fn percent_error(pair: Pair) -> Option<f64> {
    let Pair { truth, estimate } = pair;
    (truth != 0.0).then(|| 100.0 * ((truth - estimate).abs() / truth.abs()))
}

/// The middle of non-negative values, by selection.
fn median(values: &mut [f64]) -> Option<f64> {
    let middle = values.len() / 2;
    if values.is_empty() {
        return None;
    }
    let even = values.len().is_multiple_of(2);
    let (below, &mut upper, _) = values.select_nth_unstable_by(middle, f64::total_cmp);
    let lower = below.iter().copied().max_by(f64::total_cmp);
    Some(match lower {
        Some(lower) if even => f64::midpoint(lower, upper),
        _ => upper,
    })
}

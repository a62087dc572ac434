use super::PredictionInterval;
use crate::moments::Moments;
use crate::outcome::{Quantity, Undefined};
use crate::screen::Screen;

/// How intervals fared on truths.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Coverage {
    /// How many truths lie in their interval, its ends included.
    pub covered: usize,
    /// How many there are.
    pub samples: usize,
    /// Mean width of the intervals, in the unit of the truth.
    pub mean_width: f64,
}

impl Coverage {
    /// The share of truths that lie in their interval.
    pub fn fraction(&self) -> f64 {
        self.covered as f64 / self.samples as f64
    }
}

/// Empirical coverage and mean width of intervals, one per truth.
///
/// # Errors
/// [`Undefined::Empty`], [`Undefined::LengthMismatch`], [`Undefined::NonFinite`],
/// [`Undefined::InvertedInterval`], [`Undefined::OutOfRange`].
pub fn coverage(intervals: &[PredictionInterval], truth: &[f64]) -> Result<Coverage, Undefined> {
    if intervals.len() != truth.len() {
        return Err(Undefined::LengthMismatch {
            truths: truth.len(),
            estimates: intervals.len(),
        });
    }
    let mut screen = Screen::default();
    let mut widths = Moments::new();
    let mut covered = 0;
    for (interval, &truth) in intervals.iter().zip(truth) {
        let PredictionInterval { low, high } = *interval;
        screen.admit([
            (Quantity::Truth, truth),
            (Quantity::IntervalEnd, low),
            (Quantity::IntervalEnd, high),
        ]);
        covered += usize::from((low..=high).contains(&truth));
        widths.push(high - low);
    }
    let samples = screen.samples()?;
    if let Some(index) = intervals
        .iter()
        .position(|interval| interval.low > interval.high)
    {
        return Err(Undefined::InvertedInterval { index });
    }
    Ok(Coverage {
        covered,
        samples,
        // Finite ends whose distance is not: the width overflowed.
        mean_width: widths.mean().map_err(|_| Undefined::OutOfRange)?,
    })
}

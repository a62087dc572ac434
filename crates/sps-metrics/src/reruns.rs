use crate::interval::chance::{Part, p_value};
use crate::moments::Moments;
use crate::outcome::Undefined;

/// One score over reruns of one experiment.
#[derive(Clone, Debug, PartialEq)]
pub struct RerunSummary {
    /// The mean over the reruns that have a score, in the unit of the score.
    pub mean: Result<f64, Undefined>,
    /// The sample standard deviation (n - 1) over the same; [`Undefined::TooFewSamples`] for one.
    pub std: Result<f64, Undefined>,
    /// How many reruns have a score.
    pub reruns: usize,
    /// Which reruns have none, counted from 0, and why.
    pub left_out: Vec<(usize, Undefined)>,
}

impl RerunSummary {
    /// The two-sided p-value of a true mean of 0, by Student's t.
    ///
    /// # Errors
    /// Those of [`std`](Self::std).
    pub fn p_value(&self) -> Result<f64, Undefined> {
        let (mean, std) = (self.mean.clone()?, self.std.clone()?);
        let reruns = self.reruns as f64;
        let part = Part {
            variance: std * std / reruns,
            degrees_of_freedom: reruns - 1.0,
        };
        Ok(p_value(&[part], mean))
    }
}

/// Mean and sample standard deviation of a score over reruns.
///
/// Reruns without a score are left out and reported; where none has one, both results are
/// [`Undefined::NothingDefined`]. A value that is not finite makes both [`Undefined::NonFinite`].
///
/// ```
/// use sps_metrics::{Undefined, over_reruns};
///
/// let summary = over_reruns([Ok(0.50), Ok(0.54), Err(Undefined::Empty)]);
/// assert_eq!(summary.mean, Ok(0.52));
/// assert_eq!(summary.reruns, 2);
/// assert_eq!(summary.left_out, [(2, Undefined::Empty)]);
/// ```
pub fn over_reruns(values: impl IntoIterator<Item = Result<f64, Undefined>>) -> RerunSummary {
    let mut moments = Moments::new();
    let mut left_out = Vec::new();
    let mut reruns = 0;
    for (index, value) in values.into_iter().enumerate() {
        match value {
            Ok(value) => {
                moments.push(value);
                reruns += 1;
            }
            Err(reason) => left_out.push((index, reason)),
        }
    }
    let of = left_out.len();
    let nothing = |reason| match reason {
        Undefined::Empty if of > 0 => Undefined::NothingDefined { of },
        reason => reason,
    };
    RerunSummary {
        mean: moments.mean().map_err(nothing),
        std: moments.sample_std().map_err(nothing),
        reruns,
        left_out,
    }
}

use crate::double::Double;
use crate::outcome::{Quantity, Undefined, in_range};
use crate::screen::Screen;

/// Below this, what underflow took from a sum of squares could show in an `f64`.
pub(crate) const LEAST_SUM_OF_SQUARES: f64 = 1e-290;

/// Count, mean and sums of squares of a stream of values, in constant memory.
///
/// Differences from the first value are summed in double-double arithmetic and merged by moving
/// the sums to a common origin (Chan, Golub and LeVeque, "Algorithms for computing the sample
/// variance", The American Statistician 37, 1983). Welford's update in plain `f64` loses eight of
/// its sixteen digits on values like 1e8 + small and depends on their order; here any order and
/// any split into parts give the same result to the last bits, up to at least 1e9 values.
///
/// ```
/// use sps_metrics::Moments;
///
/// let mut left: Moments = [1e8 + 1.0, 1e8 + 2.0].into_iter().collect();
/// let right: Moments = [1e8 + 6.0].into_iter().collect();
/// left.merge(&right);
/// assert_eq!(left.mean(), Ok(1e8 + 3.0));
/// assert_eq!(left.sample_variance(), Ok(7.0));
/// ```
#[derive(Clone, Debug, Default)]
pub struct Moments {
    screen: Screen,
    sums: ShiftedSums,
}

impl Moments {
    /// No values yet.
    pub fn new() -> Self {
        Self::default()
    }

    /// Adds a value. One that is not finite makes every result an error that names it.
    pub fn push(&mut self, value: f64) {
        if self.screen.admit([(Quantity::Value, value)]) {
            self.sums.push(value);
        }
    }

    /// Adds all values of `later`, as if they had been pushed after those of `self`.
    pub fn merge(&mut self, later: &Self) {
        self.screen.merge(&later.screen);
        self.sums.merge(&later.sums);
    }

    /// The arithmetic mean.
    ///
    /// # Errors
    /// [`Undefined::Empty`], [`Undefined::NonFinite`], [`Undefined::OutOfRange`].
    pub fn mean(&self) -> Result<f64, Undefined> {
        self.screen.samples()?;
        in_range(self.sums.mean().value())
    }

    /// The variance with n - 1 in its denominator.
    ///
    /// # Errors
    /// As [`mean`](Self::mean), and [`Undefined::TooFewSamples`] for one value.
    pub fn sample_variance(&self) -> Result<f64, Undefined> {
        let found = self.screen.samples()?;
        if found < 2 {
            return Err(Undefined::TooFewSamples { found, needed: 2 });
        }
        let squares = self.sums.about_mean();
        if self.sums.constant().is_none() {
            trusted(squares)?;
        }
        in_range((squares / Double::from((found - 1) as f64)).value())
    }

    /// The square root of [`sample_variance`](Self::sample_variance).
    ///
    /// # Errors
    /// As [`sample_variance`](Self::sample_variance).
    pub fn sample_std(&self) -> Result<f64, Undefined> {
        self.sample_variance().map(f64::sqrt)
    }
}

impl FromIterator<f64> for Moments {
    fn from_iter<I: IntoIterator<Item = f64>>(values: I) -> Self {
        let mut moments = Self::new();
        values.into_iter().for_each(|value| moments.push(value));
        moments
    }
}

/// The sum, if it is large enough to have kept its digits and small enough to be finite.
pub(crate) fn trusted(sum_of_squares: Double) -> Result<Double, Undefined> {
    let value = sum_of_squares.value();
    if value.is_finite() && value >= LEAST_SUM_OF_SQUARES {
        Ok(sum_of_squares)
    } else {
        Err(Undefined::OutOfRange)
    }
}

/// Sums of finite values about the first of them.
///
/// The origin is one of the values, so the sum of squares about it exceeds that about the mean at
/// most (n + 1)-fold: that bounds what the subtraction in `about_mean` can cancel.
#[derive(Clone, Debug, Default)]
pub(crate) struct ShiftedSums {
    count: usize,
    origin: f64,
    sum: Double,
    squares: Double,
    varies: bool,
}

impl ShiftedSums {
    pub(crate) fn push(&mut self, value: f64) {
        if self.count == 0 {
            self.origin = value;
        }
        self.count += 1;
        if value != self.origin {
            let shifted = Double::difference(value, self.origin);
            self.sum += shifted;
            self.squares += shifted * shifted;
            self.varies = true;
        }
    }

    pub(crate) fn merge(&mut self, other: &Self) {
        if self.count == 0 {
            self.clone_from(other);
        } else if other.count > 0 {
            let (sum, squares) = other.about(self.origin);
            self.sum += sum;
            self.squares += squares;
            self.count += other.count;
            self.varies |= other.varies || other.origin != self.origin;
        }
    }

    /// The value that all have, if they have one.
    pub(crate) fn constant(&self) -> Option<f64> {
        (!self.varies).then_some(self.origin)
    }

    pub(crate) fn mean(&self) -> Double {
        Double::from(self.origin) + self.sum / self.size()
    }

    /// Sum and sum of squares of the differences from `reference`.
    pub(crate) fn about(&self, reference: f64) -> (Double, Double) {
        let shift = Double::difference(self.origin, reference);
        let shifted = self.size() * shift;
        let squares = self.squares + shift * (self.sum + self.sum + shifted);
        (self.sum + shifted, squares)
    }

    /// Sum of squared differences from the mean.
    pub(crate) fn about_mean(&self) -> Double {
        self.squares - self.sum * self.sum / self.size()
    }

    fn size(&self) -> Double {
        Double::from(self.count as f64)
    }
}

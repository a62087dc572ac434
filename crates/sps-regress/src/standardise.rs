//! One column of numbers to zero mean and unit variance.

/// Mean and spread of one column, over the rows where it was measured.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Standardiser {
    /// The mean.
    pub mean: f64,
    /// Population standard deviation; exactly 0 when the column is constant up to rounding.
    pub std: f64,
}

impl Standardiser {
    /// Of these values; `None` for no values at all.
    pub fn of(values: impl Iterator<Item = f64> + Clone) -> Option<Self> {
        let count = values.clone().count();
        if count == 0 {
            return None;
        }
        let n = count as f64;
        let mean = values.clone().sum::<f64>() / n;
        let largest = values.clone().fold(0.0_f64, |max, v| max.max(v.abs()));
        let std = (values.map(|v| (v - mean).powi(2)).sum::<f64>() / n).sqrt();
        // The mean of equal values is off by rounding, which must not pass for a spread.
        let rounding = n * f64::EPSILON * largest;
        Some(Self {
            mean,
            std: if std <= rounding { 0.0 } else { std },
        })
    }

    /// `(value - mean) / std`, and 0 where there is no spread.
    pub fn standardise(self, value: f64) -> f64 {
        if self.std == 0.0 {
            0.0
        } else {
            (value - self.mean) / self.std
        }
    }
}

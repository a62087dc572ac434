use ndarray::{Array2, ArrayView1};

/// Mean and spread of one column, over the rows where it was measured.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Spread {
    pub(crate) mean: f64,
    /// Population standard deviation; exactly 0 when the column is constant up to rounding.
    pub(crate) std: f64,
}

impl Spread {
    /// `None` for no values at all.
    pub(crate) fn of(values: impl Iterator<Item = f64> + Clone) -> Option<Self> {
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
    pub(crate) fn standardise(self, value: f64) -> f64 {
        if self.std == 0.0 {
            0.0
        } else {
            (value - self.mean) / self.std
        }
    }
}

/// Each column to zero mean and unit variance; a constant column becomes zero.
pub(super) fn columns(mut table: Array2<f64>) -> Array2<f64> {
    for mut column in table.columns_mut() {
        if let Some(spread) = spread(column.view()) {
            column.mapv_inplace(|value| spread.standardise(value));
        }
    }
    table
}

fn spread(column: ArrayView1<'_, f64>) -> Option<Spread> {
    Spread::of(column.iter().copied())
}

use ndarray::{ArrayView1, ArrayView2};
use thiserror::Error;

use crate::outcome::Undefined;
use crate::samples::{Samples, Scores, TrainingMean};

/// Truths and estimates of several properties, each `(samples, properties)`, f64.
///
/// ```
/// use sps_metrics::ndarray::array;
/// use sps_metrics::{Table, TableParts, TrainingMean};
///
/// let truth = array![[12.0, 3.0], [35.0, f64::NAN], [61.0, 5.0]];
/// let estimate = array![[15.0, 3.5], [33.0, 4.0], [58.0, 4.5]];
/// let measured = truth.mapv(f64::is_finite);
/// let table = Table::new(TableParts {
///     truth: truth.view(),
///     estimate: estimate.view(),
///     measured: Some(measured.view()),
/// })?;
/// let scores = table.scores(&[TrainingMean::new(36.0), TrainingMean::new(4.0)])?;
/// assert_eq!((scores[1].mae.clone()?.value, scores[1].mae.clone()?.samples), (0.5, 2));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Copy, Debug)]
pub struct Table<'a> {
    truth: ArrayView2<'a, f64>,
    estimate: ArrayView2<'a, f64>,
    measured: Option<ArrayView2<'a, bool>>,
}

/// What a [`Table`] is made of.
#[derive(Clone, Copy, Debug)]
pub struct TableParts<'a> {
    /// The measured values, `(samples, properties)`.
    pub truth: ArrayView2<'a, f64>,
    /// The model's values, `(samples, properties)`.
    pub estimate: ArrayView2<'a, f64>,
    /// Which truths were measured, `(samples, properties)`; `None` for all of them. The others are
    /// not looked at, so they may hold anything.
    pub measured: Option<ArrayView2<'a, bool>>,
}

/// Two parts that belong together differ in shape.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
#[error("{part} has shape {found:?}, the truth's is {truth:?}")]
pub struct ShapeError {
    /// Which part.
    pub part: &'static str,
    /// Its shape.
    pub found: Vec<usize>,
    /// The shape of the truth, of which a list of training means matches the second.
    pub truth: Vec<usize>,
}

/// The measured samples of one property.
#[derive(Clone, Debug, PartialEq)]
pub struct Column {
    /// The measured values.
    pub truth: Vec<f64>,
    /// The model's values.
    pub estimate: Vec<f64>,
    /// The row of the table that each sample comes from.
    pub rows: Vec<usize>,
}

impl Column {
    /// The samples, for scoring.
    pub fn samples(&self) -> Samples<'_> {
        Samples {
            truth: &self.truth,
            estimate: &self.estimate,
        }
    }
}

impl<'a> Table<'a> {
    /// A table of parts that agree in shape.
    ///
    /// # Errors
    ///
    /// [`ShapeError`] where they do not.
    pub fn new(parts: TableParts<'a>) -> Result<Self, ShapeError> {
        let TableParts {
            truth,
            estimate,
            measured,
        } = parts;
        let check = |part, found: &[usize]| {
            if found == truth.shape() {
                Ok(())
            } else {
                Err(ShapeError {
                    part,
                    found: found.to_vec(),
                    truth: truth.shape().to_vec(),
                })
            }
        };
        check("estimate", estimate.shape())?;
        measured.map_or(Ok(()), |measured| check("measured", measured.shape()))?;
        Ok(Self {
            truth,
            estimate,
            measured,
        })
    }

    /// How many properties the table has.
    pub fn properties(&self) -> usize {
        self.truth.ncols()
    }

    /// The measured samples of one property; `None` past the last property.
    pub fn column(&self, property: usize) -> Option<Column> {
        if property >= self.properties() {
            return None;
        }
        let measured = self.measured.as_ref().map(|mask| mask.column(property));
        let is_measured = |row: &usize| measured.is_none_or(|mask| mask[*row]);
        let rows: Vec<usize> = (0..self.truth.nrows()).filter(is_measured).collect();
        let pick = |column: ArrayView1<'_, f64>| rows.iter().map(|&row| column[row]).collect();
        Some(Column {
            truth: pick(self.truth.column(property)),
            estimate: pick(self.estimate.column(property)),
            rows,
        })
    }

    /// Every score of every property, in the table's order. `training_means` holds one per
    /// property, see [`Scores::of`].
    ///
    /// # Errors
    ///
    /// [`ShapeError`] where there is not one training mean per property.
    pub fn scores(
        &self,
        training_means: &[Result<TrainingMean, Undefined>],
    ) -> Result<Vec<Scores>, ShapeError> {
        if training_means.len() != self.properties() {
            return Err(ShapeError {
                part: "training means",
                found: vec![training_means.len()],
                truth: self.truth.shape().to_vec(),
            });
        }
        let columns = (0..self.properties()).filter_map(|property| self.column(property));
        let scored = columns.zip(training_means);
        Ok(scored
            .map(|(column, mean)| Scores::of(column.samples(), mean.clone()))
            .collect())
    }
}

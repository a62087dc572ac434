//! The scores by name, for what treats them alike.

use serde::Serialize;
use sps_metrics::{Metric, TrainingMean, Undefined};

use super::{Means, Number, PerProperty, PropertyScores};

/// A score of [`PropertyScores`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Kind {
    /// R² about the training mean.
    R2,
    /// Mean absolute error.
    Mae,
    /// Median percentage error.
    MedianPercentError,
    /// Root of the mean squared error.
    Rmse,
    /// Spearman's rank correlation.
    Spearman,
}

impl Kind {
    /// In the order of reports.
    pub const ALL: [Self; 5] = [
        Self::R2,
        Self::Mae,
        Self::MedianPercentError,
        Self::Rmse,
        Self::Spearman,
    ];

    /// Those that [`Means`] has.
    pub const WITH_MEANS: [Self; 3] = [Self::R2, Self::Mae, Self::MedianPercentError];

    /// As reports call it.
    pub const fn name(self) -> &'static str {
        match self {
            Self::R2 => "R²",
            Self::Mae => "MAE",
            Self::MedianPercentError => "median % error",
            Self::Rmse => "RMSE",
            Self::Spearman => "Spearman",
        }
    }

    /// With which a report shows it.
    pub const fn decimals(self) -> usize {
        match self {
            Self::R2 | Self::Spearman => 3,
            Self::Mae | Self::Rmse => 2,
            Self::MedianPercentError => 1,
        }
    }

    /// Its values among all scores.
    pub const fn of(self, scores: &PropertyScores) -> &PerProperty<Number> {
        match self {
            Self::R2 => &scores.r2,
            Self::Mae => &scores.mae,
            Self::MedianPercentError => &scores.median_percent_error,
            Self::Rmse => &scores.rmse,
            Self::Spearman => &scores.spearman,
        }
    }

    /// Over all properties; none where there is no such mean.
    pub const fn mean(self, means: &Means) -> Number {
        match self {
            Self::R2 => means.r2_mean,
            Self::Mae => means.mae_mean,
            Self::MedianPercentError => means.median_percent_error_mean,
            Self::Rmse | Self::Spearman => None,
        }
    }

    /// Of values less the mean of their training part, where [`is_about_training`] says so.
    ///
    /// [`is_about_training`]: Self::is_about_training
    ///
    /// # Errors
    /// A training mean that no metric takes.
    pub fn metric(self) -> Result<Metric, Undefined> {
        Ok(match self {
            Self::R2 => Metric::R2(TrainingMean::new(0.0)?),
            Self::Mae => Metric::Mae,
            Self::MedianPercentError => Metric::MedianPercentError,
            Self::Rmse => Metric::Rmse,
            Self::Spearman => Metric::Spearman,
        })
    }

    /// Whether it is about the mean of the training part.
    pub const fn is_about_training(self) -> bool {
        matches!(self, Self::R2)
    }
}

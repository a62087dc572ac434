//! Scores of one method per property: a metric that `sps-metrics` computes becomes a key of `results.json` here, and
//! `tables.rs` of `sps-report` shows it.

use serde::{Deserialize, Serialize};
use sps_metrics::{
    IntervalError, Metric, Outcome, ScoreInterval, Scored, TrainingMean, Undefined, over_reruns,
};

use super::judged::{Judged, Reference};
use super::notes::Notes;
use super::{Means, MethodOutcomes, Number, PerProperty, Scoring};

/// Means over reruns, per property.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct PropertyScores {
    /// Mean over reruns of R² about the training mean (section 5 of the paper), and the standard
    /// deviation over reruns.
    pub r2: PerProperty<Number>,
    /// Standard deviation of R² over reruns.
    pub r2_std: PerProperty<Number>,
    /// About the mean of the surfaces held out in a rerun, in place of that of the training part.
    #[serde(default)]
    pub r2_own_mean: PerProperty<Number>,
    /// In the property's unit.
    pub mae: PerProperty<Number>,
    /// In standard deviations of the property's values over all surfaces.
    #[serde(default)]
    pub mae_over_std: PerProperty<Number>,
    /// Percent; `null` where values touch zero or lie on both sides of it.
    pub median_percent_error: PerProperty<Number>,
    /// Root of the mean squared error, in the property's unit.
    pub rmse: PerProperty<Number>,
    /// Spearman's rank correlation.
    pub spearman: PerProperty<Number>,
    /// Interval of `r2` over units of the dataset and reruns.
    pub r2_interval: PerProperty<Option<[f64; 2]>>,
    /// Held-out samples, all reruns together, whose truth is zero: they have no percentage error.
    pub zero_truths: PerProperty<usize>,
}

impl PropertyScores {
    /// All but the intervals.
    pub(super) fn of(
        method: &MethodOutcomes<'_>,
        scoring: &Scoring<'_>,
        notes: &mut Notes,
    ) -> Self {
        let mut all = Self::default();
        for (property, outcomes) in &method.outcomes {
            let mut summary = |what: &str, of: &dyn Fn(&Judged<'_>) -> Outcome| {
                let values = outcomes.iter();
                let values = values.map(|judged| of(judged).map(|score| score.value));
                let summary = over_reruns(values);
                for (rerun, reason) in &summary.left_out {
                    // Those without any estimate have a note of their own.
                    if !outcomes[*rerun].is_empty() {
                        notes.add(&format!("{what} of {property}, rerun {rerun}"), reason);
                    }
                }
                summary
            };
            for kind in Kind::ALL {
                let percent = kind == Kind::MedianPercentError;
                let shown = !percent || scoring.with_percentages.contains(property);
                let found = shown.then(|| summary(kind.name(), &|judged| judged.score(kind)));
                if let (Kind::R2, Some(found)) = (kind, &found) {
                    all.r2_std.insert(property.clone(), found.std.clone().ok());
                    let own = |judged: &Judged<'_>| Metric::R2OwnMean.score(judged.samples());
                    let own = summary("R² about own mean", &own);
                    all.r2_own_mean.insert(property.clone(), own.mean.ok());
                }
                let mean = found.and_then(|found| found.mean.ok());
                kind.of_mut(&mut all).insert(property.clone(), mean);
            }
            let deviation = scoring.deviations.get(property).filter(|std| **std > 0.0);
            let mae = all.mae[property].zip(deviation).map(|(mae, std)| mae / std);
            all.mae_over_std.insert(property.clone(), mae);
            let percent = outcomes.iter();
            let percent = percent.flat_map(|judged| judged.score(Kind::MedianPercentError));
            let zeros = percent.map(|score| score.zero_truths).sum();
            all.zero_truths.insert(property.clone(), zeros);
        }
        all
    }

    /// Drops what is in no table.
    pub fn lighten(&mut self) {
        self.r2_std.clear();
        self.r2_own_mean.clear();
        self.rmse.clear();
        self.spearman.clear();
        self.r2_interval.clear();
        self.zero_truths.clear();
    }
}

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

    fn of_mut(self, scores: &mut PropertyScores) -> &mut PerProperty<Number> {
        match self {
            Self::R2 => &mut scores.r2,
            Self::Mae => &mut scores.mae,
            Self::MedianPercentError => &mut scores.median_percent_error,
            Self::Rmse => &mut scores.rmse,
            Self::Spearman => &mut scores.spearman,
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

pub(super) fn intervals(
    method: &MethodOutcomes<'_>,
    scoring: &Scoring<'_>,
    notes: &mut Notes,
) -> PerProperty<Option<[f64; 2]>> {
    let intervals = method.outcomes.iter().map(|(property, outcomes)| {
        let interval = interval_over(outcomes.iter(), scoring, Reference::Training);
        let what = format!("the interval of R² of {property}");
        (property.clone(), notes.interval(&what, interval))
    });
    intervals.collect()
}

/// The interval of the mean R² over trials that have one.
pub(super) fn interval_over<'m, 'a: 'm>(
    outcomes: impl Iterator<Item = &'m Judged<'a>>,
    scoring: &Scoring<'_>,
    about: Reference,
) -> Result<ScoreInterval, IntervalError> {
    let defined = outcomes.filter(|judged| judged.has_r2());
    let scored = defined.map(|judged| judged.scored(about));
    let scored = scored.collect::<Result<Vec<Scored<'_>>, Undefined>>()?;
    scoring.intervals.interval(&scored)
}

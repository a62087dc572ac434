//! Scores of one method per property: a metric that `sps-metrics` computes becomes a key of
//! `results.json` here, and `report/tables.rs` shows it.

use serde::{Deserialize, Serialize};
use sps_metrics::{IntervalError, Outcome, ScoreInterval, Scored, Scores, Undefined, over_reruns};

use super::judged::{Judged, Reference};
use super::notes::Notes;
use super::{MethodOutcomes, Number, PerProperty, Scoring};

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
            let scores: Vec<Scores> = outcomes.iter().map(Judged::scores).collect();
            let mut summary = |what: &str, of: fn(&Scores) -> &Outcome| {
                let values = scores
                    .iter()
                    .map(|s| of(s).clone().map(|score| score.value));
                let mut summary = over_reruns(values);
                // Those have a note of their own.
                let failed = |rerun: usize| outcomes.get(rerun).is_some_and(Judged::is_empty);
                summary.left_out.retain(|&(rerun, _)| !failed(rerun));
                notes.reruns(&format!("{what} of {property}"), summary)
            };
            let r2 = summary("R²", |s| &s.r2);
            all.r2.insert(property.clone(), r2.mean.ok());
            all.r2_std.insert(property.clone(), r2.std.ok());
            let mut mean = |values: &mut PerProperty<Number>, what, of| {
                values.insert(property.clone(), summary(what, of).mean.ok());
            };
            mean(&mut all.r2_own_mean, "R² about own mean", |s| {
                &s.r2_own_mean
            });
            mean(&mut all.mae, "MAE", |s| &s.mae);
            let percent = &mut all.median_percent_error;
            if scoring.with_percentages.contains(property) {
                mean(percent, "median % error", |s| &s.median_percent_error);
            } else {
                percent.insert(property.clone(), None);
            }
            mean(&mut all.rmse, "RMSE", |s| &s.rmse);
            mean(&mut all.spearman, "Spearman", |s| &s.spearman);
            let deviation = scoring.deviations.get(property).filter(|std| **std > 0.0);
            let mae = all.mae[property].zip(deviation).map(|(mae, std)| mae / std);
            all.mae_over_std.insert(property.clone(), mae);
            let percent = scores.iter().flat_map(|s| &s.median_percent_error);
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

/// The interval of `r2` of each property.
pub(super) fn intervals(
    method: &MethodOutcomes<'_>,
    scoring: &Scoring<'_>,
    notes: &mut Notes,
) -> PerProperty<Option<[f64; 2]>> {
    let intervals = method.outcomes.iter().map(|(property, outcomes)| {
        let interval = interval_over(outcomes.iter().enumerate(), scoring, Reference::Training);
        let what = format!("the interval of R² of {property}");
        (property.clone(), notes.interval(&what, interval))
    });
    intervals.collect()
}

/// The interval of the mean R² over trials that have one, each with its rerun.
pub(super) fn interval_over<'m, 'a: 'm>(
    outcomes: impl Iterator<Item = (usize, &'m Judged<'a>)>,
    scoring: &Scoring<'_>,
    about: Reference,
) -> Result<ScoreInterval, IntervalError> {
    let defined: Vec<(usize, &Judged<'_>)> =
        outcomes.filter(|(_, judged)| judged.has_r2()).collect();
    let units: Vec<Vec<usize>> = defined.iter().map(|(_, o)| scoring.units_of(o)).collect();
    let scored = defined.iter().zip(&units);
    let scored = scored.map(|((rerun, judged), units)| judged.scored(about, units, *rerun));
    let scored = scored.collect::<Result<Vec<Scored<'_>>, Undefined>>()?;
    scoring.intervals.interval(&scored)
}

//! Means of one method over its properties.

use serde::{Deserialize, Serialize};
use sps_metrics::{
    Better, PropertyMean, PropertyScore, Undefined, mean_over_all, mean_over_best, mean_over_named,
};

use super::judged::Reference;
use super::notes::Notes;
use super::scores::{PropertyScores, interval_over};
use super::{Kind, MethodOutcomes, Number, PerProperty, Scoring};

/// Of one method.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct Means {
    /// Means over properties.
    pub r2_mean: Number,
    /// Of `r2_mean`, over units and reruns.
    pub r2_mean_interval: Option<[f64; 2]>,
    /// Of `r2_own_mean`; the interval where groups or materials are held out.
    pub r2_own_mean_mean: Number,
    /// Of `r2_own_mean_mean`, over units and reruns.
    pub r2_own_mean_mean_interval: Option<[f64; 2]>,
    /// Means something where the properties share a unit.
    pub mae_mean: Number,
    /// Mean absolute errors in standard deviations.
    pub mae_over_std_mean: Number,
    /// Of the rank correlations.
    pub spearman_mean: Number,
    /// Over the properties that have one.
    pub median_percent_error_mean: Number,
    /// Over the paper's fixed list of eight.
    pub median_percent_error_top8: Number,
    /// Over the eight properties with the least error in this run, and which they are.
    pub median_percent_error_best8: Number,
    /// Codes of those eight.
    pub best8: Vec<String>,
    /// How much the means differ from rerun to rerun.
    pub over_reruns: Ranges,
}

/// The lowest and the highest value of the reruns; `null` where a rerun has none.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct Ranges {
    pub r2_mean: Option<[f64; 2]>,
    pub mae_mean: Option<[f64; 2]>,
    pub median_percent_error_mean: Option<[f64; 2]>,
    pub median_percent_error_top8: Option<[f64; 2]>,
}

impl Means {
    pub(super) fn of(
        scores: &PropertyScores,
        method: &MethodOutcomes<'_>,
        scoring: &Scoring<'_>,
        notes: &mut Notes,
    ) -> Self {
        let mean = |values| mean_over_all(&listed(values, scoring.properties));
        let percent = listed(&scores.median_percent_error, scoring.with_percentages);
        let named = Some(scoring.top8).filter(|named| !named.is_empty());
        let best8 = named.map(|named| mean_over_best(&percent, named.len(), Better::Lower));
        let top8 = named.map(|named| mean_over_named(&percent, named));
        let of_percent = (!percent.is_empty()).then(|| mean_over_all(&percent));
        let mut whole = |what, mean: Option<PropertyMean>| notes.whole_mean(what, mean?);
        let median_percent_error_top8 = whole("top-8 median % error", top8);
        let names = best8.as_ref().map(|best| best.properties.clone());
        let median_percent_error_best8 = whole("best-8 median % error", best8);
        let r2_mean = notes.mean("mean R²", mean(&scores.r2));
        let interval = interval_over(method.trials(), scoring, Reference::Training);
        let own_interval = scoring.own_mean_interval.then(|| {
            let interval = interval_over(method.trials(), scoring, Reference::HeldOut);
            notes.interval("the interval of mean R² about own mean", interval)
        });
        Self {
            r2_mean,
            r2_mean_interval: notes.interval("the interval of mean R²", interval),
            r2_own_mean_mean: mean(&scores.r2_own_mean).value.ok(),
            r2_own_mean_mean_interval: own_interval.flatten(),
            mae_mean: notes.mean("mean MAE", mean(&scores.mae)),
            mae_over_std_mean: mean(&scores.mae_over_std).value.ok(),
            spearman_mean: mean(&scores.spearman).value.ok(),
            median_percent_error_mean: of_percent
                .and_then(|mean| notes.mean("mean median % error", mean)),
            median_percent_error_top8,
            best8: names.unwrap_or_default(),
            median_percent_error_best8,
            over_reruns: Ranges::of(method, scoring),
        }
    }
}

impl Ranges {
    fn of(method: &MethodOutcomes<'_>, scoring: &Scoring<'_>) -> Self {
        let range =
            |kind: Kind, properties: &[String], mean: &dyn Fn(&[PropertyScore]) -> PropertyMean| {
                let values = (0..method.row.reruns).map(|rerun| {
                    let outcomes = method.outcomes.iter();
                    let values = outcomes.filter_map(|(property, all)| {
                        let score = all.get(rerun)?.score(kind).ok();
                        Some((property.clone(), score.map(|score| score.value)))
                    });
                    let mean = mean(&listed(&values.collect(), properties));
                    mean.is_complete().then_some(mean.value.ok()).flatten()
                });
                let values = values.collect::<Option<Vec<f64>>>()?;
                let low = values.iter().copied().reduce(f64::min)?;
                Some([low, values.iter().copied().reduce(f64::max)?])
            };
        let top8 = |scores: &[PropertyScore]| mean_over_named(scores, scoring.top8);
        let (all, some) = (scoring.properties, scoring.with_percentages);
        Self {
            r2_mean: range(Kind::R2, all, &mean_over_all),
            mae_mean: range(Kind::Mae, all, &mean_over_all),
            median_percent_error_mean: range(Kind::MedianPercentError, some, &mean_over_all),
            median_percent_error_top8: range(Kind::MedianPercentError, some, &top8),
        }
    }
}

fn listed(values: &PerProperty<Number>, properties: &[String]) -> Vec<PropertyScore> {
    let of = |property: &String| {
        let value = values.get(property).copied().flatten();
        PropertyScore {
            property: property.clone(),
            value: value.ok_or(Undefined::NotScored),
        }
    };
    properties.iter().map(of).collect()
}

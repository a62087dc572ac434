//! From outcomes of trials to the numbers of one method.

use std::collections::{BTreeSet, HashSet};
use std::sync::OnceLock;

use sps_metrics::{IntervalError, Intervals, Side};

use super::notes::Notes;
use super::scores::intervals;
use super::{
    AdaptiveResult, Costs, Gains, GivenIntervals, Judged, Means, MethodResult, PerProperty,
    PropertyScores,
};
use crate::config::Adaptive;
use crate::journal::Outcome;

pub(crate) struct Scoring<'a> {
    /// Codes of the properties, in the order of the reports.
    pub properties: &'a [String],
    /// Those whose values have percentages, likewise.
    pub with_percentages: &'a [String],
    /// The standard deviation of each property's values over all surfaces.
    pub deviations: &'a PerProperty<f64>,
    /// Whether R² about the mean of the surfaces held out has an interval.
    pub own_mean_interval: bool,
    /// The paper's fixed list; empty for data that is not the paper's or simulated after it.
    pub top8: &'a [String],
    pub intervals: Intervals,
}

pub(crate) struct MethodOutcomes<'a> {
    /// What is known before anything is scored.
    pub row: MethodResult,
    pub adaptive: Option<Adaptive>,
    /// In the order of the reruns, for each property.
    pub outcomes: PerProperty<Vec<Judged<'a>>>,
    /// The R² of all that have one, once a gain has needed it.
    pub r2: OnceLock<Result<Side, IntervalError>>,
}

impl<'a> MethodOutcomes<'a> {
    /// Those of all properties.
    pub(super) fn trials(&self) -> impl Iterator<Item = &Judged<'a>> {
        self.outcomes.values().flatten()
    }

    /// What became of each fold of these.
    pub(super) fn all_folds(&self) -> impl Iterator<Item = &'a Outcome> {
        self.trials().flat_map(|judged| judged.folds)
    }
}

/// Scores one of `methods`; `against` are those that gains are counted from.
pub(crate) fn score(
    method: &MethodOutcomes<'_>,
    methods: &[MethodOutcomes<'_>],
    against: &[usize],
    scoring: &Scoring<'_>,
) -> MethodResult {
    let mut notes = Notes {
        lines: method.row.notes.clone(),
    };
    notes.failures(method);
    let mut scores = PropertyScores::of(method, scoring, &mut notes);
    let gains = Gains::of(method, methods, against, scoring, &mut notes);
    scores.r2_interval = intervals(method, scoring, &mut notes);
    // Most trials have the same.
    let surfaces: HashSet<&[usize]> = method.trials().map(Judged::surfaces).collect();
    let units: HashSet<&[usize]> = method.trials().map(Judged::units).collect();
    let [surfaces, units] =
        [surfaces, units].map(|lists| lists.into_iter().flatten().collect::<BTreeSet<_>>());
    let (mut selected_views, mut training_means) = (PerProperty::new(), PerProperty::new());
    for (property, outcomes) in &method.outcomes {
        let folds = outcomes.iter().flat_map(|judged| judged.folds);
        let means = folds.clone().map(|fold| fold.training_mean);
        training_means.insert(property.clone(), means.collect());
        let views = folds.map(|fold| fold.views.clone());
        selected_views.insert(property.clone(), views.collect());
    }
    MethodResult {
        held_out_surfaces: surfaces.len(),
        held_out_units: units.len(),
        means: Means::of(&scores, method, scoring, &mut notes),
        scores,
        gains,
        costs: Costs {
            train_seconds: method.all_folds().map(|fold| fold.train_seconds).sum(),
            ..method.row.costs
        },
        adaptive: AdaptiveResult::of(method),
        intervals: GivenIntervals::of(method, scoring),
        training_means,
        training_losses: training_losses(method),
        selected_views,
        notes: notes.lines,
        ..method.row.clone()
    }
}

/// The mean loss of each epoch, over the networks that were trained in it.
fn training_losses(method: &MethodOutcomes<'_>) -> Vec<f64> {
    let courses: Vec<&[f64]> = method.all_folds().map(|fold| &fold.course[..]).collect();
    let epochs = courses.iter().map(|course| course.len()).max().unwrap_or(0);
    let mean = |epoch: usize| {
        let losses = courses.iter().filter_map(|course| course.get(epoch));
        let losses: Vec<f64> = losses.copied().collect();
        losses.iter().sum::<f64>() / losses.len() as f64
    };
    (0..epochs).map(mean).collect()
}

#[cfg(test)]
mod tests {
    use sps_metrics::Level;

    use super::*;
    use crate::journal::TrialKey;

    const FAILED: &str = "the loss is inf in epoch 3";

    /// Of four surfaces, each estimate off by `error`; a failed one where there is none.
    fn outcome(rerun: usize, error: Option<f64>) -> Outcome {
        let failed = error.is_none().then(|| FAILED.to_owned());
        let surfaces = error.map(|_| ["a", "b", "c", "d"].map(str::to_owned).to_vec());
        let truth = error.map(|_| vec![1.0, 2.0, 3.0, 6.0]).unwrap_or_default();
        let estimate = truth.iter().map(|truth| truth + error.unwrap_or(0.0));
        Outcome {
            key: TrialKey(rerun.to_string()),
            method: "one".to_owned(),
            property: "fRS".to_owned(),
            rerun,
            training_mean: 3.0,
            surfaces: surfaces.unwrap_or_default(),
            estimate: estimate.collect(),
            truth,
            views: vec![0],
            train_seconds: 1.0,
            failed,
            ..Outcome::default()
        }
    }

    fn method<'a>(id: &str, outcomes: &'a [Outcome], of_rerun: usize) -> MethodOutcomes<'a> {
        let numbers = ["a", "b", "c", "d"]
            .into_iter()
            .zip((0..).map(|at| [at; 2]));
        let numbers = numbers.collect();
        let reruns = outcomes.chunks(of_rerun).enumerate();
        let judged = reruns.map(|(rerun, folds)| Judged::of(rerun, folds, &numbers));
        let judged: Vec<Judged<'_>> = judged.collect();
        MethodOutcomes {
            row: MethodResult {
                id: id.to_owned(),
                label: id.to_owned(),
                reruns: judged.len(),
                ..MethodResult::default()
            },
            adaptive: None,
            outcomes: PerProperty::from([("fRS".to_owned(), judged)]),
            r2: OnceLock::new(),
        }
    }

    fn scored(methods: &[MethodOutcomes<'_>]) -> Vec<MethodResult> {
        let properties = ["fRS".to_owned()];
        let deviations = PerProperty::from([("fRS".to_owned(), 2.0)]);
        let scoring = Scoring {
            properties: &properties,
            with_percentages: &properties,
            deviations: &deviations,
            own_mean_interval: true,
            top8: &[],
            intervals: Intervals::of_training(Level::P95),
        };
        let score = |method| score(method, methods, &[0], &scoring);
        methods.iter().map(score).collect()
    }

    /// About the training mean 3 the truths have the sum of squares 4 + 1 + 0 + 9 = 14; an error of
    /// 0.5 on each of four leaves 1.
    const R2: f64 = 1.0 - 1.0 / 14.0;

    #[test]
    fn losses_of_training_are_means_over_the_networks_that_reached_an_epoch() {
        let with = |rerun, course| Outcome {
            course,
            ..outcome(rerun, Some(0.5))
        };
        let outcomes = [with(0, vec![1.0, 0.5]), with(1, vec![3.0])];
        let none = [with(0, Vec::new())];
        let rows = scored(&[method("network", &outcomes, 1), method("ridge", &none, 1)]);
        assert_eq!(rows[0].training_losses, [2.0, 0.5]);
        assert!(rows[1].training_losses.is_empty());
    }

    #[test]
    fn a_failed_rerun_is_left_out_with_its_reason() {
        let baseline = [outcome(0, Some(1.0)), outcome(1, Some(1.0))];
        let some = [outcome(0, None), outcome(1, Some(0.5))];
        let all = scored(&[method("zero", &baseline, 1), method("one", &some, 1)]);
        let row = &all[1];
        assert_eq!(row.reruns, 2);
        assert!((row.scores.r2["fRS"].unwrap() - R2).abs() < 1e-12);
        assert_eq!(row.scores.mae["fRS"], Some(0.5));
        assert_eq!(row.scores.mae_over_std["fRS"], Some(0.25));
        assert_eq!(row.means.spearman_mean, Some(1.0));
        assert_eq!(row.scores.r2_interval["fRS"], None);
        let mut notes = row.notes.iter();
        let one = "no intervals: reruns: 1";
        assert!(notes.any(|note| note.starts_with(one)), "{:?}", row.notes);
        assert_eq!(row.means.over_reruns.r2_mean, None);
        // Paired with the baseline's second rerun, which leaves 4 of 14.
        let gain = row.gains.r2_mean_gains["zero"].value;
        assert!((gain - 3.0 / 14.0).abs() < 1e-12, "{gain}");
        let left_out = format!("fRS, rerun 0, left out: {FAILED}");
        let left_out = row.notes.iter().filter(|note| **note == left_out);
        assert_eq!(left_out.count(), 1);
        assert!(!row.notes.iter().any(|note| note.contains("no samples")));
    }

    #[test]
    fn a_failed_fold_leaves_the_others_of_its_rerun() {
        let some = [outcome(0, Some(0.5)), outcome(1, None)];
        let row = &scored(&[method("one", &some, 2)])[0];
        assert!((row.scores.r2["fRS"].unwrap() - R2).abs() < 1e-12);
        assert_eq!(row.selected_views["fRS"], [[0], [0]]);
        let left_out = row.notes.iter().filter(|note| note.contains("left out"));
        assert_eq!(left_out.count(), 1, "{:?}", row.notes);
    }

    #[test]
    fn reruns_have_an_interval_together() {
        let some = [outcome(0, Some(0.5)), outcome(1, Some(0.6))];
        let row = &scored(&[method("one", &some, 1)])[0];
        let [low, high] = row.scores.r2_interval["fRS"].unwrap();
        let r2 = row.scores.r2["fRS"].unwrap();
        assert!(low < r2 && r2 < high && high < 1.0, "{low} {high}");
        assert_eq!(row.means.r2_mean_interval, Some([low, high]));
    }

    #[test]
    fn a_method_that_always_fails_has_a_row_without_numbers() {
        let baseline = [outcome(0, Some(1.0))];
        let none = [outcome(0, None)];
        for failing in [0, 1] {
            let mut methods = [method("one", &none, 1), method("zero", &baseline, 1)];
            methods.rotate_left(failing);
            let all = scored(&methods);
            let row = &all[failing];
            assert_eq!((row.scores.r2["fRS"], row.means.r2_mean), (None, None));
            assert_eq!(row.held_out_surfaces, 0);
            assert!(row.notes.iter().any(|note| note.contains("inf in epoch 3")));
            assert!(all[1 - failing].means.r2_mean.is_some());
        }
    }
}

//! From outcomes of trials to the numbers of one method.

use std::collections::{BTreeMap, BTreeSet, HashMap};

use sps_metrics::{
    Better, Bootstrap, BootstrapError, BootstrapInterval, Compared, PropertyScore, Scored, Scores,
    Undefined, mean_over_all, mean_over_best, mean_over_named, over_reruns,
};

use super::judged::Judged;
use super::notes::Notes;
use super::{
    AdaptiveResult, Costs, Gain, MethodResult, Number, PerProperty, SelectionResult, ranges,
};
use crate::config::Adaptive;

/// How outcomes are scored.
pub(crate) struct Scoring<'a> {
    /// Codes of the properties, in the order of the reports.
    pub properties: &'a [String],
    /// The unit of each surface, by the surface's name: what a resample keeps together.
    pub units: &'a HashMap<String, usize>,
    /// The paper's fixed list.
    pub top8: &'a [String],
    pub bootstrap: Bootstrap,
}

/// The outcomes of one method.
pub(crate) struct MethodOutcomes<'a> {
    pub id: &'a str,
    pub label: &'a str,
    /// As the config names it.
    pub kind: &'a str,
    /// In words.
    pub encoder: String,
    pub precision: String,
    pub adaptive: Option<Adaptive>,
    pub paper: Option<&'a str>,
    pub reruns: usize,
    /// That a rerun trains on, on average.
    pub training_surfaces: usize,
    /// In the order of the reruns, for each property.
    pub outcomes: PerProperty<Vec<Judged<'a>>>,
    pub costs: Costs,
    pub selections: PerProperty<Vec<SelectionResult>>,
}

/// Scores one of `methods`; `against` are those that gains are counted from.
pub(crate) fn score(
    method: &MethodOutcomes<'_>,
    methods: &[MethodOutcomes<'_>],
    against: &[usize],
    scoring: &Scoring<'_>,
) -> MethodResult {
    let mut notes = Notes::default();
    notes.failures(method);
    let scored = PropertyTables::of(method, &mut notes);
    let mut over = |at: usize| {
        let other = methods.get(at)?;
        Some((
            other.id.to_owned(),
            gain(method, other, scoring, &mut notes)?,
        ))
    };
    let gains: BTreeMap<String, Gain> = against.iter().filter_map(|&at| over(at)).collect();
    let first = methods.first().and_then(|first| gains.get(first.id));
    let first = match first {
        Some(gain) => Some(*gain),
        // One that has failed has its note already.
        None if against.contains(&0) => None,
        None => over(0).map(|(_, gain)| gain),
    };
    let mean = |values: &PerProperty<Number>, what: &str, notes: &mut Notes| {
        notes.mean(what, mean_over_all(&listed(values, scoring.properties)))
    };
    let percent = listed(&scored.median_percent_error, scoring.properties);
    let top8 = mean_over_named(&percent, scoring.top8);
    let best8 = mean_over_best(&percent, scoring.top8.len(), Better::Lower);
    let (held_out_surfaces, held_out_units) = held_out(method, scoring);
    MethodResult {
        id: method.id.to_owned(),
        label: method.label.to_owned(),
        kind: method.kind.to_owned(),
        encoder: method.encoder.clone(),
        precision: method.precision.clone(),
        over_reruns: ranges::over_reruns(method, scoring),
        adaptive: method
            .adaptive
            .and_then(|asked| AdaptiveResult::of(method, asked)),
        reruns: method.reruns,
        training_surfaces: method.training_surfaces,
        held_out_surfaces,
        held_out_units,
        r2_interval: intervals(method, scoring, &mut notes),
        r2_mean: mean(&scored.r2, "mean R²", &mut notes),
        r2_mean_interval: mean_interval(method, scoring, &mut notes),
        mae_mean: mean(&scored.mae, "mean MAE", &mut notes),
        median_percent_error_mean: mean(
            &scored.median_percent_error,
            "mean median % error",
            &mut notes,
        ),
        median_percent_error_top8: notes.whole_mean("top-8 median % error", top8),
        best8: best8.properties.clone(),
        median_percent_error_best8: notes.whole_mean("best-8 median % error", best8),
        r2_mean_gain: first,
        r2_mean_gains: gains,
        paper: method.paper.map(str::to_owned),
        frames_decoded_per_surface: method.costs.frames_decoded,
        frames_encoded_per_surface: method.costs.frames_encoded,
        predict_seconds_per_surface: method.costs.seconds,
        decode_seconds_per_surface: method.costs.decode_seconds,
        encode_seconds_per_surface: method.costs.encode_seconds,
        head_seconds_per_surface: method.costs.head_seconds,
        peak_memory_bytes: method.costs.peak_memory_bytes,
        multiply_adds_per_surface: method.costs.multiply_adds,
        encoder_train_seconds: method.costs.encoder_train_seconds,
        train_seconds: trials(method).map(Judged::train_seconds).sum(),
        selected_views: method
            .outcomes
            .iter()
            .map(|(property, outcomes)| {
                let views = outcomes.iter().flat_map(Judged::views);
                (property.clone(), views.collect())
            })
            .collect(),
        selections: method.selections.clone(),
        r2: scored.r2,
        r2_std: scored.r2_std,
        mae: scored.mae,
        median_percent_error: scored.median_percent_error,
        rmse: scored.rmse,
        spearman: scored.spearman,
        zero_truths: scored.zero_truths,
        notes: notes.lines,
    }
}

pub(super) fn trials<'m, 'a>(
    method: &'m MethodOutcomes<'a>,
) -> impl Iterator<Item = &'m Judged<'a>> {
    method.outcomes.values().flatten()
}

/// Means over reruns, per property.
#[derive(Default)]
struct PropertyTables {
    r2: PerProperty<Number>,
    r2_std: PerProperty<Number>,
    mae: PerProperty<Number>,
    median_percent_error: PerProperty<Number>,
    rmse: PerProperty<Number>,
    spearman: PerProperty<Number>,
    zero_truths: PerProperty<usize>,
}

impl PropertyTables {
    fn of(method: &MethodOutcomes<'_>, notes: &mut Notes) -> Self {
        let mut tables = Self::default();
        for (property, outcomes) in &method.outcomes {
            let scores: Vec<Scores> = outcomes.iter().map(Judged::scores).collect();
            let mut summary = |what: &str, of: &dyn Fn(&Scores) -> sps_metrics::Outcome| {
                let values = scores.iter().map(|s| of(s).map(|score| score.value));
                let mut summary = over_reruns(values);
                // Those have a note of their own.
                let failed = |rerun: usize| outcomes.get(rerun).is_some_and(Judged::is_empty);
                summary.left_out.retain(|&(rerun, _)| !failed(rerun));
                notes.reruns(&format!("{what} of {property}"), summary)
            };
            let r2 = summary("R²", &|s| s.r2.clone());
            let mae = summary("MAE", &|s| s.mae.clone());
            let percent = summary("median % error", &|s| s.median_percent_error.clone());
            let rmse = summary("RMSE", &|s| s.rmse.clone());
            let spearman = summary("Spearman", &|s| s.spearman.clone());
            let zeros = scores
                .iter()
                .filter_map(|s| s.median_percent_error.as_ref().ok())
                .map(|score| score.zero_truths)
                .sum();
            tables.r2_std.insert(property.clone(), r2.std.ok());
            tables.r2.insert(property.clone(), r2.mean.ok());
            tables.mae.insert(property.clone(), mae.mean.ok());
            tables
                .median_percent_error
                .insert(property.clone(), percent.mean.ok());
            tables.rmse.insert(property.clone(), rmse.mean.ok());
            tables.spearman.insert(property.clone(), spearman.mean.ok());
            tables.zero_truths.insert(property.clone(), zeros);
        }
        tables
    }
}

pub(super) fn listed(values: &PerProperty<Number>, properties: &[String]) -> Vec<PropertyScore> {
    let of = |property: &String| PropertyScore {
        property: property.clone(),
        value: values
            .get(property)
            .copied()
            .flatten()
            .ok_or(Undefined::NotScored),
    };
    properties.iter().map(of).collect()
}

fn intervals(
    method: &MethodOutcomes<'_>,
    scoring: &Scoring<'_>,
    notes: &mut Notes,
) -> PerProperty<Option<[f64; 2]>> {
    let intervals = method.outcomes.iter().map(|(property, outcomes)| {
        let interval = interval_over(outcomes.iter(), scoring);
        let what = format!("the interval of R² of {property}");
        (property.clone(), notes.interval(&what, interval))
    });
    intervals.collect()
}

fn mean_interval(
    method: &MethodOutcomes<'_>,
    scoring: &Scoring<'_>,
    notes: &mut Notes,
) -> Option<[f64; 2]> {
    let interval = interval_over(trials(method), scoring);
    notes.interval("the interval of mean R²", interval)
}

/// The interval of the mean R² over trials that have one.
fn interval_over<'m, 'a: 'm>(
    outcomes: impl Iterator<Item = &'m Judged<'a>>,
    scoring: &Scoring<'_>,
) -> Result<BootstrapInterval, BootstrapError> {
    let defined: Vec<&Judged<'_>> = outcomes.filter(|judged| judged.has_r2()).collect();
    let units: Vec<Vec<usize>> = defined.iter().map(|o| o.units(scoring.units)).collect();
    let scored = defined.iter().zip(&units).map(|(judged, units)| {
        Ok(Scored {
            metric: judged.r2_metric()?,
            samples: judged.r2_samples(),
            units: Some(units),
        })
    });
    let scored = scored.collect::<Result<Vec<_>, Undefined>>()?;
    scoring.bootstrap.mean_interval(&scored)
}

/// The gain over `first` on the surfaces that both were scored on.
fn gain(
    method: &MethodOutcomes<'_>,
    first: &MethodOutcomes<'_>,
    scoring: &Scoring<'_>,
    notes: &mut Notes,
) -> Option<Gain> {
    if method.id == first.id {
        return None;
    }
    let pairs: Vec<(Judged<'_>, Judged<'_>)> = method
        .outcomes
        .iter()
        .filter_map(|(property, mine)| Some((mine, first.outcomes.get(property)?)))
        .flat_map(|(mine, theirs)| mine.iter().zip(theirs))
        .map(|(mine, theirs)| mine.common(theirs))
        .filter(|(mine, theirs)| mine.has_r2() && !theirs.is_empty())
        .collect();
    let units: Vec<Vec<usize>> = pairs.iter().map(|(o, _)| o.units(scoring.units)).collect();
    let compared = pairs.iter().zip(&units).map(|((mine, theirs), units)| {
        let (mine_samples, theirs_samples) = (mine.r2_samples(), theirs.r2_samples());
        Ok(Compared {
            metric: mine.r2_metric()?,
            truth: mine_samples.truth,
            first: mine_samples.estimate,
            second: theirs_samples.estimate,
            units: Some(units),
        })
    });
    let difference = compared
        .collect::<Result<Vec<_>, Undefined>>()
        .map_err(BootstrapError::from)
        .and_then(|compared| scoring.bootstrap.mean_difference(&compared));
    match difference {
        Ok(found) => Some(Gain {
            value: found.estimate,
            interval: [found.low, found.high],
        }),
        Err(reason) => {
            notes.add(&format!("gain over {}", first.label), &reason);
            None
        }
    }
}

/// How many different surfaces a method was scored on, and units of them.
fn held_out(method: &MethodOutcomes<'_>, scoring: &Scoring<'_>) -> (usize, usize) {
    let surfaces = trials(method).flat_map(|judged| judged.surfaces().iter());
    let surfaces: BTreeSet<&String> = surfaces.collect();
    let units = surfaces.iter().filter_map(|name| scoring.units.get(*name));
    (surfaces.len(), units.collect::<BTreeSet<_>>().len())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::journal::{Outcome, TrialKey};

    /// Of four surfaces, each estimate off by `error`; a failed one where there is none.
    fn outcome(rerun: usize, error: Option<f64>) -> Outcome {
        let truth = vec![1.0, 2.0, 3.0, 6.0];
        let estimated = error.is_some();
        let some = |values: Vec<f64>| if estimated { values } else { Vec::new() };
        let estimate = truth.iter().map(|truth| truth + error.unwrap_or(0.0));
        let names = ["a", "b", "c", "d"].map(str::to_owned).to_vec();
        Outcome {
            key: TrialKey(rerun.to_string()),
            method: "one".to_owned(),
            property: "fRS".to_owned(),
            rerun,
            training_mean: 3.0,
            surfaces: if estimated { names } else { Vec::new() },
            estimate: some(estimate.collect()),
            truth: some(truth),
            views: vec![0],
            stops: Vec::new(),
            train_seconds: 1.0,
            failed: error
                .is_none()
                .then(|| "the loss is inf in epoch 3".to_owned()),
        }
    }

    fn method<'a>(id: &'a str, outcomes: &'a [Outcome], of_rerun: usize) -> MethodOutcomes<'a> {
        let outcomes: Vec<&Outcome> = outcomes.iter().collect();
        let reruns = outcomes.chunks(of_rerun).filter_map(Judged::of);
        let judged: Vec<Judged<'_>> = reruns.collect();
        MethodOutcomes {
            id,
            label: id,
            kind: "head",
            encoder: String::new(),
            precision: String::new(),
            adaptive: None,
            paper: None,
            reruns: judged.len(),
            training_surfaces: 0,
            outcomes: PerProperty::from([("fRS".to_owned(), judged)]),
            costs: Costs::default(),
            selections: PerProperty::new(),
        }
    }

    fn scored(methods: &[MethodOutcomes<'_>]) -> Vec<MethodResult> {
        let names = ["a", "b", "c", "d"].iter().zip(0..);
        let units = names.map(|(name, at)| ((*name).to_owned(), at)).collect();
        let properties = ["fRS".to_owned()];
        let scoring = Scoring {
            properties: &properties,
            units: &units,
            top8: &[],
            bootstrap: Bootstrap::new(0).with_resamples(50),
        };
        let score = |method| score(method, methods, &[0], &scoring);
        methods.iter().map(score).collect()
    }

    /// About the training mean 3 the truths have the sum of squares 4 + 1 + 0 + 9 = 14; an error of
    /// 0.5 on each of four leaves 1.
    const R2: f64 = 1.0 - 1.0 / 14.0;

    #[test]
    fn a_failed_rerun_is_left_out_with_its_reason() {
        let baseline = [outcome(0, Some(1.0)), outcome(1, Some(1.0))];
        let some = [outcome(0, None), outcome(1, Some(0.5))];
        let all = scored(&[method("zero", &baseline, 1), method("one", &some, 1)]);
        let row = &all[1];
        assert_eq!(row.reruns, 2);
        assert!((row.r2["fRS"].unwrap() - R2).abs() < 1e-12);
        assert_eq!(row.mae["fRS"], Some(0.5));
        assert!(row.r2_interval["fRS"].is_some());
        assert_eq!(row.over_reruns.r2_mean, None);
        // Paired with the baseline's second rerun, which leaves 4 of 14.
        let gain = row.r2_mean_gains["zero"].value;
        assert!((gain - 3.0 / 14.0).abs() < 1e-12, "{gain}");
        let left_out = "fRS, rerun 0, left out: the loss is inf in epoch 3";
        assert_eq!(row.notes.iter().filter(|note| *note == left_out).count(), 1);
        assert!(!row.notes.iter().any(|note| note.contains("no samples")));
    }

    #[test]
    fn a_failed_fold_leaves_the_others_of_its_rerun() {
        let some = [outcome(0, Some(0.5)), outcome(1, None)];
        let row = &scored(&[method("one", &some, 2)])[0];
        assert!((row.r2["fRS"].unwrap() - R2).abs() < 1e-12);
        assert_eq!(row.selected_views["fRS"], [[0], [0]]);
        let left_out = row.notes.iter().filter(|note| note.contains("left out"));
        assert_eq!(left_out.count(), 1, "{:?}", row.notes);
    }

    #[test]
    fn a_method_that_always_fails_has_a_row_without_numbers() {
        let baseline = [outcome(0, Some(1.0))];
        let none = [outcome(0, None)];
        for (at, methods) in [
            [method("zero", &baseline, 1), method("one", &none, 1)],
            [method("one", &none, 1), method("zero", &baseline, 1)],
        ]
        .iter()
        .enumerate()
        {
            let all = scored(methods);
            let row = &all[1 - at];
            assert_eq!(
                (row.r2["fRS"], row.r2_mean, row.held_out_surfaces),
                (None, None, 0)
            );
            assert!(row.notes.iter().any(|note| note.contains("inf in epoch 3")));
            assert!(all[at].r2_mean.is_some());
        }
    }
}

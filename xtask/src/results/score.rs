//! From outcomes of trials to the numbers of one method.

use std::collections::BTreeMap;

use sps_metrics::{
    Better, Bootstrap, BootstrapError, BootstrapInterval, Compared, Metric, PropertyMean,
    PropertyScore, RerunSummary, Samples, Scored, Scores, TrainingMean, Undefined, mean_over_all,
    mean_over_best, mean_over_named, over_reruns,
};

use super::{
    AdaptiveResult, Costs, Gain, MethodResult, Number, PerProperty, SelectionResult, ranges,
};
use crate::config::Adaptive;
use crate::journal::Outcome;

/// How outcomes are scored.
pub(crate) struct Scoring<'a> {
    /// Codes of the properties, in the order of the reports.
    pub properties: &'a [String],
    /// The paper's fixed list.
    pub top8: &'a [String],
    pub bootstrap: Bootstrap,
}

/// The outcomes of one method.
pub(crate) struct MethodOutcomes<'a> {
    pub id: &'a str,
    pub label: &'a str,
    /// `head` or `ridge`.
    pub kind: &'a str,
    /// In words.
    pub encoder: String,
    pub adaptive: Option<Adaptive>,
    pub paper: Option<&'a str>,
    pub reruns: usize,
    /// In the order of the reruns, for each property.
    pub outcomes: PerProperty<Vec<&'a Outcome>>,
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
    let scored = PropertyTables::of(method, &mut notes);
    let mut over = |at: usize| {
        let other = methods.get(at)?;
        Some((
            other.id.to_owned(),
            gain(method, other, scoring, &mut notes)?,
        ))
    };
    let first = over(0).map(|(_, gain)| gain);
    let gains = against.iter().filter_map(|&at| over(at)).collect();
    let mean = |values: &PerProperty<Number>, what: &str, notes: &mut Notes| {
        notes.mean(what, mean_over_all(&listed(values, scoring.properties)))
    };
    let percent = listed(&scored.median_percent_error, scoring.properties);
    let top8 = mean_over_named(&percent, scoring.top8);
    let best8 = mean_over_best(&percent, scoring.top8.len(), Better::Lower);
    MethodResult {
        id: method.id.to_owned(),
        label: method.label.to_owned(),
        kind: method.kind.to_owned(),
        encoder: method.encoder.clone(),
        over_reruns: ranges::over_reruns(method, scoring),
        adaptive: method
            .adaptive
            .and_then(|asked| AdaptiveResult::of(method, asked)),
        reruns: method.reruns,
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
        train_seconds: trials(method).map(|outcome| outcome.train_seconds).sum(),
        selected_views: method
            .outcomes
            .iter()
            .map(|(property, outcomes)| {
                let views = outcomes.iter().map(|outcome| outcome.views.clone());
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

pub(super) fn trials<'a>(method: &MethodOutcomes<'a>) -> impl Iterator<Item = &'a Outcome> {
    method.outcomes.values().flatten().copied()
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
            let scores: Vec<Scores> = outcomes.iter().map(|outcome| scores(outcome)).collect();
            let mut summary = |what: &str, of: &dyn Fn(&Scores) -> sps_metrics::Outcome| {
                let values = scores.iter().map(|s| of(s).map(|score| score.value));
                notes.reruns(&format!("{what} of {property}"), over_reruns(values))
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

pub(super) fn scores(outcome: &Outcome) -> Scores {
    Scores::of(samples(outcome), TrainingMean::new(outcome.training_mean))
}

fn samples(outcome: &Outcome) -> Samples<'_> {
    Samples {
        truth: &outcome.truth,
        estimate: &outcome.estimate,
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

/// Numbers for the surfaces' names: equal names are one surface in the bootstrap.
struct SurfaceNumbers(BTreeMap<String, usize>);

impl SurfaceNumbers {
    fn new<'a>(outcomes: impl Iterator<Item = &'a Outcome>) -> Self {
        let mut numbers = BTreeMap::new();
        for surface in outcomes.flat_map(|outcome| &outcome.surfaces) {
            let next = numbers.len();
            numbers.entry(surface.clone()).or_insert(next);
        }
        Self(numbers)
    }

    fn of(&self, outcome: &Outcome) -> Vec<usize> {
        outcome.surfaces.iter().map(|name| self.0[name]).collect()
    }
}

fn intervals(
    method: &MethodOutcomes<'_>,
    scoring: &Scoring<'_>,
    notes: &mut Notes,
) -> PerProperty<Option<[f64; 2]>> {
    let intervals = method.outcomes.iter().map(|(property, outcomes)| {
        let interval = interval_over(outcomes.iter().copied(), scoring);
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
fn interval_over<'a>(
    outcomes: impl Iterator<Item = &'a Outcome>,
    scoring: &Scoring<'_>,
) -> Result<BootstrapInterval, BootstrapError> {
    let defined: Vec<&Outcome> = outcomes
        .filter(|outcome| scores(outcome).r2.is_ok())
        .collect();
    let numbers = SurfaceNumbers::new(defined.iter().copied());
    let surfaces: Vec<Vec<usize>> = defined.iter().map(|o| numbers.of(o)).collect();
    let scored = defined.iter().zip(&surfaces).map(|(outcome, surfaces)| {
        Ok(Scored {
            metric: Metric::R2(TrainingMean::new(outcome.training_mean)?),
            samples: samples(outcome),
            units: Some(surfaces),
        })
    });
    let scored = scored.collect::<Result<Vec<_>, Undefined>>()?;
    scoring.bootstrap.mean_interval(&scored)
}

/// The gain over `first` on the trials that both have on the same surfaces.
fn gain(
    method: &MethodOutcomes<'_>,
    first: &MethodOutcomes<'_>,
    scoring: &Scoring<'_>,
    notes: &mut Notes,
) -> Option<Gain> {
    if method.id == first.id {
        return None;
    }
    let pairs: Vec<(&Outcome, &Outcome)> = method
        .outcomes
        .iter()
        .filter_map(|(property, mine)| Some((mine, first.outcomes.get(property)?)))
        .flat_map(|(mine, theirs)| mine.iter().copied().zip(theirs.iter().copied()))
        .filter(|(mine, theirs)| mine.surfaces == theirs.surfaces && scores(mine).r2.is_ok())
        .collect();
    let numbers = SurfaceNumbers::new(pairs.iter().map(|(mine, _)| *mine));
    let surfaces: Vec<Vec<usize>> = pairs.iter().map(|(mine, _)| numbers.of(mine)).collect();
    let compared = pairs
        .iter()
        .zip(&surfaces)
        .map(|((mine, theirs), surfaces)| {
            Ok(Compared {
                metric: Metric::R2(TrainingMean::new(mine.training_mean)?),
                truth: &mine.truth,
                first: &mine.estimate,
                second: &theirs.estimate,
                units: Some(surfaces),
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

/// Why values are missing.
#[derive(Default)]
struct Notes {
    lines: Vec<String>,
}

impl Notes {
    fn add(&mut self, what: &str, reason: &dyn std::fmt::Display) {
        self.lines.push(format!("{what}: {reason}"));
    }

    fn reruns(&mut self, what: &str, summary: RerunSummary) -> RerunSummary {
        for (rerun, reason) in &summary.left_out {
            self.add(&format!("{what}, rerun {rerun}"), reason);
        }
        summary
    }

    fn mean(&mut self, what: &str, mean: PropertyMean) -> Number {
        for (property, reason) in &mean.left_out {
            self.add(&format!("{what}, without {property}"), reason);
        }
        mean.value.ok()
    }

    /// A mean that says nothing unless every property is in it.
    fn whole_mean(&mut self, what: &str, mean: PropertyMean) -> Number {
        if mean.is_complete() {
            return self.mean(what, mean);
        }
        let found = mean.properties.len();
        let reason = format!("needs {} properties, {found} have a score", mean.wanted);
        self.add(what, &reason);
        None
    }

    fn interval(
        &mut self,
        what: &str,
        interval: Result<BootstrapInterval, BootstrapError>,
    ) -> Option<[f64; 2]> {
        match interval {
            Ok(interval) => Some([interval.low, interval.high]),
            Err(reason) => {
                self.add(what, &reason);
                None
            }
        }
    }
}

//! From embeddings to estimates with intervals.

use std::ops::Range;

use serde::{Deserialize, Serialize};
use sps_dataset::Unit;
use sps_metrics::{Level, PredictionInterval};
use sps_regress::{Embeddings, FittedRegressor, Standardiser};

use crate::error::{Error, Result};
use crate::novelty::Familiar;
use crate::radius::level_of_each;
use crate::recipe::Wanted;

/// A fitted model without its encoder.
pub struct Fitted {
    pub(crate) measures: Vec<Measure>,
    /// By ascending number of views; one alone unless views may be looked at one by one.
    pub(crate) stages: Vec<Stage>,
    /// What photographs are held against, or why there is nothing.
    pub(crate) familiar: Result<Familiar, String>,
    pub(crate) level: Level,
    /// How wide intervals are that hold for all properties at once.
    pub(crate) joint: Interval,
    pub(crate) on: FittedOn,
    /// Of an embedding.
    pub(crate) width: usize,
}

/// How many surfaces a model was fitted on, those that calibrate its intervals among them.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub struct FittedOn {
    /// Surfaces.
    pub surfaces: usize,
    /// Units that they are of.
    pub units: usize,
    /// What a unit is: intervals speak of a new one.
    pub unit: Unit,
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub(crate) struct Measure {
    pub property: String,
    /// The lowest value that it can have, where that is known.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub lowest: Option<f64>,
    /// The highest.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub highest: Option<f64>,
    /// The standard deviation of the readings that were fitted; 1 where they do not differ.
    pub deviation: f64,
    pub interval: Interval,
    /// How wide the interval of each of two photographs is whose mean is asked for, of three, and so on,
    /// in expected errors; none where photographs are not averaged.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub several: Option<Vec<f64>>,
}

/// How wide intervals are.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum Interval {
    /// Half as wide as so many times the error expected.
    Errors(f64),
    /// There is none, and why.
    None(String),
}

impl Measure {
    /// Of a property with these readings; its intervals are not calibrated yet.
    pub(crate) fn of(wanted: &Wanted, readings: &[f64]) -> Self {
        let end = |at: usize| {
            let end = wanted.range?[at];
            end.is_finite().then_some(end)
        };
        Self {
            property: wanted.property.clone(),
            lowest: end(0),
            highest: end(1),
            deviation: deviation(readings),
            interval: Interval::None("not calibrated".to_owned()),
            several: None,
        }
    }

    fn bounded(&self, value: f64) -> f64 {
        let value = self.lowest.map_or(value, |lowest| value.max(lowest));
        self.highest.map_or(value, |highest| value.min(highest))
    }

    /// Half the width, in expected errors, of the intervals of so many photographs that hold at once at
    /// the level; a reason where there are none.
    fn times(&self, photographs: usize, level: Level) -> Result<f64, String> {
        let one = match &self.interval {
            Interval::None(reason) => return Err(reason.clone()),
            Interval::Errors(times) => *times,
        };
        let Some(more) = photographs.checked_sub(2) else {
            return Ok(one);
        };
        let several = self.several.as_deref().unwrap_or_default();
        several.get(more).copied().ok_or_else(|| {
            let of_each = 100.0 * level_of_each(level, photographs);
            format!(
                "found {photographs} photographs, calibrated for the mean of at most {}: the interval of \
                each would have to hold at {of_each:.1} %",
                several.len() + 1
            )
        })
    }

    /// Estimates of photographs, with intervals half as wide as so many `times` the expected error.
    /// `values` are the estimates where they are not those that intervals lie around; one outside of the
    /// interval that it has by itself becomes the nearer end of it.
    fn predicted(
        &self,
        expected: &[Expected],
        values: Option<Vec<f64>>,
        (times, level): (Result<f64, String>, Level),
    ) -> Predicted {
        let intervals = |times: Result<f64, String>| {
            let times = times?;
            // Beyond the range, around its end: cut to nothing, an interval would claim to be certain.
            let around = |expected: &Expected| {
                let (value, half) = (self.bounded(expected.value), times * expected.error);
                PredictionInterval {
                    low: self.bounded(value - half),
                    high: self.bounded(value + half),
                }
            };
            Ok(expected.iter().map(around).collect::<Vec<_>>())
        };
        let values = values.unwrap_or_else(|| expected.iter().map(|one| one.value).collect());
        let values = values.into_iter().map(|value| self.bounded(value));
        let mut values: Vec<f64> = values.collect();
        if let Ok(intervals) = intervals(self.times(1, level)) {
            for (value, interval) in values.iter_mut().zip(intervals) {
                *value = value.max(interval.low).min(interval.high);
            }
        }
        Predicted {
            property: self.property.clone(),
            values,
            intervals: intervals(times),
        }
    }
}

/// What looks at so many views: fitted models, or what a file says in their place.
#[derive(Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub(crate) struct Stage<M = Box<dyn FittedRegressor>> {
    pub views: usize,
    pub groups: Vec<Group<M>>,
}

/// Properties that look at the same views.
#[derive(Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub(crate) struct Group<M = Box<dyn FittedRegressor>> {
    /// Their places.
    pub properties: Vec<usize>,
    /// The views, by their places among those that are asked with.
    pub slots: Vec<usize>,
    /// One for each property, in their order.
    pub models: M,
    /// Of their errors; none where all are alike.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub errors: Option<M>,
    /// What gives values where `models` learned from a part of the surfaces: the same regression, fitted
    /// to all of them. Intervals are those of `models`, which have not seen the surfaces that calibrate.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub whole: Option<M>,
    /// What each expected error is at least.
    pub least_errors: Vec<f64>,
}

/// An estimate and the error to expect of it, both in the property's measured units; an expected
/// error is above 0.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Expected {
    pub value: f64,
    pub error: f64,
}

impl<M> Stage<M> {
    /// With what `change` makes of the models of each group, by a name for them.
    pub(crate) fn with<N>(
        &self,
        mut change: impl FnMut(&Group<M>, String, &M) -> Result<N>,
    ) -> Result<Stage<N>> {
        let groups = self.groups.iter().enumerate().map(|(at, group)| {
            let mut changed = |what: &str, models: &M| {
                let name = format!("{what}-{}-{at}", self.views);
                change(group, name, models)
            };
            let errors = group.errors.as_ref();
            let whole = group.whole.as_ref();
            Ok(Group {
                properties: group.properties.clone(),
                slots: group.slots.clone(),
                models: changed("models", &group.models)?,
                errors: errors.map(|models| changed("errors", models)).transpose()?,
                whole: whole.map(|models| changed("whole", models)).transpose()?,
                least_errors: group.least_errors.clone(),
            })
        });
        Ok(Stage {
            views: self.views,
            groups: groups.collect::<Result<_>>()?,
        })
    }
}

impl Stage {
    /// What `group` says of each of its properties from its views, in the order of all properties;
    /// `embeddings` are those of the stage's views.
    fn of_groups<T: Default>(
        &self,
        embeddings: &Embeddings,
        group: impl Fn(&Group, &Embeddings) -> Result<Vec<T>>,
    ) -> Result<Vec<T>> {
        let surfaces: Vec<usize> = (0..embeddings.surfaces()).collect();
        let count = self.groups.iter().map(|group| group.properties.len()).sum();
        let mut all: Vec<T> = (0..count).map(|_| T::default()).collect();
        for one in &self.groups {
            let embeddings = embeddings.select(&surfaces, &one.slots)?;
            for (&property, said) in one.properties.iter().zip(group(one, &embeddings)?) {
                all[property] = said;
            }
        }
        Ok(all)
    }

    /// The estimates of every property, for each surface.
    pub(crate) fn expected(&self, embeddings: &Embeddings) -> Result<Vec<Vec<Expected>>> {
        self.of_groups(embeddings, Group::expected)
    }

    /// The values of every property that are not those of [`Stage::expected`], for each surface.
    fn values(&self, embeddings: &Embeddings) -> Result<Vec<Option<Vec<f64>>>> {
        if self.groups.iter().all(|group| group.whole.is_none()) {
            // Without a copy of the embeddings for each group: those of a map are large.
            let count = self.groups.iter().map(|group| group.properties.len()).sum();
            return Ok(vec![None; count]);
        }
        self.of_groups(embeddings, |group, embeddings| {
            let estimates = group.whole.as_ref().map(|whole| whole.predict(embeddings));
            let estimates = estimates.transpose()?.into_iter().flatten();
            Ok(estimates.map(|one| Some(one.values)).collect())
        })
    }
}

impl Group {
    /// The estimates of each property, from the embeddings of its views.
    fn expected(&self, embeddings: &Embeddings) -> Result<Vec<Vec<Expected>>> {
        let values = self.models.predict(embeddings)?;
        let errors = self.errors.as_ref();
        let errors = errors.map(|one| one.predict(embeddings)).transpose()?;
        let expected = values.into_iter().enumerate().map(|(at, estimates)| {
            let least = self.least_errors[at].max(f64::MIN_POSITIVE);
            let error = |surface: usize| match &errors {
                Some(errors) => errors[at].values[surface].max(least),
                None => 1.0,
            };
            let values = estimates.values.into_iter().enumerate();
            let expected = values.map(|(surface, value)| Expected {
                value,
                error: error(surface),
            });
            expected.collect()
        });
        Ok(expected.collect())
    }
}

/// What is estimated of some surfaces.
#[derive(Clone, Debug, PartialEq)]
pub struct Predictions {
    /// One for each property, in their order.
    pub properties: Vec<Predicted>,
    /// How likely it is that a surface like those fitted on looks as strange, for each surface; `None`
    /// where the model does not know ([`Fitted::no_familiar`]).
    pub familiar: Option<Vec<f64>>,
}

/// One property of some surfaces, in its measured units.
#[derive(Clone, Debug, PartialEq)]
pub struct Predicted {
    /// The property.
    pub property: String,
    /// An estimate for each surface.
    pub values: Vec<f64>,
    /// An interval for each surface, or why there is none.
    pub intervals: Result<Vec<PredictionInterval>, String>,
}

impl Fitted {
    /// The properties, in the order of the predictions.
    pub fn properties(&self) -> impl Iterator<Item = &str> {
        let measures = self.measures.iter();
        measures.map(|measure| measure.property.as_str())
    }

    /// The standard deviation of each property's readings that were fitted to, in the order of the
    /// predictions; 1 where the readings do not differ.
    pub fn deviations(&self) -> impl Iterator<Item = f64> {
        self.measures.iter().map(|measure| measure.deviation)
    }

    /// The numbers of views that it can be asked with, ascending.
    pub fn steps(&self) -> impl DoubleEndedIterator<Item = usize> + ExactSizeIterator {
        self.stages.iter().map(|stage| stage.views)
    }

    /// The share of new units whose truth an interval holds.
    pub fn level(&self) -> Level {
        self.level
    }

    /// What it was fitted on.
    pub fn fitted_on(&self) -> FittedOn {
        self.on
    }

    /// Why it does not know whether a surface is like those that it was fitted on; `None` where it does.
    pub fn no_familiar(&self) -> Option<&str> {
        self.familiar.as_ref().err().map(String::as_str)
    }

    /// Whether it looks at one photograph of a surface, so that of several the mean is meant.
    pub(crate) fn averages(&self) -> bool {
        self.steps().eq([1])
    }

    /// The width of the embeddings that it takes.
    pub fn width(&self) -> usize {
        self.width
    }

    /// Whether the intervals of predictions are at most `width` standard deviations of the readings that
    /// were fitted wide: for each property, for each surface. A property without intervals is never.
    pub fn narrow(&self, predictions: &Predictions, width: f64) -> Vec<Vec<bool>> {
        let properties = self.measures.iter().zip(&predictions.properties);
        let narrow = properties.map(|(measure, predicted)| {
            let most = width * measure.deviation;
            match &predicted.intervals {
                Ok(intervals) => intervals.iter().map(|i| i.high - i.low <= most).collect(),
                Err(_) => vec![false; predicted.values.len()],
            }
        });
        narrow.collect()
    }

    /// Of each surface the place of the step, of predictions of these surfaces from ever more views, at which a
    /// session that asks for these properties ends: the first that is [`narrow`](Fitted::narrow) for all of
    /// them, or the last.
    pub fn ends(&self, steps: &[Predictions], width: f64, properties: Range<usize>) -> Vec<usize> {
        let narrow: Vec<_> = steps.iter().map(|step| self.narrow(step, width)).collect();
        let surfaces = narrow.iter().flatten().next().map_or(0, Vec::len);
        let end = |surface: usize| {
            let ends =
                |step: &Vec<Vec<bool>>| step[properties.clone()].iter().all(|of| of[surface]);
            let end = narrow.iter().position(ends);
            end.unwrap_or(steps.len() - 1)
        };
        (0..surfaces).map(end).collect()
    }

    /// Estimates of surfaces from their views, `(surfaces, views, width)`: the first views of the
    /// [slots](crate::Recipe::slots) that it was fitted on, as many as one of [`Fitted::steps`].
    ///
    /// # Errors
    /// Another number of views, or another width.
    pub fn predict(&self, embeddings: &Embeddings) -> Result<Predictions> {
        self.predict_at_once(embeddings, 1, false)
    }

    /// As [`Fitted::predict`], with intervals of which those of all properties of a surface hold at once
    /// at the level: of the largest error over the properties, in expected errors, as [`Fitted::predict`]
    /// is of each.
    ///
    /// # Errors
    /// As [`Fitted::predict`].
    pub fn predict_jointly(&self, embeddings: &Embeddings) -> Result<Predictions> {
        self.predict_at_once(embeddings, 1, true)
    }

    /// As [`Fitted::predict`], with intervals of which those of so many photographs hold at once at the
    /// level, or `jointly` those of all properties of one.
    pub(crate) fn predict_at_once(
        &self,
        embeddings: &Embeddings,
        photographs: usize,
        jointly: bool,
    ) -> Result<Predictions> {
        let times = |measure: &Measure| match &self.joint {
            _ if !jointly => measure.times(photographs, self.level),
            Interval::None(reason) => Err(reason.clone()),
            Interval::Errors(times) if photographs == 1 => Ok(*times),
            Interval::Errors(_) => Err(format!(
                "found {photographs} photographs, expected one where all properties are to hold at once"
            )),
        };
        let (views, width) = (embeddings.views(), embeddings.width());
        let mut stages = self.stages.iter();
        let stage = stages.find(|stage| (stage.views, self.width) == (views, width));
        let stage = stage.ok_or_else(|| {
            let found = format!("{views} views of width {width}");
            let steps: Vec<String> = self.steps().map(|views| views.to_string()).collect();
            let expected = format!("{} of width {}", steps.join(" or "), self.width);
            Error::input("embeddings", found, expected)
        })?;
        let expected = stage.expected(embeddings)?.into_iter();
        let expected = expected.zip(stage.values(embeddings)?);
        let properties = self.measures.iter().zip(expected);
        let properties = properties.map(|(measure, (expected, values))| {
            measure.predicted(&expected, values, (times(measure), self.level))
        });
        let familiar = self.familiar.as_ref().ok();
        Ok(Predictions {
            properties: properties.collect(),
            familiar: familiar.map(|of| of.p_values(embeddings)).transpose()?,
        })
    }
}

/// The standard deviation; 1 where the readings do not differ.
fn deviation(readings: &[f64]) -> f64 {
    let Standardiser { std, .. } = Standardiser::of(readings.iter().copied()).unwrap_or_default();
    if std > 0.0 { std } else { 1.0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn measure(range: Option<[f64; 2]>, readings: &[f64]) -> Measure {
        let wanted = Wanted {
            property: "fRS".to_owned(),
            views: vec![0],
            range,
        };
        Measure::of(&wanted, readings)
    }

    /// The parts of the range that intervals cover, and of estimates beyond it those next to the end.
    #[test]
    fn an_interval_is_cut_to_the_range_and_has_a_width() {
        let mut measure = measure(Some([0.0, 10.0]), &[4.0, 6.0]);
        measure.interval = Interval::Errors(2.0);
        let (values, errors) = ([5.0, 9.0, 10.5, 13.0, -1.0], [1.0, 1.0, 1.0, 1.0, 0.25]);
        let expected = values.into_iter().zip(errors);
        let expected = expected.map(|(value, error)| Expected { value, error });
        let expected: Vec<Expected> = expected.collect();
        let predicted = measure.predicted(&expected, None, (Ok(2.0), Level::P90));
        assert_eq!(predicted.values, [5.0, 9.0, 10.0, 10.0, 0.0]);
        let ends = predicted.intervals.unwrap();
        let ends = ends.iter().map(|ends| (ends.low, ends.high));
        let (lows, highs): (Vec<f64>, Vec<f64>) = ends.unzip();
        assert_eq!(lows, [3.0, 7.0, 8.0, 8.0, 0.0]);
        assert_eq!(highs, [7.0, 10.0, 10.0, 10.0, 0.5]);
    }

    #[test]
    fn looking_ends_at_the_first_interval_that_is_narrow_enough() {
        let fitted = Fitted {
            measures: vec![measure(None, &[40.0, 60.0])],
            stages: Vec::new(),
            familiar: Err(String::new()),
            level: Level::P90,
            joint: Interval::None(String::new()),
            on: FittedOn {
                surfaces: 2,
                units: 2,
                unit: Unit::Surface,
            },
            width: 1,
        };
        assert!(fitted.deviations().eq([10.0]));
        // The mean of ten equal readings is not one of them in f64.
        assert_eq!(measure(None, &[0.1; 10]).deviation, 1.0);
        // 2.4, 1.8, 0.6 and 1.2 deviations wide.
        let steps = [12.0, 9.0, 3.0, 6.0].map(|half| Predictions {
            properties: vec![Predicted {
                property: "fRS".to_owned(),
                values: vec![50.0],
                intervals: Ok(vec![PredictionInterval {
                    low: 50.0 - half,
                    high: 50.0 + half,
                }]),
            }],
            familiar: None,
        });
        let end = |width| fitted.ends(&steps, width, 0..1);
        assert_eq!([end(2.4), end(2.0), end(1.0)], [[0], [1], [2]]);
        // Never narrow enough: all views.
        assert_eq!(end(0.1), [3]);
    }
}

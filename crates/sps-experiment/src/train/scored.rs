//! What was estimated of surfaces held out, property by property.

use std::collections::BTreeMap;

use anyhow::Result;
use sps_dataset::{Split, Unit, Units};
use sps_estimator::{Measured, Predicted, Predictions};
use sps_metrics::{Moments, Pair, PredictionInterval, ScoreAccumulator, TrainingMean, coverage};

use super::Say;
use crate::run::Tables;
use crate::text::{aligned, decimals, number};

/// All properties over all splits, in the order of the dataset.
#[derive(Default)]
pub(super) struct HeldOuts(Vec<(String, HeldOut)>);

/// A split, with the tables that have the readings of its surfaces.
#[derive(Clone, Copy)]
pub(super) struct OfSplit<'a> {
    pub tables: &'a Tables,
    pub split: &'a Split,
    pub units: &'a Units,
}

impl OfSplit<'_> {
    /// Of the readings of a property on the training surfaces.
    pub(super) fn training(&self, property: &str) -> Moments {
        let readings = self.tables.measured(property, &self.split.train);
        readings.into_iter().map(|(_, reading)| reading).collect()
    }
}

impl HeldOuts {
    pub(super) fn add(&mut self, of: OfSplit<'_>, predictions: &Predictions) -> Result<()> {
        for predicted in &predictions.properties {
            let mut known = self.0.iter();
            let place = known.position(|(property, _)| *property == predicted.property);
            let place = place.unwrap_or_else(|| {
                self.0
                    .push((predicted.property.clone(), HeldOut::default()));
                self.0.len() - 1
            });
            self.0[place].1.add(of, predicted)?;
        }
        Ok(())
    }

    /// Says a line for each property, and gives what it says.
    pub(super) fn print(&self, unit: Unit, say: Say<'_>) -> Result<BTreeMap<String, Measured>> {
        let mut measured = BTreeMap::new();
        let mut lines = vec![heading(unit)];
        for (property, all) in &self.0 {
            let of_property = all.measured()?;
            let decimals = decimals(all.deviation());
            lines.push(line(property, &of_property, decimals, unit));
            measured.insert(property.clone(), of_property);
        }
        say(aligned(&lines, |at| at == 0).trim_end());
        for (property, all) in &self.0 {
            if let Some(reason) = &all.no_interval {
                say(&format!("{property}: no interval, {reason}"));
            }
        }
        Ok(measured)
    }

    /// The means over the properties; widths in standard deviations of the training readings.
    pub(super) fn means(&self) -> Result<Measured> {
        let all = self.0.iter();
        let all = all.map(|(_, of)| Ok((of.measured()?, of.deviation())));
        let all = all.collect::<Result<Vec<(Measured, f64)>>>()?;
        let mean = |of: &dyn Fn(&(Measured, f64)) -> Option<f64>| {
            let values: Option<Vec<f64>> = all.iter().map(of).collect();
            values.map(|values| values.iter().sum::<f64>() / values.len().max(1) as f64)
        };
        Ok(Measured {
            readings: all.iter().map(|(measured, _)| measured.readings).sum(),
            r2: mean(&|(measured, _)| measured.r2),
            mae: mean(&|(measured, deviation)| Some(measured.mae? / deviation)),
            coverage: mean(&|(measured, _)| measured.coverage),
            unit_coverage: mean(&|(measured, _)| measured.unit_coverage),
            mean_width: mean(&|(measured, deviation)| Some(measured.mean_width? / deviation)),
        })
    }
}

/// The last column where intervals are for a new group or material alone.
pub(super) fn heading(unit: Unit) -> Vec<String> {
    let heading = ["", "R²", "MAE", "interval half width", "covered, %"];
    let mut heading = heading.map(str::to_owned).to_vec();
    heading.extend((unit != Unit::Surface).then(|| format!("by {}, %", unit.name())));
    heading
}

/// What was measured below the [`heading`], errors and half widths with so many decimals.
pub(super) fn line(name: &str, measured: &Measured, decimals: usize, unit: Unit) -> Vec<String> {
    let percent = |share: Option<f64>| number(share.map(|share| 100.0 * share), 1);
    let mut line = vec![
        name.to_owned(),
        number(measured.r2, 3),
        number(measured.mae, decimals),
        number(measured.mean_width.map(|width| width / 2.0), decimals),
        percent(measured.coverage),
    ];
    line.extend((unit != Unit::Surface).then(|| percent(measured.unit_coverage)));
    line
}

/// The mean over units of the share of each.
pub(super) fn mean_share(units: &BTreeMap<usize, (usize, usize)>) -> f64 {
    let share = |&(held, count): &(usize, usize)| held as f64 / count as f64;
    units.values().map(share).sum::<f64>() / units.len() as f64
}

#[derive(Default)]
struct HeldOut {
    /// Of differences from each split's training mean.
    scores: ScoreAccumulator,
    intervals: Vec<PredictionInterval>,
    /// Of the splits that have intervals.
    truth: Vec<f64>,
    /// Of each unit, how many of its surfaces the intervals hold, and of how many.
    units: BTreeMap<usize, (usize, usize)>,
    no_interval: Option<String>,
    /// Standard deviations of the training readings, one of each split.
    deviations: Moments,
}

impl HeldOut {
    /// Adds what was predicted of the surfaces held out, as far as they were measured.
    fn add(&mut self, of: OfSplit<'_>, predicted: &Predicted) -> Result<()> {
        let training = of.training(&predicted.property);
        let mean = training.mean()?;
        let deviation = training.sample_std().unwrap_or_default();
        self.deviations.push(deviation);
        if let Err(reason) = &predicted.intervals {
            self.no_interval = Some(reason.clone());
        }
        for (at, &surface) in of.split.validation.iter().enumerate() {
            let Some(truth) = of.tables.reading(&predicted.property, surface) else {
                continue;
            };
            self.scores.push(Pair {
                truth: truth - mean,
                estimate: predicted.values[at] - mean,
            });
            if let Ok(intervals) = &predicted.intervals {
                let interval = intervals[at];
                self.truth.push(truth);
                self.intervals.push(interval);
                let unit = self.units.entry(of.units.of_surface()[surface]);
                let (held, count) = unit.or_default();
                *held += usize::from((interval.low..=interval.high).contains(&truth));
                *count += 1;
            }
        }
        Ok(())
    }

    fn deviation(&self) -> f64 {
        self.deviations.mean().unwrap_or_default()
    }

    fn measured(&self) -> Result<Measured> {
        let any = !self.intervals.is_empty();
        let coverage = any.then(|| coverage(&self.intervals, &self.truth));
        let coverage = coverage.transpose()?;
        let r2 = self.scores.r2(TrainingMean::new(0.0)?);
        Ok(Measured {
            readings: self.scores.samples().unwrap_or_default(),
            r2: r2.ok().map(|r2| r2.value),
            mae: self.scores.mae().ok().map(|mae| mae.value),
            coverage: coverage.map(|coverage| coverage.fraction()),
            unit_coverage: any.then(|| mean_share(&self.units)),
            mean_width: coverage.map(|coverage| coverage.mean_width),
        })
    }
}

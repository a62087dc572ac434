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

impl HeldOuts {
    pub(super) fn add(
        &mut self,
        tables: &Tables,
        split: &Split,
        predictions: &Predictions,
        units: &Units,
    ) -> Result<()> {
        for (at, predicted) in predictions.properties.iter().enumerate() {
            if at == self.0.len() {
                let property = predicted.property.clone();
                self.0.push((property, HeldOut::default()));
            }
            self.0[at].1.add((tables, units), split, predicted)?;
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
        let all = self
            .0
            .iter()
            .map(|(_, of)| Ok((of.measured()?, of.deviation())));
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
    let mut heading = ["", "R²", "MAE", "interval half width", "covered, %"]
        .map(str::to_owned)
        .to_vec();
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
    let shares = units.values();
    let shares = shares.map(|(held, count)| *held as f64 / *count as f64);
    shares.sum::<f64>() / units.len() as f64
}

/// Of what was measured of a property on the training surfaces.
pub(super) fn training(tables: &Tables, property: &str, training: &[usize]) -> Moments {
    let readings = tables.measured(property, training).into_iter();
    readings.map(|(_, reading)| reading).collect()
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
    /// Adds what was predicted of some surfaces, as far as they were measured.
    fn add(
        &mut self,
        (tables, units): (&Tables, &Units),
        split: &Split,
        predicted: &Predicted,
    ) -> Result<()> {
        let surfaces = &split.validation;
        let training = training(tables, &predicted.property, &split.train);
        let mean = training.mean()?;
        self.deviations
            .push(training.sample_std().unwrap_or_default());
        let truth = |&surface: &usize| tables.reading(&predicted.property, surface);
        let truths: Vec<Option<f64>> = surfaces.iter().map(truth).collect();
        for (truth, estimate) in truths.iter().zip(&predicted.values) {
            if let Some(truth) = truth {
                self.scores.push(Pair {
                    truth: truth - mean,
                    estimate: estimate - mean,
                });
            }
        }
        match &predicted.intervals {
            Err(reason) => self.no_interval = Some(reason.clone()),
            Ok(intervals) => {
                for ((truth, interval), surface) in truths.into_iter().zip(intervals).zip(surfaces)
                {
                    let Some(truth) = truth else { continue };
                    self.truth.push(truth);
                    self.intervals.push(*interval);
                    let (held, count) = self.units.entry(units.of_surface()[*surface]).or_default();
                    *held += usize::from((interval.low..=interval.high).contains(&truth));
                    *count += 1;
                }
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
        Ok(Measured {
            readings: self.scores.samples().unwrap_or_default(),
            r2: self
                .scores
                .r2(TrainingMean::new(0.0)?)
                .ok()
                .map(|r2| r2.value),
            mae: self.scores.mae().ok().map(|mae| mae.value),
            coverage: coverage.map(|coverage| coverage.fraction()),
            unit_coverage: any.then(|| mean_share(&self.units)),
            mean_width: coverage.map(|coverage| coverage.mean_width),
        })
    }
}

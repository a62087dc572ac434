//! What models of one kind do on surfaces that they were not fitted to.

use std::collections::BTreeMap;

use anyhow::{Context, Result};
use sps_dataset::Split;
use sps_estimator::{Fitted, Measured, Predicted, Predictions};
use sps_metrics::{Moments, Pair, PredictionInterval, ScoreAccumulator, TrainingMean, coverage};

use super::Say;
use crate::config::Adaptive;
use crate::run::Tables;
use crate::text::{aligned, decimals, number};

/// Photographs are counted as unlike what a model was fitted on below this p-value.
const UNFAMILIAR: f64 = 0.05;

/// Over all splits.
pub(super) struct Check {
    /// Set where views are looked at one by one.
    adaptive: Option<Adaptive>,
    rows: BTreeMap<Row, HeldOuts>,
    /// Views that each surface took until its intervals were narrow.
    views_taken: Vec<usize>,
    /// The p-value of each surface.
    familiar: Vec<f64>,
    /// Why the models of some splits have none.
    no_familiar: Option<String>,
}

/// How many views are looked at.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Row {
    Views(usize),
    /// As many as it takes.
    Session,
}

impl Check {
    pub(super) fn new(adaptive: Option<Adaptive>) -> Self {
        Self {
            adaptive,
            rows: BTreeMap::new(),
            views_taken: Vec::new(),
            familiar: Vec::new(),
            no_familiar: None,
        }
    }

    /// Adds what was predicted of the held-out surfaces of a split from each number of views.
    pub(super) fn add(
        &mut self,
        (tables, split): (&Tables, &Split),
        fitted: &Fitted,
        mut all: BTreeMap<usize, Predictions>,
    ) -> Result<()> {
        for (views, predictions) in &all {
            let row = self.rows.entry(Row::Views(*views)).or_default();
            row.add(tables, split, predictions)?;
        }
        if let Some(adaptive) = &self.adaptive
            && let Some((views, predictions)) = stopped(fitted, &all, adaptive.width)
        {
            self.views_taken.extend(views);
            let row = self.rows.entry(Row::Session).or_default();
            row.add(tables, split, &predictions)?;
        }
        let last = all
            .pop_last()
            .and_then(|(_, predictions)| predictions.familiar);
        self.familiar.extend(last.unwrap_or_default());
        if let Some(reason) = fitted.no_familiar() {
            self.no_familiar = Some(reason.to_owned());
        }
        Ok(())
    }

    /// Says it, and gives what is measured of each property from all views.
    pub(super) fn print(&self, say: Say<'_>) -> Result<BTreeMap<String, Measured>> {
        let last = self.rows.iter().rfind(|(row, _)| **row != Row::Session);
        let measured = last.map(|(_, held_out)| held_out.print(say)).transpose()?;
        if !self.familiar.is_empty() {
            let unlike = self.familiar.iter().filter(|p| **p <= UNFAMILIAR).count();
            let share = 100.0 * unlike as f64 / self.familiar.len() as f64;
            say(&format!(
                "{share:.1} % of them are unlike what was fitted on (p <= {UNFAMILIAR}; where nothing is new, at most 5 %)"
            ));
        }
        if let Some(reason) = &self.no_familiar {
            say(&format!(
                "no p-value of \"like what was fitted on\": {reason}"
            ));
        }
        if self.adaptive.is_some() {
            self.print_steps(say)?;
        }
        Ok(measured.unwrap_or_default())
    }

    fn print_steps(&self, say: Say<'_>) -> Result<()> {
        say("\nViews one by one, means over the properties, half widths in standard deviations:");
        let taken = self.views_taken.iter().sum::<usize>();
        let mean = taken as f64 / self.views_taken.len().max(1) as f64;
        let mut lines = vec![heading()];
        for (row, held_out) in &self.rows {
            let name = match row {
                Row::Views(1) => "1 view".to_owned(),
                Row::Views(views) => format!("{views} views"),
                Row::Session => format!("until sure, {mean:.2} views"),
            };
            lines.push(line(&name, &held_out.means()?, 2));
        }
        say(aligned(&lines, |at| at == 0).trim_end());
        Ok(())
    }
}

/// What sessions say of surfaces that stop at the first number of views after which all intervals are
/// narrow, with that number for each surface.
fn stopped(
    fitted: &Fitted,
    all: &BTreeMap<usize, Predictions>,
    width: f64,
) -> Option<(Vec<usize>, Predictions)> {
    let mut steps = all.iter().rev();
    let (&most, last) = steps.next()?;
    let mut stopped = last.clone();
    let mut views = vec![most; last.properties.first()?.values.len()];
    for (&step, predictions) in steps {
        let narrow = fitted.narrow(predictions, width);
        for surface in (0..views.len()).filter(|&at| narrow.iter().all(|narrow| narrow[at])) {
            views[surface] = step;
            for (to, from) in stopped.properties.iter_mut().zip(&predictions.properties) {
                to.values[surface] = from.values[surface];
                if let (Ok(to), Ok(from)) = (&mut to.intervals, &from.intervals) {
                    to[surface] = from[surface];
                }
            }
        }
    }
    Some((views, stopped))
}

/// All properties over all splits, in the order of the dataset.
#[derive(Default)]
struct HeldOuts(Vec<(String, HeldOut)>);

impl HeldOuts {
    fn add(&mut self, tables: &Tables, split: &Split, predictions: &Predictions) -> Result<()> {
        for predicted in &predictions.properties {
            let training = training(tables, &predicted.property, &split.train)?;
            let place = self
                .0
                .iter()
                .position(|(property, _)| *property == predicted.property);
            let place = place.unwrap_or_else(|| {
                self.0
                    .push((predicted.property.clone(), HeldOut::default()));
                self.0.len() - 1
            });
            let (_, all) = &mut self.0[place];
            all.add(tables, &split.validation, &training, predicted)?;
        }
        Ok(())
    }

    /// Says a line for each property, and gives what it says.
    fn print(&self, say: Say<'_>) -> Result<BTreeMap<String, Measured>> {
        let mut measured = BTreeMap::new();
        let mut lines = vec![heading()];
        for (property, all) in &self.0 {
            let of_property = all.measured()?;
            lines.push(line(property, &of_property, decimals(all.deviation())));
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
    fn means(&self) -> Result<Measured> {
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
            coverage: mean(&|(measured, _)| measured.coverage),
            mean_width: mean(&|(measured, deviation)| Some(measured.mean_width? / deviation)),
        })
    }
}

fn heading() -> Vec<String> {
    ["", "R²", "interval half width", "covered, %"]
        .map(str::to_owned)
        .to_vec()
}

/// What was measured below the [`heading`], half widths with so many decimals.
fn line(name: &str, measured: &Measured, decimals: usize) -> Vec<String> {
    vec![
        name.to_owned(),
        number(measured.r2, 3),
        number(measured.mean_width.map(|width| width / 2.0), decimals),
        number(measured.coverage.map(|share| 100.0 * share), 1),
    ]
}

/// What was measured of the training surfaces.
fn training(tables: &Tables, property: &str, training: &[usize]) -> Result<Moments> {
    let column = tables.readings.column(property).context(NOT_MEASURED)?;
    let training = training.iter();
    let readings = training.filter_map(|&surface| tables.readings.get(surface, column));
    Ok(readings.collect())
}

const NOT_MEASURED: &str = "a property that was not measured";

/// One property over all splits.
#[derive(Default)]
struct HeldOut {
    /// Of differences from each split's training mean.
    scores: ScoreAccumulator,
    intervals: Vec<PredictionInterval>,
    /// Of the splits that have intervals.
    truth: Vec<f64>,
    no_interval: Option<String>,
    /// Standard deviations of the training readings, one of each split.
    deviations: Moments,
}

impl HeldOut {
    /// Adds what was predicted of some surfaces, as far as they were measured.
    fn add(
        &mut self,
        tables: &Tables,
        surfaces: &[usize],
        training: &Moments,
        predicted: &Predicted,
    ) -> Result<()> {
        let mean = training.mean()?;
        self.deviations
            .push(training.sample_std().unwrap_or_default());
        let column = tables.readings.column(&predicted.property);
        let column = column.context(NOT_MEASURED)?;
        let truths: Vec<Option<f64>> = surfaces
            .iter()
            .map(|&surface| tables.readings.get(surface, column))
            .collect();
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
                let read = truths.into_iter().zip(intervals);
                let read = read.filter_map(|(truth, interval)| Some((truth?, *interval)));
                let (truth, intervals): (Vec<f64>, Vec<_>) = read.unzip();
                self.truth.extend(truth);
                self.intervals.extend(intervals);
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
            coverage: coverage.map(|coverage| coverage.fraction()),
            mean_width: coverage.map(|coverage| coverage.mean_width),
        })
    }
}

//! What models of one kind do on surfaces that they were not fitted to.

use std::collections::BTreeMap;

use anyhow::Result;
use sps_dataset::{Surface, Unit};
use sps_estimator::{Fitted, Measured, Predictions};

use super::Say;
use super::scored::{HeldOuts, OfSplit, heading, line, mean_share};
use crate::config::Adaptive;
use crate::text::{aligned, counted};

/// Photographs are counted as unlike what a model was fitted on below this p-value.
const UNFAMILIAR: f64 = 0.05;

/// Surfaces that are named for their errors.
const WORST: usize = 3;

/// What is measured of each property from all views, and the worst surfaces.
pub(super) type Found = (BTreeMap<String, Measured>, Vec<(String, f64)>);

/// Over all splits.
pub(super) struct Check {
    /// What an interval promises to hold for.
    unit: Unit,
    /// Set where views are looked at one by one.
    adaptive: Option<Adaptive>,
    /// From each number of views.
    rows: BTreeMap<usize, HeldOuts>,
    /// From as many views as it takes.
    session: HeldOuts,
    /// Views that each surface took until its intervals were narrow.
    views_taken: Vec<usize>,
    /// The p-value of each surface.
    familiar: Vec<f64>,
    /// Why the models of some splits have none.
    no_familiar: Option<String>,
    /// Of each surface the squared errors of all properties, in variances of the training readings, and
    /// how many they are.
    errors: BTreeMap<usize, (f64, usize)>,
    /// Of each unit, the surfaces of which intervals hold all properties at once, and those of which all
    /// were read.
    joint: BTreeMap<usize, (usize, usize)>,
}

impl Check {
    pub(super) fn new(unit: Unit, adaptive: Option<Adaptive>) -> Self {
        Self {
            unit,
            adaptive,
            rows: BTreeMap::new(),
            session: HeldOuts::default(),
            views_taken: Vec::new(),
            familiar: Vec::new(),
            no_familiar: None,
            errors: BTreeMap::new(),
            joint: BTreeMap::new(),
        }
    }

    /// Adds intervals of the held-out surfaces of a split that are to hold all properties at once.
    pub(super) fn add_joint(&mut self, of: OfSplit<'_>, predictions: &Predictions) {
        for (at, &surface) in of.split.validation.iter().enumerate() {
            let held = predictions.properties.iter().map(|predicted| {
                let truth = of.tables.reading(&predicted.property, surface)?;
                let interval = predicted.intervals.as_ref().ok()?[at];
                Some((interval.low..=interval.high).contains(&truth))
            });
            if let Some(held) = held.collect::<Option<Vec<bool>>>() {
                let unit = self.joint.entry(of.units.of_surface()[surface]);
                let (sum, count) = unit.or_default();
                *sum += usize::from(held.into_iter().all(|held| held));
                *count += 1;
            }
        }
    }

    /// Adds what was predicted of the held-out surfaces of a split from each number of views.
    pub(super) fn add(
        &mut self,
        of: OfSplit<'_>,
        fitted: &Fitted,
        mut all: BTreeMap<usize, Predictions>,
    ) -> Result<()> {
        for (views, predictions) in &all {
            self.rows.entry(*views).or_default().add(of, predictions)?;
        }
        if let Some(adaptive) = &self.adaptive
            && let Some((views, predictions)) = stopped(fitted, &all, adaptive.width)
        {
            self.views_taken.extend(views);
            self.session.add(of, &predictions)?;
        }
        if let Some((_, last)) = all.pop_last() {
            self.note_errors(of, &last);
            self.familiar.extend(last.familiar.unwrap_or_default());
        }
        if let Some(reason) = fitted.no_familiar() {
            self.no_familiar = Some(reason.to_owned());
        }
        Ok(())
    }

    fn note_errors(&mut self, of: OfSplit<'_>, all: &Predictions) {
        for predicted in &all.properties {
            let training = of.training(&predicted.property);
            let variance = training.sample_std().unwrap_or_default().powi(2);
            for (&surface, estimate) in of.split.validation.iter().zip(&predicted.values) {
                if let Some(truth) = of.tables.reading(&predicted.property, surface)
                    && variance > 0.0
                {
                    let (sum, count) = self.errors.entry(surface).or_default();
                    *sum += (truth - estimate).powi(2) / variance;
                    *count += 1;
                }
            }
        }
    }

    /// The surfaces whose estimates are furthest from what was measured, the worst first, and by how
    /// many standard deviations.
    fn worst(&self, surfaces: &[Surface]) -> Vec<(String, f64)> {
        let errors = self.errors.iter();
        let errors = errors.map(|(&at, (sum, count))| ((sum / *count as f64).sqrt(), at));
        let mut errors: Vec<(f64, usize)> = errors.collect();
        errors.sort_by(|one, other| other.0.total_cmp(&one.0));
        let named = |(error, at): (f64, usize)| (surfaces[at].id.clone(), error);
        errors.into_iter().take(WORST).map(named).collect()
    }

    /// Says it, and gives it.
    pub(super) fn print(&self, surfaces: &[Surface], say: Say<'_>) -> Result<Found> {
        let (unit, last) = (self.unit, self.rows.values().last());
        let measured = last.map(|last| last.print(unit, say)).transpose()?;
        if measured.as_ref().is_some_and(|all| all.len() > 1) && !self.joint.is_empty() {
            say(&format!(
                "wider intervals, meant to hold all properties at once (`predict --joint`): {:.1} % of {unit}",
                100.0 * mean_share(&self.joint)
            ));
        }
        let worst = self.worst(surfaces);
        let named = worst.iter().map(|(id, error)| format!("{id} {error:.2}"));
        say(&format!(
            "furthest from what was measured, error in standard deviations: {}",
            named.collect::<Vec<_>>().join(", ")
        ));
        if !self.familiar.is_empty() {
            let unlike = self.familiar.iter().filter(|p| **p <= UNFAMILIAR).count();
            let share = 100.0 * unlike as f64 / self.familiar.len() as f64;
            say(&format!(
                "{share:.1} % of them are unlike what was fitted on (p <= {UNFAMILIAR}; where nothing is new, at most 5 %)"
            ));
        }
        if let Some(reason) = &self.no_familiar {
            let what = "no p-value of \"like what was fitted on\"";
            say(&format!("{what}: {reason}"));
        }
        if self.adaptive.is_some() {
            self.print_steps(say)?;
        }
        Ok((measured.unwrap_or_default(), worst))
    }

    fn print_steps(&self, say: Say<'_>) -> Result<()> {
        say("\nViews one by one, means over the properties, half widths in standard deviations:");
        let taken = self.views_taken.iter().sum::<usize>();
        let mean = taken as f64 / self.views_taken.len().max(1) as f64;
        let unit = self.unit;
        let mut lines = vec![heading(unit)];
        for (&views, held_out) in &self.rows {
            let name = counted(views, "view");
            lines.push(line(&name, &held_out.means()?, 2, unit));
        }
        let name = format!("until sure, {mean:.2} views");
        lines.push(line(&name, &self.session.means()?, 2, unit));
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
    let views: Vec<usize> = all.keys().copied().collect();
    let steps: Vec<Predictions> = all.values().cloned().collect();
    let mut stopped = steps.last()?.clone();
    let ends = fitted.ends(&steps, width, 0..stopped.properties.len());
    for (surface, &end) in ends.iter().enumerate() {
        for (to, from) in stopped.properties.iter_mut().zip(&steps[end].properties) {
            to.values[surface] = from.values[surface];
            if let (Ok(to), Ok(from)) = (&mut to.intervals, &from.intervals) {
                to[surface] = from[surface];
            }
        }
    }
    Some((ends.into_iter().map(|end| views[end]).collect(), stopped))
}

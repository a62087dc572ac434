//! How a model is fitted: what estimates, from which views, and what its intervals promise.

use std::collections::{BTreeMap, BTreeSet};

use sps_dataset::{Split, SplitError, Units};
use sps_metrics::{ConformalError, Level};
use sps_regress::TrainingData;

use crate::error::{Result, refuse};
use crate::fitted::{Expected, Fitted, FittedOn, Group, Interval, Measure, Stage};
use crate::novelty::Familiar;
use crate::radius::{radii, radius};
use crate::regression::Regression;
use crate::step::{Fit, Step};

/// Parts of the surfaces fitted to, of which each is estimated by the others to know the error to
/// expect of a photograph.
const FOLDS: usize = 3;

/// Units that an encoder that learned from others must not have seen, at least, to hold photographs
/// against: of n the smallest p-value is 1 / (n + 1), and from 0.05 on a photograph counts as unfamiliar.
const LEAST_UNSEEN: usize = 19;

/// A property to estimate, and from what.
#[derive(Clone, Debug, PartialEq)]
pub struct Wanted {
    /// The property, as the readings call it.
    pub property: String,
    /// The views to look at, as indices into the embeddings' views.
    pub views: Vec<usize>,
    /// The lowest and highest value that it can have, in its measured units, either of which may be infinite. An
    /// estimate beyond becomes the nearer end, and intervals around it are cut there.
    pub range: Option<[f64; 2]>,
}

/// How wide the intervals of one property are.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Widths {
    /// As wide as the photograph is hard: locally weighted.
    #[default]
    ByPhotograph,
    /// All alike.
    Constant,
}

/// What to fit, and how.
#[derive(Clone, Debug)]
pub struct Recipe {
    /// What turns embeddings into estimates.
    pub regression: Regression,
    /// The properties.
    pub wanted: Vec<Wanted>,
    /// Whether the views may be looked at one by one, and the looking end after any of them: all
    /// properties then look at the same views in the same order.
    pub one_by_one: bool,
    /// How wide intervals are.
    pub widths: Widths,
    /// What they promise, and on what.
    pub calibration: Calibration,
}

/// What intervals promise, and the surfaces that they are calibrated on.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Calibration {
    /// Share of the units that is kept aside, in (0, 1); `None` fits to all of them, and there are no
    /// intervals.
    pub share: Option<f64>,
    /// Share of new units whose truth an interval holds.
    pub level: Level,
    /// Keys every random draw of a fit.
    pub seed: u64,
}

impl Calibration {
    /// The surfaces to fit to, and those that calibrate (`validation`), which nothing may learn from:
    /// neither a regression nor the encoder of its embeddings; without a share, all are fitted to. Units
    /// stay whole. [`Recipe::fit`] parts the same surfaces under the same number in the same way.
    ///
    /// # Errors
    /// A share that is not between 0 and 1, fewer than two units.
    pub fn part(&self, units: &Units, surfaces: &[usize], number: u64) -> Result<Split> {
        let Self { share, seed, .. } = *self;
        let Some(share) = share else {
            return Ok(Split {
                train: surfaces.to_vec(),
                validation: Vec::new(),
            });
        };
        if !(share > 0.0 && share < 1.0) {
            return refuse("calibration", share, "a share between 0 and 1");
        }
        Ok(units.keep_aside(surfaces, share, seed, "random split", number)?)
    }
}

/// Tables to fit to, with what must not be parted.
#[derive(Clone, Copy, Debug)]
pub struct Examples<'a> {
    /// Embeddings and readings, one row per surface.
    pub data: TrainingData<'a>,
    /// What stays whole in every parting of surfaces, and what an interval speaks of.
    pub units: &'a Units,
    /// The surfaces that the encoder of the embeddings learned from, those among them that said when to
    /// stop; none where it was taken as it is. It may have seen none of a unit that calibrates.
    pub encoder_saw: &'a [usize],
}

impl Examples<'_> {
    /// Those of some surfaces of whose units the encoder saw nothing.
    fn unseen(&self, surfaces: &[usize]) -> Vec<usize> {
        let unit = |surface: &usize| self.units.of_surface().get(*surface).copied();
        let seen: BTreeSet<usize> = self.encoder_saw.iter().filter_map(unit).collect();
        let surfaces = surfaces.iter().copied();
        let unseen = |surface: &usize| unit(surface).is_none_or(|unit| !seen.contains(&unit));
        surfaces.filter(unseen).collect()
    }

    /// Refuses surfaces that calibrate if the encoder saw any of their units.
    fn check_unseen(&self, calibrating: &[usize]) -> Result<()> {
        if self.unseen(calibrating) == calibrating {
            return Ok(());
        }
        let found = "some of units that calibrate the intervals";
        let expected = "none of them";
        refuse("surfaces that the encoder saw", found, expected)
    }
}

impl Recipe {
    /// Estimates properties from these views, all at once, with intervals as wide as a photograph is hard.
    pub fn new<P: Into<String>>(
        regression: Regression,
        properties: impl IntoIterator<Item = P>,
        views: &[usize],
        calibration: Calibration,
    ) -> Self {
        let wanted = properties.into_iter().map(|property| Wanted {
            property: property.into(),
            views: views.to_vec(),
            range: None,
        });
        Self {
            regression,
            wanted: wanted.collect(),
            one_by_one: false,
            widths: Widths::default(),
            calibration,
        }
    }

    /// Fits to some of the surfaces, a part of which calibrates the intervals where
    /// [`Calibration::share`] keeps one aside; units stay whole. Of the same recipe and number the parts are the same.
    ///
    /// # Errors
    /// No property, views that differ where they are looked at one by one, too few units to part, one
    /// that calibrates and that the encoder saw, and what the regression says.
    pub fn fit(&self, examples: &Examples<'_>, surfaces: &[usize], number: u64) -> Result<Fitted> {
        let slots = self.slots()?;
        let split = self.calibration.part(examples.units, surfaces, number)?;
        examples.check_unseen(&split.validation)?;
        let steps = if self.one_by_one {
            (1..=slots.len()).collect()
        } else {
            vec![slots.len()]
        };
        let fit = Fitting {
            recipe: self,
            examples,
            surfaces,
            split,
            slots,
            steps,
            number,
        };
        fit.fitted()
    }

    /// All views that any property looks at, in the order in which they come up.
    ///
    /// # Errors
    /// No property or no view; views that differ, or one twice, where they are looked at one by one.
    pub fn slots(&self) -> Result<Vec<usize>> {
        let mut slots = Vec::new();
        for wanted in &self.wanted {
            if self.one_by_one && wanted.views != self.wanted[0].views {
                let found = format!("others for {}", wanted.property);
                let expected = "the same for all properties, to look at one by one";
                return refuse("views", found, expected);
            }
            for (at, view) in wanted.views.iter().enumerate() {
                if self.one_by_one && wanted.views[..at].contains(view) {
                    let expected = "each once, to look at one by one";
                    return refuse("views", format!("view {view} twice"), expected);
                }
                if !slots.contains(view) {
                    slots.push(*view);
                }
            }
        }
        if slots.is_empty() {
            return refuse("properties to estimate", "no view", "at least one");
        }
        Ok(slots)
    }
}

/// A recipe at work.
struct Fitting<'a> {
    recipe: &'a Recipe,
    examples: &'a Examples<'a>,
    surfaces: &'a [usize],
    split: Split,
    /// [`Recipe::slots`].
    slots: Vec<usize>,
    /// The numbers of views to be asked with, ascending.
    steps: Vec<usize>,
    number: u64,
}

impl Fitting<'_> {
    fn fitted(&self) -> Result<Fitted> {
        let folds = self.folds()?;
        let mut groups: BTreeMap<&[usize], Vec<usize>> = BTreeMap::new();
        for (at, wanted) in self.recipe.wanted.iter().enumerate() {
            groups.entry(&wanted.views).or_default().push(at);
        }
        let stages = self.steps.iter().map(|&views| {
            let groups = groups.iter();
            let groups = groups.map(|(&looked, properties)| {
                let one_by_one = self.recipe.one_by_one;
                let looked = if one_by_one { &looked[..views] } else { looked };
                self.group(looked, properties, &folds)
            });
            Ok(Stage {
                views,
                groups: groups.collect::<Result<_>>()?,
            })
        });
        let units = self.examples.units;
        let measure = |wanted: &Wanted| {
            let readings = self.readings(wanted, self.surfaces);
            Measure::of(wanted, &readings.into_iter().flatten().collect::<Vec<_>>())
        };
        let mut fitted = Fitted {
            measures: self.recipe.wanted.iter().map(measure).collect(),
            stages: stages.collect::<Result<_>>()?,
            familiar: self.familiar()?,
            level: self.recipe.calibration.level,
            joint: Interval::None("not calibrated".to_owned()),
            on: FittedOn {
                surfaces: self.surfaces.len(),
                units: units.among(self.surfaces),
                unit: units.unit(),
            },
            width: self.examples.data.embeddings.width(),
        };
        self.calibrate(&mut fitted)?;
        Ok(fitted)
    }

    /// Fits properties, by their places, that look at the same views.
    fn group(&self, looked: &[usize], properties: &[usize], folds: &[Vec<usize>]) -> Result<Group> {
        let recipe = self.recipe;
        let regression = if recipe.one_by_one {
            &recipe.regression.with_views(looked.len())?
        } else {
            &recipe.regression
        };
        let names = properties.iter().map(|&at| &recipe.wanted[at].property);
        let fit = Fit {
            regression,
            data: &self.examples.data,
            units: self.examples.units,
            seed: recipe.calibration.seed,
            number: self.number,
            properties: &names.cloned().collect::<Vec<_>>(),
            views: looked,
        };
        let slot = |view: &usize| self.slots.iter().position(|slot| slot == view);
        let Step {
            models,
            errors,
            least,
        } = fit.step(folds)?;
        let parted = !self.split.validation.is_empty();
        Ok(Group {
            properties: properties.to_vec(),
            slots: looked.iter().filter_map(slot).collect(),
            models,
            errors,
            whole: parted.then(|| fit.whole(self.surfaces)).transpose()?,
            least_errors: least,
        })
    }

    /// What photographs are held against, or why there is nothing: all surfaces where the encoder was
    /// taken as it is. Where it learned from some, a new surface is not exchangeable with those, and is
    /// held against one surface of each unit that it has not seen.
    fn familiar(&self) -> Result<Result<Familiar, String>> {
        let (units, seed) = (self.examples.units, self.recipe.calibration.seed);
        let mut against = self.surfaces.to_vec();
        let mut aside = self.split.validation.as_slice();
        if !self.examples.encoder_saw.is_empty() {
            aside = &[];
            let unseen = self.examples.unseen(self.surfaces);
            against = units.one_of_each(&unseen, seed, "familiar", self.number);
            if against.len() < LEAST_UNSEEN {
                return Ok(Err(format!(
                    "the encoder learned from the surfaces fitted to, and found {} {} that it has not \
                    seen, expected at least {LEAST_UNSEEN} for a p-value of 0.05",
                    against.len(),
                    units.unit()
                )));
            }
        }
        let embeddings = self.examples.data.embeddings;
        let seen = embeddings.select(&against, &self.slots)?;
        let one_of_each = units.one_of_each(aside, seed, "watched", self.number);
        let familiar = Familiar::of(&seen, &self.steps);
        Ok(familiar.map(|familiar| familiar.at(against, aside, &one_of_each)))
    }

    /// The surfaces to fit to, in the parts that say what error to expect; in one where there are too
    /// few units for that.
    fn folds(&self) -> Result<Vec<Vec<usize>>> {
        let (train, Calibration { share, seed, .. }) = (&self.split.train, self.recipe.calibration);
        let whole = || Ok(vec![train.clone()]);
        if self.recipe.widths == Widths::Constant || share.is_none() {
            return whole();
        }
        let units = self.examples.units;
        match units.folds(train, FOLDS, seed, "expected errors", self.number) {
            Ok(folds) => Ok(folds.into_iter().map(|fold| fold.validation).collect()),
            Err(SplitError::TooFew { .. }) => whole(),
            Err(error) => Err(error.into()),
        }
    }

    /// Of each property the largest error of each surface that was kept aside, over all stages, in
    /// expected errors; none where it was not read.
    fn scores(&self, fitted: &Fitted) -> Result<Vec<Vec<Option<f64>>>> {
        let aside = &self.split.validation;
        let wanted = self.recipe.wanted.iter();
        let truths: Vec<_> = wanted.map(|wanted| self.readings(wanted, aside)).collect();
        let zero = |truth: &Option<f64>| truth.map(|_| 0.0);
        let zeros = truths.iter().map(|of| of.iter().map(zero).collect());
        let mut scores: Vec<Vec<Option<f64>>> = zeros.collect();
        for stage in &fitted.stages {
            let slots = &self.slots[..stage.views];
            let embeddings = self.examples.data.embeddings.select(aside, slots)?;
            for (at, expected) in stage.expected(&embeddings)?.into_iter().enumerate() {
                let of_surface = scores[at].iter_mut().zip(&truths[at]);
                for ((score, truth), Expected { value, error }) in of_surface.zip(expected) {
                    let off = truth.map(|truth| (truth - value).abs() / error);
                    *score = score.zip(off).map(|(score, off)| score.max(off));
                }
            }
        }
        Ok(scores)
    }

    /// Sets how wide intervals are, by the surfaces that were kept aside.
    fn calibrate(&self, fitted: &mut Fitted) -> Result<()> {
        let (aside, scores) = (&self.split.validation, self.scores(fitted)?);
        let (units, level) = (self.examples.units, self.recipe.calibration.level);
        let averages = fitted.averages();
        for (measure, scores) in fitted.measures.iter_mut().zip(&scores) {
            let read = aside.iter().zip(scores);
            let read = read.filter_map(|(&surface, score)| Some((surface, (*score)?)));
            measure.interval = match radii(units, &read.collect::<Vec<_>>(), level) {
                Ok(mut times) => {
                    let one = times.remove(0);
                    // The photographs of several views are one estimate: there is nothing to average.
                    measure.several = averages.then_some(times);
                    Interval::Errors(one)
                }
                Err(reason) => self.no_interval(&reason),
            };
        }
        // All properties at once, by the surfaces of which all were read.
        let largest = |at: usize| {
            let mut of_properties = scores.iter().map(|scores| scores[at]);
            of_properties.try_fold(0.0_f64, |largest, score| Some(largest.max(score?)))
        };
        let read = aside.iter().enumerate();
        let read = read.filter_map(|(at, &surface)| Some((surface, largest(at)?)));
        fitted.joint = match radius(units, &read.collect::<Vec<_>>(), level) {
            Ok(times) => Interval::Errors(times),
            Err(reason) => self.no_interval(&reason),
        };
        Ok(())
    }

    fn no_interval(&self, reason: &ConformalError) -> Interval {
        Interval::None(match self.recipe.calibration.share {
            None => "no part of the surfaces was kept aside to calibrate it".to_owned(),
            Some(_) => reason.to_string(),
        })
    }

    /// What was measured of a property on each of the surfaces.
    fn readings(&self, wanted: &Wanted, surfaces: &[usize]) -> Vec<Option<f64>> {
        let readings = self.examples.data.readings;
        let column = readings.column(&wanted.property);
        let reading = |&surface: &usize| readings.get(surface, column?);
        surfaces.iter().map(reading).collect()
    }
}

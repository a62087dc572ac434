//! What is fitted, and to what.

use std::collections::BTreeSet;
use std::fmt::Display;

use rand::seq::SliceRandom as _;
use serde::{Deserialize, Serialize};
use sps_base::Unexpected;
use sps_base::streams::named_stream;

use crate::data::{Embeddings, Readings};
use crate::error::{Error, Result};

/// The tables that regressors are fitted to; one row per surface of the data set in each.
#[derive(Clone, Copy, Debug)]
pub struct TrainingData<'a> {
    /// Embeddings of the surfaces' views.
    pub embeddings: &'a Embeddings,
    /// Tactile readings, in measured units.
    pub readings: &'a Readings,
    /// The material of each surface; needed for labels from materials alone.
    pub materials: Option<&'a [String]>,
    /// A number for each surface: those of one number are never parted, neither by what is left out
    /// to choose a penalty nor by the folds of a stack. Each surface is for itself where none are
    /// given.
    pub units: Option<&'a [usize]>,
}

impl<'a> TrainingData<'a> {
    /// Embeddings and readings alone; the other tables are set by name.
    pub fn new(embeddings: &'a Embeddings, readings: &'a Readings) -> Self {
        Self {
            embeddings,
            readings,
            materials: None,
            units: None,
        }
    }

    /// With the material of each surface.
    #[must_use]
    pub fn with_materials(mut self, materials: &'a [String]) -> Self {
        self.materials = Some(materials);
        self
    }

    /// With the unit of each surface.
    #[must_use]
    pub fn with_units(mut self, units: &'a [usize]) -> Self {
        self.units = Some(units);
        self
    }

    /// Refuses tables of different numbers of surfaces.
    ///
    /// # Errors
    /// There are such.
    pub fn check(&self) -> Result<()> {
        let surfaces = self.embeddings.surfaces();
        let others = [
            ("readings", Some(self.readings.surfaces())),
            ("materials", self.materials.map(<[_]>::len)),
            ("units", self.units.map(<[_]>::len)),
        ];
        for (what, found) in others {
            if let Some(found) = found.filter(|&found| found != surfaces) {
                let expected = format!("{surfaces}, as there are embeddings");
                return refuse_plan(what, format!("{found} surfaces"), expected);
            }
        }
        Ok(())
    }
}

/// What to train.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Plan {
    /// Keys every random draw, together with the names of trial and purpose.
    pub seed: u64,
    /// The splits.
    pub reruns: Vec<Rerun>,
    /// The networks; each belongs to a property and a rerun.
    pub trials: Vec<Trial>,
}

/// One split of the surfaces.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Rerun {
    /// Its number, which keys its random streams.
    pub number: u64,
    /// The training surfaces, as indices into the tables; their order does not matter.
    pub training: Vec<usize>,
    /// Surfaces that are not trained on and tell which epoch of a training is the best, where it
    /// stops early; empty without. Who writes the plan draws them, by group where surfaces come in
    /// groups.
    pub validation: Vec<usize>,
}

/// One network: it depends on the configuration, the data, the seed, its property, its rerun and
/// its views, and on nothing else in the plan.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub struct Trial {
    /// The property to estimate.
    pub property: String,
    /// The number of its rerun.
    pub rerun: u64,
    /// The views of each surface to train on.
    pub views: Views,
}

/// Which views of a surface enter the slots of the visual input.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Views {
    /// These, in the order of the slots.
    Fixed(Vec<usize>),
    /// Distinct ones, drawn anew for each surface in each epoch.
    Random,
    /// These in each training step, in the order of the slots and for all surfaces of the step;
    /// after the last they come from the first on. Inputs are scaled as over all views.
    Steps(Vec<Vec<usize>>),
}

impl Plan {
    /// One trial for each of the properties in each rerun, all on view 0.
    pub fn each(seed: u64, properties: &[String], reruns: Vec<Rerun>) -> Self {
        let trials = reruns.iter().flat_map(|rerun| {
            properties.iter().map(|property| Trial {
                property: property.clone(),
                rerun: rerun.number,
                views: Views::Fixed(vec![0]),
            })
        });
        Self {
            seed,
            trials: trials.collect(),
            reruns,
        }
    }

    /// With these views in every trial.
    #[must_use]
    pub fn with_views(mut self, views: &Views) -> Self {
        for trial in &mut self.trials {
            trial.views = views.clone();
        }
        self
    }

    /// Refuses a plan that does not fit the data, or a model that takes `views` views; `None` is
    /// a model that takes any number of fixed ones.
    ///
    /// # Errors
    /// What does not fit; a property without a training reading.
    pub fn check(&self, views: Option<usize>, data: &TrainingData<'_>) -> Result<()> {
        data.check()?;
        for (at, rerun) in self.reruns.iter().enumerate() {
            if self.reruns[..at].iter().any(|r| r.number == rerun.number) {
                let found = format!("number {} twice", rerun.number);
                return refuse_plan("reruns", found, "each number once");
            }
            rerun.check(data)?;
        }
        for (at, trial) in self.trials.iter().enumerate() {
            if self.trials[..at].contains(trial) {
                let found = format!("{} of rerun {} twice", trial.property, trial.rerun);
                return refuse_plan("trials", found, "each trial once");
            }
            trial.check(self, views, data)?;
        }
        Ok(())
    }

    /// The plan with so many training surfaces of each rerun at most, drawn at random where there
    /// are more.
    pub(crate) fn thinned(&self, at_most: usize) -> Self {
        let mut plan = self.clone();
        let crowded = plan.reruns.iter_mut();
        for rerun in crowded.filter(|rerun| rerun.training.len() > at_most) {
            rerun.training.sort_unstable();
            let mut rng = named_stream(plan.seed, "thinned", rerun.number);
            rerun.training.partial_shuffle(&mut rng, at_most);
            // The drawn ones stand at the end.
            rerun.training.drain(..rerun.training.len() - at_most);
        }
        plan
    }

    /// The training surfaces of a checked plan's trial that have a reading, with it; ascending.
    pub(crate) fn readings(&self, data: &TrainingData<'_>, trial: &Trial) -> Vec<(usize, f64)> {
        let column = data.readings.column(&trial.property);
        let training = self.rerun(trial.rerun).map(|rerun| &rerun.training);
        let of = |&surface: &usize| Some((surface, data.readings.get(surface, column?)?));
        let mut readings: Vec<_> = training.into_iter().flatten().filter_map(of).collect();
        readings.sort_unstable_by_key(|(surface, _)| *surface);
        readings
    }

    /// Refuses a checked plan with a trial that no validation surface says anything about.
    ///
    /// # Errors
    /// There is such a trial.
    pub fn check_validation(&self, data: &TrainingData<'_>) -> Result<()> {
        for trial in &self.trials {
            let column = data.readings.column(&trial.property);
            let validation = self.rerun(trial.rerun).map(|rerun| &rerun.validation);
            let mut read = validation.into_iter().flatten().copied();
            if !read.any(|s| column.is_some_and(|column| data.readings.get(s, column).is_some())) {
                let what = format!("validation surfaces of rerun {}", trial.rerun);
                let found = format!("none with a reading of {}", trial.property);
                return refuse_plan(what, found, "at least one, for early stopping");
            }
        }
        Ok(())
    }

    /// The rerun of this number.
    pub fn rerun(&self, number: u64) -> Option<&Rerun> {
        self.reruns.iter().find(|rerun| rerun.number == number)
    }
}

impl Rerun {
    /// Without surfaces for validation.
    pub fn new(number: u64, training: impl IntoIterator<Item = usize>) -> Self {
        Self {
            number,
            training: training.into_iter().collect(),
            validation: Vec::new(),
        }
    }

    fn check(&self, data: &TrainingData<'_>) -> Result<()> {
        if self.training.is_empty() {
            let what = format!("training surfaces of rerun {}", self.number);
            return refuse_plan(what, "none", "at least one");
        }
        let surfaces = data.embeddings.surfaces();
        let mut seen = BTreeSet::new();
        for (part, indices) in [
            ("training", &self.training),
            ("validation", &self.validation),
        ] {
            let what = || format!("{part} surfaces of rerun {}", self.number);
            for &surface in indices {
                let index = format!("index {surface}");
                if surface >= surfaces {
                    return refuse_plan(what(), index, format!("below {surfaces}"));
                }
                if !seen.insert(surface) {
                    return refuse_plan(what(), format!("{index} twice"), "each once");
                }
            }
        }
        Ok(())
    }
}

impl Trial {
    fn check(&self, plan: &Plan, views: Option<usize>, data: &TrainingData<'_>) -> Result<()> {
        let what = || format!("trial {} of rerun {}", self.property, self.rerun);
        let Some(column) = data.readings.column(&self.property) else {
            let known = data.readings.properties().join(", ");
            return refuse_plan(what(), "unknown property", format!("one of {known}"));
        };
        let Some(rerun) = plan.rerun(self.rerun) else {
            return refuse_plan(what(), "no such rerun", "a rerun of the plan");
        };
        let mut readings = rerun.training.iter().map(|&s| data.readings.get(s, column));
        if !readings.any(|reading| reading.is_some()) {
            return Err(Error::NotMeasured {
                property: self.property.clone(),
                rerun: self.rerun,
            });
        }
        self.check_views(views, data.embeddings.views())
            .or_else(|(found, expected)| refuse_plan(what(), found, expected))
    }

    fn check_views(&self, wanted: Option<usize>, views: usize) -> Result<(), (String, String)> {
        let steps = match &self.views {
            Views::Fixed(picked) => std::slice::from_ref(picked),
            Views::Steps(steps) => steps,
            Views::Random => match wanted {
                Some(wanted) if wanted > views => {
                    let expected = format!("at most the {views} that there are");
                    return Err((format!("{wanted} random views"), expected));
                }
                Some(_) => return Ok(()),
                None => return Err(("random views for view pooling".into(), "fixed views".into())),
            },
        };
        if steps.is_empty() {
            return Err(("views for no step".into(), "at least one".into()));
        }
        for picked in steps {
            if picked.is_empty() || wanted.is_some_and(|wanted| wanted != picked.len()) {
                let wanted = wanted.map_or("at least one".into(), |n| n.to_string());
                return Err((format!("{} views", picked.len()), wanted));
            }
            if let Some(view) = picked.iter().find(|&&view| view >= views) {
                return Err((format!("view {view}"), format!("below {views}")));
            }
        }
        Ok(())
    }
}

fn refuse_plan(what: impl Display, found: impl Display, expected: impl Display) -> Result<()> {
    Err(Error::Plan(Unexpected::new(what, found, expected)))
}

//! What of an experiment is done, what is missing, and how long that will take by what was measured in
//! its folder. Nothing is computed for it and nothing written.

mod looking;
mod print;
mod times;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use anyhow::Result;
use sps_dataset::Source;

use super::deal::{Dealt, Item, items};
use super::prepared::Prepared;
use super::{Journals, shards};
use crate::config::Experiment;
use crate::data::{self, About, WithSource};
use crate::work::Shard;
use looking::Looking;

/// An experiment before it is run.
pub(crate) struct Outlook {
    experiment: String,
    folder: PathBuf,
    shard: Option<Shard>,
    encoders: Vec<OfEncoder>,
    methods: Vec<OfMethod>,
    /// As they are dealt to shards.
    items: Vec<Item>,
}

/// An encoder, and what it has to do.
#[derive(Default)]
struct OfEncoder {
    name: String,
    /// Places of the methods that are fitted on it.
    methods: Vec<usize>,
    /// Frames to encode, as far as it is known which will be looked at.
    frames: usize,
    /// Splits on which it is to be trained.
    untrained: Vec<usize>,
    seconds_per_frame: Option<f64>,
    seconds_per_training: Option<f64>,
}

/// A method, and how far it is.
#[derive(Default)]
struct OfMethod {
    id: String,
    of_split: BTreeMap<usize, Counts>,
    seconds_per_trial: Option<f64>,
    seconds_per_selection: Option<f64>,
}

/// What one split of a method comes to.
#[derive(Clone, Copy, Default)]
struct Counts {
    trials: usize,
    trials_done: usize,
    selections: usize,
    selections_done: usize,
}

/// Looks at an experiment, or at one shard of it, whose folder is `folder`. `fresh`: as if nothing
/// had been done there.
pub(crate) fn outlook(
    experiment: &Experiment,
    folder: &Path,
    fresh: bool,
    shard: Option<Shard>,
) -> Result<Outlook> {
    let look = Look {
        experiment,
        folder,
        fresh,
        shard,
    };
    data::with_source(&experiment.data, look)
}

struct Look<'a> {
    experiment: &'a Experiment,
    folder: &'a Path,
    fresh: bool,
    shard: Option<Shard>,
}

impl WithSource for Look<'_> {
    type Output = Outlook;

    fn call<S: Source>(self, source: &S, about: About) -> Result<Outlook> {
        let experiment = self.experiment;
        let prepared = Prepared::new(experiment, source, &about)?;
        let splits = prepared.splits.all.len();
        let dealt = match self.shard {
            Some(shard) => Dealt::to_shard(shard, &prepared.methods, splits)?,
            None => prepared.dealt()?,
        };
        let mut journals = Journals::look(self.folder)?;
        for of_shard in shards::folders(self.folder)? {
            journals.know(Journals::look(&of_shard.path)?);
        }
        let looking = Looking {
            journals: &mut journals,
            properties: match experiment.properties.len() {
                0 => source.tactile().properties.len(),
                some => some,
            },
            fresh: self.fresh,
        };
        let mut encoders = Vec::new();
        let mut methods = Vec::new();
        for (places, (encoder, of_methods)) in prepared.with_encoders(source, &dealt, looking)? {
            methods.extend(places.iter().copied().zip(of_methods));
            encoders.push(OfEncoder {
                methods: places,
                ..encoder
            });
        }
        methods.sort_by_key(|(at, _)| *at);
        Ok(Outlook {
            experiment: experiment.name.clone(),
            folder: self.folder.to_owned(),
            shard: self.shard,
            encoders,
            methods: methods.into_iter().map(|(_, method)| method).collect(),
            items: items(&prepared.methods, splits)?,
        })
    }
}

impl Counts {
    fn trials_missing(self) -> usize {
        self.trials - self.trials_done
    }

    fn selections_missing(self) -> usize {
        self.selections - self.selections_done
    }
}

impl OfMethod {
    /// Of all its splits.
    fn counts(&self) -> Counts {
        let add = |sum: Counts, of_split: &Counts| Counts {
            trials: sum.trials + of_split.trials,
            trials_done: sum.trials_done + of_split.trials_done,
            selections: sum.selections + of_split.selections,
            selections_done: sum.selections_done + of_split.selections_done,
        };
        self.of_split.values().fold(Counts::default(), add)
    }
}

//! Going the way of a run, as far as it goes without computing anything.

use std::collections::BTreeSet;

use anyhow::{Error, Result};
use sps_dataset::Source;

use super::{Counts, OfEncoder, OfMethod};
use crate::config::Looks;
use crate::encoder;
use crate::run::encoded::Encoded;
use crate::run::found::Selections;
use crate::run::frozen::Folds;
use crate::run::prepared::WithEncoder;
use crate::run::select::Selecting;
use crate::run::stage::Stages;
use crate::run::trials::{self, Planned};
use crate::run::{Dealt, Encodings, Journals};
use crate::work::Undone;

/// Looks for what is done in the journals and the cache.
pub(super) struct Looking<'a> {
    pub journals: &'a mut Journals,
    /// That are estimated.
    pub properties: usize,
    /// Whether to look away from what is done.
    pub fresh: bool,
}

impl<'m> WithEncoder<'m> for Looking<'_> {
    type Output = (OfEncoder, Vec<OfMethod>);

    fn call<S: Source>(
        &mut self,
        encoded: &Encoded<'_, 'm>,
        source: &S,
        sequence: Option<Vec<usize>>,
    ) -> Result<Self::Output> {
        let mut seen = Seen::new(encoded, self);
        match told(encoded.stages(source, sequence))? {
            Err(undone) => seen.lack(undone, &encoded.dealt.of_any()),
            Ok(stages) => {
                for splits in groups(encoded) {
                    self.group(encoded, source, (&stages, &splits), &mut seen)?;
                }
            }
        }
        Ok(seen.measured(self.fresh))
    }
}

/// The splits that are looked at together.
fn groups(encoded: &Encoded<'_, '_>) -> Vec<BTreeSet<usize>> {
    let splits = encoded.dealt.of_any();
    if encoded.encoder.learns() {
        splits.into_iter().map(|split| [split].into()).collect()
    } else {
        vec![splits]
    }
}

impl Looking<'_> {
    /// Counts what is done of some splits.
    fn group<S: Source>(
        &mut self,
        encoded: &Encoded<'_, '_>,
        source: &S,
        (stages, splits): (&Stages<'_, S>, &BTreeSet<usize>),
        seen: &mut Seen,
    ) -> Result<()> {
        let all = &encoded.splits.all;
        let found = Encodings::of_splits(stages, encoded.encoder, all, splits);
        let mut group = match told(found)? {
            Err(undone) => {
                seen.lack(undone, splits);
                return Ok(());
            }
            Ok(mut groups) => groups.remove(0),
        };
        seen.train_seconds.push(group.stage.train_seconds);
        if encoded.looks_in_hindsight() {
            let looked = group.look_at_all(encoded.experiment, source, all);
            if let Err(undone) = told(looked)? {
                seen.lack(undone, splits);
                return Ok(());
            }
        }
        let dealt = encoded.dealt.within(&group.splits);
        let mut selections = Selections::default();
        let lacking = self.select(encoded, &group, &dealt, &mut selections)?;
        seen.select(encoded, &dealt, &lacking, &selections);
        let ready = dealt.without(&lacking);
        let planned = encoded.planned(&group, &ready, &selections)?;
        match told(encoded.look(source, &mut group, &planned))? {
            Ok(()) => {
                for (at, planned) in planned.into_iter().enumerate() {
                    self.count(encoded, &group, (at, planned), seen)?;
                }
            }
            Err(undone) => {
                seen.lack(undone, &BTreeSet::new());
                self.one_by_one(encoded, source, (&mut group, planned), seen)?;
            }
        }
        Ok(())
    }

    /// Counts the trials of those methods alone that look at nothing that is not encoded.
    fn one_by_one<S: Source>(
        &self,
        encoded: &Encoded<'_, '_>,
        source: &S,
        (group, planned): (&mut Encodings, Vec<Vec<Planned>>),
        seen: &mut Seen,
    ) -> Result<()> {
        let methods = planned.len();
        for (at, planned) in planned.into_iter().enumerate() {
            let mut alone = vec![Vec::new(); methods];
            alone[at].clone_from(&planned);
            if told(encoded.look(source, group, &alone))?.is_ok() {
                self.count(encoded, group, (at, planned), seen)?;
            }
        }
        Ok(())
    }

    /// The selections that the journal has; the place and split of each that it lacks.
    fn select(
        &mut self,
        encoded: &Encoded<'_, '_>,
        group: &Encodings,
        dealt: &Dealt,
        selections: &mut Selections,
    ) -> Result<Vec<(usize, usize)>> {
        let selecting = Selecting {
            folds: Folds {
                experiment: encoded.experiment,
                encodings: group,
                splits: encoded.splits,
            },
            journal: &mut self.journals.selections,
        };
        selecting.look(&encoded.methods, dealt, selections)
    }

    /// Counts the trials of a method that the journal has.
    fn count(
        &self,
        encoded: &Encoded<'_, '_>,
        group: &Encodings,
        (at, planned): (usize, Vec<Planned>),
        seen: &mut Seen,
    ) -> Result<()> {
        let (experiment, method) = (encoded.experiment, encoded.methods[at]);
        let own = encoded.splits.of_method(method, experiment.seed)?;
        for trial in trials::keyed(experiment, method, group, &own.all, planned)? {
            if self.journals.trials.get(&trial.key).is_some()
                && let Some(counts) = seen.methods[at].of_split.get_mut(&trial.rerun)
            {
                counts.trials_done += 1;
            }
        }
        Ok(())
    }
}

/// What was seen of the methods of an encoder.
struct Seen {
    encoder: OfEncoder,
    methods: Vec<OfMethod>,
    /// Of the selections that were made, by method.
    selection_seconds: Vec<Vec<f64>>,
    /// Of the trainings of the encoder that are done.
    train_seconds: Vec<f64>,
}

impl Seen {
    /// Nothing done yet.
    fn new(encoded: &Encoded<'_, '_>, looking: &Looking<'_>) -> Self {
        let properties = looking.properties;
        let methods = encoded.methods.iter().enumerate().map(|(at, method)| {
            let selects = matches!(method.looks, Looks::Selected(_));
            let counts = Counts {
                trials: properties,
                selections: if selects { properties } else { 0 },
                ..Counts::default()
            };
            let splits = encoded.dealt.splits_of(at).iter();
            let own = looking.journals.trials.records();
            let own = own.filter(|outcome| outcome.method == method.id);
            OfMethod {
                id: method.id.clone(),
                of_split: splits.map(|&split| (split, counts)).collect(),
                seconds_per_trial: mean(own.map(|outcome| outcome.train_seconds)),
                seconds_per_selection: None,
            }
        });
        let name = encoder::describe(encoded.encoder);
        let encodings = looking.journals.encodings.records();
        let encodings: Vec<_> = encodings.filter(|one| one.encoder == name).collect();
        let frames: usize = encodings.iter().map(|one| one.frames).sum();
        let seconds: f64 = encodings.iter().map(|one| one.seconds).sum();
        Self {
            methods: methods.collect(),
            encoder: OfEncoder {
                name,
                seconds_per_frame: (frames > 0).then(|| seconds / frames as f64),
                ..OfEncoder::default()
            },
            selection_seconds: vec![Vec::new(); encoded.methods.len()],
            train_seconds: Vec::new(),
        }
    }

    /// Notes what stands in the way on some splits.
    fn lack(&mut self, undone: Undone, splits: &BTreeSet<usize>) {
        match undone {
            Undone::Frames(count) => self.encoder.frames += count,
            Undone::Training => self.encoder.untrained.extend(splits),
        }
    }

    /// Counts the selections that were made.
    fn select(
        &mut self,
        encoded: &Encoded<'_, '_>,
        dealt: &Dealt,
        lacking: &[(usize, usize)],
        selections: &Selections,
    ) {
        for (at, method) in self.methods.iter_mut().enumerate() {
            for &split in dealt.splits_of(at) {
                let lacking = lacking.iter().filter(|one| **one == (at, split)).count();
                if let Some(counts) = method.of_split.get_mut(&split) {
                    counts.selections_done = counts.selections - lacking;
                }
            }
            let made = selections.of_method(&encoded.methods[at].id);
            self.selection_seconds[at].extend(made.map(|found| found.seconds));
        }
    }

    /// With the times that were measured; `fresh`: as if nothing had been done.
    fn measured(mut self, fresh: bool) -> (OfEncoder, Vec<OfMethod>) {
        for (method, seconds) in self.methods.iter_mut().zip(self.selection_seconds) {
            method.seconds_per_selection = mean(seconds.into_iter());
            if fresh {
                for counts in method.of_split.values_mut() {
                    (counts.trials_done, counts.selections_done) = (0, 0);
                }
            }
        }
        self.encoder.seconds_per_training = mean(self.train_seconds.into_iter());
        (self.encoder, self.methods)
    }
}

/// Tells what is not done from what went wrong.
fn told<T>(result: Result<T>) -> Result<Result<T, Undone>> {
    result
        .map(Ok)
        .or_else(|error: Error| error.downcast::<Undone>().map(Err))
}

fn mean(values: impl Iterator<Item = f64>) -> Option<f64> {
    let values: Vec<f64> = values.collect();
    let sum: f64 = values.iter().sum();
    (!values.is_empty()).then(|| sum / values.len() as f64)
}

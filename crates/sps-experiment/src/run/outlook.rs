//! What of an experiment is done and what is missing. Nothing is computed for it and nothing written.

use std::collections::BTreeSet;
use std::iter;
use std::path::Path;

use anyhow::{Error, Result};

use super::encoded::Encoded;
use super::found::Selections;
use super::frozen::Folds;
use super::prepared::Prepared;
use super::stage::Stages;
use super::{Encodings, Journals, shards, tables};
use crate::config::{Experiment, Looks};
use crate::data;
use crate::encoder;
use crate::text::{aligned, counted};
use crate::work::{Shard, Undone, Work};

/// What is done and missing of an experiment whose folder is `folder`, or of one shard of it, as lines
/// for the terminal.
///
/// # Errors
/// Data or a journal that cannot be read; methods that do not fit the data.
pub fn outlook(experiment: &Experiment, folder: &Path, shard: Option<Shard>) -> Result<String> {
    let (source, about) = data::open(&experiment.data)?;
    let prepared = Prepared::new(experiment, source.as_ref(), &about)?;
    let dealt = prepared.dealt(shard.map_or(experiment.work, Work::Shard))?;
    let mut journals = Journals::look(folder)?;
    for of_shard in shards::folders(folder)? {
        journals.know(Journals::look(&of_shard.path)?);
    }
    let mut looking = Looking {
        journals,
        properties: tables::properties(source.as_ref(), &experiment.properties)?.len(),
        encoders: Vec::new(),
    };
    let methods = prepared.with_encoders(&dealt, |encoded| looking.of_encoder(encoded))?;
    let head = ["method", "done", "missing", "views selected", "missing"].map(str::to_owned);
    let lines = methods.iter().map(|(id, counts)| {
        let selects = counts[2..] != [0, 0];
        let counts = counts.iter().take(if selects { 4 } else { 2 });
        let counts = counts.map(ToString::to_string);
        iter::once(id.clone()).chain(counts).collect()
    });
    let lines: Vec<Vec<String>> = iter::once(head.to_vec()).chain(lines).collect();
    let is_whole = methods.iter().all(|(_, counts)| counts[1] == 0);
    Ok(format!(
        "{} in {}{}\n{}{}{}",
        experiment.name,
        folder.display(),
        shard.map_or(String::new(), |shard| format!(", shard {shard}")),
        aligned(&lines, |at| at == 0),
        looking.encoders.concat(),
        if is_whole { "nothing is missing\n" } else { "" },
    ))
}

/// Of a method: trials done and missing, selections of views done and missing.
type Counts = [usize; 4];

/// What is done and missing of the methods of an encoder.
struct Seen {
    methods: Vec<Counts>,
    frames: usize,
    /// Splits on which the encoder is not trained.
    untrained: usize,
}

impl Seen {
    /// What came of a step on so many splits; nothing where something that it needs is not there.
    fn there<T>(&mut self, step: Result<T>, splits: usize) -> Result<Option<T>> {
        match told(step)? {
            Ok(done) => return Ok(Some(done)),
            Err(Undone::Frames(count)) => self.frames += count,
            Err(Undone::Training) => self.untrained += splits,
        }
        Ok(None)
    }
}

/// Tells what is not done from what went wrong.
fn told<T>(step: Result<T>) -> Result<Result<T, Undone>> {
    step.map(Ok)
        .or_else(|error: Error| error.downcast::<Undone>().map(Err))
}

/// Goes the way of a run as far as the journals and the cache allow.
struct Looking {
    journals: Journals,
    /// How many are estimated.
    properties: usize,
    /// A line for each thing that encoders have yet to do.
    encoders: Vec<String>,
}

impl Looking {
    /// What is done and missing of each method of an encoder, with the method's id; adds to `encoders` what the
    /// encoder has yet to do.
    fn of_encoder(&mut self, encoded: &Encoded<'_, '_>) -> Result<Vec<(String, Counts)>> {
        let methods = encoded.methods.iter().enumerate().map(|(at, method)| {
            let all = self.properties * encoded.dealt.splits_of(at).len();
            let selects = matches!(method.looks, Looks::Selected(_));
            [0, all, 0, if selects { all } else { 0 }]
        });
        let mut seen = Seen {
            methods: methods.collect(),
            frames: 0,
            untrained: 0,
        };
        self.look(encoded, &mut seen)?;
        let encoder = encoder::describe(encoded.encoder);
        if seen.frames > 0 {
            let frames = counted(seen.frames, "frame");
            self.encoders
                .push(format!("  {encoder}: {frames} to encode\n"));
        }
        if seen.untrained > 0 {
            let splits = counted(seen.untrained, "split");
            let line = format!("  {encoder}: to be trained on {splits}\n");
            self.encoders.push(line);
        }
        let ids = encoded.methods.iter().map(|method| method.id.clone());
        Ok(ids.zip(seen.methods).collect())
    }

    fn look(&self, encoded: &Encoded<'_, '_>, seen: &mut Seen) -> Result<()> {
        let splits = encoded.dealt.of_any();
        let Some(stages) = seen.there(Stages::new(encoded), 0)? else {
            return Ok(());
        };
        let groups: Vec<BTreeSet<usize>> = if encoded.encoder.learns() {
            splits.into_iter().map(|split| [split].into()).collect()
        } else {
            vec![splits]
        };
        for splits in groups {
            let all = &encoded.splits.all;
            let group = stages.of_splits(all, &splits);
            if let Some(mut group) = seen.there(group, splits.len())? {
                self.count(encoded, &mut group[0], seen)?;
            }
        }
        Ok(())
    }

    /// Counts what is done of splits that share their embeddings.
    fn count(
        &self,
        encoded: &Encoded<'_, '_>,
        group: &mut Encodings,
        seen: &mut Seen,
    ) -> Result<()> {
        let (experiment, splits) = (encoded.experiment, encoded.splits);
        if encoded.looks_in_hindsight() {
            let looked = group.look_at_all(encoded);
            if seen.there(looked, 0)?.is_none() {
                return Ok(());
            }
        }
        let mut selections = Selections::default();
        let dealt = encoded.dealt.within(&group.splits);
        let encodings = &*group;
        let folds = Folds {
            experiment,
            encodings,
            splits,
        };
        let journal = &self.journals.selections;
        let lacking = folds.look(&encoded.methods, &dealt, journal, &mut selections)?;
        for (at, [.., selected, missing]) in seen.methods.iter_mut().enumerate() {
            let lacking = lacking.iter().filter(|one| one.0 == at).count();
            if *missing > 0 {
                let done = self.properties * dealt.splits_of(at).len() - lacking;
                (*selected, *missing) = (*selected + done, *missing - done);
            }
        }
        let planned = encoded.planned(group, &dealt.without(&lacking), &selections)?;
        let looked = group.look(encoded, &planned);
        let is_whole = seen.there(looked, 0)?.is_some();
        let methods = planned.len();
        for (at, planned) in planned.into_iter().enumerate() {
            if !is_whole {
                let mut alone = vec![Vec::new(); methods];
                alone[at].clone_from(&planned);
                if told(group.look(encoded, &alone))?.is_err() {
                    continue;
                }
            }
            let method = encoded.methods[at];
            let own = splits.of_method(method, experiment.seed)?;
            let keyed = encoded.judge(method, group, &own).keyed(planned)?;
            let done = keyed.iter();
            let done = done.filter(|one| self.journals.trials.get(&one.key).is_some());
            let ([trials, missing, ..], done) = (&mut seen.methods[at], done.count());
            (*trials, *missing) = (*trials + done, *missing - done);
        }
        Ok(())
    }
}

//! An experiment on its data, one encoder after the other.

use anyhow::Result;
use sps_dataset::Source;

use super::deal::Dealt;
use super::encoded::Encoded;
use super::{Splits, by_encoder, estimates, views};
use crate::config::{Experiment, Method, Network};
use crate::data::About;
use crate::sequences::Sequences;
use crate::work::Work;

/// An experiment with all that is known of its data before any of it is looked at.
pub(super) struct Prepared<'a> {
    experiment: &'a Experiment,
    source: &'a dyn Source,
    about: &'a About,
    /// As they are on this data.
    pub methods: Vec<Method>,
    pub splits: Splits,
}

impl<'a> Prepared<'a> {
    pub(super) fn new(
        experiment: &'a Experiment,
        source: &'a dyn Source,
        about: &'a About,
    ) -> Result<Self> {
        let methods = experiment.methods.iter().map(|method| method.on(source));
        let mut methods = methods.collect::<Result<Vec<_>>>()?;
        let splits = Splits::of(experiment, source.surfaces())?;
        estimates::read(experiment, &mut methods, (source, about), &splits)?;
        Ok(Self {
            experiment,
            source,
            about,
            methods,
            splits,
        })
    }

    /// What is dealt to a process that does this work.
    pub(super) fn dealt(&self, work: Work) -> Result<Dealt> {
        Dealt::to(work, &self.methods, self.splits.all.len())
    }

    /// Does `work` with each encoder of which anything is dealt; what came of each of its methods, in the
    /// order of all methods.
    pub(super) fn with_encoders<'m, T>(
        &'m self,
        dealt: &Dealt,
        mut work: impl FnMut(&Encoded<'_, 'm>) -> Result<Vec<T>>,
    ) -> Result<Vec<T>> {
        let mut done = Vec::new();
        for (encoder, members) in by_encoder(&self.methods) {
            let sequences;
            let mut encoded = Encoded {
                experiment: self.experiment,
                source: self.source,
                about: self.about,
                sequence: None,
                encoder,
                methods: members.iter().map(|&at| &self.methods[at]).collect(),
                splits: &self.splits,
                dealt: dealt.of(&members),
            };
            if encoded.dealt.of_any().is_empty() {
                continue;
            }
            if let Network::Sequences { frames, .. } = encoder.network {
                let views = views::equidistant(self.source, frames)?;
                sequences = Sequences::new(self.source, views.clone());
                (encoded.source, encoded.sequence) = (&sequences, Some(views));
            }
            done.extend(members.into_iter().zip(work(&encoded)?));
        }
        done.sort_by_key(|(place, _)| *place);
        Ok(done.into_iter().map(|(_, of_method)| of_method).collect())
    }
}

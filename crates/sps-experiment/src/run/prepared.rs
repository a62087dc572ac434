//! An experiment on its data, one encoder after the other.

use anyhow::Result;
use sps_dataset::Source;

use super::deal::Dealt;
use super::encoded::Encoded;
use super::{Splits, by_encoder, estimates, views};
use crate::config::{Experiment, Method, Network};
use crate::data::About;
use crate::sequences::Sequences;

/// An experiment with all that is known of its data before any of it is looked at.
pub(super) struct Prepared<'a> {
    pub experiment: &'a Experiment,
    pub about: &'a About,
    /// As they are on this data.
    pub methods: Vec<Method>,
    pub splits: Splits,
}

/// What is done with the methods of one encoder, those of `encoded`; `sequence` says what the one view
/// of a source of sequences is made of.
pub(super) trait WithEncoder<'m> {
    type Output;

    fn call<S: Source>(
        &mut self,
        encoded: &Encoded<'_, 'm>,
        source: &S,
        sequence: Option<Vec<usize>>,
    ) -> Result<Self::Output>;
}

impl<'a> Prepared<'a> {
    pub(super) fn new<S: Source>(
        experiment: &'a Experiment,
        source: &S,
        about: &'a About,
    ) -> Result<Self> {
        let methods = experiment.methods.iter().map(|method| method.on(source));
        let mut methods = methods.collect::<Result<Vec<_>>>()?;
        let splits = Splits::of(experiment, source.surfaces())?;
        estimates::read(experiment, &mut methods, (source, about), &splits)?;
        Ok(Self {
            experiment,
            about,
            methods,
            splits,
        })
    }

    /// What is dealt to a process that does what `experiment.work` says.
    pub(super) fn dealt(&self) -> Result<Dealt> {
        let splits = self.splits.all.len();
        Dealt::to(self.experiment.work, &self.methods, splits)
    }

    /// Does `work` with each encoder of which anything is dealt; the places of its methods with what
    /// came of it.
    pub(super) fn with_encoders<'m, S: Source, W: WithEncoder<'m>>(
        &'m self,
        source: &S,
        dealt: &Dealt,
        mut work: W,
    ) -> Result<Vec<(Vec<usize>, W::Output)>> {
        let mut done = Vec::new();
        for (encoder, members) in by_encoder(&self.methods) {
            let encoded = Encoded {
                experiment: self.experiment,
                about: self.about,
                encoder,
                methods: members.iter().map(|&at| &self.methods[at]).collect(),
                splits: &self.splits,
                dealt: dealt.of(&members),
            };
            if encoded.dealt.of_any().is_empty() {
                continue;
            }
            let one = match encoder.network {
                Network::Sequences { frames, .. } => {
                    let views = views::equidistant(source, frames)?;
                    let sequences = Sequences::new(source, views.clone());
                    work.call(&encoded, &sequences, Some(views))?
                }
                _ => work.call(&encoded, source, None)?,
            };
            done.push((members, one));
        }
        Ok(done)
    }
}

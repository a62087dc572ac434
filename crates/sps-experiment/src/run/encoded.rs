//! The methods that share an encoder, from its embeddings to their outcomes.

use anyhow::Result;
use sps_dataset::Source;

use super::costs;
use super::deal::Dealt;
use super::fit::Judge;
use super::found::{Found, Selections};
use super::frozen::Folds;
use super::results::MethodRow;
use super::stage::Stages;
use super::trials::{Planned, TrialSpec};
use super::{Encodings, Journals, Splits, views};
use crate::config::{EncoderSpec, Experiment, Method};
use crate::data::About;
use crate::journal::Journal;

/// Methods that share an encoder.
pub(crate) struct Encoded<'a, 'm> {
    pub experiment: &'a Experiment,
    pub source: &'a dyn Source,
    pub about: &'a About,
    /// What the one view of a source of sequences is made of.
    pub sequence: Option<Vec<usize>>,
    pub encoder: &'a EncoderSpec,
    pub methods: Vec<&'m Method>,
    pub splits: &'a Splits,
    /// What of the methods is done here.
    pub dealt: Dealt,
}

impl<'m> Encoded<'_, 'm> {
    /// Selects views and runs the trials, as far as they are dealt and the journals lack them: what
    /// methods were fitted on, and the trials of each.
    pub(super) fn fitted(
        &self,
        journals: &mut Journals,
    ) -> Result<(Vec<Encodings>, Selections, Vec<Vec<TrialSpec>>)> {
        let stages = Stages::new(self)?;
        let mut groups = stages.of_splits(&self.splits.all, &self.dealt.of_any())?;
        if self.looks_in_hindsight() {
            for group in &mut groups {
                group.look_at_all(self)?;
            }
        }
        let selections = self.select(&groups, &mut journals.selections)?;
        let trials = self.fit(&mut groups, &selections, journals)?;
        Ok((groups, selections, trials))
    }

    /// Whether any method that is dealt chooses its views by the surfaces held out.
    pub(super) fn looks_in_hindsight(&self) -> bool {
        let methods = self.methods.iter().enumerate();
        let mut dealt = methods.filter(|(at, _)| !self.dealt.splits_of(*at).is_empty());
        dealt.any(|(_, method)| method.in_hindsight())
    }

    /// The rows of the methods.
    pub(super) fn rows(&self, journals: &mut Journals) -> Result<Vec<MethodRow<'m>>> {
        let (groups, selections, trials) = self.fitted(journals)?;
        let rows = self.methods.iter().zip(trials);
        let rows = rows
            .map(|(method, trials)| MethodRow::of(method, trials, &journals.trials, &selections));
        let mut rows = rows.collect::<Result<Vec<_>>>()?;
        costs::measure(self.source, self.splits, &groups[0].stage, &mut rows)?;
        let seconds = groups.iter().map(|group| group.stage.train_seconds).sum();
        for row in &mut rows {
            row.costs.encoder_train_seconds = seconds;
        }
        Ok(rows)
    }

    fn select(&self, groups: &[Encodings], journal: &mut Journal<Found>) -> Result<Selections> {
        let mut selections = Selections::default();
        for group in groups {
            let folds = Folds {
                experiment: self.experiment,
                encodings: group,
                splits: self.splits,
            };
            let dealt = self.dealt.within(&group.splits);
            folds.select(&self.methods, &dealt, journal, &mut selections)?;
        }
        Ok(selections)
    }

    /// Fits what the journal lacks; the trials of each method.
    fn fit(
        &self,
        groups: &mut [Encodings],
        selections: &Selections,
        journals: &mut Journals,
    ) -> Result<Vec<Vec<TrialSpec>>> {
        let mut trials: Vec<Vec<TrialSpec>> = self.methods.iter().map(|_| Vec::new()).collect();
        for group in groups {
            let dealt = self.dealt.within(&group.splits);
            let planned = self.planned(group, &dealt, selections)?;
            group.look(self, &planned)?;
            for ((method, planned), all) in self.methods.iter().zip(planned).zip(&mut trials) {
                let own = self.splits.of_method(method, self.experiment.seed)?;
                let judge = self.judge(method, group, &own);
                let specs = judge.keyed(planned)?;
                judge.run_missing(&specs, &mut journals.trials)?;
                all.extend(specs);
            }
        }
        Ok(trials)
    }

    pub(super) fn judge<'s>(
        &'s self,
        method: &'s Method,
        encodings: &'s Encodings,
        splits: &'s Splits,
    ) -> Judge<'s> {
        Judge {
            experiment: self.experiment,
            method,
            encodings,
            splits,
        }
    }

    /// The trials of each method that are dealt of a group.
    pub(super) fn planned(
        &self,
        group: &Encodings,
        dealt: &Dealt,
        selections: &Selections,
    ) -> Result<Vec<Vec<Planned>>> {
        let tables = &group.stage.tables;
        let methods = self.methods.iter().enumerate();
        let planned = methods.map(|(at, method)| {
            let mut planned = Vec::new();
            for property in &tables.properties {
                for &split in dealt.splits_of(at) {
                    let of = (property, split, &self.splits.all[split]);
                    let views = views::of_trial(self.experiment, method, tables, of, selections)?;
                    let property = property.clone();
                    planned.push(Planned {
                        property,
                        split,
                        views,
                    });
                }
            }
            Ok(planned)
        });
        planned.collect()
    }
}

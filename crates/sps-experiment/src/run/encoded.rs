//! The methods that share an encoder, from its embeddings to their outcomes.

use anyhow::{Context, Result};
use sps_dataset::{Property, Source};

use super::costs;
use super::deal::Dealt;
use super::found::{Found, Selections};
use super::frozen::Folds;
use super::results::MethodRow;
use super::select::Selecting;
use super::stage::{Stage, Stages};
use super::trials::{self, Planned, TrialSpec};
use super::{Encodings, Journals, Splits, fit, views};
use crate::config::{EncoderSpec, Experiment, Looks, Method};
use crate::data::About;
use crate::journal::{Journal, Outcome, Stop};
use crate::results::{Costs, PerProperty};

/// Methods that share an encoder.
pub(super) struct Encoded<'a, 'm> {
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

/// What methods were fitted on, and to what.
pub(super) struct Fitted {
    groups: Vec<Encodings>,
    selections: Selections,
    /// Of each method.
    trials: Vec<Vec<TrialSpec>>,
}

impl<'m> Encoded<'_, 'm> {
    /// Selects views and runs the trials, as far as they are dealt and the journals lack them.
    pub(super) fn fitted(&self, journals: &mut Journals) -> Result<Fitted> {
        let splits = &self.splits.all;
        let stages = self.stages()?;
        let dealt = self.dealt.of_any();
        let mut groups = Encodings::of_splits(&stages, self.encoder, splits, &dealt)?;
        if self.looks_in_hindsight() {
            for group in &mut groups {
                group.look_at_all(self.experiment, self.source, splits)?;
            }
        }
        let selections = self.select(&groups, &mut journals.selections)?;
        let trials = self.fit(&mut groups, &selections, journals)?;
        Ok(Fitted {
            groups,
            selections,
            trials,
        })
    }

    pub(super) fn stages(&self) -> Result<Stages<'_>> {
        let views = views::needed(&self.methods, self.source)?;
        let data = (self.source, self.about);
        let sequence = self.sequence.clone();
        let (experiment, encoder) = (self.experiment, self.encoder);
        Stages::new(experiment, encoder, data, self.splits, views, sequence)
    }

    /// Whether any method that is dealt chooses its views by the surfaces held out.
    pub(super) fn looks_in_hindsight(&self) -> bool {
        let methods = self.methods.iter().enumerate();
        let mut dealt = methods.filter(|(at, _)| !self.dealt.splits_of(*at).is_empty());
        dealt.any(|(_, method)| method.in_hindsight())
    }

    /// The codes of the properties, and the rows of the methods.
    pub(super) fn rows(
        &self,
        journals: &mut Journals,
    ) -> Result<(Vec<String>, Vec<MethodRow<'m>>)> {
        let Fitted {
            groups,
            selections,
            trials,
        } = self.fitted(journals)?;
        let finished = self.methods.iter().zip(trials);
        let finished =
            finished.map(|(method, trials)| Finished::of(method, trials, &journals.trials));
        let finished = finished.collect::<Result<Vec<_>>>()?;
        let stage = &groups[0].stage;
        let costs = self.costs(stage, &finished)?;
        let encoder_train_seconds = groups.iter().map(|group| group.stage.train_seconds).sum();
        let rows = finished.into_iter().zip(costs).map(|(finished, costs)| {
            let costs = Costs {
                encoder_train_seconds,
                ..costs
            };
            finished.row(costs, &selections)
        });
        Ok((stage.tables.codes(), rows.collect()))
    }

    fn select(&self, groups: &[Encodings], journal: &mut Journal<Found>) -> Result<Selections> {
        let mut selections = Selections::default();
        for group in groups {
            let folds = Folds {
                experiment: self.experiment,
                encodings: group,
                splits: self.splits,
            };
            let mut selecting = Selecting { folds, journal };
            let dealt = self.dealt.within(&group.splits);
            selecting.run(&self.methods, &dealt, &mut selections)?;
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
        let experiment = self.experiment;
        let mut trials: Vec<Vec<TrialSpec>> = self.methods.iter().map(|_| Vec::new()).collect();
        for group in groups {
            let dealt = self.dealt.within(&group.splits);
            let planned = self.planned(group, &dealt, selections)?;
            self.look(group, &planned)?;
            for ((method, planned), all) in self.methods.iter().zip(planned).zip(&mut trials) {
                let own = self.splits.of_method(method, experiment.seed)?;
                let specs = trials::keyed(experiment, method, group, &own.all, planned)?;
                let journal = &mut journals.trials;
                fit::run_missing(experiment, method, group, &own, &specs, journal)?;
                all.extend(specs);
            }
        }
        Ok(trials)
    }

    /// The trials of each method that are dealt of a group.
    pub(super) fn planned(
        &self,
        group: &Encodings,
        dealt: &Dealt,
        selections: &Selections,
    ) -> Result<Vec<Vec<Planned>>> {
        let (tables, splits) = (&group.stage.tables, &self.splits.all);
        let methods = self.methods.iter().enumerate();
        let planned = methods.map(|(at, method)| {
            let some = dealt.splits_of(at);
            trials::planned(self.experiment, method, tables, splits, some, selections)
        });
        planned.collect()
    }

    /// Has a group look at what the trials of all methods look at.
    pub(super) fn look(&self, group: &mut Encodings, planned: &[Vec<Planned>]) -> Result<()> {
        let planned = planned.iter().map(Vec::as_slice);
        let of_method = self.methods.iter().copied().zip(planned);
        group.look(self.experiment, self.source, &self.splits.all, of_method)
    }

    fn costs(&self, stage: &Stage, finished: &[Finished<'_>]) -> Result<Vec<Costs>> {
        let looks = |finished: &&Finished<'_>| finished.method.looks != Looks::Nothing;
        let looking: Vec<&Finished<'_>> = finished.iter().filter(looks).collect();
        let mut measured = costs::measure(self.source, self.splits, stage, &looking)?.into_iter();
        let of = |finished: &Finished<'_>| match finished.method.looks {
            Looks::Nothing => Costs::default(),
            _ => measured.next().unwrap_or_default(),
        };
        Ok(finished.iter().map(of).collect())
    }
}

/// A method whose trials have all been run.
pub(super) struct Finished<'m> {
    pub method: &'m Method,
    pub trials: Vec<TrialSpec>,
    outcomes: PerProperty<Vec<Outcome>>,
    /// Where it stopped, if it looks at one view after the other.
    pub stops: Vec<Stop>,
}

impl<'m> Finished<'m> {
    fn of(method: &'m Method, trials: Vec<TrialSpec>, journal: &Journal<Outcome>) -> Result<Self> {
        let outcomes = trials.iter().map(|trial| {
            let outcome = journal.get(&trial.key).context("a trial was not run")?;
            let mut outcome = outcome.clone();
            if outcome.rerun != trial.rerun {
                // Fitted once for several reruns.
                outcome.rerun = trial.rerun;
                outcome.train_seconds = 0.0;
            }
            Ok((&trial.property, outcome))
        });
        let outcomes = by_property(outcomes.collect::<Result<Vec<_>>>()?);
        let stops = outcomes.values().flatten().flat_map(|o| &o.stops);
        Ok(Self {
            method,
            stops: stops.copied().collect(),
            trials,
            outcomes,
        })
    }

    fn row(self, costs: Costs, selections: &Selections) -> MethodRow<'m> {
        let found = self.trials.iter().filter_map(|trial| {
            let found = selections.get(&self.method.id, &trial.property, trial.rerun)?;
            Some((&trial.property, found.clone()))
        });
        MethodRow {
            costs,
            found: by_property(found),
            outcomes: self.outcomes,
            method: self.method,
        }
    }
}

fn by_property<'a, T>(all: impl IntoIterator<Item = (&'a Property, T)>) -> PerProperty<Vec<T>> {
    let mut by_property = PerProperty::<Vec<T>>::new();
    for (property, one) in all {
        let of_property = by_property.entry(property.to_string()).or_default();
        of_property.push(one);
    }
    by_property
}

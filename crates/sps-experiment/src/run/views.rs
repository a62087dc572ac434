//! The views that each trial looks at.

use std::collections::BTreeSet;

use anyhow::{Context, Result};
use sps_dataset::{Property, Source, Split};
use sps_models::heads::HeadConfig;
use sps_regress::Views;
use sps_viewselect::{
    AnySelector, Equidistant, Problem, Relations, Selection, Selector, SetFunction,
    TemporalRelations,
};

use super::Tables;
use super::found::Selections;
use crate::config::{Experiment, Looks, Method, Selected};
use crate::data;

/// The views of a trial, as places in the tables.
#[derive(Clone, Debug)]
pub(crate) struct TrialViews {
    /// In training.
    pub training: Views,
    /// At prediction, which averages over several fillings of the slots.
    pub fillings: Vec<Vec<usize>>,
}

impl TrialViews {
    /// The same in training and at prediction.
    pub(crate) fn fixed(views: Vec<usize>) -> Self {
        Self {
            training: Views::Fixed(views.clone()),
            fillings: vec![views],
        }
    }

    /// Each view that a prediction looks at, once: in the order of the slots where there is one
    /// filling, and with its repeats.
    pub(crate) fn shown(&self) -> Vec<usize> {
        match self.fillings.as_slice() {
            [one] => one.clone(),
            several => {
                let all: BTreeSet<usize> = several.iter().flatten().copied().collect();
                all.into_iter().collect()
            }
        }
    }
}

/// The views that any of the methods may look at, as indices of the source, ascending.
pub(crate) fn needed(methods: &[&Method], source: &dyn Source) -> Result<Vec<usize>> {
    let count = source.view_angles().len();
    let mut needed = BTreeSet::new();
    for method in methods {
        match &method.looks {
            Looks::Nothing => {}
            Looks::Nadir => drop(needed.insert(data::nadir(source)?)),
            Looks::Selected(selected) if selected.selector.is_fixed() => {
                let views = without_loss(selected, count, 0);
                let views = views.with_context(|| format!("method `{}`", method.id))?;
                needed.extend(views.picks);
            }
            _ => return Ok((0..count).collect()),
        }
    }
    if needed.is_empty() {
        needed.insert(data::nadir(source)?);
    }
    Ok(needed.into_iter().collect())
}

/// So many views of a source at equal distances.
pub(crate) fn equidistant(source: &dyn Source, views: usize) -> Result<Vec<usize>> {
    let selected = Selected {
        picks: views,
        distinct: false,
        selector: AnySelector::Equidistant(Equidistant::default()),
        refit: None,
    };
    Ok(without_loss(&selected, source.view_angles().len(), 0)?.picks)
}

/// The choice of a selector that asks for no loss.
pub(crate) fn without_loss(selected: &Selected, views: usize, seed: u64) -> Result<Selection> {
    let loss = SetFunction::new(views, selected.picks, |_: &[usize]| 0.0);
    let problem = Problem::new(&loss)?.distinct(selected.distinct).seed(seed);
    Ok(selected.selector.select(&problem)?)
}

pub(crate) fn of_trial(
    experiment: &Experiment,
    method: &Method,
    tables: &Tables,
    (property, rerun, split): (&Property, usize, &Split),
    selections: &Selections,
) -> Result<TrialViews> {
    match &method.looks {
        Looks::Nothing => Ok(TrialViews::fixed(Vec::new())),
        Looks::Nadir => Ok(TrialViews::fixed(vec![tables.place(tables.nadir)?])),
        Looks::All => Ok(TrialViews::fixed((0..tables.views.len()).collect())),
        Looks::Selected(selected) => {
            let found = selections.get(&method.id, property, rerun);
            let found = found.context("views that were not selected")?;
            let mut picks = found.selection.picks.clone();
            if method.adaptive.is_some() {
                picks = in_order(&selected.selector, picks);
            }
            let places = picks.iter().map(|&view| tables.place(view));
            Ok(TrialViews::fixed(places.collect::<Result<_>>()?))
        }
        Looks::Relations(relations) => {
            let head = method.estimator.head();
            let head = head.context("only networks relate views")?;
            let seed = seed(experiment.seed, "relations", rerun);
            related(relations, head.config(), tables, split, seed)
        }
    }
}

/// The picks of a selector in the order in which they are looked at. Most selectors have an order;
/// equidistant views lie from one end to the other, so each next one is that farthest from those
/// before it, beginning in the middle.
fn in_order(selector: &AnySelector, mut picks: Vec<usize>) -> Vec<usize> {
    if !matches!(selector, AnySelector::Equidistant(_)) || picks.is_empty() {
        return picks;
    }
    let mut ordered = vec![picks.remove((picks.len() - 1) / 2)];
    while !picks.is_empty() {
        let distance = |view: usize| ordered.iter().map(|&other| view.abs_diff(other)).min();
        // Of equally far ones the first.
        let farthest = (0..picks.len()).rev();
        let farthest = farthest.max_by_key(|&at| distance(picks[at]));
        ordered.push(picks.remove(farthest.unwrap_or(0)));
    }
    ordered
}

fn related(
    relations: &TemporalRelations,
    head: &HeadConfig,
    tables: &Tables,
    split: &Split,
    seed: u64,
) -> Result<TrialViews> {
    let sampler = relations.clone().sampler(tables.views.len(), seed)?;
    let flat = |scales: Vec<Relations>| -> Vec<usize> {
        let groups = scales.into_iter().flat_map(|scale| scale.groups);
        groups.flatten().collect()
    };
    let steps = head.epochs * split.train.len().div_ceil(head.batch_size);
    let training = (0..steps as u64).map(|step| flat(sampler.training_step(step)));
    Ok(TrialViews {
        training: Views::Steps(training.collect()),
        fillings: sampler.test_draws().map(flat).collect(),
    })
}

/// The seed for one purpose of a rerun.
pub(crate) fn seed(seed: u64, purpose: &str, rerun: usize) -> u64 {
    let mut hasher = blake3::Hasher::new();
    hasher.update(&seed.to_le_bytes());
    hasher.update(&(rerun as u64).to_le_bytes());
    hasher.update(purpose.as_bytes());
    let hash = hasher.finalize();
    let bytes = hash.as_bytes().first_chunk::<8>();
    bytes.map_or(0, |bytes| u64::from_le_bytes(*bytes))
}

#[cfg(test)]
mod tests {
    use super::*;
    use sps_viewselect::Nadir;

    #[test]
    fn equidistant_views_spread_from_the_middle() {
        let equidistant = AnySelector::Equidistant(Equidistant::default());
        let ordered = in_order(&equidistant, vec![10, 30, 50, 70, 90]);
        assert_eq!(ordered, [50, 10, 90, 30, 70]);
        let nadir = AnySelector::Nadir(Nadir::default());
        assert_eq!(in_order(&nadir, vec![50, 49, 51]), [50, 49, 51]);
    }
}

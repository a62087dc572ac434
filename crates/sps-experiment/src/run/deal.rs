//! Who does what: an experiment's items, dealt to its shards.
//!
//! An item is a split of one method or of several, with all properties: what shares training surfaces,
//! labels and kernel matrices, and is trained in one stack. Together are, so that no shard needs what
//! another finds:
//!
//! - an encoder that learns from the split, and all methods that are fitted on it;
//! - selectors that ask the same frozen networks, or the same refits, with the methods that look at
//!   what they choose.
//!
//! Items are dealt in turn, as every process counts them.

use std::collections::BTreeSet;
use std::ops::Range;

use anyhow::Result;

use super::by_encoder;
use super::select::asks_together;
use crate::config::Method;
use crate::work::Work;

/// Which methods, by their places, are done together.
fn together(methods: &[Method]) -> Result<Vec<Vec<usize>>> {
    let mut together = Vec::new();
    for (encoder, members) in by_encoder(methods) {
        if encoder.learns() {
            together.push(members);
        } else {
            together.extend(asks_together(methods, &members)?);
        }
    }
    Ok(together)
}

/// The splits that are done of each of some methods.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Dealt(Vec<BTreeSet<usize>>);

impl Dealt {
    /// The same splits of so many methods.
    pub(crate) fn all(methods: usize, splits: Range<usize>) -> Self {
        Self(vec![splits.collect(); methods])
    }

    /// What a process does of an experiment.
    pub(super) fn to(work: Work, methods: &[Method], splits: usize) -> Result<Self> {
        let Work::Shard(shard) = work else {
            return Ok(Self::all(methods.len(), 0..splits));
        };
        let mut dealt = Self(vec![BTreeSet::new(); methods.len()]);
        let together = together(methods)?;
        let items = together.iter();
        let items = items.flat_map(|methods| (0..splits).map(move |split| (methods, split)));
        for (_, (methods, split)) in items.enumerate().filter(|(place, _)| shard.has(*place)) {
            for &method in methods {
                dealt.0[method].insert(split);
            }
        }
        Ok(dealt)
    }

    pub(crate) fn has(&self, method: usize, split: usize) -> bool {
        let dealt = self.0.get(method);
        dealt.is_some_and(|dealt| dealt.contains(&split))
    }

    /// Of these methods alone, in this order.
    pub(super) fn of(&self, methods: &[usize]) -> Self {
        Self(methods.iter().map(|&at| self.0[at].clone()).collect())
    }

    /// Of these splits alone.
    pub(super) fn within(&self, splits: &Range<usize>) -> Self {
        let within = |dealt: &BTreeSet<usize>| dealt.range(splits.clone()).copied().collect();
        Self(self.0.iter().map(within).collect())
    }

    /// Without some splits of methods, both by their places.
    pub(super) fn without(&self, some: &[(usize, usize)]) -> Self {
        let mut rest = self.clone();
        for (method, split) in some {
            rest.0[*method].remove(split);
        }
        rest
    }

    /// The splits of the method at this place, ascending.
    pub(super) fn splits_of(&self, method: usize) -> &BTreeSet<usize> {
        &self.0[method]
    }

    /// The splits of any method, ascending.
    pub(crate) fn of_any(&self) -> BTreeSet<usize> {
        self.0.iter().flatten().copied().collect()
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;
    use crate::config::Experiment;
    use crate::work::Shard;

    /// The methods of a config of the project.
    fn methods(config: &str) -> Vec<Method> {
        let configs = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../configs");
        let path = configs.join(format!("{config}.toml"));
        Experiment::read(&path, &[]).unwrap().methods
    }

    /// The ids of methods that are done together.
    fn families(methods: &[Method]) -> Vec<String> {
        let several = together(methods).unwrap().into_iter();
        let ids = several.filter(|places| places.len() > 1).map(|places| {
            let ids = places.iter().map(|&at| methods[at].id.as_str());
            ids.collect::<Vec<_>>().join(" ")
        });
        ids.collect()
    }

    #[test]
    fn selectors_of_one_network_stay_together_and_all_else_does_not() {
        let methods = methods("multi-view");
        let family = "random equidistant nvs vb-nvs greedy exhaustive equidistant-ends";
        assert_eq!(families(&methods), [family]);
    }

    #[test]
    fn methods_on_an_encoder_that_is_trained_stay_with_it() {
        let methods = methods("end-to-end");
        let heads = methods.iter().find(|method| method.id == "heads").unwrap();
        let same = |method: &&Method| method.encoder == heads.encoder;
        let ids: Vec<&str> = methods.iter().filter(same).map(|m| &m.id[..]).collect();
        assert!(ids.len() > 1);
        assert!(families(&methods).contains(&ids.join(" ")), "{ids:?}");
    }

    #[test]
    fn every_split_of_every_method_is_dealt_once() {
        for config in ["multi-view", "end-to-end", "view-worth"] {
            let methods = methods(config);
            for of in [1, 2, 7, 100] {
                let mut counts = vec![[0; 3]; methods.len()];
                for shard in Shard::all(of) {
                    let dealt = Dealt::to(Work::Shard(shard), &methods, 3).unwrap();
                    for (at, counts) in counts.iter_mut().enumerate() {
                        for &split in dealt.splits_of(at) {
                            counts[split] += 1;
                        }
                    }
                }
                assert!(
                    counts.iter().all(|counts| *counts == [1; 3]),
                    "{config} {of}"
                );
            }
        }
    }
}

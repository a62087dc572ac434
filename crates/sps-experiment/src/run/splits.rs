//! Which surfaces each rerun trains on and is scored on, and every further parting of what it trains
//! on: all of them go by the same units, and nothing else in this program parts surfaces.

use std::borrow::Cow;
use std::collections::{BTreeSet, HashMap};

use anyhow::{Context, Result, ensure};
use sps_dataset::{Split, SplitError, SplitPlan, Surface, Units};

use crate::config::{Experiment, Method};
use crate::data::{Protocol, TestSurfaces};

#[derive(Clone)]
pub(crate) struct Splits {
    /// Of all reruns, in order.
    pub all: Vec<Split>,
    /// How many each rerun has.
    pub of_rerun: usize,
    /// What every split and fold keeps together, and every interval counts.
    pub units: Units,
    /// Surfaces before this one may be trained on; from here on they are only scored on.
    pub pool: usize,
}

impl Splits {
    pub(crate) fn of(experiment: &Experiment, surfaces: &[Surface]) -> Result<Self> {
        match &experiment.protocol {
            Protocol::TestSurfaces(protocol) => Self::apart(experiment, protocol, surfaces),
            Protocol::Split(plan) => {
                Self::parted(plan, surfaces, experiment.seed, experiment.reruns)
            }
        }
    }

    /// As a plan parts surfaces, in another way for each rerun.
    pub(super) fn parted(
        plan: &SplitPlan,
        surfaces: &[Surface],
        seed: u64,
        reruns: usize,
    ) -> Result<Self> {
        let mut all = Vec::new();
        for rerun in 0..reruns as u64 {
            all.extend(plan.splits(surfaces, seed, rerun)?);
        }
        Ok(Self {
            of_rerun: all.len() / reruns,
            all,
            units: plan.units(surfaces),
            pool: surfaces.len(),
        })
    }

    /// The splits that a method is trained on: with fewer training surfaces where it asks for fewer,
    /// drawn at random by whole units.
    pub(crate) fn of_method(&self, method: &Method, seed: u64) -> Result<Cow<'_, Self>> {
        let Some(wanted) = method.training_surfaces else {
            return Ok(Cow::Borrowed(self));
        };
        let mut fewer = self.clone();
        for (index, split) in fewer.all.iter_mut().enumerate() {
            let count = split.train.len();
            ensure!(
                wanted <= count,
                "method `{}`: {wanted} `training-surfaces` of {count}",
                method.id
            );
            if wanted < count {
                let share = wanted as f64 / count as f64;
                let (units, number) = (&self.units, index as u64);
                let drawn = units.keep_aside(&split.train, share, seed, "fewer", number);
                split.train = drawn.context("training-surfaces")?.validation;
            }
        }
        Ok(Cow::Owned(fewer))
    }

    /// The group or material that each surface is kept together with, by the surface's name; none
    /// where it is a unit of its own.
    pub(crate) fn groups<'s>(&self, surfaces: &'s [Surface]) -> HashMap<&'s str, &'s str> {
        let unit = self.units.unit();
        let named = |surface: &'s Surface| Some((surface.id.as_str(), unit.of(surface)?));
        surfaces.iter().filter_map(named).collect()
    }

    /// One split of the same surfaces.
    pub(crate) fn only(&self, split: Split) -> Self {
        Self {
            all: vec![split],
            of_rerun: 1,
            units: self.units.clone(),
            pool: self.pool,
        }
    }

    /// Units held out for each that is trained on, where surfaces are both in turn; 0 where
    /// those that are scored on are never trained on.
    pub(crate) fn test_per_training(&self) -> f64 {
        let units = self.units.of_surface();
        if self.pool < units.len() {
            return 0.0;
        }
        let count = |of: fn(&Split) -> &Vec<usize>| -> usize {
            let different = |split: &Split| {
                let units: BTreeSet<usize> = of(split).iter().map(|&at| units[at]).collect();
                units.len()
            };
            self.all.iter().map(different).sum()
        };
        let training = count(|split| &split.train).max(1);
        count(|split| &split.validation) as f64 / training as f64
    }

    pub(crate) fn training_surfaces(&self) -> usize {
        let sum: usize = self.all.iter().map(|split| split.train.len()).sum();
        sum / self.all.len().max(1)
    }

    /// A share of the units of some surfaces kept aside at random: those that calibrate intervals, or say when an
    /// encoder has trained enough.
    pub(crate) fn kept_aside(
        &self,
        surfaces: &[usize],
        share: f64,
        seed: u64,
        number: u64,
    ) -> Result<Split, SplitError> {
        let units = &self.units;
        units.keep_aside(surfaces, share, seed, "random split", number)
    }

    /// The training surfaces of a split that an estimator to search is trained on, and those that
    /// its loss is measured on; with one fold both are all of them.
    pub(super) fn to_select(&self, split: usize, folds: usize, seed: u64) -> Result<Vec<Split>> {
        let all = &self.all[split].train;
        if folds == 1 {
            return Ok(vec![Split {
                train: all.clone(),
                validation: all.clone(),
            }]);
        }
        let (units, number) = (&self.units, split as u64);
        let parts = units.folds(all, folds, seed, "selection", number);
        parts.context("selection.folds")
    }

    /// Training surfaces first, those that are only scored on after them.
    fn apart(
        experiment: &Experiment,
        protocol: &TestSurfaces,
        surfaces: &[Surface],
    ) -> Result<Self> {
        let units = Units::of(surfaces);
        let pool = protocol.pool(experiment.reruns);
        ensure!(
            pool + protocol.test == surfaces.len(),
            "another number of surfaces"
        );
        let training = protocol.training;
        let of_rerun = |rerun: usize| -> Result<Vec<usize>> {
            if protocol.pool.is_none() {
                return Ok((rerun * training..(rerun + 1) * training).collect());
            }
            let all: Vec<usize> = (0..pool).collect();
            if training == pool {
                return Ok(all);
            }
            let share = training as f64 / pool as f64;
            let drawn = units.keep_aside(&all, share, experiment.seed, "training", rerun as u64);
            Ok(drawn.context("data.simulated.pool")?.validation)
        };
        let split = |rerun| {
            Ok(Split {
                train: of_rerun(rerun)?,
                validation: (pool..surfaces.len()).collect(),
            })
        };
        Ok(Self {
            all: (0..experiment.reruns).map(split).collect::<Result<_>>()?,
            of_rerun: 1,
            units,
            pool,
        })
    }
}

#[cfg(test)]
mod tests {
    use std::fs;
    use std::path::{Path, PathBuf};

    use proptest::prelude::*;
    use sps_dataset::{KFold, RandomSplit, Unit};

    use super::*;

    fn splits(groups: &[u8], plan: SplitPlan) -> Option<Splits> {
        let surface = |(i, group): (usize, &u8)| Surface {
            id: i.to_string(),
            material: String::new(),
            group: group.to_string(),
        };
        let surfaces: Vec<Surface> = groups.iter().enumerate().map(surface).collect();
        Splits::parted(&plan, &surfaces, 3, 1).ok()
    }

    fn apart(groups: &[u8], one: &[usize], other: &[usize]) -> bool {
        one.iter()
            .all(|&a| other.iter().all(|&b| groups[a] != groups[b]))
    }

    /// Words that part surfaces, draw at random, count or calibrate, with the files in which
    /// they may stand and are seen to go by units.
    const PARTING: [(&str, &[&str]); 12] = [
        (".keep_aside(", &["run/splits.rs"]),
        (".folds(", &["run/splits.rs"]),
        (".each_aside(", &["run/splits.rs"]),
        (".splits(", &["run/splits.rs"]),
        // Costs are timed on the first few surfaces of either side.
        (" Split {", &["run/splits.rs", "run/costs/turn.rs"]),
        (".shuffle(", &[]),
        ("use rand", &[]),
        (" rand::", &[]),
        ("rand_chacha::", &[]),
        ("streams::", &[]),
        ("Conformal::", &[]),
        // An interval of made-up numbers is timed.
        ("units: None", &["bench/kernels.rs"]),
    ];

    fn sources(folder: &Path, found: &mut Vec<PathBuf>) {
        for entry in fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                sources(&path, found);
            } else if path.extension().is_some_and(|ending| ending == "rs") {
                found.push(path);
            }
        }
    }

    #[test]
    fn nothing_else_parts_surfaces() {
        let package = Path::new(env!("CARGO_MANIFEST_DIR"));
        let mut seen = 0;
        for root in ["src", "../sps-report/src", "../sps/src", "../../xtask/src"] {
            let root = package.join(root);
            let mut paths = Vec::new();
            sources(&root, &mut paths);
            seen += paths.len();
            for path in paths {
                let name = path.strip_prefix(&root).unwrap().to_string_lossy();
                let text = fs::read_to_string(&path).unwrap();
                let code = text.split("#[cfg(test)]\nmod tests").next().unwrap();
                let is_code = |line: &&str| !line.trim_start().starts_with("//");
                for line in code.lines().filter(is_code) {
                    for (word, files) in PARTING {
                        let allowed = !line.contains(word) || files.contains(&name.as_ref());
                        assert!(allowed, "{name}: {line}");
                    }
                }
            }
        }
        assert!(seen > 150);
    }

    proptest! {
        /// Whatever learns, what says when to stop, how wide an interval is and which views are
        /// best has seen no member of a group that it judges by.
        #[test]
        fn no_part_of_a_training_part_separates_a_group(
            groups in prop::collection::vec(0_u8..9, 12..60),
            (share, folds) in (0.05_f64..0.6, 2_usize..5),
            (seed, number) in any::<(u64, u64)>(),
            plan in prop_oneof![
                Just(SplitPlan::Random(RandomSplit::default())),
                Just(SplitPlan::KFold(KFold { folds: 3, ..KFold::default() })),
                Just(SplitPlan::LeaveOneOut { by: Some(Unit::Group) }),
            ],
        ) {
            let Some(splits) = splits(&groups, plan) else { return Ok(()) };
            for (at, split) in splits.all.iter().enumerate() {
                prop_assert!(apart(&groups, &split.train, &split.validation));
                if let Ok(part) = splits.kept_aside(&split.train, share, seed, number) {
                    prop_assert!(apart(&groups, &part.train, &part.validation));
                }
                for part in splits.to_select(at, folds, seed).unwrap_or_default() {
                    prop_assert!(apart(&groups, &part.train, &part.validation));
                }
            }
        }
    }
}

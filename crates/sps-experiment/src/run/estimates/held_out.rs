//! Whether a file has an estimate for all that is held out.

use std::collections::BTreeSet;

use sps_dataset::{Property, Split};

use super::problems::Problems;
use super::{Asked, Estimates};
use crate::config::Method;

/// So many surfaces without an estimate are named.
const NAMED: usize = 5;

/// Names what a method is scored on without an estimate of it. A surface that was not measured is not
/// scored on, and needs none.
pub(super) fn check(
    asked: &Asked<'_>,
    method: &Method,
    estimates: &Estimates,
    problems: &mut Problems<'_>,
) {
    let splits = asked.splits;
    let together = if estimates.by_rerun {
        splits.of_rerun
    } else {
        splits.all.len()
    };
    for property in &asked.properties {
        if !estimates.of.keys().any(|(of, ..)| of == property) {
            problems.of_all(|| format!("no row of `{property}`, which the experiment estimates"));
            continue;
        }
        for (rerun, splits) in splits.all.chunks(together).enumerate() {
            let held_out = asked.held_out(method, property, splits);
            let missing: Vec<usize> = held_out
                .iter()
                .copied()
                .filter(|&surface| estimates.get(property, rerun, surface).is_none())
                .collect();
            if missing.is_empty() {
                continue;
            }
            let in_rerun = if estimates.by_rerun {
                format!(" in rerun {rerun}")
            } else {
                String::new()
            };
            problems.of_all(|| {
                format!(
                    "no estimate of `{property}` for {} of the {} surfaces held out{in_rerun}: {}",
                    missing.len(),
                    held_out.len(),
                    asked.names(&missing)
                )
            });
        }
    }
}

impl Asked<'_> {
    fn held_out(&self, method: &Method, property: &Property, splits: &[Split]) -> BTreeSet<usize> {
        let column = self.readings.column(property.code());
        let is_measured = |surface: &usize| {
            column.is_some_and(|column| self.readings.get(*surface, column).is_some())
        };
        let surfaces = splits
            .iter()
            .flat_map(|split| method.scored_on(&split.validation));
        surfaces.copied().filter(is_measured).collect()
    }

    /// The first few of some surfaces, and how many others there are.
    fn names(&self, surfaces: &[usize]) -> String {
        let named = surfaces.iter().take(NAMED);
        let named: Vec<&str> = named.map(|&at| self.surfaces[at].id.as_str()).collect();
        let named = named.join(", ");
        match surfaces.len().saturating_sub(NAMED) {
            0 => named,
            others => format!("{named} and {others} more"),
        }
    }
}

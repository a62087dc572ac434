//! Finds the sets that a value network expects least of.

use crate::problem::Problem;
use crate::sets::SetList;
use crate::value::{Sums, ValueNetwork};
use crate::vb_nvs::ValueSearch;

/// The sets of lowest value that are not known yet, lowest first: coordinate descent from every
/// start, then every combination of the best few views of each slot.
pub(crate) fn lowest_sets(
    network: &ValueNetwork,
    problem: &Problem<'_>,
    starts: &SetList,
    limits: ValueSearch,
    is_known: impl Fn(&[usize]) -> bool,
) -> SetList {
    let mut lowest = vec![vec![f64::INFINITY; problem.views()]; problem.picks()];
    let mut found: Vec<(f64, Vec<usize>)> = Vec::new();
    for start in starts.as_sets() {
        let optimum = descend(network, problem, start.to_vec(), &mut lowest);
        found.push((network.of_set(&optimum), optimum));
    }
    let width = views_per_slot(problem, limits.combinations);
    let slots = lowest.iter().map(|values| best_views(values, width));
    let slots: Vec<Vec<usize>> = slots.collect();
    let mut walk = Walk {
        network,
        distinct: problem.is_distinct(),
        slots: &slots,
        set: Vec::with_capacity(slots.len()),
        found: &mut found,
    };
    walk.go(&network.start());
    found.sort_by(|a, b| a.0.total_cmp(&b.0).then_with(|| a.1.cmp(&b.1)));
    found.dedup_by(|a, b| a.1 == b.1);
    let mut sets = SetList::new(problem.picks());
    let unknown = found.into_iter().map(|(_, set)| set);
    let unknown = unknown.filter(|set| !is_known(set));
    sets.extend(unknown.take(limits.shortlist));
    sets
}

/// A descent takes a few sweeps. Values depend in the last digit on the order of the slots' sums,
/// so that equals could take turns for ever.
const MOST_SWEEPS: usize = 50;

/// Chooses slot after slot anew until none changes. `lowest` keeps, for each slot and view, the
/// lowest value that was seen with that view in that slot.
fn descend(
    network: &ValueNetwork,
    problem: &Problem<'_>,
    mut set: Vec<usize>,
    lowest: &mut [Vec<f64>],
) -> Vec<usize> {
    for _ in 0..MOST_SWEEPS {
        let mut still = true;
        for (slot, lowest) in lowest.iter_mut().enumerate() {
            let view = best_view(network, problem, &set, slot, lowest);
            still &= view == set[slot];
            set[slot] = view;
        }
        if still {
            break;
        }
    }
    set
}

/// The view of lowest value in a slot, given the other slots; the present one where none is lower.
fn best_view(
    network: &ValueNetwork,
    problem: &Problem<'_>,
    set: &[usize],
    slot: usize,
    lowest: &mut [f64],
) -> usize {
    let mut rest = network.start();
    for (other, &view) in set.iter().enumerate() {
        if other != slot {
            rest.add(network, other, view);
        }
    }
    let mut best = (f64::INFINITY, set[slot]);
    for (view, lowest) in lowest.iter_mut().enumerate() {
        if problem.is_distinct() && view != set[slot] && set.contains(&view) {
            continue;
        }
        let mut sums = rest.clone();
        sums.add(network, slot, view);
        let value = network.finish(&sums);
        *lowest = lowest.min(value);
        if value < best.0 || (value == best.0 && view == set[slot]) {
            best = (value, view);
        }
    }
    best.1
}

/// The largest K with K^M combinations within the limit, from 1 to N.
fn views_per_slot(problem: &Problem<'_>, combinations: usize) -> usize {
    let picks = u32::try_from(problem.picks()).unwrap_or(u32::MAX);
    let fits = |width: &usize| {
        let sets = width.checked_pow(picks);
        sets.is_some_and(|sets| sets <= combinations)
    };
    (2..=problem.views()).take_while(fits).last().unwrap_or(1)
}

fn best_views(values: &[f64], width: usize) -> Vec<usize> {
    let mut views: Vec<usize> = (0..values.len()).collect();
    views.sort_by(|&a, &b| values[a].total_cmp(&values[b]).then(a.cmp(&b)));
    views.truncate(width);
    views
}

/// Every combination of the slots' views, sums shared by those that begin alike.
struct Walk<'w> {
    network: &'w ValueNetwork,
    distinct: bool,
    slots: &'w [Vec<usize>],
    set: Vec<usize>,
    found: &'w mut Vec<(f64, Vec<usize>)>,
}

impl Walk<'_> {
    fn go(&mut self, sums: &Sums) {
        let slots = self.slots;
        let Some(views) = slots.get(self.set.len()) else {
            self.found
                .push((self.network.finish(sums), self.set.clone()));
            return;
        };
        for &view in views {
            if self.distinct && self.set.contains(&view) {
                continue;
            }
            let mut longer = sums.clone();
            longer.add(self.network, self.set.len(), view);
            self.set.push(view);
            self.go(&longer);
            self.set.pop();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::loss::SetFunction;
    use crate::sets::is_distinct;

    /// With all combinations allowed, the shortlist is a sort of all sets.
    #[test]
    fn equals_a_sort_of_all_sets() {
        let loss = SetFunction::new(4, 3, |_: &[usize]| 0.0);
        for distinct in [false, true] {
            let problem = Problem::new(&loss)
                .expect("views enough")
                .distinct(distinct);
            let network = ValueNetwork::new(&problem, 6, 0.1);
            let sets = (0..64).map(|index| vec![index / 16, index / 4 % 4, index % 4]);
            let mut expected: Vec<_> = sets.filter(|set| !distinct || is_distinct(set)).collect();
            expected.sort_by(|a, b| network.of_set(a).total_cmp(&network.of_set(b)));
            let limits = ValueSearch {
                combinations: 64,
                shortlist: 20,
                ..ValueSearch::default()
            };
            let mut starts = SetList::new(3);
            starts.push(&[0, 1, 2]);
            let first = expected.remove(0);
            let found = lowest_sets(&network, &problem, &starts, limits, |set| set == first);
            assert!(found.as_sets().iter().eq(&expected[..20]));
        }
    }
}

//! Selectors to go through, and a loss that counts.

use std::sync::atomic::{AtomicU64, Ordering};

use sps_viewselect::{
    Equidistant, EquidistantAt, Exhaustive, Greedy, LossError, Nadir, Nvs, Problem, Random,
    Selection, Selector, SetLoss, Sets, VbNvs,
};

/// Every selector, the learned ones with few evaluations.
pub(crate) fn all_selectors() -> Vec<(&'static str, Box<dyn Selector>)> {
    vec![
        ("random", Box::new(Random::default())),
        ("random of 20", Box::new(Random { draws: 20 })),
        ("equidistant", Box::new(Equidistant::default())),
        (
            "equidistant ends",
            Box::new(Equidistant {
                at: EquidistantAt::Ends,
            }),
        ),
        ("nadir", Box::new(Nadir::default())),
        ("nvs", Box::new(short_nvs())),
        ("vb-nvs", Box::new(short_vb_nvs())),
        ("greedy", Box::new(Greedy::default())),
        ("exhaustive", Box::new(Exhaustive::default())),
    ]
}

pub(crate) fn short_nvs() -> Nvs {
    Nvs {
        evaluations: 501,
        ..Nvs::default()
    }
}

pub(crate) fn short_vb_nvs() -> VbNvs {
    let mut selector = VbNvs {
        evaluations: 560,
        ..VbNvs::default()
    };
    selector.search.shortlist = 20;
    selector.search.rounds = 3;
    selector.search.combinations = 200;
    selector
}

pub(crate) fn select(selector: &dyn Selector, problem: &Problem<'_>) -> Selection {
    selector
        .select(problem)
        .unwrap_or_else(|error| panic!("{error}"))
}

pub(crate) fn problem(loss: &dyn SetLoss) -> Problem<'_> {
    Problem::new(loss).unwrap_or_else(|error| panic!("{error}"))
}

/// Counts the sets that another loss is asked for.
pub(crate) struct Counted<L> {
    pub(crate) loss: L,
    sets: AtomicU64,
}

impl<L> Counted<L> {
    pub(crate) fn new(loss: L) -> Self {
        Self {
            loss,
            sets: AtomicU64::new(0),
        }
    }

    pub(crate) fn take(&self) -> u64 {
        self.sets.swap(0, Ordering::Relaxed)
    }
}

impl<L: SetLoss> SetLoss for Counted<L> {
    fn views(&self) -> usize {
        self.loss.views()
    }

    fn picks(&self) -> usize {
        self.loss.picks()
    }

    fn losses(&self, sets: Sets<'_>, losses: &mut [f64]) -> Result<(), LossError> {
        self.sets.fetch_add(sets.len() as u64, Ordering::Relaxed);
        self.loss.losses(sets, losses)
    }
}

/// Every set of `picks` of `views` views in lexicographic order, by counting.
pub(crate) fn all_sets(views: usize, picks: usize, distinct: bool) -> Vec<Vec<usize>> {
    let mut sets = vec![Vec::new()];
    for _ in 0..picks {
        sets = sets
            .into_iter()
            .flat_map(|set: Vec<usize>| {
                (0..views).map(move |view| [set.as_slice(), &[view]].concat())
            })
            .filter(|set| !distinct || !set[..set.len() - 1].contains(&set[set.len() - 1]))
            .collect();
    }
    sets
}

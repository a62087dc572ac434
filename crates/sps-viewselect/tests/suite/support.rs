//! Selectors to go through, and what they go through.

use sps_viewselect::{
    Equidistant, EquidistantAt, Exhaustive, Greedy, Nadir, Nvs, Problem, Random, Selection,
    Selector, SetLoss, Sets, VbNvs,
};

/// Every selector, the learned ones with few evaluations.
pub(crate) fn all_selectors() -> Vec<(&'static str, Box<dyn Selector>)> {
    let at = EquidistantAt::Ends;
    vec![
        ("random", Box::new(Random::default())),
        ("random of 20", Box::new(Random { draws: 20 })),
        ("equidistant", Box::new(Equidistant::default())),
        ("equidistant ends", Box::new(Equidistant { at })),
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
    let found = selector.select(problem);
    found.unwrap_or_else(|error| panic!("{error}"))
}

/// What a selector finds on so many threads, without the time that it took.
pub(crate) fn select_on(
    threads: usize,
    selector: &dyn Selector,
    problem: &Problem<'_>,
) -> Selection {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
    let found = pool.expect("a pool").install(|| select(selector, problem));
    Selection {
        seconds: 0.0,
        ..found
    }
}

pub(crate) fn problem(loss: &dyn SetLoss) -> Problem<'_> {
    Problem::new(loss).unwrap_or_else(|error| panic!("{error}"))
}

/// The losses of sets, one after the other in one slice.
pub(crate) fn losses_of(loss: &dyn SetLoss, flat: &[usize]) -> Vec<f64> {
    let sets = Sets::new(flat, loss.picks()).expect("whole sets");
    let mut losses = vec![0.0; sets.len()];
    let computed = loss.losses(sets, &mut losses);
    computed.expect("a loss that does not fail");
    losses
}

/// Every set of `picks` of `views` views in lexicographic order, by counting.
pub(crate) fn all_sets(views: usize, picks: usize, distinct: bool) -> Vec<Vec<usize>> {
    let mut sets = vec![Vec::new()];
    for _ in 0..picks {
        let longer = |set: Vec<usize>| -> Vec<Vec<usize>> {
            let left = (0..views).filter(|view| !distinct || !set.contains(view));
            left.map(|view| [&set[..], &[view]].concat()).collect()
        };
        sets = sets.into_iter().flat_map(longer).collect();
    }
    sets
}

//! On losses with many near-optimal sets.

use rayon::prelude::*;
use sps_viewselect::{Exhaustive, Greedy, Nvs, Random, Selector, VbNvs};

use crate::problems::LateFusion;
use crate::support::{problem, select};

/// Median over problems of the regret, as a share of the random-to-optimal distance.
fn median_regret(selector: &impl Selector) -> f64 {
    let regrets = (0..9_u64).into_par_iter().map(|index| {
        let loss = LateFusion::new(40, 3, 20, index);
        let problem = problem(&loss).seed(index);
        let random = select(&Random { draws: 2000 }, &problem).curve[0].mean;
        let optimum = select(&Exhaustive::default(), &problem).loss;
        let selection = select(selector, &problem);
        selection.regret(random, optimum).expect("a distance")
    });
    let mut regrets: Vec<f64> = regrets.collect();
    regrets.sort_by(f64::total_cmp);
    regrets[regrets.len() / 2]
}

#[test]
fn searches_stay_below_five_percent() {
    for (name, regret) in [
        ("nvs", median_regret(&Nvs::default())),
        ("vb-nvs", median_regret(&VbNvs::default())),
        ("greedy", median_regret(&Greedy::default())),
    ] {
        assert!((0.0..0.05).contains(&regret), "{name}: {regret}");
    }
}

#[test]
fn a_single_random_set_has_a_large_regret() {
    assert!(median_regret(&Random::default()) > 0.3);
}

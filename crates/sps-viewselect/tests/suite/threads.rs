//! Same seed, same picks, for any number of threads.

use sps_viewselect::Selection;

use crate::problems::LateFusion;
use crate::support::{all_selectors, problem, select};

/// Everything but the time.
fn untimed(selection: Selection) -> Selection {
    Selection {
        seconds: 0.0,
        ..selection
    }
}

#[test]
fn selections_do_not_depend_on_the_number_of_threads() {
    let loss = LateFusion::new(20, 3, 10, 3);
    for distinct in [false, true] {
        let problem = problem(&loss).seed(11).distinct(distinct);
        for (name, selector) in all_selectors() {
            let with = |threads| {
                let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
                let pool = pool.expect("a pool");
                pool.install(|| untimed(select(&*selector, &problem)))
            };
            let one = with(1);
            for threads in [2, 5] {
                assert_eq!(one, with(threads), "{name} on {threads} threads");
            }
        }
    }
}

//! Loops give what they would one item after the other, on any number of threads.

use sps_base::parallel::{each, map};

#[test]
fn every_item_is_met_once_and_keeps_its_place() {
    for threads in [1, 2, 7] {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
        pool.unwrap().install(|| {
            for count in [0, 1, 2, 15, 1000] {
                let squares: Vec<usize> = (0..count).map(|i| i * i).collect();
                assert_eq!(map(0..count, |i| i * i), squares);
                let mut found: Vec<usize> = (0..count).collect();
                each(&mut found, |i| *i *= *i);
                assert_eq!(found, squares);
            }
        });
    }
}

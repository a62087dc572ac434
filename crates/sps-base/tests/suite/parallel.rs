//! Loops give what they would one item after the other, on any number of threads.

use std::sync::Mutex;

use sps_base::parallel::{each, each_chunk, map};

fn on_pools(work: impl Fn() + Sync) {
    for threads in [1, 2, 7] {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
        pool.unwrap().install(&work);
    }
}

#[test]
fn every_item_is_met_once_and_keeps_its_place() {
    on_pools(|| {
        for count in [0, 1, 2, 15, 1000] {
            let squares: Vec<usize> = (0..count).map(|i| i * i).collect();
            assert_eq!(map(0..count, |i| i * i), squares);
            let met = Mutex::new(Vec::new());
            each(&squares, |square| met.lock().unwrap().push(*square));
            let mut met = met.into_inner().unwrap();
            met.sort_unstable();
            assert_eq!(met, squares);
        }
    });
}

#[test]
fn chunks_have_their_numbers_and_the_last_what_is_left() {
    on_pools(|| {
        for (count, len) in [(0, 3), (1, 3), (9, 3), (100, 7), (1000, 1), (5, 0)] {
            let mut found = vec![usize::MAX; count];
            each_chunk(&mut found, len, |number, chunk| {
                assert!(chunk.len() == len.max(1) || number == count / len);
                chunk.fill(number);
            });
            let expected: Vec<usize> = (0..count).map(|i| i / len.max(1)).collect();
            assert_eq!(found, expected);
        }
    });
}

/// Loops within loops, as a stack of networks trains while each reads its photographs.
#[test]
fn loops_may_hold_loops() {
    on_pools(|| {
        let table = map(0..20, |row| map(0..20, |column| row * 20 + column));
        assert!(table.concat().into_iter().eq(0..400));
    });
}

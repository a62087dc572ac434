//! What an exhaustive search keeps: alone in its process, since what is allocated is counted for the
//! whole of it.

use sps_base::memory::{CountingAllocator, peak};
use sps_viewselect::{Exhaustive, Problem, Selector, SetFunction};

#[global_allocator]
static ALLOCATOR: CountingAllocator = CountingAllocator;

/// Seven of seven views in blocks of one run: 7^6 blocks. As documented, 24 bytes each and thrice
/// that while the curve moves; the results of 1024 blocks (two words and a number, and seven views on
/// the heap) and each thread's block are below a megabyte.
#[test]
fn an_exhaustive_search_keeps_no_picks_but_the_best() -> Result<(), Box<dyn std::error::Error>> {
    let loss = SetFunction::new(7, 7, |set: &[usize]| -(set.iter().sum::<usize>() as f64));
    let exhaustive = Exhaustive {
        block: 1,
        ..Exhaustive::default()
    };
    let problem = Problem::new(&loss)?;
    // The pool's threads begin here.
    let few = SetFunction::new(2, 1, |set: &[usize]| set[0] as f64);
    exhaustive.select(&Problem::new(&few)?)?;
    let (found, most) = peak(|| exhaustive.select(&problem));
    let found = found?;
    let blocks = 7_usize.pow(6);
    assert_eq!((found.picks, found.curve.len()), (vec![6; 7], blocks));
    assert!(
        most < 72 * blocks + (1 << 20),
        "{most} bytes for {blocks} blocks"
    );
    Ok(())
}

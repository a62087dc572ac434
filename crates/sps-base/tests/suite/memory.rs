//! Bytes that a piece of work allocates.

use std::hint::black_box;

use sps_base::memory::{CountingAllocator, kept, peak};

#[global_allocator]
static ALLOCATOR: CountingAllocator = CountingAllocator;

const BYTES: usize = 200 << 20;

/// Other tests allocate at the same time, but little.
fn near(bytes: usize, measured: usize) -> bool {
    measured.abs_diff(bytes) < bytes / 4
}

#[test]
fn what_is_freed_counts_for_the_peak_alone() {
    let freed = || drop(black_box(vec![1_u8; BYTES]));
    let ((), most) = peak(freed);
    assert!(near(BYTES, most), "{most}");
    let before = black_box(vec![1_u8; BYTES]);
    let (half, left) = kept(|| {
        freed();
        black_box(vec![0_u8; BYTES / 2])
    });
    assert!(near(BYTES / 2, left), "{left}");
    let ((), left) = kept(|| drop((before, half)));
    assert_eq!(left, 0);
}

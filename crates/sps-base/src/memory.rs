//! How much memory a piece of work takes, by what it allocates: 0 in a program whose global allocator is
//! not [`CountingAllocator`]. What other threads allocate in the meantime counts too.

use std::alloc::{GlobalAlloc, Layout, System};
use std::sync::atomic::{AtomicIsize, AtomicUsize, Ordering::Relaxed};

/// Measurements that are under way.
static MEASURING: AtomicUsize = AtomicUsize::new(0);
/// Bytes that were allocated, less those that were freed, while anything was measured.
static CURRENT: AtomicIsize = AtomicIsize::new(0);
/// The most that [`CURRENT`] has been since the last measurement of a peak began.
static PEAK: AtomicIsize = AtomicIsize::new(0);

/// The system's allocator, which counts bytes only while memory is measured: counters that all threads
/// write to can take a third of the time of work that allocates much.
#[derive(Debug)]
pub struct CountingAllocator;

fn count(allocated: usize, freed: usize) {
    if MEASURING.load(Relaxed) > 0 {
        let change = allocated as isize - freed as isize;
        let before = CURRENT.fetch_add(change, Relaxed);
        PEAK.fetch_max(before + change, Relaxed);
    }
}

#[expect(unsafe_code, reason = "an allocator's interface is unsafe")]
// SAFETY: all memory is the system's, asked for as the caller asked.
unsafe impl GlobalAlloc for CountingAllocator {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        count(layout.size(), 0);
        // SAFETY: what the caller promises.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, memory: *mut u8, layout: Layout) {
        count(0, layout.size());
        // SAFETY: what the caller promises.
        unsafe { System.dealloc(memory, layout) }
    }
}

/// Counts as long as it lives.
struct Measurement;

impl Measurement {
    fn start() -> Self {
        MEASURING.fetch_add(1, Relaxed);
        Self
    }
}

impl Drop for Measurement {
    fn drop(&mut self) {
        MEASURING.fetch_sub(1, Relaxed);
    }
}

/// What `make` gives, and the bytes that it has allocated and not freed.
pub fn kept<T>(make: impl FnOnce() -> T) -> (T, usize) {
    let _counting = Measurement::start();
    let before = CURRENT.load(Relaxed);
    let made = make();
    (made, since(before, CURRENT.load(Relaxed)))
}

/// What `work` gives, and the bytes that it had allocated at most at any one time.
pub fn peak<T>(work: impl FnOnce() -> T) -> (T, usize) {
    let _counting = Measurement::start();
    let before = CURRENT.load(Relaxed);
    PEAK.store(before, Relaxed);
    let done = work();
    (done, since(before, PEAK.load(Relaxed)))
}

fn since(before: isize, now: isize) -> usize {
    usize::try_from(now - before).unwrap_or(0)
}

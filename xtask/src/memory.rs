//! How much memory a piece of work takes, by what it allocates.

use peak_alloc::PeakAlloc;

#[global_allocator]
static ALLOCATOR: PeakAlloc = PeakAlloc;

/// Bytes that `made` keeps allocated.
pub(crate) fn of<T, E>(make: impl FnOnce() -> Result<T, E>) -> Result<usize, E> {
    let before = ALLOCATOR.current_usage();
    let made = make()?;
    let bytes = ALLOCATOR.current_usage().saturating_sub(before);
    drop(made);
    Ok(bytes)
}

/// What `work` gives, and the bytes that it had allocated at most at any one time.
pub(crate) fn peak<T>(work: impl FnOnce() -> T) -> (T, usize) {
    ALLOCATOR.reset_peak_usage();
    let before = ALLOCATOR.current_usage();
    let done = work();
    (done, ALLOCATOR.peak_usage().saturating_sub(before))
}

#[cfg(test)]
mod tests {
    use super::*;

    const BYTES: usize = 200 << 20;

    /// Other tests allocate at the same time, so one of several tries has to come near.
    fn near(bytes: usize, measure: impl Fn() -> usize) -> bool {
        (0..50).any(|_| measure().abs_diff(bytes) < bytes / 4)
    }

    #[test]
    fn what_is_freed_counts_for_the_peak_alone() {
        let freed = || drop(vec![1_u8; BYTES]);
        assert!(near(BYTES, || peak(freed).1));
        let kept = || {
            freed();
            Ok::<_, ()>(vec![1_u8; BYTES / 2])
        };
        assert!(near(BYTES / 2, || of(kept).unwrap()));
    }
}

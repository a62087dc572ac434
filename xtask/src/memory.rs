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

    // Other tests allocate at the same time: large enough that they do not count.
    const BYTES: usize = 200 << 20;

    #[test]
    fn what_is_freed_counts_for_the_peak_alone() {
        let (kept, peak) = peak(|| {
            drop(vec![1_u8; BYTES]);
            vec![1_u8; 16]
        });
        assert_eq!(kept.len(), 16);
        assert!((BYTES..BYTES + BYTES / 4).contains(&peak), "{peak}");
        let kept = of(|| {
            drop(vec![1_u8; BYTES]);
            Ok::<_, ()>(vec![1_u8; BYTES / 2])
        });
        let kept = kept.unwrap();
        assert!((BYTES / 4..BYTES * 3 / 4).contains(&kept), "{kept}");
    }
}

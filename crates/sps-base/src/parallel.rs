//! Loops on the threads of the rayon pool that the caller is in. Rayon compiles its own part of a loop anew for each
//! closure, an eighth of a crate with many loops; here all of them go through one.

use std::sync::{Mutex, PoisonError};

use rayon::prelude::*;

/// Calls `work` on each item, in no order.
pub fn each<T: Send>(items: impl IntoIterator<Item = T>, work: impl Fn(T) + Sync) {
    let items = items.into_iter().map(|item| Mutex::new(Some(item)));
    let items: Vec<_> = items.collect();
    indices(items.len(), &|index| {
        let item = items[index]
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
            .take();
        if let Some(item) = item {
            work(item);
        }
    });
}

/// What `work` makes of each item, in the order of the items.
pub fn map<T: Send, O: Send>(
    items: impl IntoIterator<Item = T>,
    work: impl Fn(T) -> O + Sync,
) -> Vec<O> {
    let items: Vec<T> = items.into_iter().collect();
    let mut made: Vec<Option<O>> = items.iter().map(|_| None).collect();
    each(items.into_iter().zip(&mut made), |(item, made)| {
        *made = Some(work(item));
    });
    made.into_iter().flatten().collect()
}

/// Calls `work` on each chunk of `len` values, the last of which may be shorter, with its number.
pub fn each_chunk<T: Send>(values: &mut [T], len: usize, work: impl Fn(usize, &mut [T]) + Sync) {
    let len = len.max(1);
    // Many are small: neighbours go together, to a few parts for each thread.
    let together = values.len().div_ceil(len).div_ceil(4 * rayon::current_num_threads());
    let parts = values.chunks_mut(together.max(1) * len).enumerate();
    each(parts, |(part, values)| {
        for (number, chunk) in (part * together..).zip(values.chunks_mut(len)) {
            work(number, chunk);
        }
    });
}

fn indices(count: usize, work: &(dyn Fn(usize) + Sync)) {
    (0..count).into_par_iter().for_each(work);
}

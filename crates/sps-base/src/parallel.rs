//! Loops on the threads of the rayon pool that the caller is in. Rayon compiles its own part of a loop anew for each
//! closure, an eighth of a crate with many loops; here all of them go through one.

use std::iter::repeat_with;
use std::mem::take;
use std::sync::{Mutex, PoisonError};

use rayon::prelude::*;

/// Calls `work` on each item, in no order.
pub fn each<T: Send>(items: impl IntoIterator<Item = T>, work: impl Fn(T) + Sync) {
    let items: Vec<T> = items.into_iter().collect();
    // Of many small items neighbours go together.
    let together = items.len().div_ceil(64 * rayon::current_num_threads());
    let mut items = items.into_iter();
    let part = || items.by_ref().take(together).collect();
    let parts = repeat_with(part).take_while(|part: &Vec<T>| !part.is_empty());
    let parts: Vec<Mutex<Vec<T>>> = parts.map(Mutex::new).collect();
    indices(parts.len(), &|index| {
        let part = take(&mut *parts[index].lock().unwrap_or_else(PoisonError::into_inner));
        part.into_iter().for_each(&work);
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

fn indices(count: usize, work: &(dyn Fn(usize) + Sync)) {
    (0..count).into_par_iter().for_each(work);
}

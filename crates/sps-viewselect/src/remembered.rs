//! Losses that are computed once.

use std::collections::{HashMap, HashSet};
use std::fmt;
use std::sync::{Mutex, MutexGuard, PoisonError};

use crate::loss::LossError;
use crate::sets::{SetList, Sets};
use crate::shared::SharedLoss;

/// A [`SharedLoss`] that computes the losses of a set once, however many properties, amounts and
/// selectors ask for it. Two threads that ask for a new set at the same moment both compute it.
///
/// Where the order within a set does not matter, the loss is asked for the sorted set: all orders
/// of it are one, to the last bit. An exhaustive search of M views then costs about a M!-th.
///
/// It keeps some 100 + 8 (M + P) bytes a set. A failure is not remembered.
pub struct Remembered<L> {
    loss: L,
    known: Mutex<LossesBySet>,
}

/// The losses of all properties of each set.
type LossesBySet = HashMap<Box<[usize]>, Box<[f64]>>;

impl<L: SharedLoss> Remembered<L> {
    /// Remembers what `loss` says from now on.
    pub fn new(loss: L) -> Self {
        Self {
            loss,
            known: Mutex::default(),
        }
    }

    /// How many sets' losses are remembered.
    pub fn sets(&self) -> usize {
        self.known().len()
    }

    /// A thread that panicked left whole entries, if any.
    fn known(&self) -> MutexGuard<'_, LossesBySet> {
        self.known.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// The sets as they are remembered.
    fn keys(&self, sets: Sets<'_>) -> SetList {
        let mut keys = SetList::new(sets.picks());
        keys.extend(sets.iter().map(|set| {
            let mut key = set.to_vec();
            if !self.loss.ordered() {
                key.sort_unstable();
            }
            key
        }));
        keys
    }

    /// Those of `keys` that are not remembered, each once, in their order.
    fn unknown(&self, keys: Sets<'_>) -> SetList {
        let known = self.known();
        let mut seen = HashSet::new();
        let mut unknown = SetList::new(keys.picks());
        for key in keys {
            if !known.contains_key(key) && seen.insert(key) {
                unknown.push(key);
            }
        }
        unknown
    }
}

impl<L> fmt::Debug for Remembered<L> {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.debug_struct("Remembered").finish_non_exhaustive()
    }
}

impl<L: SharedLoss> SharedLoss for Remembered<L> {
    fn views(&self) -> usize {
        self.loss.views()
    }

    fn picks(&self) -> usize {
        self.loss.picks()
    }

    fn properties(&self) -> usize {
        self.loss.properties()
    }

    fn ordered(&self) -> bool {
        self.loss.ordered()
    }

    fn losses(&self, sets: Sets<'_>, losses: &mut [f64]) -> Result<(), LossError> {
        let properties = self.loss.properties();
        if properties == 0 {
            return Ok(());
        }
        let keys = self.keys(sets);
        let unknown = self.unknown(keys.as_sets());
        let unknown = unknown.as_sets();
        let mut computed = vec![0.0; unknown.len() * properties];
        if !unknown.is_empty() {
            // Without the lock: others go on, and the loss may ask for threads of its own.
            self.loss.losses(unknown, &mut computed)?;
        }
        let mut known = self.known();
        for (key, of_set) in unknown.iter().zip(computed.chunks_exact(properties)) {
            known.insert(key.into(), of_set.into());
        }
        let of_sets = losses.chunks_exact_mut(properties);
        for (key, of_set) in keys.as_sets().iter().zip(of_sets) {
            if let Some(remembered) = known.get(key) {
                of_set.copy_from_slice(remembered);
            }
        }
        Ok(())
    }
}

//! Many sets of views in one slice.

use crate::error::{SelectError, require_some};

/// Ordered sets of M views each, one after the other in one slice.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Sets<'a> {
    flat: &'a [usize],
    picks: usize,
}

impl<'a> Sets<'a> {
    /// Sets of `picks` views each.
    ///
    /// # Errors
    /// [`SelectError::Length`] if `flat` does not hold whole sets, [`SelectError::Setting`] if
    /// `picks` is 0.
    pub fn new(flat: &'a [usize], picks: usize) -> Result<Self, SelectError> {
        require_some("picks", picks)?;
        let (found, expected) = (flat.len(), flat.len() / picks * picks);
        if found != expected {
            return Err(SelectError::Length { found, expected });
        }
        Ok(Self { flat, picks })
    }

    /// Views in a set, M.
    pub fn picks(self) -> usize {
        self.picks
    }

    /// How many sets there are.
    pub fn len(self) -> usize {
        self.flat.len() / self.picks
    }

    /// Whether there is no set.
    pub fn is_empty(self) -> bool {
        self.flat.is_empty()
    }

    pub(crate) fn get(self, index: usize) -> &'a [usize] {
        &self.flat[index * self.picks..][..self.picks]
    }

    /// One set after the other, each a slice of M views in the order of the slots.
    pub fn iter(self) -> std::slice::ChunksExact<'a, usize> {
        self.flat.chunks_exact(self.picks)
    }

    /// All views, set by set: shape (sets, slots), row-major.
    pub fn as_flat(self) -> &'a [usize] {
        self.flat
    }
}

impl<'a> IntoIterator for Sets<'a> {
    type Item = &'a [usize];
    type IntoIter = std::slice::ChunksExact<'a, usize>;

    fn into_iter(self) -> Self::IntoIter {
        self.iter()
    }
}

/// [`Sets`] that own their views.
pub(crate) struct SetList {
    flat: Vec<usize>,
    picks: usize,
}

impl SetList {
    /// No sets yet. `picks` is at least 1, as a `Problem` has it.
    pub(crate) fn new(picks: usize) -> Self {
        Self::with_capacity(picks, 0)
    }

    /// No sets yet, and room for as many.
    pub(crate) fn with_capacity(picks: usize, sets: usize) -> Self {
        Self {
            flat: Vec::with_capacity(sets * picks),
            picks,
        }
    }

    pub(crate) fn push(&mut self, set: &[usize]) {
        debug_assert_eq!(set.len(), self.picks);
        self.flat.extend_from_slice(set);
    }

    pub(crate) fn append(&mut self, sets: Sets<'_>) {
        debug_assert_eq!(sets.picks, self.picks);
        self.flat.extend_from_slice(sets.flat);
    }

    pub(crate) fn as_sets(&self) -> Sets<'_> {
        Sets {
            flat: &self.flat,
            picks: self.picks,
        }
    }
}

impl Extend<Vec<usize>> for SetList {
    fn extend<I: IntoIterator<Item = Vec<usize>>>(&mut self, sets: I) {
        for set in sets {
            self.push(&set);
        }
    }
}

/// Whether no view comes twice.
pub(crate) fn is_distinct(set: &[usize]) -> bool {
    set.iter()
        .enumerate()
        .all(|(place, view)| !set[..place].contains(view))
}

use crate::outcome::{NonFiniteKind, Quantity, Undefined};

/// Counts samples, and remembers the first one that is not finite.
#[derive(Clone, Debug, Default)]
pub(crate) struct Screen {
    seen: usize,
    rejected: usize,
    first: Option<(usize, Quantity, NonFiniteKind)>,
}

impl Screen {
    /// Whether every part of the next sample is finite.
    pub(crate) fn admit<const N: usize>(&mut self, parts: [(Quantity, f64); N]) -> bool {
        let index = self.seen;
        self.seen += 1;
        let refused = |(quantity, value)| Some((index, quantity, NonFiniteKind::of(value)?));
        let found = parts.into_iter().find_map(refused);
        if found.is_some() {
            self.rejected += 1;
            self.first = self.first.or(found);
        }
        found.is_none()
    }

    /// As if the samples of `later` had come after those of `self`.
    pub(crate) fn merge(&mut self, later: &Self) {
        let shifted = |(index, quantity, kind)| (self.seen + index, quantity, kind);
        self.first = self.first.or(later.first.map(shifted));
        self.seen += later.seen;
        self.rejected += later.rejected;
    }

    /// How many samples were seen, if there are any and all are finite.
    pub(crate) fn samples(&self) -> Result<usize, Undefined> {
        match self.first {
            Some((index, quantity, kind)) => Err(Undefined::NonFinite {
                quantity,
                index,
                kind,
                count: self.rejected,
                of: self.seen,
            }),
            None if self.seen == 0 => Err(Undefined::Empty),
            None => Ok(self.seen),
        }
    }
}

//! What of an experiment a process does: all of it, one of several parts, or none.

use std::fmt;
use std::str::FromStr;

use anyhow::{Result, ensure};

/// What is done of what is missing.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Work {
    /// All of it.
    All,
    /// One of several parts.
    Shard(Shard),
    /// Frames are encoded: without embeddings nobody can tell what else is there. All else is
    /// there, or told as not done.
    Encoding,
    /// Nothing, and nothing is written: what is missing is told as not done.
    None,
}

impl Work {
    /// Whether encoders are trained, views selected and trials run.
    pub(crate) fn fits(self) -> bool {
        matches!(self, Self::All | Self::Shard(_))
    }

    /// That they are, where there is something to do: `what` is not there.
    pub(crate) fn ensure_fits(self, what: &str) -> Result<()> {
        ensure!(
            self.fits(),
            "{what}: in none of the shards, although all have ended. Either a line of a journal was \
            damaged, and its shard run again mends it; or the shards saw other embeddings, as \
            processors of another kind make them. Without --merge what is missing is done here"
        );
        Ok(())
    }
}

/// One of several parts of an experiment, which together are all of it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Shard {
    /// How many parts there are.
    pub of: usize,
    /// Which, from 1.
    pub number: usize,
}

impl Shard {
    pub(crate) fn all(of: usize) -> impl Iterator<Item = Self> {
        (1..=of).map(move |number| Self { of, number })
    }

    /// Whether the item at this place is dealt to this part.
    pub(crate) fn has(self, place: usize) -> bool {
        place % self.of == self.number - 1
    }

    /// Places below `count` in the order in which this part visits them: first those that are its
    /// own, which lie together, then those of the others in an order of its own, so that parts that
    /// help one another seldom meet.
    pub(crate) fn order(self, count: usize) -> Vec<usize> {
        let is_own = |place: usize| place * self.of / count.max(1) == self.number - 1;
        let mut places: Vec<usize> = (0..count).collect();
        places.sort_by_cached_key(|&place| {
            let name = format!("{self} {place}");
            let of_other = (!is_own(place)).then(|| *blake3::hash(name.as_bytes()).as_bytes());
            (of_other, place)
        });
        places
    }

    /// Its folder in that of the run.
    pub(crate) fn folder(self) -> String {
        format!("{}-of-{}", self.number, self.of)
    }

    /// The part that a folder is named after.
    pub(crate) fn of_folder(name: &str) -> Option<Self> {
        let (number, of) = name.split_once("-of-")?;
        format!("{number}/{of}").parse().ok()
    }
}

impl fmt::Display for Shard {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}/{}", self.number, self.of)
    }
}

impl FromStr for Shard {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        let numbers = text.split_once('/').and_then(|(number, of)| {
            let (number, of) = (number.parse().ok()?, of.parse().ok()?);
            (1..=of).contains(&number).then_some(Self { of, number })
        });
        numbers.ok_or_else(|| format!("`{text}` is not K/N with K from 1 to N, such as 2/4"))
    }
}

/// Something missing where it is not to be made.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Undone {
    Frames(usize),
    Training,
}

impl fmt::Display for Undone {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Frames(count) => write!(f, "{count} frames are not encoded"),
            Self::Training => f.write_str("an encoder is not trained"),
        }
    }
}

impl std::error::Error for Undone {}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_shard_is_read_as_it_is_written() {
        let shard: Shard = "2/4".parse().unwrap();
        assert_eq!((shard.number, shard.of), (2, 4));
        assert_eq!(shard.to_string(), "2/4");
        assert_eq!(Shard::of_folder(&shard.folder()), Some(shard));
        for text in ["0/4", "5/4", "1/0", "2", "a/b", "1/2/3", "-1/2", ""] {
            let error = text.parse::<Shard>().unwrap_err();
            assert!(error.contains(&format!("`{text}`")), "{error}");
        }
    }

    #[test]
    fn every_place_is_dealt_to_one_shard() {
        for of in 1..9 {
            for place in 0..50 {
                assert_eq!(Shard::all(of).filter(|shard| shard.has(place)).count(), 1);
            }
        }
    }

    #[test]
    fn each_shard_visits_every_place_once_beginning_with_its_own() {
        let mut own = Vec::new();
        for shard in Shard::all(4) {
            let order = shard.order(10);
            let mut sorted = order.clone();
            sorted.sort_unstable();
            assert_eq!(sorted, (0..10).collect::<Vec<_>>());
            // 10 places are 3, 2, 3 and 2.
            own.extend(order[..[3, 2, 3, 2][shard.number - 1]].iter().copied());
        }
        assert_eq!(own, (0..10).collect::<Vec<_>>());
        assert_eq!(Shard::all(1).next().unwrap().order(3), [0, 1, 2]);
        assert!(Shard::all(2).all(|shard| shard.order(0).is_empty()));
    }

    #[test]
    fn shards_help_others_in_different_orders() {
        let orders: Vec<Vec<usize>> = Shard::all(3)
            .map(|shard| shard.order(30)[10..].to_vec())
            .collect();
        assert!(orders[0] != orders[1] && orders[1] != orders[2]);
    }
}

//! Which feature maps an embedding is made of.

use std::convert::Infallible;
use std::fmt;
use std::str::FromStr;

use super::Depth;
use crate::error::Error;

/// The feature maps whose means over space make an embedding, one block each, side by side in the order of the
/// network's layers.
///
/// In configurations `"last"`, `"all"`, or the names of depths: `["stage-2", "stage-4"]`. Touch lies in fine
/// structure, which earlier maps hold and the last has thrown away.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub enum Depths {
    /// The last map alone.
    #[default]
    Last,
    /// The map after each stage, or after each block of a network without stages.
    All,
    /// Those of these names.
    Named(Vec<String>),
}

/// One depth of an encoder's embeddings.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Block {
    /// `stage-3`, or `block-3` in a network without stages; `head` of a convolution behind the stages.
    pub name: String,
    /// How many features it has: the channels of its map.
    pub width: usize,
}

const LAST: &str = "last";
const ALL: &str = "all";

impl Depths {
    /// Leaves the depths that are chosen.
    pub(super) fn choose(
        &self,
        network: &str,
        depths: &mut Vec<Depth>,
    ) -> crate::error::Result<()> {
        let names = match self {
            Self::All => return Ok(()),
            Self::Last => {
                depths.drain(..depths.len().saturating_sub(1));
                return Ok(());
            }
            Self::Named(names) => names,
        };
        let known = |name: &&String| depths.iter().any(|depth| depth.name == **name);
        let twice = (1..names.len()).find(|&at| names[..at].contains(&names[at]));
        let found = if let Some(name) = names.iter().find(|name| !known(name)) {
            format!("{name:?}")
        } else if let Some(at) = twice {
            format!("{:?} twice", names[at])
        } else if names.is_empty() {
            "none".to_owned()
        } else {
            depths.retain(|depth| names.contains(&depth.name));
            return Ok(());
        };
        let all: Vec<&str> = depths.iter().map(|depth| &depth.name[..]).collect();
        let expected = format!("some of {network}'s {}, each once", all.join(", "));
        Err(Error::input("depths", found, expected))
    }
}

impl fmt::Display for Depths {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Last => f.write_str(LAST),
            Self::All => f.write_str(ALL),
            Self::Named(names) => f.write_str(&names.join(",")),
        }
    }
}

/// As they are printed: names with commas between them.
impl FromStr for Depths {
    type Err = Infallible;

    fn from_str(text: &str) -> Result<Self, Infallible> {
        Ok(match text {
            LAST => Self::Last,
            ALL => Self::All,
            names => Self::Named(names.split(',').map(str::to_owned).collect()),
        })
    }
}

/// As configurations and files have them.
#[cfg(feature = "serde")]
mod words {
    use std::fmt;

    use serde::de::value::SeqAccessDeserializer;
    use serde::de::{self, Error as _, SeqAccess, Visitor};
    use serde::{Deserialize, Deserializer, Serialize, Serializer};

    use super::{ALL, Depths, LAST};

    impl Serialize for Depths {
        fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
            match self {
                Self::Last => serializer.serialize_str(LAST),
                Self::All => serializer.serialize_str(ALL),
                Self::Named(names) => names.serialize(serializer),
            }
        }
    }

    impl<'de> Deserialize<'de> for Depths {
        fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
            deserializer.deserialize_any(Words)
        }
    }

    /// Takes a word or a list of names.
    struct Words;

    impl<'de> Visitor<'de> for Words {
        type Value = Depths;

        fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
            f.write_str("\"last\", \"all\" or a list of names of depths")
        }

        fn visit_str<E: de::Error>(self, word: &str) -> Result<Depths, E> {
            match word {
                LAST => Ok(Depths::Last),
                ALL => Ok(Depths::All),
                _ => Err(E::invalid_value(de::Unexpected::Str(word), &self)),
            }
        }

        fn visit_seq<A: SeqAccess<'de>>(self, names: A) -> Result<Depths, A::Error> {
            let names = Vec::deserialize(SeqAccessDeserializer::new(names))?;
            if names.is_empty() {
                return Err(A::Error::invalid_length(0, &self));
            }
            Ok(Depths::Named(names))
        }
    }
}

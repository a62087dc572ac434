use std::error::Error;
use std::fmt::{self, Display, Formatter};

/// Something handed in that is not what it should be.
#[derive(Debug, Clone)]
pub struct Unexpected {
    /// The argument, the setting's key, or the part of a file.
    pub what: String,
    /// What it was.
    pub found: String,
    /// What it must be.
    pub expected: String,
}

impl Unexpected {
    /// What was wrong, what was found and what was expected, in words.
    pub fn new(what: impl Display, found: impl Display, expected: impl Display) -> Self {
        Self {
            what: what.to_string(),
            found: found.to_string(),
            expected: expected.to_string(),
        }
    }
}

impl Display for Unexpected {
    fn fmt(&self, to: &mut Formatter<'_>) -> fmt::Result {
        let Self {
            what,
            found,
            expected,
        } = self;
        write!(to, "{what}: found {found}, expected {expected}")
    }
}

impl Error for Unexpected {}

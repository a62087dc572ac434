//! Names that are none of those known, and the one that was probably meant.
//!
//! ```
//! use sps_base::names::UnknownName;
//!
//! let message = "unknown variant `wide-cvs`, expected `long-csv` or `wide-csv`";
//! assert_eq!(
//!     UnknownName::of_serde(message).unwrap().to_string(),
//!     "unknown value `wide-cvs`, did you mean `wide-csv`? Expected one of `long-csv`, `wide-csv`",
//! );
//! ```

use std::fmt;

/// A name that is none of those known.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct UnknownName {
    /// What kind of name it is, for example `key`.
    pub what: &'static str,
    /// The name that was found.
    pub found: String,
    /// The one that was probably meant.
    pub nearest: Option<String>,
    /// Every name that would have been right; empty where there are too many to list.
    pub expected: Vec<String>,
}

impl UnknownName {
    /// `found`, which is none of `known`.
    pub fn new<'a>(
        what: &'static str,
        found: &str,
        known: impl IntoIterator<Item = &'a str>,
    ) -> Self {
        let known: Vec<&str> = known.into_iter().collect();
        Self {
            what,
            found: found.to_owned(),
            nearest: nearest(found, known.iter().copied()).map(str::to_owned),
            expected: known.into_iter().map(str::to_owned).collect(),
        }
    }

    /// What serde's message about a field (`key`) or variant (`value`) means, for it says only in
    /// words which names it knows; `None` where the message is about something else.
    pub fn of_serde(message: &str) -> Option<Self> {
        let kinds = [("unknown field ", "key"), ("unknown variant ", "value")];
        kinds.into_iter().find_map(|(start, what)| {
            let mut names = message.strip_prefix(start)?.split('`').skip(1).step_by(2);
            let found = names.next()?;
            Some(Self::new(what, found, names))
        })
    }
}

impl fmt::Display for UnknownName {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "unknown {} `{}`, ", self.what, self.found)?;
        let expected = self.expected.join("`, `");
        match &self.nearest {
            Some(nearest) if expected.is_empty() => write!(f, "did you mean `{nearest}`?"),
            Some(nearest) => write!(f, "did you mean `{nearest}`? Expected one of `{expected}`"),
            None if expected.is_empty() => f.write_str("which is not one of those known"),
            None => write!(f, "expected one of `{expected}`"),
        }
    }
}

/// The one of `known` that `typed` probably stands for: equal but for case, or a typing slip away
/// (one edit, or swapped neighbours, for every three characters, at most three).
pub fn nearest<'a>(typed: &str, known: impl IntoIterator<Item = &'a str>) -> Option<&'a str> {
    let typed = typed.to_lowercase();
    let slips = (typed.chars().count() / 3).clamp(1, 3);
    known
        .into_iter()
        .map(|name| (strsim::osa_distance(&typed, &name.to_lowercase()), name))
        .filter(|(distance, _)| *distance <= slips)
        .min_by_key(|(distance, _)| *distance)
        .map(|(_, name)| name)
}

//! What is measured of a surface: codes, what is known of them, and the ones that the project knows.

mod description;
mod order;
pub mod toccare;

use std::fmt;
use std::ops::Deref;
use std::str::FromStr;
use std::sync::Arc;

use serde::{Deserialize, Deserializer, Serialize, Serializer, de};

pub use description::{Description, PropertyRange};
pub use order::PropertyOrder;

/// Columns of a tactile table that are no property.
pub(crate) const RESERVED: [&str; 3] = ["surface", "location", "repeat"];

/// Codes are parts of file names.
const LONGEST: usize = 64;

/// A property of surfaces that somebody measured, by its code: `fRS`, `friction`,
/// `surface-roughness`.
///
/// A code has letters from a to z in either case, digits, `-` and `_`, at most 64 of them; the case
/// counts. `surface`, `location` and `repeat` are none, for a tactile table has columns of these names.
/// What a property means is a [`Description`]; the codes of the SynTouch Toccare are in [`toccare`].
///
/// ```
/// use sps_dataset::Property;
///
/// let property: Property = "surface-roughness".parse()?;
/// assert_eq!(property.code(), "surface-roughness");
/// let refused = "surface roughness".parse::<Property>().unwrap_err();
/// assert_eq!(refused.suggestion().unwrap(), property);
/// # Ok::<(), sps_dataset::InvalidCode>(())
/// ```
#[derive(Clone, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct Property(Arc<str>);

/// A text that cannot be the code of a property.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct InvalidCode(
    /// What was found.
    pub String,
);

impl Property {
    /// The code.
    pub fn code(&self) -> &str {
        &self.0
    }
}

impl FromStr for Property {
    type Err = InvalidCode;

    fn from_str(code: &str) -> Result<Self, InvalidCode> {
        let allowed = |c: char| c.is_ascii_alphanumeric() || matches!(c, '-' | '_');
        let fits = (1..=LONGEST).contains(&code.len()) && code.chars().all(allowed);
        if fits && !RESERVED.contains(&code) {
            Ok(Self(code.into()))
        } else {
            Err(InvalidCode(code.to_owned()))
        }
    }
}

impl Deref for Property {
    type Target = str;

    fn deref(&self) -> &str {
        &self.0
    }
}

impl PartialEq<&str> for Property {
    fn eq(&self, code: &&str) -> bool {
        &*self.0 == *code
    }
}

impl fmt::Debug for Property {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        fmt::Debug::fmt(&self.0, f)
    }
}

impl fmt::Display for Property {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(&self.0)
    }
}

/// As its code, for example `"fRS"`.
impl Serialize for Property {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_str(&self.0)
    }
}

/// From its code.
impl<'de> Deserialize<'de> for Property {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let code = String::deserialize(deserializer)?;
        code.parse().map_err(de::Error::custom)
    }
}

impl InvalidCode {
    /// A code that is close: what is not allowed becomes `-`.
    pub fn suggestion(&self) -> Option<Property> {
        let stands_between = |c: char| !c.is_ascii_alphanumeric() && c != '_';
        let parts = self.0.split(stands_between);
        let parts: Vec<&str> = parts.filter(|part| !part.is_empty()).collect();
        parts.join("-").parse().ok()
    }
}

impl fmt::Display for InvalidCode {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "`{}` cannot be ", self.0.escape_debug())?;
        if RESERVED.contains(&self.0.as_str()) {
            return f.write_str("a property: a tactile table has a column of that name");
        }
        let letters = "a to z, A to Z, 0 to 9, `-` and `_`";
        write!(
            f,
            "the code of a property, expected 1 to {LONGEST} of {letters}"
        )?;
        match self.suggestion() {
            Some(code) => write!(f, ", for example `{code}`"),
            None => Ok(()),
        }
    }
}

impl std::error::Error for InvalidCode {}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_code_is_a_short_plain_name() {
        for code in "fRS friction surface-roughness a_1 7 - true mean".split(' ') {
            assert_eq!(code.parse::<Property>().unwrap(), code);
        }
        let longest = "x".repeat(64);
        assert_eq!(longest.parse::<Property>().unwrap().code(), longest);
    }

    #[test]
    fn what_is_none_is_refused_by_name() {
        let longer = "x".repeat(65);
        for (text, near) in [
            ("", None),
            ("color vibrancy", Some("color-vibrancy")),
            ("../etc/passwd", Some("etc-passwd")),
            ("Härte", Some("H-rte")),
            ("硬度", None),
            ("твёрдость", None),
            ("a\u{0}b", Some("a-b")),
            ("friction (N)", Some("friction-N")),
            (" ", None),
            (longer.as_str(), None),
            ("surface", None),
            ("location", None),
            ("repeat", None),
        ] {
            let refused = text.parse::<Property>().unwrap_err();
            assert_eq!(refused.0, text);
            let suggested = refused.suggestion();
            assert_eq!(suggested.as_deref(), near, "{text:?}");
            let (message, shown) = (refused.to_string(), text.escape_debug().to_string());
            assert!(message.contains(&shown), "{message}");
            assert!(message.contains("property"), "{message}");
        }
    }
}

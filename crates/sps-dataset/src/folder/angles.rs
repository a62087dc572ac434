use std::fmt;

use serde::de::value::{MapAccessDeserializer, SeqAccessDeserializer};
use serde::de::{MapAccess, SeqAccess, Visitor};
use serde::{Deserialize, Deserializer, Serialize, de};

use crate::{InvalidValue, RollAngle};

/// More views than any sequence has; a range must not be able to ask for all memory.
const MOST_VIEWS: usize = 1_000_000;

/// The roll angle of each view in degrees: a list, or an evenly spaced range with both ends; a list
/// again where it is written.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ViewAngles(Vec<RollAngle>);

#[derive(Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
struct EvenRange {
    from: f64,
    to: f64,
    count: usize,
}

impl ViewAngles {
    /// The given angles.
    ///
    /// # Errors
    /// Where there is none, or one is not finite.
    pub fn list(degrees: Vec<f64>) -> Result<Self, InvalidValue> {
        if degrees.is_empty() {
            return invalid("a dataset has at least one view");
        }
        if degrees.iter().any(|angle| !angle.is_finite()) {
            return invalid("a view angle is a finite number of degrees");
        }
        Ok(Self(degrees.into_iter().map(RollAngle).collect()))
    }

    /// `count` angles from `from` to `to`, evenly spaced, both ends included; one view is at
    /// `from`. The paper's sequences are -45 to 45 with 100 views.
    ///
    /// # Errors
    /// Where `count` is zero or beyond a million, or an end is not finite.
    pub fn evenly_spaced(from: f64, to: f64, count: usize) -> Result<Self, InvalidValue> {
        if count > MOST_VIEWS {
            return invalid("a sequence has at most 1000000 views");
        }
        let steps = count.saturating_sub(1).max(1);
        // Symmetric about the middle, so that the two views beside it are equally far from it.
        let angle = |i: usize| (from * (steps - i) as f64 + to * i as f64) / steps as f64;
        Self::list((0..count).map(angle).collect())
    }

    /// The angles, one per view.
    pub fn as_slice(&self) -> &[RollAngle] {
        &self.0
    }
}

fn invalid(text: &str) -> Result<ViewAngles, InvalidValue> {
    Err(InvalidValue(text.to_owned()))
}

/// From a list of degrees or from `{ from, to, count }`.
impl<'de> Deserialize<'de> for ViewAngles {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        // Not serde's untagged enum: its messages name neither the line nor the key.
        deserializer.deserialize_any(AnglesVisitor)
    }
}

struct AnglesVisitor;

impl<'de> Visitor<'de> for AnglesVisitor {
    type Value = ViewAngles;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("a list of degrees or { from = DEGREES, to = DEGREES, count = VIEWS }")
    }

    fn visit_seq<A: SeqAccess<'de>>(self, seq: A) -> Result<ViewAngles, A::Error> {
        let degrees = Vec::deserialize(SeqAccessDeserializer::new(seq))?;
        ViewAngles::list(degrees).map_err(de::Error::custom)
    }

    fn visit_map<A: MapAccess<'de>>(self, map: A) -> Result<ViewAngles, A::Error> {
        let range = EvenRange::deserialize(MapAccessDeserializer::new(map))?;
        ViewAngles::evenly_spaced(range.from, range.to, range.count).map_err(de::Error::custom)
    }
}

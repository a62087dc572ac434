use std::collections::HashSet;

use crate::moments::Moments;
use crate::outcome::{Quantity, Undefined};
use crate::samples::Better;

/// One metric's value for one property.
#[derive(Clone, Debug, PartialEq)]
pub struct PropertyScore {
    /// The property's name, for example `fRS`.
    pub property: String,
    /// The score, or why there is none.
    pub value: Result<f64, Undefined>,
}

/// A mean over properties, and what it rests on.
#[derive(Clone, Debug, PartialEq)]
pub struct PropertyMean {
    /// The mean over [`properties`](Self::properties), in the unit of the scores.
    pub value: Result<f64, Undefined>,
    /// The properties averaged, in the order asked for; best first for
    /// [`mean_over_best`].
    pub properties: Vec<String>,
    /// The properties that have no score, and why.
    pub left_out: Vec<(String, Undefined)>,
    /// Over how many properties the mean was asked for.
    pub wanted: usize,
}

impl PropertyMean {
    /// Whether every property that was asked for is in the mean.
    pub fn is_complete(&self) -> bool {
        self.properties.len() == self.wanted
    }

    /// Over those of some names and scores that have one.
    fn over<'a>(
        scores: impl Iterator<Item = (&'a str, Result<f64, Undefined>)>,
        wanted: usize,
    ) -> Self {
        let mut mean = Self::refused(Undefined::NothingDefined { of: wanted }, wanted);
        let mut moments = Moments::new();
        for (property, value) in scores {
            match value {
                Ok(value) => {
                    moments.push(value);
                    mean.properties.push(property.to_owned());
                }
                Err(reason) => mean.left_out.push((property.to_owned(), reason)),
            }
        }
        if !mean.properties.is_empty() {
            mean.value = moments.mean();
        }
        mean
    }

    fn refused(reason: Undefined, wanted: usize) -> Self {
        Self {
            value: Err(reason),
            properties: Vec::new(),
            left_out: Vec::new(),
            wanted,
        }
    }
}

/// The mean over all properties. Those without a score are left out and reported.
///
/// A property named twice makes the value [`Undefined::RepeatedProperty`]; no score at all,
/// [`Undefined::NothingDefined`].
pub fn mean_over_all(scores: &[PropertyScore]) -> PropertyMean {
    if let Some(repeated) = repeated(names(scores)) {
        return PropertyMean::refused(repeated, scores.len());
    }
    PropertyMean::over(scores.iter().map(checked), scores.len())
}

/// The mean over a fixed list of properties, such as the paper's top eight. Those without a score,
/// and those that `scores` does not hold ([`Undefined::NotScored`]), are left out and reported.
///
/// A property named twice in either list makes the value [`Undefined::RepeatedProperty`]; no score
/// at all, [`Undefined::NothingDefined`].
///
/// ```
/// use sps_metrics::{PropertyScore, Undefined, mean_over_named};
///
/// let scores = [
///     PropertyScore { property: "fRS".into(), value: Ok(13.0) },
///     PropertyScore { property: "cDF".into(), value: Ok(15.0) },
///     PropertyScore { property: "fST".into(), value: Ok(73.5) },
/// ];
/// let mean = mean_over_named(&scores, &["fRS", "cDF", "tCO"]);
/// assert_eq!(mean.value, Ok(14.0));
/// assert_eq!(mean.left_out, [("tCO".to_owned(), Undefined::NotScored)]);
/// ```
pub fn mean_over_named<N: AsRef<str>>(scores: &[PropertyScore], wanted: &[N]) -> PropertyMean {
    let listed = wanted.iter().map(AsRef::as_ref);
    if let Some(repeated) = repeated(names(scores)).or_else(|| repeated(listed.clone())) {
        return PropertyMean::refused(repeated, wanted.len());
    }
    let found = listed.map(|name| {
        let score = scores.iter().find(|score| score.property == name);
        score.map_or((name, Err(Undefined::NotScored)), checked)
    });
    PropertyMean::over(found, wanted.len())
}

/// The mean over the `count` best properties of this run, by these scores themselves. Of equal
/// scores the earlier property counts as better. Properties without a score cannot be among the
/// best and are reported; where fewer than `count` have one, the mean is over those.
///
/// A property named twice makes the value [`Undefined::RepeatedProperty`]; no score at all,
/// [`Undefined::NothingDefined`].
pub fn mean_over_best(scores: &[PropertyScore], count: usize, better: Better) -> PropertyMean {
    if let Some(repeated) = repeated(names(scores)) {
        return PropertyMean::refused(repeated, count);
    }
    let all = scores.iter().map(checked);
    let (mut best, undefined): (Vec<_>, Vec<_>) = all.partition(|(_, value)| value.is_ok());
    // Adding zero makes -0 and 0 one value.
    let value = |of: &(_, Result<f64, _>)| of.1.as_ref().map_or(0.0, |value| value + 0.0);
    best.sort_by(|a, b| match better {
        Better::Higher => value(b).total_cmp(&value(a)),
        Better::Lower => value(a).total_cmp(&value(b)),
    });
    best.truncate(count);
    PropertyMean::over(best.into_iter().chain(undefined), count)
}

fn names(scores: &[PropertyScore]) -> impl Iterator<Item = &str> {
    scores.iter().map(|score| score.property.as_str())
}

/// The name and the score, where one that is not finite is none.
fn checked(score: &PropertyScore) -> (&str, Result<f64, Undefined>) {
    let value = score.value.clone();
    (
        &score.property,
        value.and_then(|value| Quantity::Value.finite(value)),
    )
}

fn repeated<'a>(names: impl Iterator<Item = &'a str>) -> Option<Undefined> {
    let mut seen = HashSet::new();
    let repeated = names.into_iter().find(|&name| !seen.insert(name))?;
    Some(Undefined::RepeatedProperty {
        property: repeated.to_owned(),
    })
}

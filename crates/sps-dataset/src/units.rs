//! What is never split apart: a surface, or a group of surfaces.

use std::collections::HashMap;
use std::fmt;

use serde::de::{self, Deserializer, Visitor};
use serde::{Deserialize, Serialize, Serializer};

use crate::stream::shuffle;
use crate::{Split, SplitError, Surface};

/// What a split keeps together, a resample draws and an interval speaks of.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Unit {
    /// Each surface on its own.
    Surface,
    /// All surfaces of a group.
    Group,
}

impl fmt::Display for Unit {
    /// In the plural.
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str(match self {
            Self::Surface => "surfaces",
            Self::Group => "groups",
        })
    }
}

/// Whether surfaces of one group stay together: `"auto"`, `true` or `false` in a config.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum KeepGroups {
    /// Where any group has more than one surface.
    #[default]
    Auto,
    /// In any case.
    Always,
    /// They may be split apart: what is measured then is how well known groups are recognised.
    Never,
}

impl Serialize for KeepGroups {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        match self {
            Self::Auto => serializer.serialize_str("auto"),
            Self::Always => serializer.serialize_bool(true),
            Self::Never => serializer.serialize_bool(false),
        }
    }
}

impl<'de> Deserialize<'de> for KeepGroups {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Written;
        impl Visitor<'_> for Written {
            type Value = KeepGroups;

            fn expecting(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
                formatter.write_str("\"auto\", true or false")
            }

            fn visit_bool<E: de::Error>(self, keep: bool) -> Result<KeepGroups, E> {
                Ok(if keep {
                    KeepGroups::Always
                } else {
                    KeepGroups::Never
                })
            }

            fn visit_str<E: de::Error>(self, word: &str) -> Result<KeepGroups, E> {
                match word {
                    "auto" => Ok(KeepGroups::Auto),
                    other => Err(E::invalid_value(de::Unexpected::Str(other), &self)),
                }
            }
        }
        deserializer.deserialize_any(Written)
    }
}

/// The unit that each surface belongs to.
///
/// ```
/// use sps_dataset::{KeepGroups, Surface, Unit, Units};
///
/// let surface = |id: &str, group: &str| Surface {
///     id: id.into(),
///     material: String::new(),
///     group: group.into(),
/// };
/// let surfaces = [surface("a1", "a"), surface("b1", "b"), surface("a2", "a")];
/// let units = Units::of(&surfaces, KeepGroups::Auto);
/// assert_eq!((units.unit(), units.count()), (Unit::Group, 2));
/// assert_eq!(units.of_surface(), [0, 1, 0]);
///
/// // A third of the surfaces kept aside: no group is on both sides.
/// let split = units.keep_aside(&[0, 1, 2], 0.34, 1, "calibration", 0)?;
/// assert_eq!((split.train, split.validation), (vec![0, 2], vec![1]));
/// # Ok::<(), sps_dataset::SplitError>(())
/// ```
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Units {
    unit: Unit,
    of_surface: Vec<usize>,
    count: usize,
}

impl Units {
    /// The units of `surfaces`, numbered in the order in which they come up.
    pub fn of(surfaces: &[Surface], keep: KeepGroups) -> Self {
        let mut numbers: HashMap<&str, usize> = HashMap::new();
        let groups: Vec<usize> = surfaces
            .iter()
            .map(|surface| {
                let next = numbers.len();
                *numbers.entry(&surface.group).or_insert(next)
            })
            .collect();
        let unit = match keep {
            KeepGroups::Always => Unit::Group,
            KeepGroups::Auto if numbers.len() < surfaces.len() => Unit::Group,
            KeepGroups::Auto | KeepGroups::Never => Unit::Surface,
        };
        match unit {
            Unit::Group => Self {
                unit,
                of_surface: groups,
                count: numbers.len(),
            },
            Unit::Surface => Self {
                unit,
                of_surface: (0..surfaces.len()).collect(),
                count: surfaces.len(),
            },
        }
    }

    /// What is kept together.
    pub fn unit(&self) -> Unit {
        self.unit
    }

    /// How many units there are.
    pub fn count(&self) -> usize {
        self.count
    }

    /// The number of each surface's unit, below [`count`](Self::count).
    pub fn of_surface(&self) -> &[usize] {
        &self.of_surface
    }

    /// How many units there are among some surfaces.
    pub fn among(&self, surfaces: &[usize]) -> usize {
        self.members(surfaces).len()
    }

    /// Keeps a share of some surfaces aside, whole units at random: the stream is keyed by `seed`,
    /// `purpose` and `index`. Indices without a surface are left out.
    ///
    /// # Errors
    /// A share that is not between 0 and 1, or fewer than two units.
    pub fn keep_aside(
        &self,
        surfaces: &[usize],
        share: f64,
        seed: u64,
        purpose: &str,
        index: u64,
    ) -> Result<Split, SplitError> {
        if !(share > 0.0 && share < 1.0) {
            return Err(SplitError::Share(share));
        }
        let units = self.shuffled(surfaces, 2, seed, purpose, index)?;
        let count = units.iter().map(Vec::len).sum();
        Ok(Split::keeping_aside(
            kept_aside(&units, count, share),
            surfaces,
        ))
    }

    /// Deals the units of some surfaces into `folds` parts at random, each kept aside once.
    ///
    /// # Errors
    /// Fewer than two folds, or fewer units than folds.
    pub fn folds(
        &self,
        surfaces: &[usize],
        folds: usize,
        seed: u64,
        purpose: &str,
        index: u64,
    ) -> Result<Vec<Split>, SplitError> {
        if folds < 2 {
            return Err(SplitError::Folds(folds));
        }
        let parts = deal(self.shuffled(surfaces, folds, seed, purpose, index)?, folds);
        let aside = |part| Split::keeping_aside(part, surfaces);
        Ok(parts.into_iter().map(aside).collect())
    }

    /// Keeps each unit of some surfaces aside once.
    ///
    /// # Errors
    /// Fewer than two units.
    pub fn each_aside(&self, surfaces: &[usize]) -> Result<Vec<Split>, SplitError> {
        let units = self.at_least(2, surfaces)?;
        let aside = |unit| Split::keeping_aside(unit, surfaces);
        Ok(units.into_iter().map(aside).collect())
    }

    fn shuffled(
        &self,
        surfaces: &[usize],
        parts: usize,
        seed: u64,
        purpose: &str,
        index: u64,
    ) -> Result<Vec<Vec<usize>>, SplitError> {
        let mut units = self.at_least(parts, surfaces)?;
        shuffle(&mut units, seed, purpose, index);
        Ok(units)
    }

    fn at_least(&self, wanted: usize, surfaces: &[usize]) -> Result<Vec<Vec<usize>>, SplitError> {
        let units = self.members(surfaces);
        if units.len() < wanted {
            return Err(SplitError::TooFew {
                unit: self.unit,
                found: units.len(),
                wanted,
            });
        }
        Ok(units)
    }

    /// The units of some surfaces, in the order in which they come up.
    fn members(&self, surfaces: &[usize]) -> Vec<Vec<usize>> {
        let mut places: HashMap<usize, usize> = HashMap::new();
        let mut members: Vec<Vec<usize>> = Vec::new();
        for &surface in surfaces {
            let Some(&unit) = self.of_surface.get(surface) else {
                continue;
            };
            let place = *places.entry(unit).or_insert(members.len());
            if place == members.len() {
                members.push(Vec::new());
            }
            members[place].push(surface);
        }
        members
    }
}

impl Split {
    fn keeping_aside(mut validation: Vec<usize>, surfaces: &[usize]) -> Self {
        validation.sort_unstable();
        let kept = |surface: &usize| validation.binary_search(surface).is_err();
        let mut train: Vec<usize> = surfaces.iter().copied().filter(kept).collect();
        train.sort_unstable();
        Self { train, validation }
    }
}

/// Takes, in order, each unit that brings the part nearer to the share asked for; the smallest
/// where none does. At least one unit is left over.
fn kept_aside(units: &[Vec<usize>], surfaces: usize, share: f64) -> Vec<usize> {
    let wanted = ((surfaces as f64 * share).round() as usize).clamp(1, surfaces - 1);
    let mut part: Vec<usize> = Vec::new();
    for unit in units {
        let with_it = part.len() + unit.len();
        if with_it.abs_diff(wanted) < part.len().abs_diff(wanted) && with_it < surfaces {
            part.extend(unit);
        }
    }
    if part.is_empty() {
        let smallest = units.iter().min_by_key(|unit| unit.len());
        part.extend(smallest.into_iter().flatten());
    }
    part
}

/// Deals units out, large ones first, each to the part that is smallest so far.
fn deal(mut units: Vec<Vec<usize>>, parts: usize) -> Vec<Vec<usize>> {
    units.sort_by_key(|unit| std::cmp::Reverse(unit.len()));
    let mut dealt: Vec<Vec<usize>> = vec![Vec::new(); parts];
    for unit in units {
        if let Some(smallest) = dealt.iter_mut().min_by_key(|part| part.len()) {
            smallest.extend(unit);
        }
    }
    dealt
}

//! What is never split apart: a surface, or a group of surfaces.

use std::collections::HashMap;
use std::fmt;

use serde::{Deserialize, Serialize};

use crate::stream::shuffle;
use crate::{Split, SplitError, Surface};

/// What a split keeps together and an interval counts; in ascending order of
/// how much that is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Unit {
    /// Each surface on its own.
    Surface,
    /// All surfaces of a group.
    Group,
    /// All surfaces of a material.
    Material,
}

impl Unit {
    /// As a config names it.
    pub fn name(self) -> &'static str {
        match self {
            Self::Surface => "surface",
            Self::Group => "group",
            Self::Material => "material",
        }
    }

    /// The name of the group or material that a surface is of; `None` where the surface is a unit of
    /// its own, as one without such a name is.
    pub fn of(self, surface: &Surface) -> Option<&str> {
        let name = match self {
            Self::Surface => return None,
            Self::Group => &surface.group,
            Self::Material => &surface.material,
        };
        (!name.is_empty()).then_some(name)
    }
}

impl fmt::Display for Unit {
    /// In the plural.
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(formatter, "{}s", self.name())
    }
}

/// The unit that each surface belongs to.
///
/// ```
/// use sps_dataset::{Surface, Unit, Units};
///
/// let surface = |id: &str, group: &str| Surface {
///     id: id.into(),
///     material: String::new(),
///     group: group.into(),
/// };
/// let surfaces = [surface("a1", "a"), surface("b1", "b"), surface("a2", "a")];
/// let units = Units::of(&surfaces);
/// assert_eq!((units.unit(), units.count()), (Unit::Group, 2));
/// assert_eq!(units.of_surface(), [0, 1, 0]);
///
/// // Half of the groups kept aside: no group is on both sides.
/// let split = units.keep_aside(&[0, 1, 2], 0.5, 1, "calibration", 0)?;
/// assert_eq!(split.train.contains(&0), split.train.contains(&2));
/// # Ok::<(), sps_dataset::SplitError>(())
/// ```
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Units {
    unit: Unit,
    of_surface: Vec<usize>,
    count: usize,
}

impl Units {
    /// Groups where any has more than one surface, else surfaces.
    pub fn of(surfaces: &[Surface]) -> Self {
        let groups = Self::by(surfaces, Unit::Group);
        if groups.count < surfaces.len() {
            groups
        } else {
            Self::by(surfaces, Unit::Surface)
        }
    }

    /// The units of `surfaces`, numbered in the order in which they come up. A surface without a
    /// group or material is a unit of its own.
    pub fn by(surfaces: &[Surface], unit: Unit) -> Self {
        let mut numbers: HashMap<&str, usize> = HashMap::new();
        let mut count = 0;
        let number = |surface| {
            let number = match unit.of(surface) {
                Some(name) => *numbers.entry(name).or_insert(count),
                None => count,
            };
            count = count.max(number + 1);
            number
        };
        Self {
            unit,
            of_surface: surfaces.iter().map(number).collect(),
            count,
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

    /// Keeps a share of the units of some surfaces aside, at random: the stream is keyed by `seed`,
    /// `purpose` and `index`. Every unit is as likely to be drawn as any other, whatever its size, so
    /// what holds on average for the units kept aside holds for a new one; the share of the
    /// surfaces varies. Indices without a surface are left out.
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
        let wanted = (units.len() as f64 * share).round() as usize;
        let drawn = &units[..wanted.clamp(1, units.len() - 1)];
        Ok(Split::keeping_aside(drawn.concat(), surfaces))
    }

    /// Deals the units of some surfaces into `folds` parts at random, each kept aside once. Every
    /// unit is in one part, and parts have about as many surfaces: large units are dealt first, so
    /// which units share a part goes with their sizes. Where a part must be like new units, as to
    /// calibrate, take [`keep_aside`](Self::keep_aside).
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

    /// One surface of each unit of some surfaces, drawn at random, ascending: the stream is keyed by
    /// `seed`, `purpose` and `index`. Where units are alike and so are the surfaces within one, so are
    /// those drawn. Indices without a surface are left out.
    ///
    /// ```
    /// use sps_dataset::{Surface, Units};
    ///
    /// let surface = |group: &str| Surface {
    ///     id: String::new(),
    ///     material: String::new(),
    ///     group: group.into(),
    /// };
    /// let units = Units::of(&["a", "b", "a", "a"].map(surface));
    /// let drawn = units.one_of_each(&[0, 1, 2, 3], 1, "example", 0);
    /// assert_eq!(drawn.len(), 2);
    /// assert_eq!(units.among(&drawn), 2);
    /// ```
    pub fn one_of_each(
        &self,
        surfaces: &[usize],
        seed: u64,
        purpose: &str,
        index: u64,
    ) -> Vec<usize> {
        let mut surfaces = surfaces.to_vec();
        shuffle(&mut surfaces, seed, purpose, index);
        let units = self.members(&surfaces).into_iter();
        let mut drawn: Vec<usize> = units.filter_map(|unit| unit.first().copied()).collect();
        drawn.sort_unstable();
        drawn
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

//! The radius of intervals that hold what they promise for a new unit.

use sps_dataset::{Unit, Units};
use sps_metrics::{ConformalError, GroupConformal, Level, SplitConformal};

/// Photographs of one surface, at most, for whose mean intervals are calibrated.
const MOST_PHOTOGRAPHS: usize = 100;

/// Half the width of intervals that hold the truth of a surface of a new unit at this level, from
/// the residuals of calibration surfaces, by their index, that the model has not seen: by
/// [`SplitConformal`] where the unit is a surface, by [`GroupConformal`] where it is a group or a
/// material.
///
/// # Errors
/// Too few surfaces or groups for the level, a residual that is not finite, a surface of no unit.
pub fn radius(
    units: &Units,
    residuals: &[(usize, f64)],
    level: Level,
) -> Result<f64, ConformalError> {
    let (surfaces, residuals): (Vec<usize>, Vec<f64>) = residuals.iter().copied().unzip();
    match units.unit() {
        Unit::Surface => Ok(SplitConformal::from_residuals(&residuals, level)?.radius),
        Unit::Group | Unit::Material => {
            let group = |&surface: &usize| units.of_surface().get(surface).copied();
            let groups: Vec<usize> = surfaces.iter().filter_map(group).collect();
            Ok(GroupConformal::from_residuals(&residuals, &groups, level)?.radius)
        }
    }
}

/// The share of new units that the interval of each of so many photographs must hold, for all of them
/// to hold at once at the level (Bonferroni). Where all hold the truth, so does their mean.
pub(crate) fn level_of_each(level: Level, photographs: usize) -> f64 {
    1.0 - (1.0 - level.get()) / photographs as f64
}

/// What [`radius`] says of each photograph where the mean of one is asked for, of two, and so on as
/// long as there are enough units for the [`level_of_each`], at most a hundred.
///
/// # Errors
/// As [`radius`], of one photograph.
pub(crate) fn radii(
    units: &Units,
    residuals: &[(usize, f64)],
    level: Level,
) -> Result<Vec<f64>, ConformalError> {
    let one = radius(units, residuals, level)?;
    let more = (2..=MOST_PHOTOGRAPHS).map_while(|photographs| {
        let of_each = Level::new(level_of_each(level, photographs)).ok()?;
        radius(units, residuals, of_each).ok()
    });
    Ok([one].into_iter().chain(more).collect())
}

#[cfg(test)]
mod tests {
    use sps_dataset::Surface;

    use super::*;

    fn units(groups: &[usize]) -> Units {
        let surface = |group: &usize| Surface {
            id: String::new(),
            material: String::new(),
            group: group.to_string(),
        };
        Units::of(&groups.iter().map(surface).collect::<Vec<_>>())
    }

    /// Of residuals 1 to 39 the radius is the ceil(40 (1 - 0.1 / k))-th: of 36, 38, 38.67, 39, 39.2.
    #[test]
    fn more_photographs_have_a_higher_rank() {
        let residuals: Vec<(usize, f64)> = (0..39).map(|at| (at, 1.0 + at as f64)).collect();
        let surfaces = units(&(0..39).collect::<Vec<_>>());
        let radii = |level| radii(&surfaces, &residuals, Level::new(level).unwrap());
        assert_eq!(radii(0.9).unwrap(), [36.0, 38.0, 39.0, 39.0]);
        // 40 * 0.98 is above 39.
        assert!(radii(0.98).is_err());
        // As many photographs as 40 * 0.99 = 39.6 has whole ones.
        assert_eq!(radii(0.01).unwrap().len(), 39);
    }

    /// Three groups and the new one make four: the masses wanted are 4 * 0.5, 4 * 0.75 and 4 * 5 / 6, and
    /// three groups have no more than 3.
    #[test]
    fn groups_count_the_same_whatever_their_size() {
        let units = units(&[0, 0, 0, 1, 2]);
        let residuals = [0.1, 0.2, 0.3, 0.5, 0.7].into_iter().enumerate();
        let residuals: Vec<(usize, f64)> = residuals.collect();
        let radii = radii(&units, &residuals, Level::new(0.5).unwrap());
        assert_eq!(radii.unwrap(), [0.5, 0.7]);
    }

    #[test]
    fn a_hundred_photographs_are_enough() {
        let residuals: Vec<(usize, f64)> = (0..1200).map(|at| (at, 1.0)).collect();
        let surfaces = units(&(0..1200).collect::<Vec<_>>());
        let radii = radii(&surfaces, &residuals, Level::P90);
        assert_eq!(radii.unwrap().len(), 100);
    }
}

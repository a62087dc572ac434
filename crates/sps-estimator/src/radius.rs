//! The radius of intervals that hold what they promise for a new unit.

use sps_dataset::{Unit, Units};
use sps_metrics::{ConformalError, GroupConformal, Level, SplitConformal};

/// Half the width of intervals that hold the truth of a surface of a new unit at this level, from
/// the residuals of calibration surfaces, by their index, that the model has not seen: by
/// [`SplitConformal`] where the unit is a surface, by [`GroupConformal`] where it is a group or a
/// material.
///
/// # Errors
///
/// Too few surfaces or groups for the level, a residual that is not finite, a surface of no unit.
pub fn radius(
    units: &Units,
    residuals: &[(usize, f64)],
    level: Level,
) -> Result<f64, ConformalError> {
    let (surfaces, residuals): (Vec<usize>, Vec<f64>) = residuals.iter().copied().unzip();
    match units.unit() {
        Unit::Surface => Ok(SplitConformal::from_residuals(&residuals, level)?.radius()),
        Unit::Group | Unit::Material => {
            let of_surface = units.of_surface();
            let groups = surfaces.iter();
            let groups: Vec<usize> = groups
                .filter_map(|&surface| of_surface.get(surface).copied())
                .collect();
            Ok(GroupConformal::from_residuals(&residuals, &groups, level)?.radius())
        }
    }
}

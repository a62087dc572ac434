//! What to simulate.

use std::fmt::Display;
use std::ops::RangeInclusive;

use serde::{Deserialize, Serialize};
use thiserror::Error;

use sps_dataset::RollAngle;

/// Surfaces of one seed.
pub(super) const MOST_SURFACES: usize = 1_000_000;

/// What to simulate; every surface is a function of `seed` and its index alone, so sets of
/// different lengths agree in the surfaces that both hold.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields, default)]
pub struct SimulatorSpec {
    /// Number of surfaces.
    pub surfaces: usize,
    /// Seed of everything.
    pub seed: u64,
    /// Width and height of a view, in pixels; at least 8, at most 2048.
    pub size: usize,
    /// Number of views of each surface.
    pub views: usize,
    /// Roll angle of the first view, in degrees; at least -60.
    pub from_deg: f64,
    /// Roll angle of the last view, in degrees; at most 60.
    pub to_deg: f64,
    /// Places at which each surface is touched.
    pub locations: u32,
    /// Touches of each place.
    pub repeats: u32,
}

impl Default for SimulatorSpec {
    /// The paper's set: 400 surfaces, 100 views from -45 to 45 degrees, five repeats; 128 pixels,
    /// three places.
    fn default() -> Self {
        Self {
            surfaces: 400,
            seed: 1,
            size: 128,
            views: 100,
            from_deg: -45.0,
            to_deg: 45.0,
            locations: 3,
            repeats: 5,
        }
    }
}

/// Why a simulation cannot be.
#[derive(Clone, Debug, PartialEq, Error)]
#[non_exhaustive]
pub enum SimulateError {
    /// A field of the spec is out of range.
    #[error("`{field}` is {found}, expected {expected}")]
    Spec {
        /// The field, as it is written in a configuration.
        field: &'static str,
        /// What it holds.
        found: String,
        /// What it may hold.
        expected: &'static str,
    },
    /// There is no such surface.
    #[error("surface {found} was asked for, but there are {count}")]
    Surface {
        /// The index asked for.
        found: usize,
        /// The number of surfaces.
        count: usize,
    },
    /// There is no such view.
    #[error("view {found} was asked for, but there are {count}")]
    View {
        /// The index asked for.
        found: usize,
        /// The number of views.
        count: usize,
    },
}

impl SimulatorSpec {
    /// Checks every field and gives the roll angle of each view.
    pub(crate) fn check(&self) -> Result<Vec<RollAngle>, SimulateError> {
        let angle = "an angle from -60 to 60 degrees";
        require("surfaces", self.surfaces, 1..=MOST_SURFACES, "1 to 1000000")?;
        require("size", self.size, 8..=2048, "8 to 2048 pixels")?;
        require("views", self.views, 1..=10_000, "1 to 10000")?;
        require("from-deg", self.from_deg, -60.0..=60.0, angle)?;
        require("to-deg", self.to_deg, -60.0..=60.0, angle)?;
        let after = self.from_deg..=60.0;
        require("to-deg", self.to_deg, after, "not below `from-deg`")?;
        require("locations", self.locations, 1..=1000, "1 to 1000")?;
        require("repeats", self.repeats, 1..=1000, "1 to 1000")?;
        Ok(self.angles())
    }

    /// Evenly spaced; a single view lies halfway.
    fn angles(&self) -> Vec<RollAngle> {
        let (from, to) = (self.from_deg, self.to_deg);
        if self.views == 1 {
            return vec![RollAngle(0.5 * (from + to))];
        }
        let last = (self.views - 1) as f64;
        let angle = |i| RollAngle(from + (to - from) * i as f64 / last);
        (0..self.views).map(angle).collect()
    }
}

fn require<T: PartialOrd + Display + Copy>(
    field: &'static str,
    found: T,
    range: RangeInclusive<T>,
    expected: &'static str,
) -> Result<(), SimulateError> {
    if range.contains(&found) {
        return Ok(());
    }
    Err(SimulateError::Spec {
        field,
        found: found.to_string(),
        expected,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_bad_field_is_named() {
        type Spoil = fn(&mut SimulatorSpec);
        let good = SimulatorSpec::default();
        let bad: [(&str, Spoil); 9] = [
            ("surfaces", |spec| spec.surfaces = 0),
            ("size", |spec| spec.size = 4),
            ("size", |spec| spec.size = 5000),
            ("views", |spec| spec.views = 0),
            ("from-deg", |spec| spec.from_deg = f64::NAN),
            ("to-deg", |spec| spec.to_deg = 61.0),
            ("to-deg", |spec| (spec.from_deg, spec.to_deg) = (10.0, 5.0)),
            ("locations", |spec| spec.locations = 0),
            ("repeats", |spec| spec.repeats = 0),
        ];
        for (name, spoil) in bad {
            let mut spec = good.clone();
            spoil(&mut spec);
            let Err(SimulateError::Spec { field, .. }) = spec.check() else {
                panic!("{name} was taken");
            };
            assert_eq!(field, name);
        }
        assert_eq!(good.check().unwrap().len(), 100);
    }

    #[test]
    fn angles_run_from_end_to_end() {
        let of = |views| SimulatorSpec {
            views,
            ..SimulatorSpec::default()
        };
        assert_eq!(of(3).check().unwrap(), [-45.0, 0.0, 45.0].map(RollAngle));
        assert_eq!(of(1).check().unwrap(), [RollAngle(0.0)]);
    }
}

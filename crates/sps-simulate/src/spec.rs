//! What to simulate.

use serde::{Deserialize, Serialize};
use thiserror::Error;

use sps_dataset::RollAngle;

/// Surfaces of one seed.
pub(super) const MOST_SURFACES: usize = 1_000_000;

/// What to simulate; every surface is a function of `seed` and its index alone, so sets of
/// different lengths agree in the surfaces that both hold.
///
/// ```
/// use sps_simulate::SimulatorSpec;
///
/// let spec = SimulatorSpec { surfaces: 40, ..SimulatorSpec::default() };
/// assert_eq!((spec.views, spec.from_deg, spec.to_deg), (100, -45.0, 45.0));
/// ```
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
        require(self.surfaces >= 1, "surfaces", self.surfaces, "at least 1")?;
        require(
            self.surfaces <= MOST_SURFACES,
            "surfaces",
            self.surfaces,
            "at most 1000000",
        )?;
        let size_fits = (8..=2048).contains(&self.size);
        require(size_fits, "size", self.size, "8 to 2048 pixels")?;
        require(
            (1..=10_000).contains(&self.views),
            "views",
            self.views,
            "1 to 10000",
        )?;
        let angle = -60.0..=60.0;
        let expected = "an angle from -60 to 60 degrees";
        require(
            angle.contains(&self.from_deg),
            "from-deg",
            self.from_deg,
            expected,
        )?;
        require(
            angle.contains(&self.to_deg),
            "to-deg",
            self.to_deg,
            expected,
        )?;
        require(
            self.from_deg <= self.to_deg,
            "to-deg",
            self.to_deg,
            "not below `from-deg`",
        )?;
        require(
            (1..=1000).contains(&self.locations),
            "locations",
            self.locations,
            "1 to 1000",
        )?;
        require(
            (1..=1000).contains(&self.repeats),
            "repeats",
            self.repeats,
            "1 to 1000",
        )?;
        Ok(self.angles())
    }

    /// Evenly spaced; a single view lies halfway.
    fn angles(&self) -> Vec<RollAngle> {
        let (from, to) = (self.from_deg, self.to_deg);
        if self.views == 1 {
            return vec![RollAngle(0.5 * (from + to))];
        }
        let last = (self.views - 1) as f64;
        (0..self.views)
            .map(|i| RollAngle(from + (to - from) * i as f64 / last))
            .collect()
    }
}

fn require(
    holds: bool,
    field: &'static str,
    found: impl std::fmt::Display + Copy,
    expected: &'static str,
) -> Result<(), SimulateError> {
    if holds {
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
        let good = SimulatorSpec::default();
        let bad = [
            (
                "surfaces",
                SimulatorSpec {
                    surfaces: 0,
                    ..good.clone()
                },
            ),
            (
                "size",
                SimulatorSpec {
                    size: 4,
                    ..good.clone()
                },
            ),
            (
                "size",
                SimulatorSpec {
                    size: 5000,
                    ..good.clone()
                },
            ),
            (
                "views",
                SimulatorSpec {
                    views: 0,
                    ..good.clone()
                },
            ),
            (
                "from-deg",
                SimulatorSpec {
                    from_deg: f64::NAN,
                    ..good.clone()
                },
            ),
            (
                "to-deg",
                SimulatorSpec {
                    to_deg: 61.0,
                    ..good.clone()
                },
            ),
            (
                "to-deg",
                SimulatorSpec {
                    from_deg: 10.0,
                    to_deg: 5.0,
                    ..good.clone()
                },
            ),
            (
                "locations",
                SimulatorSpec {
                    locations: 0,
                    ..good.clone()
                },
            ),
            (
                "repeats",
                SimulatorSpec {
                    repeats: 0,
                    ..good.clone()
                },
            ),
        ];
        for (name, spec) in bad {
            let Err(SimulateError::Spec { field, .. }) = spec.check() else {
                panic!("{name} was taken");
            };
            assert_eq!(field, name);
        }
        assert_eq!(good.check().unwrap().len(), 100);
    }

    #[test]
    fn angles_run_from_end_to_end() {
        let spec = SimulatorSpec {
            views: 3,
            ..SimulatorSpec::default()
        };
        assert_eq!(spec.check().unwrap(), [-45.0, 0.0, 45.0].map(RollAngle));
        let one = SimulatorSpec {
            views: 1,
            ..SimulatorSpec::default()
        };
        assert_eq!(one.check().unwrap(), [RollAngle(0.0)]);
    }
}

//! The surfaces that an experiment runs on: a file for each kind of source.

mod folder;
mod simulated;

use anyhow::{Context, Result};
use serde::Deserialize;
use sps_dataset::{DecodeSettings, RollAngle, Source, SplitPlan, TactileSettings};
use sps_simulate::{Ceilings, SimulatorSpec};

use crate::config::{Config, ConfigError, Layers};
use simulated::SimulatedConfig;

pub use folder::FolderConfig;
pub(crate) use simulated::TestSurfaces;
pub use simulated::simulate;

#[derive(Clone, Debug, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub(crate) struct DataConfig {
    pub from: DataOrigin,
    pub simulated: SimulatedConfig,
    pub folder: FolderConfig,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum DataOrigin {
    Simulator,
    Folder,
}

/// Where surfaces come from.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub enum DataSpec {
    /// Surfaces of the simulator.
    Simulated {
        /// What it simulates.
        spec: SimulatorSpec,
        /// Which surfaces of the seed; those to score on come last.
        indices: Vec<usize>,
    },
    /// A dataset on disk.
    Folder(Box<FolderConfig>),
}

/// Which surfaces are trained and which are scored on.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Protocol {
    /// As the plan divides them.
    Split(SplitPlan),
    /// Reruns train on surfaces of their own and are scored on the same others.
    TestSurfaces(TestSurfaces),
}

type Checked = Result<(DataSpec, Protocol), ConfigError>;

pub(crate) fn of_config(layers: &Layers<'_>, config: &Config) -> Checked {
    match config.data.from {
        DataOrigin::Simulator => config.data.simulated.checked(layers, config),
        DataOrigin::Folder => config.data.folder.checked(layers, config.split),
    }
}

/// A source, and what is known of it beside its surfaces.
pub type Opened = (Box<dyn Source>, About);

/// What is known of a source beside its surfaces.
#[derive(Clone, Debug, Default)]
pub struct About {
    pub(crate) simulated: bool,
    /// The simulator's seed, where it is one.
    pub(crate) seed: Option<u64>,
    pub(crate) published_sps: bool,
    /// Where it comes from and under which licence, as far as it says.
    pub(crate) origin: String,
    /// How photographs were decoded.
    pub(crate) decode: DecodeSettings,
    /// How readings of one surface become one value.
    pub(crate) tactile: TactileSettings,
    /// The known limit of simulated data.
    pub(crate) ceilings: Option<Ceilings>,
    /// What a reader of results must know of the data.
    pub(crate) notes: Vec<String>,
}

/// Opens the data.
///
/// # Errors
/// Data that cannot be opened.
pub fn open(data: &DataSpec) -> Result<Opened> {
    match data {
        DataSpec::Simulated { spec, indices } => simulated::open(spec, indices),
        DataSpec::Folder(folder) => folder.open(),
    }
}

/// The view that looks straight down.
pub(crate) fn nadir(source: &dyn Source) -> Result<usize> {
    source
        .nearest_view(RollAngle::NADIR)
        .context("the dataset has no views")
}

#[cfg(test)]
mod tests {
    use super::*;
    use sps_dataset::ReadSettings;

    #[test]
    fn near_twins_share_a_group_and_the_notes_say_so() {
        let seen = |near_twins| {
            let data = DataSpec::Folder(Box::new(FolderConfig {
                path: concat!(env!("CARGO_MANIFEST_DIR"), "/../../fixtures/tiny-dataset").into(),
                read: ReadSettings::default(),
                published_sps: false,
                near_twins,
            }));
            let (source, about) = open(&data).unwrap();
            let groups = source.surfaces().iter().map(|s| s.group.clone());
            (groups.collect::<Vec<_>>(), about.notes)
        };
        let (own, notes) = seen(0.0);
        let mut twins = notes.iter().filter(|note| note.contains("twins"));
        assert_eq!(twins.next(), None);
        // No two patterns are equal, and two surfaces have one group in the dataset.
        let (groups, notes) = seen(1.0);
        assert_eq!(groups, own);
        let said = "a likeness of 1 or more; 6 surfaces make 5 groups, and the largest has 2";
        assert!(notes.iter().any(|note| note.ends_with(said)), "{notes:?}");
        // The least likeness joins all.
        let (groups, _) = seen(-1.0);
        assert!(groups.iter().all(|group| *group == own[0]), "{groups:?}");
    }
}

//! The surfaces that an experiment runs on.

use anyhow::{Context, Result};
use sps_dataset::{
    DatasetFolder, Origin, OutOfRange, Property, RollAngle, Source, TactileSettings,
};
use sps_simulate::{Ceilings, Simulator, SimulatorSpec, ceilings};
use tracing::info;

use crate::config::DataSpec;

/// Work that can be done on any source.
pub(crate) trait WithSource {
    type Output;

    fn call<S: Source>(self, source: &S, about: About) -> Result<Self::Output>;
}

/// What is known of a source beside its surfaces.
#[derive(Clone, Debug)]
pub(crate) struct About {
    pub simulated: bool,
    pub published_sps: bool,
    /// Where it comes from and under which licence, as far as it says.
    pub origin: String,
    /// How readings of one surface become one value.
    pub tactile: TactileSettings,
    /// The known limit of simulated data.
    pub ceilings: Option<Ceilings>,
    /// What a reader of results must know of the data.
    pub notes: Vec<String>,
}

/// Surfaces that the ceilings are measured on: the standard error is then about 0.01.
pub(crate) const CEILING_SURFACES: usize = 4000;

/// Opens the data and hands it to `work`.
pub(crate) fn with_source<W: WithSource>(data: &DataSpec, work: W) -> Result<W::Output> {
    match data {
        DataSpec::Simulated { spec, indices } => {
            let (surfaces, views) = (spec.surfaces, spec.views);
            info!(
                "simulated: {surfaces} surfaces in {views} views, rendered when they are looked at"
            );
            let source = Simulator::of(spec.clone(), indices).context("data.simulated")?;
            work.call(&source, about_simulated(spec))
        }
        DataSpec::Folder {
            path,
            read,
            published_sps,
        } => {
            let source = DatasetFolder::open(path, read)?;
            let about = About {
                simulated: source.origin() == Some(Origin::Simulator),
                published_sps: *published_sps || source.origin() == Some(Origin::Paper),
                origin: source.manifest().source.clone(),
                tactile: read.tactile,
                ceilings: None,
                notes: out_of_range_notes(source.out_of_range()),
            };
            info!("{}: {} surfaces", path.display(), source.surfaces().len());
            work.call(&source, about)
        }
    }
}

fn about_simulated(spec: &SimulatorSpec) -> About {
    About {
        simulated: true,
        published_sps: false,
        origin: String::new(),
        tactile: TactileSettings::default(),
        ceilings: Some(ceilings(spec.seed, CEILING_SURFACES, spec.locations)),
        notes: Vec::new(),
    }
}

fn out_of_range_notes(found: &[(Property, OutOfRange)]) -> Vec<String> {
    found
        .iter()
        .filter(|(_, count)| count.below + count.above > 0)
        .map(|(property, count)| {
            format!(
                "{property}: {} readings below its range and {} above",
                count.below, count.above
            )
        })
        .collect()
}

/// The view that looks straight down.
pub(crate) fn nadir<S: Source>(source: &S) -> Result<usize> {
    source
        .nearest_view(RollAngle::NADIR)
        .context("the dataset has no views")
}

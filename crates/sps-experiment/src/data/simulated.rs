//! Surfaces of the simulator.

use std::path::Path;

use anyhow::{Context, Result};
use serde::Deserialize;
use sps_dataset::{FrameFormat, WriteOptions, Written, write_dataset};
use sps_simulate::{Simulator, SimulatorSpec, ceilings};
use tracing::info;

use super::{About, Checked, DataSpec, Opened, Protocol};
use crate::config::{Config, Layers};
use crate::files::write_atomically;
use crate::progress::Progress;

/// The index of the first surface that is only scored on: far beyond any that is trained on, so
/// that neither moves where there are more or fewer of the other.
const FIRST_TEST_SURFACE: usize = 500_000;

/// Surfaces that the ceilings are measured on: the standard error is then about 0.01.
const CEILING_SURFACES: usize = 4000;

#[derive(Clone, Debug, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub(crate) struct SimulatedConfig {
    pub surfaces: usize,
    pub test_surfaces: usize,
    pub pool: usize,
    pub seed: u64,
    pub size: usize,
    pub views: usize,
    pub from_deg: f64,
    pub to_deg: f64,
    pub locations: u32,
    pub repeats: u32,
}

impl SimulatedConfig {
    pub(super) fn checked(&self, layers: &Layers<'_>, config: &Config) -> Checked {
        let (spec, split, reruns) = (self.spec(), config.split, config.reruns);
        if self.test_surfaces == 0 {
            let indices = (0..self.surfaces).collect();
            let data = DataSpec::Simulated { spec, indices };
            return Ok((data, Protocol::Split(split.unwrap_or_default())));
        }
        let problem = "there are `data.simulated.test-surfaces` to score on; with 0 of them, the \
                       surfaces are split";
        layers.require(split.is_none(), "split", problem)?;
        let enough = self.pool == 0 || self.pool >= self.surfaces;
        let problem = format!("is below the {} `surfaces` of a rerun", self.surfaces);
        layers.require(enough, "data.simulated.pool", &problem)?;
        let some = self.surfaces > 0;
        layers.require(some, "data.simulated.surfaces", "must be at least 1")?;
        for (key, count) in [
            ("surfaces", self.surfaces.saturating_mul(reruns)),
            ("pool", self.pool),
            ("test-surfaces", self.test_surfaces),
        ] {
            let (key, most) = (format!("data.simulated.{key}"), FIRST_TEST_SURFACE);
            let problem = format!("makes {count} surfaces in all, at most {most} can be");
            layers.require(count <= most, &key, &problem)?;
        }
        let protocol = TestSurfaces {
            training: self.surfaces,
            pool: (self.pool > 0).then_some(self.pool),
            test: self.test_surfaces,
        };
        let test = FIRST_TEST_SURFACE..FIRST_TEST_SURFACE + protocol.test;
        let indices = (0..protocol.pool(reruns)).chain(test).collect();
        let data = DataSpec::Simulated { spec, indices };
        Ok((data, Protocol::TestSurfaces(protocol)))
    }

    pub(crate) fn spec(&self) -> SimulatorSpec {
        SimulatorSpec {
            surfaces: self.surfaces,
            seed: self.seed,
            size: self.size,
            views: self.views,
            from_deg: self.from_deg,
            to_deg: self.to_deg,
            locations: self.locations,
            repeats: self.repeats,
        }
    }
}

/// Surfaces that exist for scoring alone.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct TestSurfaces {
    /// That a rerun is trained on.
    pub training: usize,
    /// That reruns draw theirs from; `None`: each has its own.
    pub pool: Option<usize>,
    /// That are scored on.
    pub test: usize,
}

impl TestSurfaces {
    /// Surfaces of all reruns that are trained on; they come first.
    pub(crate) fn pool(&self, reruns: usize) -> usize {
        self.pool.unwrap_or(reruns * self.training)
    }
}

/// Opens it; frames are rendered when they are looked at.
pub(super) fn open(spec: &SimulatorSpec, indices: &[usize]) -> Result<Opened> {
    let (surfaces, views) = (spec.surfaces, spec.views);
    info!("simulated: {surfaces} surfaces in {views} views, rendered when they are looked at");
    let source = Simulator::of(spec.clone(), indices).context("data.simulated")?;
    let about = About {
        simulated: true,
        seed: Some(spec.seed),
        ceilings: Some(ceilings(spec.seed, CEILING_SURFACES, spec.locations)),
        ..About::default()
    };
    Ok((Box::new(source), about))
}

/// Writes simulated surfaces into `folder` as a dataset, with the limit of what can be known of them in
/// `ceilings.json`, or goes on where that was stopped.
///
/// # Errors
/// Numbers that no simulator has; a folder that cannot be written to.
pub fn simulate(spec: &SimulatorSpec, format: FrameFormat, folder: &Path) -> Result<Written> {
    let simulator = Simulator::new(spec.clone())?;
    let options = WriteOptions {
        format,
        description: "Simulated surfaces; no value in it was measured".to_owned(),
        source: format!("sps simulator, seed {}", spec.seed),
    };
    let progress = Progress::new("surfaces", spec.surfaces);
    let written = write_dataset(&simulator, folder, &options, |_, _| progress.advance(1))?;
    let ceilings = ceilings(spec.seed, CEILING_SURFACES, spec.locations);
    let mut text = serde_json::to_string_pretty(&ceilings).context("ceilings")?;
    text.push('\n');
    write_atomically(&folder.join("ceilings.json"), text.as_bytes())?;
    Ok(written)
}

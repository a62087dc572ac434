//! Where surfaces come from, and which of them are trained and scored on.

use std::path::PathBuf;

use sps_dataset::{KFold, RandomSplit, ReadSettings, SplitPlan, Unit};
use sps_simulate::SimulatorSpec;

use super::layers::Layers;
use super::locate::ConfigError;
use super::schema::{Config, DataOrigin, SimulatedConfig};

/// The index of the first surface that is only scored on: far beyond any that is trained on, so
/// that neither moves where there are more or fewer of the other.
const FIRST_TEST_SURFACE: usize = 500_000;

/// Where surfaces come from.
#[derive(Clone, Debug)]
pub enum DataSpec {
    /// Surfaces of the simulator.
    Simulated {
        /// What it simulates.
        spec: SimulatorSpec,
        /// Which surfaces of the seed; those to score on come last.
        indices: Vec<usize>,
    },
    /// A dataset on disk.
    Folder {
        /// Its folder.
        path: PathBuf,
        /// How it is read.
        read: Box<ReadSettings>,
        /// Whether it is the paper's own dataset.
        published_sps: bool,
        /// How alike surfaces are that are kept together; `None`: groups are the dataset's own.
        near_twins: Option<f64>,
    },
}

/// Which surfaces are trained and which are scored on.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Protocol {
    /// As the plan divides them.
    Split(SplitPlan),
    /// Reruns train on surfaces of their own and are scored on the same others.
    TestSurfaces(TestSurfaces),
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

    fn indices(&self, reruns: usize) -> Vec<usize> {
        let test = FIRST_TEST_SURFACE..FIRST_TEST_SURFACE + self.test;
        (0..self.pool(reruns)).chain(test).collect()
    }
}

/// What the config says of its data.
pub(super) fn data(
    layers: &Layers<'_>,
    config: &Config,
) -> Result<(DataSpec, Protocol), ConfigError> {
    let folder = &config.data.folder;
    match config.data.from {
        DataOrigin::Simulator => simulated(layers, config),
        DataOrigin::Folder if folder.path.as_os_str().is_empty() => {
            Err(layers.error("data.folder.path", "names no folder"))
        }
        DataOrigin::Folder if !(0.0..=1.0).contains(&folder.near_twins) => {
            let problem = format!(
                "is {}, expected a likeness above 0 and at most 1, or 0 to keep the dataset's groups",
                folder.near_twins
            );
            Err(layers.error("data.folder.near-twins", problem))
        }
        DataOrigin::Folder if folder.near_twins > 0.0 && parts_groups(config.split) => Err(layers
            .error(
                "data.folder.near-twins",
                "makes groups, which `split` parts: expected `by = \"group\"` there, or no `by`",
            )),
        DataOrigin::Folder => {
            let data = DataSpec::Folder {
                path: folder.path.clone(),
                read: Box::new(folder.read.clone()),
                published_sps: folder.published_sps,
                near_twins: (folder.near_twins > 0.0).then_some(folder.near_twins),
            };
            Ok((data, Protocol::Split(config.split.unwrap_or_default())))
        }
    }
}

/// Whether a plan says that something else than groups stays whole.
fn parts_groups(plan: Option<SplitPlan>) -> bool {
    let (SplitPlan::Random(RandomSplit { by, .. })
    | SplitPlan::KFold(KFold { by, .. })
    | SplitPlan::LeaveOneOut { by }) = plan.unwrap_or_default();
    by.is_some_and(|unit| unit != Unit::Group)
}

fn simulated(layers: &Layers<'_>, config: &Config) -> Result<(DataSpec, Protocol), ConfigError> {
    let simulated = &config.data.simulated;
    let refused =
        |key: &str, problem: String| Err(layers.error(&format!("data.simulated.{key}"), problem));
    if simulated.test_surfaces == 0 {
        let data = DataSpec::Simulated {
            spec: simulated.spec(),
            indices: (0..simulated.surfaces).collect(),
        };
        return Ok((data, Protocol::Split(config.split.unwrap_or_default())));
    }
    if config.split.is_some() {
        let problem = "there are `data.simulated.test-surfaces` to score on; with 0 of them, the \
                       surfaces are split";
        return Err(layers.error("split", problem));
    }
    if simulated.pool > 0 && simulated.pool < simulated.surfaces {
        let surfaces = simulated.surfaces;
        return refused(
            "pool",
            format!("is below the {surfaces} `surfaces` of a rerun"),
        );
    }
    let protocol = TestSurfaces {
        training: simulated.surfaces,
        pool: (simulated.pool > 0).then_some(simulated.pool),
        test: simulated.test_surfaces,
    };
    if simulated.surfaces == 0 {
        return refused("surfaces", "must be at least 1".to_owned());
    }
    for (key, count) in [
        ("surfaces", simulated.surfaces.saturating_mul(config.reruns)),
        ("pool", simulated.pool),
        ("test-surfaces", simulated.test_surfaces),
    ] {
        if count > FIRST_TEST_SURFACE {
            let problem =
                format!("makes {count} surfaces in all, at most {FIRST_TEST_SURFACE} can be");
            return refused(key, problem);
        }
    }
    let data = DataSpec::Simulated {
        spec: simulated.spec(),
        indices: protocol.indices(config.reruns),
    };
    Ok((data, Protocol::TestSurfaces(protocol)))
}

impl SimulatedConfig {
    pub(super) fn spec(&self) -> SimulatorSpec {
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

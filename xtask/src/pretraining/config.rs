//! The config of `pretrain`.

use std::path::{Path, PathBuf};

use anyhow::Result;
use serde::Deserialize;
use sps_experiment::config::{ConfigError, Layers, Setting, check_depths, check_training};
use sps_experiment::files::read_text;
use sps_models::encoders::{Depths, EncoderKind};
use sps_models::training::TrainingConfig;
use sps_simulate::SimulatorSpec;

const DEFAULTS: &str = include_str!("defaults.toml");

/// What to pretrain, on what, and how.
#[derive(Clone, Debug)]
pub(crate) struct Pretraining {
    pub name: String,
    pub seed: u64,
    pub kind: EncoderKind,
    /// What everything is learnt from.
    pub depths: Depths,
    /// A weights file to start from.
    pub start: Option<PathBuf>,
    /// Share of the trained weights in those that result; the rest is the start.
    pub trained_share: f64,
    pub simulated: SimulatorSpec,
    pub views_per_surface: usize,
    pub patterns: PatternsSpec,
    pub teacher: Option<TeacherSpec>,
    pub training: TrainingConfig,
    /// Every key with its value, as TOML.
    pub resolved: String,
}

/// How many patterns there are beside the simulated surfaces.
#[derive(Clone, Debug, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub(crate) struct PatternsSpec {
    pub seed: u64,
    pub classes: usize,
    /// Of each class.
    pub images: usize,
}

/// The encoder whose embeddings are learnt as well.
#[derive(Clone, Debug)]
pub(crate) struct TeacherSpec {
    pub kind: EncoderKind,
    pub depths: Depths,
    pub weights: PathBuf,
    /// Pixels along a side of what it sees.
    pub size: usize,
    /// How much its loss counts.
    pub weight: f64,
}

#[derive(Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
struct TeacherConfig {
    encoder: String,
    #[serde(default)]
    depths: Depths,
    weights: PathBuf,
    #[serde(default = "usual_size")]
    size: usize,
    #[serde(default = "usual_weight")]
    weight: f64,
}

const fn usual_size() -> usize {
    224
}

const fn usual_weight() -> f64 {
    1.0
}

#[derive(Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
struct Config {
    seed: u64,
    encoder: String,
    depths: Depths,
    start: Option<PathBuf>,
    trained_share: f64,
    views_per_surface: usize,
    simulated: SimulatorSpec,
    patterns: PatternsSpec,
    teacher: Option<TeacherConfig>,
    training: TrainingConfig,
}

impl Pretraining {
    /// Reads the config at `path` with `settings` over it.
    pub(crate) fn read(path: &Path, settings: &[Setting]) -> Result<Self> {
        let text = read_text(path)?;
        let defaults = DEFAULTS.parse()?;
        let layers = Layers::new(&defaults, path, &text, settings)?;
        let config: Config = layers.read()?;
        let kind = kind(&layers, "encoder", &config.encoder)?;
        check_depths(&layers, "depths", kind, &config.depths)?;
        let teacher = config.teacher.map(|teacher| {
            let positive = teacher.weight.is_finite() && teacher.weight > 0.0;
            layers.require(positive, "teacher.weight", "must be above 0")?;
            let kind = self::kind(&layers, "teacher.encoder", &teacher.encoder)?;
            check_depths(&layers, "teacher.depths", kind, &teacher.depths)?;
            let least = kind.min_size();
            let problem = format!("must be at least {least}, the least that the teacher takes");
            layers.require(teacher.size >= least, "teacher.size", &problem)?;
            Ok::<_, ConfigError>(TeacherSpec {
                kind,
                depths: teacher.depths,
                weights: teacher.weights,
                size: teacher.size,
                weight: teacher.weight,
            })
        });
        let share = config.trained_share;
        layers.require(
            share > 0.0 && (share == 1.0 || share < 1.0 && config.start.is_some()),
            "trained-share",
            "must be above 0 and at most 1; below 1 it needs `start`",
        )?;
        layers.require(
            config.patterns.images > 0,
            "patterns.images",
            "must be at least 1; without patterns, `patterns.classes` is 0",
        )?;
        let views = config.simulated.views;
        if config.views_per_surface == 0 || config.views_per_surface > views {
            let problem = format!("must be from 1 to `simulated.views`, {views}");
            return Err(layers.error("views-per-surface", problem).into());
        }
        check_training(&layers, "training", &config.training)?;
        let name = path.file_stem().unwrap_or(path.as_os_str());
        Ok(Self {
            name: name.to_string_lossy().into_owned(),
            seed: config.seed,
            kind,
            depths: config.depths,
            start: config.start,
            trained_share: share,
            simulated: config.simulated,
            views_per_surface: config.views_per_surface,
            patterns: config.patterns,
            teacher: teacher.transpose()?,
            training: config.training,
            resolved: layers.to_toml(),
        })
    }
}

fn kind(layers: &Layers<'_>, key: &str, name: &str) -> Result<EncoderKind, ConfigError> {
    let kind: Result<EncoderKind, sps_models::Error> = name.parse();
    let kind = kind.map_err(|error| layers.error(key, error.to_string()))?;
    let why = "embeds sequences; expected a network of images";
    layers.require(!kind.takes_sequences(), key, why)?;
    Ok(kind)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_written_defaults_are_those_of_the_crates() {
        let config: Config = toml::from_str(DEFAULTS).unwrap();
        assert_eq!(config.training, TrainingConfig::default());
        assert_eq!(config.simulated, SimulatorSpec::default());
    }
}

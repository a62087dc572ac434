//! The config of `pretrain`.

use std::path::{Path, PathBuf};

use anyhow::Result;
use serde::de::Error;
use serde::{Deserialize, Deserializer};
use sps_experiment::config::{ConfigError, Layers, Setting};
use sps_experiment::files::read_text;
use sps_models::encoders::{Depths, EncoderKind};
use sps_models::training::TrainingConfig;
use sps_simulate::SimulatorSpec;

const DEFAULTS: &str = include_str!("defaults.toml");

/// What to pretrain, on what, and how.
#[derive(Clone, Debug, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub(crate) struct Pretraining {
    /// Of the config's file.
    #[serde(skip)]
    pub name: String,
    pub seed: u64,
    #[serde(rename = "encoder", deserialize_with = "of_images")]
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
    #[serde(skip)]
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
#[derive(Clone, Debug, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub(crate) struct TeacherSpec {
    #[serde(rename = "encoder", deserialize_with = "of_images")]
    pub kind: EncoderKind,
    #[serde(default)]
    pub depths: Depths,
    pub weights: PathBuf,
    /// Pixels along a side of what it sees.
    #[serde(default = "usual_size")]
    pub size: usize,
    /// How much its loss counts.
    #[serde(default = "usual_weight")]
    pub weight: f64,
}

const fn usual_size() -> usize {
    224
}

const fn usual_weight() -> f64 {
    1.0
}

/// A network of images, by its name.
fn of_images<'de, D: Deserializer<'de>>(name: D) -> Result<EncoderKind, D::Error> {
    let name = String::deserialize(name)?;
    let kind: EncoderKind = name.parse().map_err(D::Error::custom)?;
    if kind.takes_sequences() {
        let why = "embeds sequences; expected a network of images";
        return Err(D::Error::custom(why));
    }
    Ok(kind)
}

impl Pretraining {
    pub(crate) fn read(path: &Path, settings: &[Setting]) -> Result<Self> {
        let text = read_text(path)?;
        let defaults = DEFAULTS.parse()?;
        let layers = Layers::new(&defaults, path, &text, settings)?;
        let config: Self = layers.read()?;
        config.check(&layers)?;
        let name = path.file_stem().unwrap_or(path.as_os_str());
        Ok(Self {
            name: name.to_string_lossy().into_owned(),
            resolved: layers.to_toml(),
            ..config
        })
    }

    fn check(&self, layers: &Layers<'_>) -> Result<(), ConfigError> {
        layers.checked("", self.kind.blocks(&self.depths))?;
        if let Some(teacher) = &self.teacher {
            let positive = teacher.weight.is_finite() && teacher.weight > 0.0;
            layers.require(positive, "teacher.weight", "must be above 0")?;
            layers.checked("teacher", teacher.kind.blocks(&teacher.depths))?;
            let least = teacher.kind.min_size();
            let problem = format!("must be at least {least}, the least that the teacher takes");
            layers.require(teacher.size >= least, "teacher.size", &problem)?;
        }
        let share = self.trained_share;
        let fits = share > 0.0 && (share == 1.0 || share < 1.0 && self.start.is_some());
        let problem = "must be above 0 and at most 1; below 1 it needs `start`";
        layers.require(fits, "trained-share", problem)?;
        let problem = "must be at least 1; without patterns, `patterns.classes` is 0";
        layers.require(self.patterns.images > 0, "patterns.images", problem)?;
        let views = self.simulated.views;
        let fits = (1..=views).contains(&self.views_per_surface);
        let problem = format!("must be from 1 to `simulated.views`, {views}");
        layers.require(fits, "views-per-surface", &problem)?;
        layers.checked("training", self.training.check())?;
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_written_defaults_are_those_of_the_crates() {
        let config: Pretraining = toml::from_str(DEFAULTS).unwrap();
        assert_eq!(config.training, TrainingConfig::default());
        assert_eq!(config.simulated, SimulatorSpec::default());
    }
}

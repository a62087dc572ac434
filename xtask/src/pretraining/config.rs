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
    pub kept: KeptSpec,
    pub training: TrainingConfig,
    /// Every key with its value, as TOML.
    #[serde(skip)]
    pub resolved: String,
}

/// Images beside those of surfaces, whose features stay those of `start`.
#[derive(Clone, Debug, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub(crate) struct KeptSpec {
    /// How much it counts that they do.
    pub weight: f64,
    pub seed: u64,
    /// Images that formulas draw.
    pub patterns: usize,
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
        let weight = self.kept.weight;
        let positive = weight.is_finite() && weight > 0.0;
        layers.require(positive, "kept.weight", "must be above 0")?;
        let share = self.trained_share;
        let fits = share > 0.0 && (share == 1.0 || share < 1.0 && self.start.is_some());
        let problem = "must be above 0 and at most 1; below 1 it needs `start`";
        layers.require(fits, "trained-share", problem)?;
        let known = self.kept.patterns == 0 || self.start.is_some();
        layers.require(
            known,
            "kept.patterns",
            "must be 0 without a `start` to keep",
        )?;
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

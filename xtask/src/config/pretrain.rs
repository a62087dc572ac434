//! The config of `pretrain`.

use std::path::Path;

use anyhow::Result;
use serde::Deserialize;
use sps_models::encoders::EncoderKind;
use sps_models::training::TrainingConfig;
use sps_simulate::SimulatorSpec;

use super::encoder::check_training;
use super::layers::Layers;
use super::setting::Setting;
use crate::files::read_text;

const DEFAULTS: &str = include_str!("pretrain.toml");

/// What to pretrain, on what, and how.
#[derive(Clone, Debug)]
pub(crate) struct Pretraining {
    pub name: String,
    pub seed: u64,
    pub kind: EncoderKind,
    pub simulated: SimulatorSpec,
    pub views_per_surface: usize,
    pub training: TrainingConfig,
    /// Every key with its value, as TOML.
    pub resolved: String,
}

#[derive(Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
struct Config {
    seed: u64,
    encoder: String,
    views_per_surface: usize,
    simulated: SimulatorSpec,
    training: TrainingConfig,
}

impl Pretraining {
    /// Reads the config at `path` with `settings` over it.
    pub(crate) fn read(path: &Path, settings: &[Setting]) -> Result<Self> {
        let text = read_text(path)?;
        let defaults = DEFAULTS.parse()?;
        let layers = Layers::new(&defaults, path, &text, settings)?;
        let config: Config = layers.read()?;
        let kind = config.encoder.parse();
        let kind =
            kind.map_err(|error: sps_models::Error| layers.error("encoder", error.to_string()))?;
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
            simulated: config.simulated,
            views_per_surface: config.views_per_surface,
            training: config.training,
            resolved: layers.to_toml(),
        })
    }
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

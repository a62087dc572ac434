//! A training that was stopped, as safetensors: `encoder/..`, `objective/..`, `adam/..` and, where
//! there is one, `best/..`; the metadata hold the config and the epochs so far.
use serde::{Deserialize, Serialize};

use super::config::TrainingConfig;
use super::targets::Targets;
use super::trainer::{Best, Epoch, Parts, Trainer};
use crate::encoders::{Depths, Encoder, EncoderKind};
use crate::error::{Error, Result, require};
use crate::weights::{Storage, Weights};

const KEY: &str = "sps-training";
const FORMAT: u32 = 4;

#[derive(Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
struct Metadata {
    format: u32,
    encoder: String,
    #[serde(default)]
    depths: Depths,
    config: TrainingConfig,
    seed: u64,
    /// The hash of targets and parts.
    data: String,
    steps: u32,
    history: Vec<Epoch>,
    best: Option<(usize, f64)>,
}

impl Trainer {
    /// Everything that the next epoch depends on, as the content of a safetensors file.
    ///
    /// # Errors
    /// When a weight is no longer finite.
    pub fn to_bytes(&self) -> Result<Vec<u8>> {
        let metadata = Metadata {
            format: FORMAT,
            encoder: self.encoder.kind().to_string(),
            depths: self.encoder.depths().clone(),
            config: self.config.clone(),
            seed: self.seed,
            data: self.data.clone(),
            steps: self.adam.steps(),
            history: self.history.clone(),
            best: self.best.as_ref().map(|best| (best.epoch, best.loss)),
        };
        let metadata = serde_json::to_string(&metadata)
            .map_err(|error| Error::input("training state", error, "numbers that JSON has"))?;
        let mut tensors = Vec::new();
        let encoder = self.encoder.weights()?;
        let best = self.best.iter().map(|best| ("best", &best.weights));
        for (part, weights) in best.chain([("encoder", &encoder)]) {
            let weights = weights.iter();
            tensors.extend(weights.map(|(name, t)| (format!("{part}/{name}"), t.clone())));
        }
        for (name, variable) in self.objective.parameters() {
            tensors.push((format!("objective/{name}"), variable.as_tensor().clone()));
        }
        for (index, [mean, square]) in self.adam.moments()?.into_iter().enumerate() {
            tensors.push((format!("adam/{index}/mean"), mean));
            tensors.push((format!("adam/{index}/square"), square));
        }
        let tensors = Weights::sharing("training state", tensors);
        Ok(tensors.to_bytes_as(Storage::F32, Some((KEY, &metadata)))?)
    }

    /// Goes on from what [`Trainer::to_bytes`] gave, with the targets, parts, config and seed that
    /// training began with; `name` stands for the bytes in errors.
    ///
    /// # Errors
    /// Bytes that are no such state, or one of another training.
    pub fn resume(
        name: &str,
        bytes: &[u8],
        targets: Targets,
        parts: Parts,
        config: TrainingConfig,
        seed: u64,
    ) -> Result<Self> {
        let metadata = Weights::note(name, bytes, KEY)?;
        let metadata: Metadata = serde_json::from_str(&metadata)
            .map_err(|error| Error::input("training state", error, "valid metadata"))?;
        let same = (FORMAT, &config, seed) == (metadata.format, &metadata.config, metadata.seed);
        let expected = "a state of this format, config and seed";
        require(same, "training state", name, expected)?;
        let tensors = Weights::from_bytes(name, bytes)?;
        let kind: EncoderKind = metadata.encoder.parse()?;
        let encoder = Encoder::new(kind, tensors.part("encoder/"))?;
        let encoder = encoder.with_depths(&metadata.depths)?;
        let mut trainer = Self::new(&encoder, targets, parts, config, seed)?;
        let same = trainer.data == metadata.data;
        let expected = "a state of these targets and parts";
        require(same, "training state", name, expected)?;
        let layers = tensors.part("objective/");
        for (name, variable) in trainer.objective.parameters() {
            variable.set(layers.get(&name)?)?;
        }
        let moments = tensors.part("adam/");
        trainer.adam.restore(metadata.steps, |index| {
            let moment = |name| moments.get(&format!("{index}/{name}")).cloned();
            Ok([moment("mean")?, moment("square")?])
        })?;
        trainer.check_progress(&metadata)?;
        if let Some((epoch, loss)) = metadata.best {
            let network = Encoder::new(kind, tensors.part("best/"))?;
            let weights = network.weights().clone();
            trainer.best = Some(Best {
                epoch,
                loss,
                weights,
            });
        }
        trainer.history = metadata.history;
        Ok(trainer)
    }

    /// Refuses epochs and steps that are still to come.
    fn check_progress(&self, metadata: &Metadata) -> Result<()> {
        let (epochs, steps) = (metadata.history.len(), metadata.steps as usize);
        let best = metadata.best.map_or(0, |(epoch, _)| epoch);
        for (what, found, most) in [
            ("epochs of a training state", epochs, self.config.epochs),
            ("steps of a training state", steps, self.steps()),
            ("best epoch of a training state", best, epochs),
        ] {
            require(found <= most, what, found, format_args!("at most {most}"))?;
        }
        Ok(())
    }
}

/// A hash of what is learnt and from which images.
pub(super) fn hash(targets: &Targets, parts: &Parts) -> Result<String> {
    let values = targets.values.as_ref().map(|values| {
        let rows = (0..values.surfaces()).map(|image| values.row(image));
        (values.properties(), rows.collect::<Vec<_>>())
    });
    let classes = targets.classes.as_ref();
    let classes = classes.map(|classes| (&classes.of_image, classes.count));
    let (training, validation) = (&parts.training, &parts.validation);
    let materials = &targets.materials;
    let text = serde_json::to_vec(&(values, classes, materials, training, validation))
        .map_err(|error| Error::input("targets", error, "numbers that JSON has"))?;
    let mut hasher = blake3::Hasher::new();
    hasher.update(&text);
    let mut add = |values: &[f32]| {
        for value in values {
            hasher.update(&value.to_le_bytes());
        }
    };
    if let Some(start) = &targets.start {
        add(start.values());
    }
    if let Some(kept) = &targets.kept {
        hasher.update(&kept.encoder.content_hash());
        hasher.update(format!("{:?} {}", kept.images, kept.weight).as_bytes());
    }
    Ok(hasher.finalize().to_hex().to_string())
}

//! What methods are fitted on: an encoder, and the tables that it makes of a source.

use std::collections::BTreeSet;
use std::sync::Arc;

use anyhow::{Context, Result};
use sps_base::memory;
use sps_dataset::{FEWEST_PER_MATERIAL, FrameIndex, MaterialLabels, Property, Split};
use sps_estimator::{Embedder, Network};
use sps_models::encoders::Precision;
use sps_models::training::{Classes, Parts, Targets, TrainingConfig, TrainingObjective};
use sps_regress::Embeddings;
use tracing::info;

use super::Encodings;
use super::encoded::Encoded;
use super::tables::{self, Tables, hash_row, hash_text, readings};
use super::views::{self, equidistant};
use crate::data;
use crate::embeddings::embed;
use crate::encoder;
use crate::training::{FrameImages, Task, train, trained};
use crate::work::Undone;

pub(crate) struct Stage {
    pub embedder: Embedder,
    pub tables: Tables,
    /// Seconds that the encoder was trained for; 0 where it was not.
    pub train_seconds: f64,
    /// Memory that the encoder takes, in bytes.
    pub encoder_bytes: usize,
}

/// The stage of each part of the surfaces: one and the same where the encoder stays as it is, and
/// one for each where it learns from that part.
pub(crate) struct Stages<'a> {
    of: &'a Encoded<'a, 'a>,
    /// The views to embed, as indices of the source.
    views: Vec<usize>,
    /// Those to estimate.
    properties: Vec<Property>,
    start: Network,
    /// Memory that it takes, in bytes; a trained one takes as much.
    encoder_bytes: usize,
    shared: Option<Arc<Stage>>,
}

impl<'a> Stages<'a> {
    pub(crate) fn new(of: &'a Encoded<'a, 'a>) -> Result<Self> {
        let (experiment, source) = (of.experiment, of.source);
        let (start, encoder_bytes) = memory::kept(|| encoder::load(of.encoder, experiment.seed));
        let mut stages = Self {
            of,
            views: views::needed(&of.methods, source)?,
            properties: tables::properties(source, &experiment.properties)?,
            start: start?,
            encoder_bytes,
            shared: None,
        };
        if !of.encoder.learns() {
            stages.shared = Some(Arc::new(stages.stage(stages.start.clone(), 0.0)?));
        }
        Ok(stages)
    }

    /// Of all splits together, or of each of `some` on its own where the encoder learns from each.
    pub(crate) fn of_splits(
        &self,
        splits: &[Split],
        some: &BTreeSet<usize>,
    ) -> Result<Vec<Encodings>> {
        if let Some(shared) = &self.shared {
            return Ok(vec![Encodings::new(Arc::clone(shared), 0..splits.len())]);
        }
        let own = |&split: &usize| {
            let stage = self.of(&splits[split].train)?;
            Ok(Encodings::new(Arc::new(stage), split..split + 1))
        };
        some.iter().map(own).collect()
    }

    /// What methods are fitted on whose training surfaces are `training`.
    fn of(&self, training: &[usize]) -> Result<Stage> {
        let (mut encoder, seconds) = match &self.of.encoder.training {
            Some(config) => self.trained(config, training)?,
            None => (self.start.clone(), 0.0),
        };
        if self.of.encoder.precision == Precision::Int8 {
            encoder = self.calibrated(encoder, training)?;
        }
        self.stage(encoder, seconds)
    }

    /// The encoder in int8, scaled for the surfaces `training`, each seen from one of the views in turn.
    fn calibrated(&self, network: Network, training: &[usize]) -> Result<Network> {
        let resize = self.of.encoder.resize;
        let frame = |i: usize| {
            let view = self.views[i % self.views.len()];
            Ok(self.of.source.frame_to_resize(training[i], view, resize)?)
        };
        encoder::calibrated(&Embedder::new(network, resize)?, training.len(), frame)
    }

    fn stage(&self, encoder: Network, train_seconds: f64) -> Result<Stage> {
        let embedder = Embedder::new(encoder, self.of.encoder.resize)?;
        let views = &self.views;
        let embeddings = self.embedded(&embedder, views)?;
        let properties = self.properties.clone();
        Ok(Stage {
            encoder_bytes: self.encoder_bytes,
            embedder,
            tables: Tables::new(self.of, views, embeddings, properties)?,
            train_seconds,
        })
    }

    /// Some views of every surface that may be trained on.
    fn embedded(&self, embedder: &Embedder, views: &[usize]) -> Result<Embeddings> {
        let pool = self.of.splits.pool;
        let frames = frames(pool, views);
        let (values, new) = embed(self.of.source, &frames, embedder, self.of.experiment)?;
        let all = frames.len();
        info!("{all} embeddings of {pool} surfaces, {new} of them encoded now");
        Ok(embedder.table(&values, pool, views.len())?)
    }

    /// The encoder after it was trained on the surfaces `training`, and the seconds that took.
    fn trained(&self, config: &TrainingConfig, training: &[usize]) -> Result<(Network, f64)> {
        let views = match config.objective.views() {
            1 => vec![data::nadir(self.of.source)?],
            several => equidistant(self.of.source, several)?,
        };
        let pool = self.of.splits.pool;
        let frames = frames(pool, &views);
        let embedder = Embedder::new(self.start.clone(), self.of.encoder.resize)?;
        let targets = self.targets(config, &embedder, &views)?;
        let task = Task {
            name: "encoder",
            start: self.start.encoder()?,
            key: self.key(&frames, &targets)?,
            targets,
            parts: self.parts(config, training)?,
            config,
            seed: self.of.experiment.seed,
        };
        let images = FrameImages::of_source(self.of.source, frames, &embedder);
        let folder = self.of.experiment.cache.join("encoders");
        let trained = if self.of.experiment.work.fits() {
            train(task, &images, &folder)?
        } else {
            trained(&task, &folder)?.context(Undone::Training)?
        };
        info!("TensorBoard: {}", trained.folder.display());
        let encoder = match self.of.encoder.precision {
            Precision::Int8 => trained.encoder,
            precision => trained.encoder.with_precision(precision)?,
        };
        Ok((self.start.with_encoder(encoder), trained.seconds))
    }

    /// What the encoder learns to say of every surface that may be trained on: the readings and the
    /// material, each as its objective takes them, and what it sees itself where that is needed.
    fn targets(
        &self,
        config: &TrainingConfig,
        embedder: &Embedder,
        views: &[usize],
    ) -> Result<Targets> {
        let pool = self.of.splits.pool;
        let labels = MaterialLabels::of(self.of.source.surfaces(), FEWEST_PER_MATERIAL);
        let of_pool = &labels.labels()[..pool];
        let mut targets = Targets {
            values: Some(readings(self.of.source, self.of.about, pool)?),
            ..Targets::default()
        };
        match config.objective {
            TrainingObjective::Linear {} => {
                let class = |&label: &usize| u32::try_from(label);
                targets.classes = Some(Classes {
                    of_image: of_pool.iter().map(class).collect::<Result<_, _>>()?,
                    count: u32::try_from(labels.names().len())?,
                });
            }
            TrainingObjective::Heads { .. } => {
                let name = |&label: &usize| labels.names()[label].clone();
                targets.materials = Some(of_pool.iter().map(name).collect());
            }
        }
        if config.needs_start() {
            targets.start = Some(self.embedded(embedder, views)?);
        }
        Ok(targets)
    }

    /// The surfaces `training`, some of which say when to stop.
    fn parts(&self, config: &TrainingConfig, training: &[usize]) -> Result<Parts> {
        let (share, seed) = (config.validation, self.of.experiment.seed);
        let (training, validation) = if share == 0.0 {
            (training.to_vec(), Vec::new())
        } else {
            let split = self.of.splits.kept_aside(training, share, seed, 0)?;
            (split.train, split.validation)
        };
        Ok(Parts {
            training,
            validation,
        })
    }

    /// Names the images with what they are to say. What the encoder sees of them at the start follows
    /// from them and from the encoder.
    fn key(&self, frames: &[FrameIndex], targets: &Targets) -> Result<blake3::Hash> {
        let mut hasher = blake3::Hasher::new();
        hasher.update(format!("{:?}", self.of.encoder.resize).as_bytes());
        for frame in frames {
            hasher.update(&self.of.source.frame_key(frame.surface, frame.view)?);
        }
        if let Some(values) = &targets.values {
            (0..values.surfaces()).for_each(|surface| hash_row(&mut hasher, values, surface));
        }
        let classes = targets.classes.iter().flat_map(|classes| &classes.of_image);
        classes.for_each(|class| {
            hasher.update(&class.to_le_bytes());
        });
        let materials = targets.materials.iter().flatten();
        materials.for_each(|material| hash_text(&mut hasher, material));
        Ok(hasher.finalize())
    }
}

fn frames(surfaces: usize, views: &[usize]) -> Vec<FrameIndex> {
    let of_surface = |surface| views.iter().map(move |&view| FrameIndex { surface, view });
    (0..surfaces).flat_map(of_surface).collect()
}

//! What methods are fitted on: an encoder, and the tables that it makes of a source.

use std::sync::Arc;

use anyhow::{Context, Result};
use sps_dataset::{FEWEST_PER_MATERIAL, FrameIndex, MaterialLabels, Source};
use sps_estimator::{Embedder, Network};
use sps_models::Readings;
use sps_models::encoders::Precision;
use sps_models::training::{Classes, Parts, Targets, TrainingConfig};
use tracing::info;

use super::Splits;
use super::tables::{Tables, readings, table};
use crate::config::{EncoderSpec, Experiment};
use crate::data::{self, About};
use crate::embeddings::{EmbeddingCache, embed};
use crate::encoder;
use crate::memory;
use crate::training::{FrameImages, Task, train, trained};
use crate::work::Undone;

/// An encoder and the tables that it makes.
pub(crate) struct Stage {
    pub embedder: Embedder,
    pub tables: Tables,
    /// Seconds that the encoder was trained for; 0 where it was not.
    pub train_seconds: f64,
    /// Frames that were encoded now, and the seconds that took.
    pub encoded: (usize, f64),
    /// Memory that the encoder takes, in bytes.
    pub encoder_bytes: usize,
}

/// The stage of each part of the surfaces: one and the same where the encoder stays as it is, and
/// one for each where it learns from that part.
pub(crate) struct Stages<'a, S> {
    experiment: &'a Experiment,
    encoder: &'a EncoderSpec,
    source: &'a S,
    about: &'a About,
    splits: &'a Splits,
    /// The views to embed, as indices of the source.
    views: Vec<usize>,
    start: Network,
    /// Memory that it takes, in bytes; a trained one takes as much.
    encoder_bytes: usize,
    /// What the source's one view is made of where it is a sequence.
    sequence: Option<Vec<usize>>,
    shared: Option<Arc<Stage>>,
}

impl<'a, S: Source> Stages<'a, S> {
    /// With embeddings of the given views by an encoder; `sequence` says what the one view of a
    /// source of sequences is made of.
    pub(crate) fn new(
        experiment: &'a Experiment,
        encoder: &'a EncoderSpec,
        (source, about): (&'a S, &'a About),
        splits: &'a Splits,
        views: Vec<usize>,
        sequence: Option<Vec<usize>>,
    ) -> Result<Self> {
        let (start, encoder_bytes) = memory::kept(|| encoder::load(encoder, experiment.seed));
        let mut stages = Self {
            experiment,
            encoder,
            source,
            about,
            splits,
            views,
            start: start?,
            encoder_bytes,
            sequence,
            shared: None,
        };
        if !encoder.learns() {
            stages.shared = Some(Arc::new(stages.stage(stages.start.clone(), 0.0)?));
        }
        Ok(stages)
    }

    /// What methods are fitted on whose training surfaces are `training`.
    pub(crate) fn of(&self, training: &[usize]) -> Result<Arc<Stage>> {
        if let Some(shared) = &self.shared {
            return Ok(Arc::clone(shared));
        }
        let (encoder, seconds) = match &self.encoder.training {
            Some(config) => self.trained(config, training)?,
            None => (self.start.clone(), 0.0),
        };
        let encoder = match self.encoder.precision {
            Precision::Int8 => self.calibrated(&encoder, training)?,
            _ => encoder,
        };
        Ok(Arc::new(self.stage(encoder, seconds)?))
    }

    /// The encoder in int8, scaled for the surfaces `training`, each seen from one of the views in turn.
    fn calibrated(&self, encoder: &Network, training: &[usize]) -> Result<Network> {
        let resize = self.encoder.resize;
        let frame = |i: usize| {
            let view = self.views[i % self.views.len()];
            let frame = self.source.frame_to_resize(training[i], view, resize)?;
            Ok(match resize {
                Some(shorter) => frame.resized(shorter)?.into_owned(),
                None => frame,
            })
        };
        let encoder = encoder::calibrated(encoder.of_images()?, training.len(), frame)?;
        Ok(Network::Images(encoder))
    }

    /// Embeds the views of every surface that may be trained on.
    fn stage(&self, encoder: Network, train_seconds: f64) -> Result<Stage> {
        let experiment = self.experiment;
        let embedder = Embedder::new(encoder, self.encoder.resize)?;
        let (identity, width) = (embedder.identity(), embedder.width());
        let cache = EmbeddingCache::open(&experiment.cache, identity, width, experiment.work)?;
        let (views, pool) = (&self.views, self.splits.pool);
        let frames = frames(pool, views);
        let embedded = embed(self.source, &frames, &embedder, &cache)?;
        info!(
            "{} embeddings of {pool} surfaces, {} of them encoded now",
            frames.len(),
            embedded.frames_decoded
        );
        let embeddings = table(embedded.values, pool, embedded.width)?;
        let wanted = &experiment.properties;
        let mut tables = Tables::new(self.source, self.about, views, embeddings, wanted)?;
        tables.sequence.clone_from(&self.sequence);
        Ok(Stage {
            encoder_bytes: self.encoder_bytes,
            encoded: (embedded.frames_decoded, embedded.seconds),
            embedder,
            tables,
            train_seconds,
        })
    }

    /// The encoder after it was trained to say the readings of the surfaces `training` from the
    /// view straight down, and the seconds that took.
    fn trained(&self, config: &TrainingConfig, training: &[usize]) -> Result<(Network, f64)> {
        let views = [data::nadir(self.source)?];
        let frames = frames(self.splits.pool, &views);
        let readings = readings(self.source, self.about, self.splits.pool)?;
        let rows: Vec<Vec<Option<f64>>> = frames
            .iter()
            .map(|frame| row(&readings, frame.surface))
            .collect();
        let properties = readings.properties().to_vec();
        let classes = materials(self.source, &frames)?;
        let task = Task {
            name: "encoder",
            start: self.start.of_images()?,
            key: self.key(&frames, &rows, &classes)?,
            targets: Targets {
                values: Some(Readings::new(properties, &rows)?),
                classes: Some(classes),
                features: None,
            },
            parts: self.parts(config, training, views.len())?,
            config,
            seed: self.experiment.seed,
        };
        let images = FrameImages::of_source(self.source, frames, self.encoder.resize);
        let folder = self.experiment.cache.join("encoders");
        let trained = if self.experiment.work.fits() {
            train(task, &images, &folder)?
        } else {
            trained(&task, &folder)?.context(Undone::Training)?
        };
        info!("TensorBoard: {}", trained.folder.display());
        let encoder = match self.encoder.precision {
            Precision::Int8 => trained.encoder,
            precision => trained.encoder.with_precision(precision)?,
        };
        Ok((Network::Images(encoder), trained.seconds))
    }

    /// The images of the surfaces `training`, some of which say when to stop.
    fn parts(&self, config: &TrainingConfig, training: &[usize], views: usize) -> Result<Parts> {
        let images = |surfaces: &[usize]| -> Vec<usize> {
            let of_surface = |&s: &usize| s * views..(s + 1) * views;
            surfaces.iter().flat_map(of_surface).collect()
        };
        if config.validation == 0.0 {
            return Ok(Parts {
                training: images(training),
                validation: Vec::new(),
            });
        }
        let seed = self.experiment.seed;
        let split = self
            .splits
            .kept_aside(training, config.validation, seed, 0)?;
        Ok(Parts {
            training: images(&split.train),
            validation: images(&split.validation),
        })
    }

    /// Names the images with what they are to say.
    fn key(
        &self,
        frames: &[FrameIndex],
        rows: &[Vec<Option<f64>>],
        classes: &Classes,
    ) -> Result<blake3::Hash> {
        let mut hasher = blake3::Hasher::new();
        hasher.update(format!("{:?}", self.encoder.resize).as_bytes());
        for frame in frames {
            hasher.update(&self.source.frame_key(frame.surface, frame.view)?);
        }
        for cell in rows.iter().flatten() {
            hasher.update(&cell.map_or([0xff; 8], f64::to_le_bytes));
        }
        for class in &classes.of_image {
            hasher.update(&class.to_le_bytes());
        }
        Ok(hasher.finalize())
    }
}

/// The given views of the first so many surfaces.
fn frames(surfaces: usize, views: &[usize]) -> Vec<FrameIndex> {
    let of_surface = |surface| views.iter().map(move |&view| FrameIndex { surface, view });
    (0..surfaces).flat_map(of_surface).collect()
}

/// The material of each frame's surface, by the paper's rule.
fn materials<S: Source>(source: &S, frames: &[FrameIndex]) -> Result<Classes> {
    let labels = MaterialLabels::of(source.surfaces(), FEWEST_PER_MATERIAL);
    let class = |frame: &FrameIndex| u32::try_from(labels.labels()[frame.surface]);
    Ok(Classes {
        of_image: frames.iter().map(class).collect::<Result<_, _>>()?,
        count: u32::try_from(labels.names().len())?,
    })
}

fn row(readings: &Readings, surface: usize) -> Vec<Option<f64>> {
    let columns = 0..readings.properties().len();
    columns
        .map(|column| readings.get(surface, column))
        .collect()
}

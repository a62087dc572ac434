//! What a teacher sees in a world.

use std::fs;
use std::path::Path;

use anyhow::{Context, Result, ensure};
use candle_core::{Device, Tensor};
use rayon::prelude::*;
use sps_dataset::Frame;
use sps_experiment::files::{create_folder, write_atomically};
use sps_experiment::progress::Progress;
use sps_models::encoders::{Depths, Encoder};
use sps_models::training::Features;
use sps_models::weights::{Storage, Weights};
use tracing::warn;

use super::config::TeacherSpec;
use super::{World, sources};

/// Images that are embedded together.
const BATCH: usize = 32;

const NAME: &str = "features";
/// In the metadata: the hash of what the features were made by, and their checksum.
const NOTE: &str = "sps-teacher";

/// An encoder whose embeddings are learnt.
pub(crate) struct Teacher<'a> {
    spec: &'a TeacherSpec,
    encoder: Encoder,
}

impl<'a> Teacher<'a> {
    pub(crate) fn read(spec: &'a TeacherSpec) -> Result<Self> {
        let weights = Weights::read(&spec.weights)?;
        let encoder = Encoder::new(spec.kind, weights)?;
        let encoder = encoder.with_depths(&spec.depths)?;
        Ok(Self { spec, encoder })
    }

    /// Two teachers of one key see the same.
    pub(crate) fn key(&self) -> String {
        let hash = blake3::Hash::from(self.encoder.content_hash());
        format!("{} {}", hash.to_hex(), self.spec.size)
    }

    pub(crate) fn weight(&self) -> f64 {
        self.spec.weight
    }

    /// The embeddings of all images of a world; kept in `folder`, where another training by the same
    /// teacher in the same world finds them.
    pub(crate) fn features(&self, world: &World, folder: &Path) -> Result<Features> {
        let key = format!("{} {}", self.key(), world.key());
        let name = &blake3::hash(key.as_bytes()).to_hex()[..16];
        let path = folder.join(format!("teacher-{name}.safetensors"));
        let source = blake3::hash(format!("{} {key}", sources()).as_bytes());
        let embeddings = if let Some(kept) = kept(&path, source)? {
            kept
        } else {
            let embeddings = self.embed(world)?;
            let kept = Weights::from_tensors(NAME, [(NAME.to_owned(), embeddings.clone())])?;
            let note = note(source, &kept)?;
            create_folder(folder)?;
            let bytes = kept.to_bytes_as(Storage::F32, Some((NOTE, &note)))?;
            write_atomically(&path, &bytes)?;
            embeddings
        };
        Ok(Features {
            embeddings,
            blocks: match self.spec.depths {
                Depths::Last => Vec::new(),
                _ => self.encoder.blocks(),
            },
            weight: self.spec.weight,
        })
    }

    /// `(images, width)`
    fn embed(&self, world: &World) -> Result<Tensor> {
        let progress = Progress::new("what the teacher sees", world.len());
        let side = self.spec.size;
        let mut rows = Vec::new();
        for first in (0..world.len()).step_by(BATCH) {
            let images = first..(first + BATCH).min(world.len());
            let count = images.len();
            let frame = |image| Ok(world.frame(image)?.resized(side)?.into_owned());
            let frames = images.into_par_iter().map(frame);
            let frames: Vec<Frame> = frames.collect::<Result<_>>()?;
            let pixels: Vec<&[f32]> = frames.iter().map(|frame| &frame.data[..]).collect();
            rows.extend(self.encoder.embed_pixels(&pixels, [side, side])?);
            progress.advance(count);
        }
        let shape = (world.len(), self.encoder.width());
        Ok(Tensor::from_vec(rows, shape, &Device::Cpu)?)
    }
}

/// What was kept at `path`; none where it was made by another source, or is damaged.
fn kept(path: &Path, source: blake3::Hash) -> Result<Option<Tensor>> {
    if !path.exists() {
        return Ok(None);
    }
    let name = path.display().to_string();
    let bytes = fs::read(path).with_context(|| format!("cannot read {name}"))?;
    let check = || {
        let weights = Weights::from_bytes(&name, &bytes)?;
        let found = Weights::note(&name, &bytes, NOTE)?;
        let expected = note(source, &weights)?;
        ensure!(
            found == expected,
            "{name}: found the note {found:?}, expected {expected:?}"
        );
        Ok(weights.get(NAME)?.clone())
    };
    let kept = check()
        .inspect_err(|error: &anyhow::Error| warn!("{error:#}; the features are computed again"));
    Ok(kept.ok())
}

fn note(source: blake3::Hash, features: &Weights) -> Result<String> {
    let checksum = blake3::hash(&features.to_bytes()?);
    Ok(format!("{source} {checksum}"))
}

//! What a teacher sees in a world.

use std::path::Path;

use anyhow::Result;
use candle_core::{Device, Tensor};
use rayon::prelude::*;
use sps_dataset::Frame;
use sps_models::encoders::{Depths, Encoder};
use sps_models::training::Features;
use sps_models::weights::{Storage, Weights};

use super::World;
use crate::config::TeacherSpec;
use crate::files::{create_folder, write_atomically};
use crate::progress::Progress;

/// Images that are embedded together.
const BATCH: usize = 32;

const NAME: &str = "features";

/// An encoder whose embeddings are learnt.
pub(crate) struct Teacher<'a> {
    spec: &'a TeacherSpec,
    encoder: Encoder,
}

impl<'a> Teacher<'a> {
    pub(crate) fn read(spec: &'a TeacherSpec) -> Result<Self> {
        let weights = Weights::read(&spec.weights)?;
        let encoder = Encoder::new(spec.kind, weights, &Device::Cpu)?;
        let encoder = encoder.with_depths(&spec.depths)?;
        Ok(Self { spec, encoder })
    }

    /// Two teachers of one key see the same.
    pub(crate) fn key(&self) -> String {
        let hash = blake3::Hash::from(self.encoder.content_hash());
        format!("{} {}", hash.to_hex(), self.spec.size)
    }

    /// The embeddings of all images of a world; kept in `folder`, where another training by the same
    /// teacher in the same world finds them.
    pub(crate) fn features(&self, world: &World, folder: &Path) -> Result<Features> {
        let name = blake3::hash(format!("{} {}", self.key(), world.key()).as_bytes());
        let name = &name.to_hex()[..16];
        let path = folder.join(format!("teacher-{name}.safetensors"));
        let embeddings = if path.exists() {
            Weights::read(&path)?.get(NAME)?.clone()
        } else {
            let embeddings = self.embed(world)?;
            let kept = Weights::from_tensors(NAME, [(NAME.to_owned(), embeddings.clone())])?;
            create_folder(folder)?;
            write_atomically(&path, &kept.to_bytes_as(Storage::F32, None)?)?;
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
            let frames = images.into_par_iter().map(|image| {
                let frame = world.frame(image)?;
                Ok(frame.resized(side)?.into_owned())
            });
            let frames: Vec<Frame> = frames.collect::<Result<_>>()?;
            let pixels: Vec<&[f32]> = frames.iter().map(|frame| &frame.data[..]).collect();
            rows.extend(self.encoder.embed_pixels(&pixels, [side, side])?);
            progress.advance(count);
        }
        let shape = (world.len(), self.encoder.width());
        Ok(Tensor::from_vec(rows, shape, &Device::Cpu)?)
    }
}

//! Features that an encoder keeps while it learns.

use std::collections::BTreeSet;

use candle_core::{Device, Tensor};
use sps_base::parallel;
use sps_regress::Standardiser;

use super::batches::{self, ImageSource};
use crate::encoders::{Block, Encoder};
use crate::error::{Error, Result, require};
use crate::heads::Share;

/// Images whose features say by how much each of them varies.
const SAMPLE: usize = 1024;

/// What an encoder is to go on seeing in some images, whatever it learns from others: the features of another of its
/// kind, most often its own before the training (of outputs: Li and Hoiem, "Learning without Forgetting", ECCV 2016).
///
/// Both see an image varied in the same way. The loss is the mean squared error of a block's features, each in units of
/// its standard deviation, and of that the mean over the blocks.
#[derive(Clone, Debug)]
pub struct Kept {
    pub(super) encoder: Encoder,
    pub(super) images: BTreeSet<usize>,
    pub(super) weight: f64,
    /// What makes a sum of squared errors the loss of one image, `(width)`.
    scale: Tensor,
}

impl Kept {
    /// The features that `encoder` has of `images` of a source; their loss counts `weight` beside the others.
    ///
    /// # Errors
    /// A weight that is not above 0; an image that cannot be had, or embedded.
    pub fn new(
        encoder: Encoder,
        images: impl IntoIterator<Item = usize>,
        source: &dyn ImageSource,
        weight: f64,
    ) -> Result<Self> {
        let positive = weight.is_finite() && weight > 0.0;
        require(positive, "weight of kept features", weight, "above 0")?;
        let images: BTreeSet<usize> = images.into_iter().collect();
        let every = images.len().div_ceil(SAMPLE).max(1);
        let sample: Vec<usize> = images.iter().copied().step_by(every).collect();
        let rows = parallel::map(&sample, |&index| {
            let image = batches::image(source, index)?;
            let embedding = encoder.embed(&batches::stack(&[image], &[index])?)?;
            Ok::<_, Error>(embedding.flatten_all()?.to_vec1::<f32>()?)
        });
        let rows: Vec<Vec<f32>> = rows.into_iter().collect::<Result<_>>()?;
        let blocks = encoder.blocks();
        let widths = blocks
            .iter()
            .flat_map(|block| std::iter::repeat_n(block.width, block.width));
        let scales = widths.enumerate().map(|(column, width)| {
            let values = rows.iter().map(|row| f64::from(row[column]));
            let std = Standardiser::of(values).unwrap_or_default().std;
            let share = ((width * blocks.len()) as f64).sqrt();
            // What is the same in all of them has no unit.
            if std > 0.0 {
                (1.0 / (std * share)) as f32
            } else {
                0.0
            }
        });
        let scales: Vec<f32> = scales.collect();
        Ok(Self {
            scale: Tensor::new(scales, &Device::Cpu)?,
            encoder,
            images,
            weight,
        })
    }

    pub(super) fn check(&self, encoder: &[Block]) -> Result<()> {
        let same = self.encoder.blocks() == encoder;
        let expected = "of the blocks that the trained encoder has";
        require(same, "kept features", "others", expected)
    }

    /// The loss of the embeddings of some surfaces' images: their share of the mean over the step's images that are
    /// to be kept. None where none of theirs is.
    pub(super) fn loss(
        &self,
        images: &Tensor,
        embeddings: &Tensor,
        Share { surfaces, of }: Share<'_>,
    ) -> Result<Option<Tensor>> {
        let views = embeddings.dim(0)? / surfaces.len().max(1);
        let kept = |surfaces: &[usize]| -> Vec<u32> {
            let numbers = batches::images(surfaces, views).into_iter().enumerate();
            let kept = numbers.filter(|(_, image)| self.images.contains(image));
            kept.map(|(row, _)| row as u32).collect()
        };
        let (rows, count) = (kept(surfaces), kept(of).len());
        if rows.is_empty() {
            return Ok(None);
        }
        let rows = Tensor::new(rows, &Device::Cpu)?;
        let wanted = self.encoder.embed(&images.index_select(&rows, 0)?)?;
        let error = embeddings.index_select(&rows, 0)?.sub(&wanted)?;
        let squares = error.broadcast_mul(&self.scale)?.sqr()?.sum_all()?;
        Ok(Some((squares * (self.weight / count as f64))?))
    }
}

//! The order in which images are shown, and their way to the network.

use std::error::Error as StdError;
use std::ops::Range;
use std::sync::mpsc::{SyncSender, sync_channel};
use std::thread;

use candle_core::{Device, Tensor};
use rand::seq::SliceRandom;
use sps_base::parallel;
use sps_base::streams::named_stream;

use super::config::Augmentation;
use super::image::Image;
use crate::error::{Error, Result};

/// Where training images, or sequences, come from, by index; asked for from several threads at once.
///
/// ```
/// use sps_models::training::{Image, ImageSource};
///
/// struct Grey(usize);
///
/// impl ImageSource for Grey {
///     fn image(&self, index: usize) -> Result<Image, Box<dyn std::error::Error + Send + Sync>> {
///         let value = index as f32 / self.0 as f32;
///         Ok(Image::new(32, 32, vec![value; 32 * 32 * 3])?)
///     }
/// }
/// ```
pub trait ImageSource: Sync {
    /// Decodes or renders an image.
    ///
    /// # Errors
    /// When there is no such image, or it cannot be read.
    fn image(&self, index: usize) -> Result<Image, Box<dyn StdError + Send + Sync>>;
}

/// Batches made ready while another is trained on.
const AHEAD: usize = 2;

/// Images of one step.
pub(super) struct Batch {
    /// `(surfaces x views, 3, [frames,] height, width)`
    pub(super) tensor: Tensor,
    pub(super) surfaces: Vec<usize>,
}

/// The surfaces of an epoch in batches of nearly the same size, of at most `size`.
pub(super) fn epoch(surfaces: &[usize], size: usize, seed: u64, epoch: usize) -> Vec<Vec<usize>> {
    let mut order = surfaces.to_vec();
    order.shuffle(&mut named_stream(seed, "training/order", epoch as u64));
    let parts = cut(order.len(), size);
    parts.map(|part| order[part].to_vec()).collect()
}

/// So many surfaces in parts of nearly the same size, of at most `size`.
pub(super) fn cut(surfaces: usize, size: usize) -> impl Iterator<Item = Range<usize>> {
    let parts = steps(surfaces, size);
    let at = move |part: usize| part * surfaces / parts;
    (0..parts).map(move |part| at(part)..at(part + 1))
}

/// Batches in an epoch.
pub(super) fn steps(surfaces: usize, size: usize) -> usize {
    surfaces.div_ceil(size).max(1)
}

/// Hands each batch to `train`, and has the next ones read meanwhile.
pub(super) fn for_each(
    source: &dyn ImageSource,
    batches: &[Vec<usize>],
    vary: &Vary<'_>,
    mut train: impl FnMut(Batch) -> Result<()>,
) -> Result<()> {
    thread::scope(|scope| {
        let (ready, batches_ready) = sync_channel(AHEAD - 1);
        scope.spawn(move || read(source, batches, vary, &ready));
        batches_ready.iter().try_for_each(|batch| train(batch?))
    })
}

/// How an epoch's images are varied.
pub(super) struct Vary<'a> {
    pub(super) augmentation: &'a Augmentation,
    pub(super) seed: u64,
    pub(super) epoch: usize,
    /// Images of a surface.
    pub(super) views: usize,
}

/// The images of some surfaces.
pub(super) fn images(surfaces: &[usize], views: usize) -> Vec<usize> {
    let of = |&surface: &usize| surface * views..(surface + 1) * views;
    surfaces.iter().flat_map(of).collect()
}

fn read(
    source: &dyn ImageSource,
    batches: &[Vec<usize>],
    vary: &Vary<'_>,
    ready: &SyncSender<Result<Batch>>,
) {
    let purpose = format!("training/augmentation/{}", vary.epoch);
    for surfaces in batches {
        let images = images(surfaces, vary.views);
        let shown = parallel::map(&images, |&index| {
            let image = image(source, index)?;
            let mut rng = named_stream(vary.seed, &purpose, index as u64);
            Ok(image.varied(vary.augmentation, &mut rng))
        });
        let shown: Result<Vec<Image>> = shown.into_iter().collect();
        let batch = shown.and_then(|shown| {
            Ok(Batch {
                tensor: stack(&shown, &images)?,
                surfaces: surfaces.clone(),
            })
        });
        // Nobody listens any more once training has failed.
        if ready.send(batch).is_err() {
            return;
        }
    }
}

/// One image, with its index where it cannot be had.
pub(super) fn image(source: &dyn ImageSource, index: usize) -> Result<Image> {
    let image = source.image(index);
    image.map_err(|source| Error::Image { index, source })
}

/// `(images, 3, [frames,] height, width)` of images of one size.
pub(super) fn stack(shown: &[Image], indices: &[usize]) -> Result<Tensor> {
    let shape = shown.first().map_or(Vec::new(), Image::shape);
    if let Some(at) = shown.iter().position(|i| i.shape() != shape) {
        let found = format_args!("{:?} of image {}", shown[at].shape(), indices[at]);
        let expected = format_args!("{shape:?}, as of image {}", indices[0]);
        return Err(Error::input("image size", found, expected));
    }
    let values: Vec<f32> = shown.iter().flat_map(Image::pixels).copied().collect();
    let axes = shape.len();
    let shape = [&[shown.len()], &shape[..]].concat();
    let tensor = Tensor::from_vec(values, shape, &Device::Cpu)?;
    let channels_first: Vec<usize> = [0, axes].into_iter().chain(1..axes).collect();
    Ok(tensor.permute(channels_first)?.contiguous()?)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_epoch_shows_every_image_once_in_batches_of_nearly_one_size() {
        let images: Vec<usize> = (10..47).collect();
        let batches = epoch(&images, 16, 3, 0);
        let sizes: Vec<usize> = batches.iter().map(Vec::len).collect();
        assert_eq!(sizes, [12, 12, 13]);
        let mut all = batches.concat();
        assert_ne!(all, images);
        all.sort_unstable();
        assert_eq!(all, images);
        assert_eq!(epoch(&images, 16, 3, 0), batches);
        assert_ne!(epoch(&images, 16, 3, 1), batches);
    }

    struct Broken;

    impl ImageSource for Broken {
        fn image(&self, index: usize) -> Result<Image, Box<dyn StdError + Send + Sync>> {
            match index {
                7 => Err("a torn page".into()),
                _ => Ok(Image::new(2 + index, 3, vec![0.0; (2 + index) * 9])?),
            }
        }
    }

    fn message(batches: &[Vec<usize>]) -> String {
        let vary = Vary {
            augmentation: &Augmentation::default(),
            seed: 0,
            epoch: 0,
            views: 1,
        };
        let error = for_each(&Broken, batches, &vary, |_| Ok(())).unwrap_err();
        error.to_string()
    }

    #[test]
    fn an_image_that_cannot_be_had_is_named() {
        let message = message(&[vec![1], vec![7], vec![1]]);
        assert_eq!(message, "image 7: a torn page");
    }

    #[test]
    fn images_of_different_sizes_are_named() {
        assert!(message(&[vec![0, 9]]).contains("image 9"));
    }
}

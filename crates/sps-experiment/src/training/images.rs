use std::error::Error as StdError;
use std::sync::OnceLock;

use anyhow::Result;
use sps_dataset::{Frame, FrameIndex, Source};
use sps_estimator::{Embedder, Network};
use sps_models::training::{Image, ImageSource};

/// Frames as training images, or as sequences of such.
///
/// What is decoded or rendered once is kept, with 8 bits for each colour as in a PNG, because an
/// epoch shows every frame again.
pub struct FrameImages<'a> {
    decode: Box<dyn Fn(usize) -> Result<Image> + Sync + 'a>,
    kept: Vec<OnceLock<Kept>>,
}

struct Kept {
    frames: Option<usize>,
    height: usize,
    width: usize,
    values: Box<[u8]>,
}

/// Frames beyond so many values are decoded each time they are shown.
const MOST_KEPT: usize = 4 << 30;

impl<'a> FrameImages<'a> {
    /// So many images, each as `decode` gives it.
    pub fn new(count: usize, decode: impl Fn(usize) -> Result<Image> + Sync + 'a) -> Self {
        Self {
            decode: Box::new(decode),
            kept: (0..count).map(|_| OnceLock::new()).collect(),
        }
    }

    /// Image `i` is `frames[i]` of a source as the embedder takes it.
    pub(crate) fn of_source(
        source: &'a dyn Source,
        frames: Vec<FrameIndex>,
        embedder: &'a Embedder,
    ) -> Self {
        Self::new(frames.len(), move |index| {
            let FrameIndex { surface, view } = frames[index];
            let frame = source.frame_to_resize(surface, view, embedder.resize())?;
            let Frame {
                width,
                height,
                data,
            } = embedder.prepared(&frame)?.into_owned();
            Ok(match embedder.network() {
                Network::Sequences(_, frames) => {
                    Image::sequence(*frames, height / frames, width, data)?
                }
                _ => Image::new(height, width, data)?,
            })
        })
    }
}

impl ImageSource for FrameImages<'_> {
    fn image(&self, index: usize) -> Result<Image, Box<dyn StdError + Send + Sync>> {
        if let Some(kept) = self.kept[index].get() {
            return kept.image();
        }
        let image = (self.decode)(index)?;
        let kept = Kept::new(&image);
        let shown = kept.image();
        if image.pixels().len().saturating_mul(self.kept.len()) <= MOST_KEPT {
            // Another thread may have kept the same values meanwhile.
            let _ = self.kept[index].set(kept);
        }
        shown
    }
}

impl Kept {
    fn new(image: &Image) -> Self {
        let byte = |&value: &f32| (value.clamp(0.0, 1.0) * 255.0).round() as u8;
        let (height, width) = image.size();
        Self {
            frames: image.frames(),
            height,
            width,
            values: image.pixels().iter().map(byte).collect(),
        }
    }

    fn image(&self) -> Result<Image, Box<dyn StdError + Send + Sync>> {
        let values = self.values.iter().map(|&byte| f32::from(byte) / 255.0);
        let (height, width, values) = (self.height, self.width, values.collect());
        Ok(match self.frames {
            None => Image::new(height, width, values)?,
            Some(frames) => Image::sequence(frames, height, width, values)?,
        })
    }
}

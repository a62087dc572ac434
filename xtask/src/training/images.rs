use std::error::Error as StdError;
use std::sync::OnceLock;

use sps_dataset::{Frame, FrameIndex, Source};
use sps_models::training::{Image, ImageSource};

/// Frames of a source as training images.
///
/// What is decoded or rendered once is kept, with 8 bits for each colour as in a PNG, because an
/// epoch shows every frame again.
pub(crate) struct FrameImages<'a, S> {
    source: &'a S,
    frames: Vec<FrameIndex>,
    resize: Option<usize>,
    kept: Vec<OnceLock<Kept>>,
}

struct Kept {
    height: usize,
    width: usize,
    values: Box<[u8]>,
}

/// Frames beyond so many values are decoded each time they are shown.
const MOST_KEPT: usize = 4 << 30;

impl<'a, S: Source> FrameImages<'a, S> {
    /// Image `i` is `frames[i]`, its shorter side brought to `resize` pixels.
    pub(crate) fn new(source: &'a S, frames: Vec<FrameIndex>, resize: Option<usize>) -> Self {
        Self {
            kept: frames.iter().map(|_| OnceLock::new()).collect(),
            source,
            frames,
            resize,
        }
    }

    fn decode(&self, index: usize) -> Result<Frame, Box<dyn StdError + Send + Sync>> {
        let FrameIndex { surface, view } = self.frames[index];
        let frame = self.source.frame_to_resize(surface, view, self.resize)?;
        Ok(match self.resize {
            Some(shorter) => frame.resized(shorter)?.into_owned(),
            None => frame,
        })
    }
}

impl<S: Source> ImageSource for FrameImages<'_, S> {
    fn image(&self, index: usize) -> Result<Image, Box<dyn StdError + Send + Sync>> {
        if let Some(kept) = self.kept[index].get() {
            return kept.image();
        }
        let frame = self.decode(index)?;
        let kept = Kept::new(&frame);
        let image = kept.image();
        if frame.data.len().saturating_mul(self.frames.len()) <= MOST_KEPT {
            // Another thread may have kept the same values meanwhile.
            let _ = self.kept[index].set(kept);
        }
        image
    }
}

impl Kept {
    fn new(frame: &Frame) -> Self {
        let byte = |&value: &f32| (value.clamp(0.0, 1.0) * 255.0).round() as u8;
        Self {
            height: frame.height,
            width: frame.width,
            values: frame.data.iter().map(byte).collect(),
        }
    }

    fn image(&self) -> Result<Image, Box<dyn StdError + Send + Sync>> {
        let values = self.values.iter().map(|&byte| f32::from(byte) / 255.0);
        Ok(Image::new(self.height, self.width, values.collect())?)
    }
}

use std::error::Error as StdError;
use std::sync::OnceLock;

use anyhow::Result;
use sps_dataset::{Frame, FrameIndex, Source};
use sps_models::training::{Image, ImageSource};

/// Frames as training images.
///
/// What is decoded or rendered once is kept, with 8 bits for each colour as in a PNG, because an
/// epoch shows every frame again.
pub(crate) struct FrameImages<'a> {
    decode: Box<dyn Fn(usize) -> Result<Frame> + Sync + 'a>,
    kept: Vec<OnceLock<Kept>>,
}

struct Kept {
    height: usize,
    width: usize,
    values: Box<[u8]>,
}

/// Frames beyond so many values are decoded each time they are shown.
const MOST_KEPT: usize = 4 << 30;

impl<'a> FrameImages<'a> {
    /// So many frames, each as `decode` gives it.
    pub(crate) fn new(count: usize, decode: impl Fn(usize) -> Result<Frame> + Sync + 'a) -> Self {
        Self {
            decode: Box::new(decode),
            kept: (0..count).map(|_| OnceLock::new()).collect(),
        }
    }

    /// Image `i` is `frames[i]` of a source, its shorter side brought to `resize` pixels.
    pub(crate) fn of_source(
        source: &'a impl Source,
        frames: Vec<FrameIndex>,
        resize: Option<usize>,
    ) -> Self {
        Self::new(frames.len(), move |index| {
            let FrameIndex { surface, view } = frames[index];
            let frame = source.frame_to_resize(surface, view, resize)?;
            Ok(match resize {
                Some(shorter) => frame.resized(shorter)?.into_owned(),
                None => frame,
            })
        })
    }
}

impl ImageSource for FrameImages<'_> {
    fn image(&self, index: usize) -> Result<Image, Box<dyn StdError + Send + Sync>> {
        if let Some(kept) = self.kept[index].get() {
            return kept.image();
        }
        let frame = (self.decode)(index)?;
        let kept = Kept::new(&frame);
        let image = kept.image();
        if frame.data.len().saturating_mul(self.kept.len()) <= MOST_KEPT {
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

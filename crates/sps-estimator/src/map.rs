//! An estimate at every place of a photograph.

use sps_dataset::{Extent, Frame};

use crate::error::{Error, Result};
use crate::estimator::Estimator;
use crate::fitted::Predictions;

/// Windows along the shorter side of one, where nothing is said of how far apart they lie.
const STEPS_PER_WINDOW: usize = 8;

/// What is said of windows on a regular grid over a photograph.
#[derive(Clone, Debug, PartialEq)]
pub struct Map {
    /// Windows from the photograph's top to its bottom.
    pub rows: usize,
    /// Windows from its left to its right.
    pub columns: usize,
    /// Height and width of a window in pixels: the extent of the photographs that the model was fitted
    /// on.
    pub window: [usize; 2],
    /// The centre of each window, row by row: pixels down and to the right from the upper left corner.
    pub centres: Vec<[f64; 2]>,
    /// What is said of each window, row by row.
    pub predictions: Predictions,
}

/// How the encoder looks at a window.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Sight {
    /// All in one pass over the whole photograph: what the encoder sees there is not what it sees of a
    /// crop, whose edges it pads with zeros
    /// ([`Encoder::embed_windows`](sps_models::encoders::Encoder::embed_windows)). Intervals and p-values
    /// were calibrated on crops; the smaller the window, the less they hold.
    #[default]
    Within,
    /// Each as a photograph of its own, in a pass of its own: what [`Estimator::predict`] says of the
    /// crop, to the bit.
    Alone,
}

impl Estimator {
    /// Estimates every property in windows of a photograph, `stride` pixels apart. A pixel of the
    /// photograph shows as much of a surface as one of the photographs that the model was fitted on,
    /// after it was brought to the model's own size. Neighbouring windows share pixels, and none is a
    /// new surface of its own: intervals and p-values hold for each alone.
    ///
    /// # Errors
    ///
    /// A model of several views, a photograph smaller than a window, a stride of 0.
    pub fn map(&self, photograph: &Frame, stride: usize, sight: Sight) -> Result<Map> {
        if !self.fitted.steps().eq([1]) {
            let found = format!("one of {} views", self.about.angles.len());
            return Err(Error::input(
                "model",
                found,
                "one that looks at a single photograph",
            ));
        }
        let window = self.window();
        let encoder = self.embedder.network().of_images()?;
        let size = [photograph.height, photograph.width];
        let mut windows = encoder.embed_windows(&photograph.data, size, window, stride)?;
        if sight == Sight::Alone {
            windows.embeddings = self.each_alone(photograph, window, &windows.centres)?;
        }
        let count = windows.rows * windows.columns;
        let embeddings = self.embeddings(&windows.embeddings, count, 1)?;
        Ok(Map {
            rows: windows.rows,
            columns: windows.columns,
            window,
            centres: windows.centres,
            predictions: self.fitted.predict(&embeddings)?,
        })
    }

    /// The embeddings of windows with these centres, each encoded as a photograph of its own.
    fn each_alone(
        &self,
        photograph: &Frame,
        [height, width]: [usize; 2],
        centres: &[[f64; 2]],
    ) -> Result<Vec<f32>> {
        const AT_ONCE: usize = 32;
        let crop = |&[y, x]: &[f64; 2]| {
            let top = (y - height as f64 / 2.0) as usize;
            let left = (x - width as f64 / 2.0) as usize;
            let row = |y: usize| &photograph.data[3 * (y * photograph.width + left)..][..3 * width];
            Frame {
                width,
                height,
                data: (top..top + height).flat_map(row).copied().collect(),
            }
        };
        let mut embeddings = Vec::new();
        for centres in centres.chunks(AT_ONCE) {
            let crops: Vec<Frame> = centres.iter().map(crop).collect();
            embeddings.extend(self.embedder.embed(&crops)?);
        }
        Ok(embeddings)
    }

    /// How far apart windows of a map lie where nothing else is asked for, in pixels: an eighth of the
    /// shorter side of one.
    pub fn stride(&self) -> usize {
        let [height, width] = self.window();
        (height.min(width) / STEPS_PER_WINDOW).max(1)
    }

    /// Height and width of a map's windows: those of the photographs fitted on, as the encoder saw them.
    fn window(&self) -> [usize; 2] {
        let [height, width] = self.about.frame_size;
        let frames = Extent { width, height };
        let extent = self.embedder.resize();
        let extent = extent.map_or(frames, |shorter| frames.with_shorter_side(shorter));
        [extent.height, extent.width]
    }
}

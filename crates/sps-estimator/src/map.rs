//! An estimate at every place of a photograph.

use sps_dataset::Frame;

use crate::error::{Error, Result};
use crate::estimator::Estimator;
use crate::fitted::Predictions;

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

impl Estimator {
    /// Estimates every property in windows of a photograph, `stride` pixels apart, from one pass
    /// through the encoder. A pixel of the photograph shows as much of a surface as one of the
    /// photographs that the model was fitted on, after it was brought to the model's own size.
    ///
    /// A window is estimated from what the encoder sees there within the whole photograph, which is not
    /// quite what it sees of a crop
    /// ([`Encoder::embed_windows`](sps_models::encoders::Encoder::embed_windows)). Neighbouring windows share
    /// pixels, and none is a new surface of its own: intervals and p-values hold for each alone.
    ///
    /// # Errors
    ///
    /// A model of several views, a photograph smaller than a window, a stride of 0.
    pub fn map(&self, photograph: &Frame, stride: usize) -> Result<Map> {
        if !self.fitted.steps().eq([1]) {
            let found = format!("one of {} views", self.about.angles.len());
            return Err(Error::input(
                "model",
                found,
                "one that looks at a single photograph",
            ));
        }
        let [height, width] = self.about.frame_size;
        let frames = sps_dataset::Extent { width, height };
        let extent = self.embedder.resize();
        let extent = extent.map_or(frames, |shorter| frames.with_shorter_side(shorter));
        let window = [extent.height, extent.width];
        let encoder = self.embedder.network().of_images()?;
        let size = [photograph.height, photograph.width];
        let windows = encoder.embed_windows(&photograph.data, size, window, stride)?;
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
}

//! An estimate at every place of a photograph.

use sps_dataset::{Extent, Frame};
use sps_models::encoders::Windows;

use crate::embedder::Network;
use crate::error::{Result, refuse};
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
    /// were calibrated on crops; the smaller the window, the less they hold. A network in an ONNX file
    /// looks at each alone all the same.
    #[default]
    Within,
    /// Each as a photograph of its own, in a pass of its own: what [`Estimator::predict`] says of the
    /// crop, but for the last digits of sums.
    Alone,
}

impl Estimator {
    /// Estimates every property in windows of a photograph, `stride` pixels apart. A pixel of it shows
    /// as much of a surface as one of the photographs that the model was fitted on, as they came: where
    /// the model brings those to a size of its own, the map's photograph shrinks or grows as they did.
    /// Neighbouring windows share pixels, and none is a new surface of its own: intervals and p-values
    /// hold for each alone.
    ///
    /// # Errors
    /// A model of several views, a photograph without its pixels or smaller than a window, a stride of
    /// 0, more windows than a gibibyte of embeddings holds.
    pub fn map(&self, photograph: &Frame, stride: usize, sight: Sight) -> Result<Map> {
        if !self.fitted.averages() {
            let found = format!("one of {} views", self.about.angles.len());
            let expected =
                "one that looks at a single photograph of a surface, which can be mapped";
            return refuse("model", found, expected);
        }
        let scale = self.scale();
        let shorter = photograph.width.min(photograph.height) as f64 * scale;
        let scaled = photograph.resized((shorter.round() as usize).max(1))?;
        let window = self.window();
        let size = [scaled.height, scaled.width];
        let stride = match stride {
            0 => 0,
            stride => ((stride as f64 * scale).round() as usize).max(1),
        };
        if size[0] < window[0] || size[1] < window[1] {
            let [height, width] = self.about.frame_size;
            let found = format!("{} x {} pixels", photograph.width, photograph.height);
            let expected = format!(
                "at least a window, {width} x {height} pixels as the photographs that the model was fitted on"
            );
            return refuse("a photograph to map", found, expected);
        }
        let windows = Windows::new(size, window, stride).map_err(sps_models::Error::from)?;
        let embeddings = match (sight, self.embedder.network()) {
            (Sight::Within, Network::Images(encoder)) => {
                let windows = encoder.embed_windows(&scaled.data, size, window, stride)?;
                windows.embeddings
            }
            _ => self.each_alone(&scaled, window, &windows)?,
        };
        let [rows, columns] = windows.counts();
        let embeddings = self.embedder().table(&embeddings, rows * columns, 1)?;
        let as_it_came = |[y, x]: [f64; 2]| {
            let down = photograph.height as f64 / scaled.height as f64;
            let right = photograph.width as f64 / scaled.width as f64;
            [y * down, x * right]
        };
        Ok(Map {
            rows,
            columns,
            window: self.about.frame_size,
            centres: windows.centres().into_iter().map(as_it_came).collect(),
            predictions: self.fitted.predict(&embeddings)?,
        })
    }

    /// The embeddings of windows, each encoded as a photograph of its own.
    fn each_alone(
        &self,
        photograph: &Frame,
        [height, width]: [usize; 2],
        windows: &Windows,
    ) -> Result<Vec<f32>> {
        const AT_ONCE: usize = 32;
        let crop = |&[top, left]: &[usize; 2]| {
            let row = |y: usize| &photograph.data[3 * (y * photograph.width + left)..][..3 * width];
            Frame {
                width,
                height,
                data: (top..top + height).flat_map(row).copied().collect(),
            }
        };
        let mut embeddings = Vec::new();
        let corners: Vec<[usize; 2]> = windows.corners().collect();
        for corners in corners.chunks(AT_ONCE) {
            let crops: Vec<Frame> = corners.iter().map(crop).collect();
            embeddings.extend(self.embedder.embed(&crops)?);
        }
        Ok(embeddings)
    }

    /// How far apart windows of a map lie where nothing else is asked for, in pixels: an eighth of the
    /// shorter side of one.
    pub fn stride(&self) -> usize {
        let [height, width] = self.about.frame_size;
        (height.min(width) / STEPS_PER_WINDOW).max(1)
    }

    /// How much smaller the encoder sees a photograph than it came.
    fn scale(&self) -> f64 {
        let [height, width] = self.about.frame_size;
        let own = self.embedder.resize();
        own.map_or(1.0, |own| own as f64 / height.min(width) as f64)
    }

    /// Height and width of the photographs that were fitted, as the encoder saw them.
    fn window(&self) -> [usize; 2] {
        let [height, width] = self.about.frame_size;
        let frames = Extent { width, height };
        let extent = self.embedder.resize();
        let extent = extent.map_or(frames, |shorter| frames.with_shorter_side(shorter));
        [extent.height, extent.width]
    }
}

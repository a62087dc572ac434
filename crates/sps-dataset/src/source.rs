use std::error::Error;
use std::ops::Deref;

use serde::{Deserialize, Serialize};
use sps_base::parallel;

use crate::{Description, Frame, LinearFrame, Property, TactileTable};

/// A physical surface: what was imaged and touched.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Surface {
    /// Its name, unique within a source.
    pub id: String,
    /// Its material label as the source writes it, for example `denim`.
    pub material: String,
    /// Surfaces of one group must not be split apart.
    pub group: String,
}

/// Whose surfaces these are, where that decides what a number may be compared with.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Origin {
    /// The published dataset of the paper.
    Paper,
    /// A simulator.
    Simulator,
}

/// A rotation about the roll axis in degrees; 0 looks straight down (nadir).
#[derive(Clone, Copy, Debug, PartialEq, PartialOrd, Serialize)]
pub struct RollAngle(
    /// Degrees.
    pub f64,
);

impl RollAngle {
    /// Straight down: the view that single-image experiments use (section 5).
    pub const NADIR: Self = Self(0.0);
}

/// Identifies the content of a frame: equal keys mean equal pixels.
pub type FrameKey = [u8; 32];

/// Names one frame of a source.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct FrameIndex {
    /// Index of the surface.
    pub surface: usize,
    /// Index of the view.
    pub view: usize,
}

/// Why a source cannot give a frame.
#[derive(Debug, thiserror::Error)]
#[error(transparent)]
pub struct SourceError(Box<dyn Error + Send + Sync>);

impl SourceError {
    /// What the source itself says.
    pub fn new(error: impl Into<Box<dyn Error + Send + Sync>>) -> Self {
        Self(error.into())
    }
}

impl Deref for SourceError {
    type Target = dyn Error + Send + Sync;

    fn deref(&self) -> &Self::Target {
        &*self.0
    }
}

/// Surfaces with an image sequence each and a tactile table: a dataset on disk or a simulator.
///
/// Nothing is decoded or rendered before [`Source::frame`] asks for it.
pub trait Source: Send + Sync {
    /// What the source is called in reports.
    fn name(&self) -> &str;

    /// Whether its surfaces are the paper's or simulated; most sources have their own.
    fn origin(&self) -> Option<Origin> {
        None
    }

    /// The surfaces, in the order that every index refers to.
    fn surfaces(&self) -> &[Surface];

    /// The roll angle of each view, the same for all surfaces.
    fn view_angles(&self) -> &[RollAngle];

    /// Every tactile reading of every surface.
    fn tactile(&self) -> &TactileTable;

    /// What it knows of a property: its name, its unit, and the range that every reading lies within.
    /// Unless a source says more, what the project knows of the code.
    fn describe(&self, property: &Property) -> Description {
        Description::known(property)
    }

    /// Decodes or renders one view of one surface.
    ///
    /// # Errors
    /// Where the frame is missing or damaged, or an index is out of range.
    fn frame(&self, surface: usize, view: usize) -> Result<Frame, SourceError>;

    /// One view for whoever will bring its shorter side to so many pixels ([`Frame::resized`]), if to
    /// any: of that size already, with the same pixels, where the source reads it so in less time and
    /// memory than whole. Most sources do not.
    ///
    /// # Errors
    /// As [`Source::frame`]; a size that [`Frame::resized`] refuses.
    fn frame_to_resize(
        &self,
        surface: usize,
        view: usize,
        _shorter_side: Option<usize>,
    ) -> Result<Frame, SourceError> {
        self.frame(surface, view)
    }

    /// A key that changes whenever the pixels of [`Source::frame`] would change; cheaper than the
    /// frame itself.
    ///
    /// # Errors
    /// As [`Source::frame`].
    fn frame_key(&self, surface: usize, view: usize) -> Result<FrameKey, SourceError>;

    /// The light behind [`Source::frame`], before it was clipped and encoded for a display, where
    /// the source knows it: what a file of linear light should hold. Most sources do not.
    ///
    /// # Errors
    /// As [`Source::frame`].
    fn linear_frame(
        &self,
        _surface: usize,
        _view: usize,
    ) -> Result<Option<LinearFrame>, SourceError> {
        Ok(None)
    }

    /// The view nearest to an angle; see [`nearest_view`].
    fn nearest_view(&self, angle: RollAngle) -> Option<usize> {
        nearest_view(self.view_angles(), angle)
    }
}

/// Angles closer than this, in degrees, are equally near: far below any mechanism's error, far
/// above that of their computation.
const SAME_ANGLE: f64 = 1e-9;

/// The index of the angle nearest to the one asked for, the lower where two are equally near.
///
/// `None` where there is no view, or no distance to it.
///
/// ```
/// use sps_dataset::{RollAngle, ViewAngles, nearest_view};
///
/// let views = ViewAngles::evenly_spaced(-45.0, 45.0, 100)?;
/// assert_eq!(nearest_view(views.as_slice(), RollAngle::NADIR), Some(49));
/// # Ok::<(), sps_dataset::InvalidValue>(())
/// ```
pub fn nearest_view(views: &[RollAngle], angle: RollAngle) -> Option<usize> {
    let distance = |view: &RollAngle| (view.0 - angle.0).abs();
    let least = views.iter().map(distance).fold(f64::INFINITY, f64::min);
    let nearest = |view| distance(view) <= least + SAME_ANGLE && least.is_finite();
    views.iter().position(nearest)
}

/// Decodes or renders the given frames in parallel; the result is in the order asked for, whatever
/// the number of threads.
///
/// ```
/// use sps_dataset::{DatasetFolder, FrameIndex, ReadSettings, Source, SplitPlan, decode_frames};
///
/// # let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/../../fixtures/tiny-dataset").as_ref();
/// let dataset = DatasetFolder::open(folder, &ReadSettings::default())?;
/// let split = SplitPlan::default().splits(dataset.surfaces(), 1, 0)?.remove(0);
/// let first_views = split.validation.iter().map(|&surface| FrameIndex { surface, view: 0 });
/// let frames = decode_frames(&dataset, &first_views.collect::<Vec<_>>())?;
/// assert_eq!(frames.len(), split.validation.len());
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
///
/// # Errors
/// That of the first frame, in the order asked for, that failed.
pub fn decode_frames(
    source: &dyn Source,
    frames: &[FrameIndex],
) -> Result<Vec<Frame>, SourceError> {
    let decoded = parallel::map(frames, |index| source.frame(index.surface, index.view));
    decoded.into_iter().collect()
}

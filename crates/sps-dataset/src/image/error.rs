use std::fmt;
use std::io;
use std::path::{Path, PathBuf};

/// A frame that cannot be had: which file, and why.
#[derive(Debug, thiserror::Error)]
#[error("{}: {kind}", path.display())]
pub struct FrameError {
    path: PathBuf,
    kind: FrameErrorKind,
}

/// Why a frame cannot be had.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum FrameErrorKind {
    /// The file cannot be opened or read.
    #[error("cannot be read: {0}")]
    Io(io::Error),
    /// No file for that view.
    #[error("has no frame for view {view}: looked for {tried}")]
    Missing {
        /// The view.
        view: usize,
        /// The file names looked for.
        tried: String,
    },
    /// Two files for one view.
    #[error("has two frames for view {view}: `{first}` and `{second}`")]
    Ambiguous {
        /// The view.
        view: usize,
        /// One file name.
        first: String,
        /// The other.
        second: String,
    },
    /// A surface or view that the dataset does not have.
    #[error("there is no {what} {index}: the dataset has {count}, counted from 0")]
    NoSuchIndex {
        /// `surface` or `view`.
        what: &'static str,
        /// The index asked for.
        index: usize,
        /// How many there are.
        count: usize,
    },
    /// The file is larger than [`Limits::file_bytes`](crate::Limits::file_bytes).
    #[error("has {bytes} bytes, more than the limit `file-bytes` = {limit}")]
    FileTooLarge {
        /// Its size.
        bytes: u64,
        /// The largest size allowed.
        limit: u64,
    },
    /// The image is larger than [`Limits::pixels`](crate::Limits::pixels).
    #[error("says it has {width} x {height} pixels, more than the limit `pixels` = {limit}")]
    TooManyPixels {
        /// Its width, as its header has it.
        width: u64,
        /// Its height, as its header has it.
        height: u64,
        /// The most pixels allowed.
        limit: u64,
    },
    /// A frame to be resized without three values for each of its pixels, or without pixels.
    #[error("has {values} values for {width} x {height} pixels, expected three for each")]
    NotItsPixels {
        /// Its columns.
        width: usize,
        /// Its rows.
        height: usize,
        /// How many values it has.
        values: usize,
    },
    /// A size beyond what [`Limits::pixels`](crate::Limits::pixels) are by default.
    #[error(
        "would have {width} x {height} pixels with a shorter side of {shorter_side}, more than the \
         limit of {limit}"
    )]
    ResizedTooLarge {
        /// The shorter side asked for.
        shorter_side: usize,
        /// Its columns then.
        width: usize,
        /// Its rows then.
        height: usize,
        /// The most pixels allowed.
        limit: u64,
    },
    /// The first bytes are of no known format.
    #[error("begins with {found}, which is no PNG, JPEG or EXR")]
    UnknownFormat {
        /// The first bytes.
        found: String,
    },
    /// The file is cut off or its content contradicts itself.
    #[error("is not a whole {format} image: {reason}")]
    Damaged {
        /// The format.
        format: ImageFormat,
        /// What is wrong.
        reason: String,
    },
    /// The file may be sound, but uses something that is not read.
    #[error("uses a feature of {format} that is not read: {reason}")]
    Unsupported {
        /// The format.
        format: ImageFormat,
        /// What it uses.
        reason: String,
    },
    /// An EXR without the channels of a picture.
    #[error("has the channels {found}; expected {expected}")]
    MissingChannels {
        /// The channels it has.
        found: String,
        /// Those that are needed.
        expected: String,
    },
    /// An EXR with samples that are no light, under
    /// [`NonFinite::Reject`](crate::NonFinite::Reject).
    #[error("has {nan} NaN and {infinite} infinite samples, and the policy is to reject them")]
    NonFinite {
        /// NaN samples.
        nan: usize,
        /// Infinite samples.
        infinite: usize,
    },
}

/// The image formats that frames are read from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ImageFormat {
    /// Portable Network Graphics.
    Png,
    /// Baseline or progressive JPEG.
    Jpeg,
    /// OpenEXR.
    Exr,
}

impl fmt::Display for ImageFormat {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(match self {
            Self::Png => "PNG",
            Self::Jpeg => "JPEG",
            Self::Exr => "EXR",
        })
    }
}

impl FrameError {
    pub(crate) fn new(path: &Path, kind: FrameErrorKind) -> Self {
        Self {
            path: path.to_owned(),
            kind,
        }
    }

    /// The file, or the folder that should have had it.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Why.
    pub fn kind(&self) -> &FrameErrorKind {
        &self.kind
    }
}

impl FrameErrorKind {
    pub(crate) fn damaged(format: ImageFormat, reason: impl fmt::Display) -> Self {
        Self::Damaged {
            format,
            reason: reason.to_string(),
        }
    }

    pub(crate) fn unsupported(format: ImageFormat, reason: impl fmt::Display) -> Self {
        Self::Unsupported {
            format,
            reason: reason.to_string(),
        }
    }
}

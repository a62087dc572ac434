use std::{fmt, io};

use crate::FileError;

/// A frame that cannot be had: which file, and why.
pub type FrameError = FileError<FrameErrorKind>;

/// Why a frame cannot be had.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum FrameErrorKind {
    /// The file cannot be opened or read.
    #[error("cannot be read: {0}")]
    Io(#[from] io::Error),
    /// No file for that view, or two; or the dataset has no such surface or view.
    #[error("{0}")]
    NoFrame(String),
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
    /// The file is cut off or its content contradicts itself.
    #[error("{0}")]
    Damaged(String),
    /// The file may be sound, but uses something that is not read.
    #[error("{0}")]
    Unsupported(String),
    /// No frame can be made of what is there: an unknown format, channels that make no picture,
    /// samples that are no light under [`NonFinite::Reject`](crate::NonFinite::Reject), or a frame to
    /// be resized without three values for each of its pixels.
    #[error("{0}")]
    Invalid(String),
}

/// The image formats that frames are read from.
#[derive(Clone, Copy)]
pub(super) enum ImageFormat {
    Png,
    Jpeg,
    Exr,
}

impl fmt::Display for ImageFormat {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Png => "PNG",
            Self::Jpeg => "JPEG",
            Self::Exr => "EXR",
        })
    }
}

impl FrameErrorKind {
    pub(super) fn damaged(format: ImageFormat, reason: impl fmt::Display) -> Self {
        Self::Damaged(format!("is not a whole {format} image: {reason}"))
    }

    pub(super) fn unsupported(format: ImageFormat, reason: impl fmt::Display) -> Self {
        Self::Unsupported(format!(
            "uses a feature of {format} that is not read: {reason}"
        ))
    }
}

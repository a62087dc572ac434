//! Photographs of surfaces from one or many angles and what was measured on them: as in "Teaching
//! Cameras to Feel" (Purri and Dana, ECCV 2020), image sequences of a gonioreflectometer and tables of
//! the SynTouch Toccare, or any other properties that somebody measured.
//!
//! Take this crate to read such a dataset from a folder, frame by frame as frames are asked for, to
//! bring tactile tables of several forms into one, to split surfaces and label their materials, or
//! to write a dataset. What reads the same from a folder and from a simulator (the crate
//! `sps-simulate`) is a [`Source`].
//!
//! ```
//! use sps_dataset::{
//!     DatasetFolder, FrameIndex, ReadSettings, RollAngle, Source, SplitPlan, TactileSettings,
//!     decode_frames,
//! };
//!
//! # let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/../../fixtures/tiny-dataset").as_ref();
//! let dataset = DatasetFolder::open(folder, &ReadSettings::default())?;
//!
//! // The view that looks straight down, of every surface that is kept aside.
//! let nadir = dataset.nearest_view(RollAngle::NADIR).ok_or("no view")?;
//! let split = SplitPlan::default().splits(dataset.surfaces(), 1, 0)?.remove(0);
//! let wanted: Vec<_> =
//!     split.validation.iter().map(|&surface| FrameIndex { surface, view: nadir }).collect();
//! let frames = decode_frames(&dataset, &wanted)?;
//!
//! // What was felt on them.
//! let averages = dataset.tactile().averages(&TactileSettings::default(), dataset.surfaces().len());
//! for (index, frame) in wanted.iter().zip(&frames) {
//!     let friction = averages.value(index.surface, "fRS");
//!     println!("{} x {}: {friction:?}", frame.width, frame.height);
//! }
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! # What is where
//!
//! - **Datasets.** [`DatasetFolder`] opens a folder as [`ReadSettings`] say; [`Manifest`] is its
//!   `dataset.toml`. [`DatasetFolder::inspect`] summarises it, [`DatasetFolder::inspect_frames`]
//!   finds broken frames, and [`write_dataset`] writes any [`Source`] as one.
//! - **Frames.** A [`Frame`] comes from a PNG, JPEG or EXR by [`decode_image`] or [`read_image`],
//!   as [`DecodeSettings`] say; many come in parallel by [`decode_frames`] or [`map_frames`].
//!   [`read_image_resized`] and [`decode_image_resized`] bring a large photograph to a size as they
//!   read it, [`Frame::resized`] does so with a frame. A [`LinearFrame`] is the light behind one,
//!   where a source knows it.
//! - **Touches.** A [`TactileTable`] has every [`Reading`]; [`TactileTable::averages`] makes one
//!   value per surface and [`Property`] of them. [`TableFormat`] says how a file is laid out,
//!   [`TactileSettings`] what is made of its values, [`Description`] what a property is called, its unit
//!   and where it ends. The codes of the Toccare are in [`toccare`].
//! - **Surfaces.** [`SplitPlan`] divides them, [`MaterialLabels`] labels them.
//! - **Configs.** Every settings type reads from TOML with serde, denies unknown keys and has
//!   kebab-case names; [`parse_toml`] makes errors that name the line and the nearest valid key.
//!
//! Results do not depend on the number of threads, random ones are fixed by a seed, and no input
//! makes a function panic. The format on disk is in `docs/dataset-format.md` of the repository.
//!
//! # Features
//!
//! `exr` (default) reads and writes OpenEXR frames; `npz` reads tactile tables from NumPy archives.

mod error;
mod files;
mod folder;
mod frame;
mod image;
mod inspect;
mod intraclass;
mod material;
mod pattern;
mod property;
mod resample;
mod settings;
mod source;
mod split;
mod stream;
mod table;
mod tactile;
mod toml_text;
mod units;

pub use error::{DatasetError, DatasetErrorKind, Place};
pub use folder::{
    DatasetFolder, InvalidAngles, InvalidSurfaceId, Manifest, NearTwins, ViewAngles, WriteError,
    WriteErrorKind, WriteOptions, Written, check_surface_id, write_dataset,
};
pub use frame::{Extent, Frame, LinearFrame};
pub use image::{
    DecodeSettings, Decoded, EncodeError, FrameError, FrameErrorKind, FrameFormat, ImageFormat,
    LightCounts, Limits, NonFinite, PHOTOGRAPH_ENDINGS, decode_image, decode_image_resized,
    photograph_ending, read_image, read_image_resized,
};
pub use inspect::{BrokenFrame, FrameSummary, Inspection, PropertySummary};
pub use material::{FEWEST_PER_MATERIAL, MaterialLabels, OTHER};
pub use property::{
    Description, InvalidCode, InvalidOrder, InvalidRange, Property, PropertyOrder, PropertyRange,
    toccare,
};
pub use settings::ReadSettings;
pub use source::{
    FrameIndex, FrameKey, Origin, RollAngle, Source, SourceError, Surface, decode_frames,
    map_frames, nearest_view,
};
pub use split::{KFold, RandomSplit, Split, SplitError, SplitPlan};
pub use sps_base::names::UnknownName;
pub use table::{
    Header, Json, JsonLayout, LongCsv, Npz, NpzLayout, Stacked, Statistics, TableFormat, WideCsv,
    read_npy,
};
pub use tactile::{
    Average, Cell, OutOfRange, RangePolicy, Reading, SurfaceAverages, TactileSettings, TactileTable,
};
pub use toml_text::parse_toml;
pub use units::{Unit, Units};

/// Runs the examples of the README as tests.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;

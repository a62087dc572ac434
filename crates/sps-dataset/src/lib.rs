#![doc = include_str!("../README.md")]

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

pub use error::{DatasetError, DatasetErrorKind, FileError, InvalidValue};
pub use folder::{
    DatasetFolder, InvalidSurfaceId, Manifest, NearTwins, ViewAngles, WriteError, WriteErrorKind,
    WriteOptions, Written, check_surface_id, write_dataset,
};
pub use frame::{Extent, Frame, LinearFrame};
pub use image::{
    DecodeSettings, Decoded, EncodeError, FrameError, FrameErrorKind, FrameFormat, LightCounts,
    Limits, NonFinite, PHOTOGRAPH_ENDINGS, decode_image, decode_image_resized, photograph_ending,
    read_image, read_image_resized,
};
pub use inspect::{BrokenFrame, FrameSummary, Inspection, PropertySummary};
pub use material::{FEWEST_PER_MATERIAL, MaterialLabels, OTHER};
pub use property::{Description, InvalidCode, Property, PropertyOrder, PropertyRange, toccare};
pub use settings::ReadSettings;
pub use source::{
    FrameIndex, FrameKey, Origin, RollAngle, Source, SourceError, Surface, decode_frames,
    nearest_view,
};
pub use split::{KFold, RandomSplit, Split, SplitError, SplitPlan};
pub use table::{
    Header, Json, JsonLayout, LongCsv, Npz, NpzLayout, Stacked, Statistics, TableFormat, WideCsv,
    read_npy,
};
pub use tactile::{
    Average, Cell, OutOfRange, RangePolicy, Reading, SurfaceAverages, TactileSettings, TactileTable,
};
pub use toml_text::parse_toml;
pub use units::{Unit, Units};

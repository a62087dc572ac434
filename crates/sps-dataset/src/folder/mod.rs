//! A dataset in a folder.

mod angles;
mod manifest;
mod surfaces;
mod tables;
mod twins;
mod write;

use std::path::{Path, PathBuf};

use crate::error::Fault;
use crate::files::{read_file, text};
use crate::image::{PHOTOGRAPH_ENDINGS, read_frame_file};
use crate::table::read_table;
use crate::{
    DatasetError, DecodeSettings, Decoded, Description, Frame, FrameError, FrameErrorKind,
    FrameKey, Origin, OutOfRange, Property, ReadSettings, RollAngle, Source, SourceError, Surface,
    TactileTable, read_image, read_image_resized,
};

pub use angles::ViewAngles;
pub use manifest::Manifest;
pub use surfaces::{InvalidSurfaceId, check_surface_id};
use surfaces::{check_table, read_surfaces};
pub use twins::NearTwins;
pub use write::{WriteError, WriteErrorKind, WriteOptions, Written, write_dataset};

/// A change of how files become frames must change every frame's key.
const FRAME_KEY_CONTEXT: &str = "sps-dataset 0.1 frame key";

/// A dataset on disk: `dataset.toml`, `surfaces.csv`, a tactile table and one file per frame.
///
/// Opening it reads all but the frames, which are read one by one when they are asked for.
/// `docs/dataset-format.md` has the format.
#[derive(Clone, Debug)]
pub struct DatasetFolder {
    folder: PathBuf,
    manifest: Manifest,
    surfaces: Vec<Surface>,
    tactile: TactileTable,
    out_of_range: Vec<(Property, OutOfRange)>,
    images: DecodeSettings,
    image_key: blake3::Hash,
}

impl DatasetFolder {
    /// Opens the dataset in `folder`.
    ///
    /// # Errors
    /// Where the folder is no dataset, or `dataset.toml`, `surfaces.csv` or the tactile table
    /// breaks its format, speaks of a surface or property that does not exist, or has a value that
    /// `settings` reject or that lies outside of its declared range; where the table would be outside the folder.
    pub fn open(folder: &Path, settings: &ReadSettings) -> Result<Self, DatasetError> {
        let limit = settings.table_bytes;
        let path = folder.join("dataset.toml");
        let in_folder = |fault: Fault| fault.of_file(folder);
        let lacks = |what| Err(in_folder(Fault::invalid(format!("not a dataset: {what}"))));
        if !folder.is_dir() {
            return lacks("there is no such folder");
        }
        if !path.exists() {
            return lacks("it has no `dataset.toml`");
        }
        let text = read_file(&path, limit, |bytes| Ok(text("TOML", bytes)?.to_owned()))?;
        let manifest = Manifest::parse(&path, &text)?;
        let surfaces = read_file(&folder.join("surfaces.csv"), limit, read_surfaces)?;
        let format = settings.table.as_ref().unwrap_or(&manifest.tactile);
        check_table(format.file()).map_err(in_folder)?;
        let table = |bytes: &[u8]| read_table(bytes, format, &surfaces, &manifest, settings);
        let read = read_file(&folder.join(format.file()), limit, table)?;
        let images = settings.images.clone();
        Ok(Self {
            folder: folder.to_owned(),
            manifest,
            surfaces,
            tactile: read.table,
            out_of_range: read.out_of_range,
            image_key: blake3::hash(&images.key()),
            images,
        })
    }

    /// The folder.
    pub fn folder(&self) -> &Path {
        &self.folder
    }

    /// What `dataset.toml` says.
    pub fn manifest(&self) -> &Manifest {
        &self.manifest
    }

    /// How many values of each property lay outside of its range, before any were clamped.
    pub fn out_of_range(&self) -> &[(Property, OutOfRange)] {
        &self.out_of_range
    }

    /// The file of a frame.
    ///
    /// # Errors
    /// Where an index is out of range, or there is no file or more than one for that view.
    pub fn frame_path(&self, surface: usize, view: usize) -> Result<PathBuf, FrameError> {
        let no_frame = |folder: &Path, why| FrameError::new(folder, FrameErrorKind::NoFrame(why));
        let no_such = |what, index, count| {
            let why =
                format!("there is no {what} {index}: the dataset has {count}, counted from 0");
            no_frame(&self.folder, why)
        };
        let (surfaces, views) = (self.surfaces.len(), self.view_angles().len());
        let found = self.surfaces.get(surface);
        let found = found.ok_or_else(|| no_such("surface", surface, surfaces))?;
        if view >= views {
            return Err(no_such("view", view, views));
        }
        let folder = self.folder.join("frames").join(&found.id);
        let names = PHOTOGRAPH_ENDINGS.map(|extension| format!("{view:03}.{extension}"));
        let mut files = names.iter().filter(|name| folder.join(name).is_file());
        let why = match (files.next(), files.next()) {
            (Some(file), None) => return Ok(folder.join(file)),
            (Some(first), Some(second)) => {
                format!("has two frames for view {view}: `{first}` and `{second}`")
            }
            (None, _) => {
                let tried = names.join(", ");
                format!("has no frame for view {view}: looked for {tried}")
            }
        };
        Err(no_frame(&folder, why))
    }

    /// Decodes one frame and says what had to be done to its light.
    ///
    /// # Errors
    /// As [`Source::frame`].
    pub fn decode(&self, surface: usize, view: usize) -> Result<Decoded, FrameError> {
        let path = self.frame_path(surface, view)?;
        read_image(&path, &self.images)
    }
}

impl Source for DatasetFolder {
    fn name(&self) -> &str {
        &self.manifest.name
    }

    fn origin(&self) -> Option<Origin> {
        self.manifest.origin
    }

    fn surfaces(&self) -> &[Surface] {
        &self.surfaces
    }

    fn view_angles(&self) -> &[RollAngle] {
        self.manifest.view_angles_deg.as_slice()
    }

    fn tactile(&self) -> &TactileTable {
        &self.tactile
    }

    fn describe(&self, property: &Property) -> Description {
        self.manifest.describe(property)
    }

    fn frame(&self, surface: usize, view: usize) -> Result<Frame, SourceError> {
        self.frame_to_resize(surface, view, None)
    }

    fn frame_to_resize(
        &self,
        surface: usize,
        view: usize,
        shorter_side: Option<usize>,
    ) -> Result<Frame, SourceError> {
        let path = self.frame_path(surface, view);
        let decoded = path.and_then(|path| read_image_resized(&path, &self.images, shorter_side));
        Ok(decoded.map_err(SourceError::new)?.frame)
    }

    /// BLAKE3 of the file's bytes and of every setting that changes pixels.
    fn frame_key(&self, surface: usize, view: usize) -> Result<FrameKey, SourceError> {
        let path = self.frame_path(surface, view).map_err(SourceError::new)?;
        let bytes = read_frame_file(&path, &self.images)
            .map_err(|kind| SourceError::new(FrameError::new(&path, kind)))?;
        let mut hasher = blake3::Hasher::new_derive_key(FRAME_KEY_CONTEXT);
        hasher.update(self.image_key.as_bytes());
        hasher.update(&bytes);
        Ok(hasher.finalize().into())
    }
}

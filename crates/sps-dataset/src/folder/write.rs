use std::collections::BTreeMap;
use std::fs::{self, File, TryLockError};
use std::io::{self, Read, Seek, Write};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Duration;

use rayon::prelude::*;
use sps_base::files::{remove_unfinished, write_file, write_folder, write_new};

use super::surfaces::{check_surface_id, read_surfaces};
use super::tables::{surfaces_csv, tactile_csv};
use crate::error::Fault;
use crate::table::read_table;
use crate::{
    Description, FileError, FrameFormat, Manifest, PropertyOrder, ReadSettings, Source,
    SourceError, Surface, TableFormat, ViewAngles,
};

/// Holds what is being written, and is locked while it is.
const PLAN: &str = ".write-plan";

/// What a dataset that is written says about itself.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct WriteOptions {
    /// What each frame's file is.
    pub format: FrameFormat,
    /// For `dataset.toml`: one line about the dataset.
    pub description: String,
    /// For `dataset.toml`: where it comes from and under which licence.
    pub source: String,
}

/// What was done.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Written {
    /// Surfaces whose frames were written.
    pub written: usize,
    /// Surfaces that an earlier run had finished.
    pub already_there: usize,
}

/// A dataset that cannot be written: at which path, and why.
pub type WriteError = FileError<WriteErrorKind>;

/// Why a dataset cannot be written.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum WriteErrorKind {
    /// No space is left. What was finished stays; the same call goes on from there.
    #[error("no space is left to write it; the surfaces finished so far stay")]
    StorageFull(io::Error),
    /// The file or folder cannot be written.
    #[error("cannot be written: {0}")]
    Io(io::Error),
    /// Another process is writing there.
    #[error("another process is writing a dataset there")]
    InUse,
    /// The folder has something else than an unfinished run of the same dataset.
    #[error("holds {0}; choose an empty folder")]
    Occupied(&'static str),
    /// The source has something that the format cannot hold.
    #[error("{0}")]
    Unsuitable(String),
    /// The source could not give a frame, or gave one that cannot be encoded.
    #[error("view {view} of surface `{surface}` cannot be had: {error}")]
    Frame {
        /// The surface.
        surface: String,
        /// The view.
        view: usize,
        /// What the source says, or why the frame cannot be encoded.
        error: SourceError,
    },
}

impl From<io::Error> for WriteErrorKind {
    fn from(error: io::Error) -> Self {
        match error.kind() {
            io::ErrorKind::StorageFull | io::ErrorKind::QuotaExceeded => Self::StorageFull(error),
            _ => Self::Io(error),
        }
    }
}

/// Writes any source as a dataset in `folder`, in parallel; `progress` is called with the surfaces
/// done and their total after each.
///
/// EXR takes the light of [`Source::linear_frame`] where there is one, and else the inverse of sRGB.
/// The frames of a surface take their name together, once all of them are on disk, and
/// `dataset.toml` comes last, so nothing that is half there can be taken for whole. Called again
/// with the same source and options after it was stopped, it leaves finished surfaces alone. A
/// hidden file `.write-plan` keeps two processes, or two different datasets, out of one folder.
///
/// # Errors
/// Where the source fails; where it has no view, or what could not be read again, such as a surface
/// whose id is no file name, a touch that is listed twice or a reading outside of the range of
/// [`Source::describe`]; where the folder has another dataset, is being written to, or cannot be;
/// and where no space is left.
pub fn write_dataset(
    source: &dyn Source,
    folder: &Path,
    options: &WriteOptions,
    progress: impl Fn(usize, usize) + Sync,
) -> Result<Written, WriteError> {
    let writer = Writer {
        source,
        folder,
        options,
    };
    let files = writer.files()?;
    let _claim = writer.claim(&files)?;
    let (done, skipped) = (AtomicUsize::new(0), AtomicUsize::new(0));
    let total = source.surfaces().len();
    (0..total).into_par_iter().try_for_each(|surface| {
        if writer.is_complete(surface) {
            skipped.fetch_add(1, Ordering::Relaxed);
        } else {
            writer.surface(surface)?;
        }
        progress(done.fetch_add(1, Ordering::Relaxed) + 1, total);
        Ok(())
    })?;
    for (name, content) in &files {
        let path = folder.join(name);
        write_file(&path, content).map_err(|error| WriteError::new(&path, error.into()))?;
    }
    let already_there = skipped.into_inner();
    Ok(Written {
        written: total - already_there,
        already_there,
    })
}

/// A file that is locked as long as a process writes into its folder.
struct Claim(File);

impl Drop for Claim {
    /// Closing the file would not always do: a child that another thread is just starting has it as
    /// well until it becomes its own program, and holds the lock with it.
    fn drop(&mut self) {
        let _ = self.0.unlock();
    }
}

/// Names and contents of files, in the order of writing.
type Files = [(&'static str, Vec<u8>); 3];

struct Writer<'a> {
    source: &'a dyn Source,
    folder: &'a Path,
    options: &'a WriteOptions,
}

impl Writer<'_> {
    /// Everything but the frames.
    fn files(&self) -> Result<Files, WriteError> {
        let manifest = self.manifest()?;
        let error = |error: io::Error| WriteError::new(self.folder, error.into());
        let text = toml::to_string(&manifest).map_err(|e| error(io::Error::other(e)))?;
        let surfaces = surfaces_csv(self.source.surfaces()).map_err(error)?;
        let tactile = tactile_csv(self.source).map_err(error)?;

        // What could not be read again is not written.
        let refused = |file: &str, fault: Fault| {
            let refused = fault.of_file(file.as_ref());
            self.unsuitable(refused.to_string())
        };
        let read = read_surfaces(&surfaces).map_err(|fault| refused("surfaces.csv", fault))?;
        self.check_ids(&read)?;
        let (format, settings) = (&manifest.tactile, ReadSettings::default());
        let table = read_table(&tactile, format, &read, &manifest, &settings);
        table.map_err(|fault| refused("tactile.csv", fault))?;
        self.check_numbers()?;
        Ok([
            ("surfaces.csv", surfaces),
            ("tactile.csv", tactile),
            ("dataset.toml", text.into_bytes()),
        ])
    }

    /// A reader takes NaN for what was not measured.
    fn check_numbers(&self) -> Result<(), WriteError> {
        let table = self.source.tactile();
        for reading in &table.readings {
            for (property, value) in table.properties.iter().zip(&reading.values) {
                if value.is_some_and(f64::is_nan) {
                    let surface = self.source.surfaces().get(reading.surface);
                    let id = surface.map_or("", |surface| &surface.id);
                    let found = format!("a reading: found {property} of `{id}` at NaN");
                    return Err(self.unsuitable(format!("{found}, expected a number, or none")));
                }
            }
        }
        Ok(())
    }

    /// A reader trims white space, line ends too, and skips a line without text; the folders of the
    /// frames have the ids as they are.
    fn check_ids(&self, read: &[Surface]) -> Result<(), WriteError> {
        for (at, surface) in self.source.surfaces().iter().enumerate() {
            if read.get(at).is_none_or(|read| read.id != surface.id) {
                let found = surface.id.escape_debug();
                let trimmed = "a name that neither begins nor ends with white space";
                let refused = check_surface_id(&surface.id).err();
                let expected = refused.map_or(trimmed, |refused| refused.expected);
                let text = format!("a surface's id: found `{found}`, expected {expected}");
                return Err(self.unsuitable(text));
            }
        }
        Ok(())
    }

    fn unsuitable(&self, text: String) -> WriteError {
        WriteError::new(self.folder, WriteErrorKind::Unsuitable(text))
    }

    fn manifest(&self) -> Result<Manifest, WriteError> {
        let angles = self.source.view_angles().iter();
        let view_angles_deg = ViewAngles::list(angles.map(|angle| angle.0).collect())
            .map_err(|error| self.unsuitable(format!("the views: {error}")))?;
        let properties = PropertyOrder::try_from(self.source.tactile().properties.clone())
            .map_err(|error| self.unsuitable(format!("the properties: {error}")))?;
        // What is known of a code anyway is not written.
        let described = properties.iter().filter_map(|property| {
            let mut described = self.source.describe(property);
            if described.name == Description::known(property).name {
                described.name.clear();
            }
            (described != Description::default()).then(|| (property.clone(), described))
        });
        let described = described.collect();
        let manifest = Manifest {
            name: self.source.name().to_owned(),
            description: self.options.description.clone(),
            source: self.options.source.clone(),
            origin: self.source.origin(),
            properties,
            view_angles_deg,
            ranges: BTreeMap::new(),
            tactile: TableFormat::default(),
            property: described,
        };
        manifest.check().map_err(|text| self.unsuitable(text))?;
        Ok(manifest)
    }

    /// Makes the folder this dataset's own, or finds that it is.
    fn claim(&self, files: &Files) -> Result<Claim, WriteError> {
        let frames = self.folder.join("frames");
        let path = self.folder.join(PLAN);
        let error = |error: io::Error| WriteError::new(&path, error.into());
        let occupied = |by| Err(WriteError::new(self.folder, WriteErrorKind::Occupied(by)));
        let dataset = frames.exists() || self.folder.join("dataset.toml").exists();
        if dataset && !path.exists() {
            return occupied("a dataset that was not written by this program");
        }
        fs::create_dir_all(&frames).map_err(error)?;
        let mut options = File::options();
        let options = options.read(true).write(true).create(true).truncate(false);
        let file = options.open(&path).map_err(error)?;
        file.try_lock().map_err(|refused| match refused {
            TryLockError::WouldBlock => WriteError::new(self.folder, WriteErrorKind::InUse),
            TryLockError::Error(refused) => error(refused),
        })?;
        let mut claim = Claim(file);
        for folder in [self.folder, &frames] {
            let removed = remove_unfinished(folder, Duration::ZERO);
            removed.map_err(|left| WriteError::new(folder, left.into()))?;
        }
        let plan = self.plan(files)?;
        let mut found = Vec::new();
        let file = &mut claim.0;
        file.read_to_end(&mut found).map_err(error)?;
        if found == plan.as_bytes() {
            return Ok(claim);
        }
        // A program that was stopped may have left only the beginning.
        if !plan.as_bytes().starts_with(&found) {
            return occupied("another dataset, or the same of another version or settings");
        }
        let written = file.rewind().and_then(|()| file.write_all(plan.as_bytes()));
        written.and_then(|()| file.sync_all()).map_err(error)?;
        Ok(claim)
    }

    /// Differs whenever anything that is to be written does.
    fn plan(&self, files: &Files) -> Result<String, WriteError> {
        let key = self.source.frame_key(0, 0);
        let key = key.map_err(|error| self.no_frame(0, 0, error))?;
        let mut hasher = blake3::Hasher::new_derive_key("sps-dataset 0.1 write plan 2");
        hasher.update(&key);
        hasher.update(self.options.format.extension().as_bytes());
        for (_, content) in files {
            hasher.update(content);
        }
        Ok(format!("{}\n", hasher.finalize()))
    }

    fn surface_folder(&self, surface: usize) -> PathBuf {
        let id = &self.source.surfaces()[surface].id;
        self.folder.join("frames").join(id)
    }

    fn frame_name(&self, view: usize) -> String {
        format!("{view:03}.{}", self.options.format.extension())
    }

    fn is_complete(&self, surface: usize) -> bool {
        let folder = self.surface_folder(surface);
        let mut views = 0..self.source.view_angles().len();
        views.all(|view| folder.join(self.frame_name(view)).is_file())
    }

    /// Writes every frame of a surface, or none.
    fn surface(&self, surface: usize) -> Result<(), WriteError> {
        let folder = self.surface_folder(surface);
        let views = self.source.view_angles().len();
        let write = |partial: &Path| {
            (0..views).into_par_iter().try_for_each(|view| {
                let path = partial.join(self.frame_name(view));
                let bytes = self.encoded(surface, view);
                let bytes = bytes.map_err(|error| self.no_frame(surface, view, error))?;
                write_new(&path, &bytes).map_err(|error| WriteError::new(&path, error.into()))
            })
        };
        write_folder(&folder, write, |error| {
            WriteError::new(&folder, error.into())
        })
    }

    /// The frame as its format holds it best: as linear light where both know of that.
    fn encoded(&self, surface: usize, view: usize) -> Result<Vec<u8>, SourceError> {
        let format = self.options.format;
        let encoded = if format != FrameFormat::Png
            && let Some(light) = self.source.linear_frame(surface, view)?
        {
            format.encode_linear(&light)
        } else {
            format.encode(&self.source.frame(surface, view)?)
        };
        encoded.map_err(SourceError::new)
    }

    fn no_frame(&self, surface: usize, view: usize, error: SourceError) -> WriteError {
        let kind = WriteErrorKind::Frame {
            surface: self.source.surfaces()[surface].id.clone(),
            view,
            error,
        };
        WriteError::new(self.folder, kind)
    }
}

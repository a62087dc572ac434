//! Photographs of surfaces with what was measured on them.

use std::ffi::OsStr;
use std::path::{Path, PathBuf};

use anyhow::{Result, ensure};
use numpy::{AllowTypeChange, PyArray1, PyArray2, PyArrayLikeDyn, PyArrayMethods};
use pyo3::prelude::*;
use sps::importing::{Frames, Import, Listed, Options, Request};
use sps_dataset::{
    DatasetFolder, FrameFormat, Property, ReadSettings, Source, Surface, TactileSettings,
};
use sps_experiment::data;
use sps_simulate::SimulatorSpec;
use tempfile::TempDir;

use crate::errors::Raises;
use crate::estimator::{Surfaces, Values, numbered, scratch};
use crate::work::watched;

/// Photographs of surfaces with what was measured on them: a folder in the format of
/// docs/dataset-format.md.
///
/// `Dataset(folder)` opens one. `Dataset(photographs, "values.csv")` takes the folder and the table that
/// `sps fit` takes. `Dataset(photographs, values)` takes an item for each surface, a photograph or a list
/// of equally many, and values (n,) or (n, properties), NaN where nothing was measured; `properties` names
/// the columns, `groups` says which surfaces are alike, `materials` what they are of, `angles` from where
/// the photographs of a surface were taken, in degrees. Surfaces are then called "0", "1" and so on. The
/// dataset lies in a temporary folder as long as the object lives; pixels of float32 are kept within 0.0003.
///
/// Raises OSError where a file cannot be read, ValueError for what is no dataset, table or photograph.
#[pyclass(module = "sps", frozen)]
pub(crate) struct Dataset {
    folder: DatasetFolder,
    /// Where it lies, if it goes with the object.
    _scratch: Option<TempDir>,
}

#[pymethods]
impl Dataset {
    #[new]
    #[pyo3(signature = (
        photographs, values = None, *, properties = None, groups = None, materials = None, angles = None
    ))]
    fn new(
        photographs: &Bound<'_, PyAny>,
        values: Option<&Bound<'_, PyAny>>,
        properties: Option<Vec<String>>,
        groups: Option<&Bound<'_, PyAny>>,
        materials: Option<Vec<String>>,
        angles: Option<Vec<f64>>,
    ) -> Raises<Self> {
        let made = Self::made(photographs, values, properties, groups, materials, angles)?;
        Ok(made.0)
    }

    /// The folder that it lies in.
    #[getter]
    pub(crate) fn folder(&self) -> &Path {
        self.folder.folder()
    }

    /// What it is called.
    #[getter]
    pub(crate) fn name(&self) -> &str {
        self.folder.name()
    }

    /// The names of the surfaces.
    #[getter]
    fn surfaces(&self) -> Vec<&str> {
        self.each(|surface| &surface.id)
    }

    /// The material of each surface.
    #[getter]
    fn materials(&self) -> Vec<&str> {
        self.each(|surface| &surface.material)
    }

    /// The group of each surface, which must not be parted.
    #[getter]
    fn groups(&self) -> Vec<&str> {
        self.each(|surface| &surface.group)
    }

    /// The roll angle of each view, in degrees.
    #[getter]
    fn angles(&self) -> Vec<f64> {
        let angles = self.folder.view_angles().iter();
        angles.map(|angle| angle.0).collect()
    }

    /// The codes of the properties, in the order of the columns of values.
    #[getter]
    fn properties(&self) -> Vec<&str> {
        let properties = self.folder.tactile().properties.iter();
        properties.map(Property::code).collect()
    }

    /// What was measured, float64 (surfaces, properties): the mean of all readings of a surface, NaN where
    /// there is none.
    #[getter]
    fn values<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let surfaces = self.folder.surfaces().len();
        let tactile = self.folder.tactile();
        let averages = tactile.averages(&TactileSettings::default(), surfaces);
        let properties = self.properties();
        let cells = (0..surfaces).flat_map(|surface| {
            let of = |code: &&str| averages.value(surface, code).unwrap_or(f64::NAN);
            properties.iter().map(of).collect::<Vec<f64>>()
        });
        let cells = PyArray1::from_vec(py, cells.collect());
        cells.reshape([surfaces, properties.len()])
    }

    /// The files of the photographs: of each surface a list with one for each view.
    ///
    /// Raises OSError where one is missing.
    #[getter]
    fn photographs(&self) -> Raises<Vec<Vec<PathBuf>>> {
        let views = self.folder.view_angles().len();
        let of_surface = |surface| {
            let files = (0..views).map(|view| Ok(self.folder.frame_path(surface, view)?));
            files.collect()
        };
        (0..self.__len__()).map(of_surface).collect()
    }

    fn __fspath__(&self) -> &OsStr {
        self.folder().as_os_str()
    }

    fn __len__(&self) -> usize {
        self.folder.surfaces().len()
    }

    fn __repr__(&self) -> String {
        let (surfaces, views) = (self.__len__(), self.folder.view_angles().len());
        let properties = self.properties();
        let folder = self.folder().display();
        format!(
            "Dataset(\"{folder}\", surfaces={surfaces}, views={views}, properties={properties:?})"
        )
    }
}

impl Dataset {
    /// What Dataset takes as a dataset; unless it was one, also how it was imported.
    pub(crate) fn made(
        photographs: &Bound<'_, PyAny>,
        values: Option<&Bound<'_, PyAny>>,
        properties: Option<Vec<String>>,
        groups: Option<&Bound<'_, PyAny>>,
        materials: Option<Vec<String>>,
        angles: Option<Vec<f64>>,
    ) -> Result<(Self, Option<Import>)> {
        let path = || photographs.extract::<PathBuf>();
        let table: Option<PathBuf> = values.and_then(|values| values.extract().ok());
        let alone =
            groups.is_none() && properties.is_none() && materials.is_none() && angles.is_none();
        ensure!(
            alone || (values.is_some() && table.is_none()),
            "properties, groups, materials and angles: expected none beside a dataset or a table, which say \
             them"
        );
        let Some(values) = values else {
            return Ok((Self::open(&path()?, None)?, None));
        };
        let scratch = scratch()?;
        let import = if let Some(table) = table {
            Import::find(&Request {
                photographs: &path()?,
                values: &table,
                options: &Options::default(),
            })
        } else {
            let values: PyArrayLikeDyn<'_, f64, AllowTypeChange> = values.extract()?;
            let values = Values::new(&values, properties)?;
            let codes = values.properties.iter().map(|code| code.parse());
            let codes = codes.collect::<Result<_, _>>()?;
            let groups = groups.map(numbered).transpose()?;
            let known = (groups, materials);
            let listed = listed(photographs, values.rows, known, scratch.path())?;
            Import::listed(codes, &angles.unwrap_or_default(), listed)
        };
        let import = import?;
        let path = path().ok();
        let name = path.as_deref().and_then(Path::file_stem);
        let folder = scratch.path().join(name.unwrap_or("photographs".as_ref()));
        import.write(&folder, Frames::Linked)?;
        Ok((Self::open(&folder, Some(scratch))?, Some(import)))
    }

    fn open(folder: &Path, scratch: Option<TempDir>) -> Result<Self> {
        Ok(Self {
            folder: DatasetFolder::open(folder, &ReadSettings::default())?,
            _scratch: scratch,
        })
    }

    fn each<'a>(&'a self, of: impl Fn(&'a Surface) -> &'a str) -> Vec<&'a str> {
        self.folder.surfaces().iter().map(of).collect()
    }
}

/// Surfaces with their photographs; pixels become files in `folder`.
fn listed(
    photographs: &Bound<'_, PyAny>,
    rows: Vec<Vec<Option<f64>>>,
    (groups, materials): (Option<Vec<usize>>, Option<Vec<String>>),
    folder: &Path,
) -> Result<Vec<Listed>> {
    let mut surfaces = Surfaces::new(photographs)?;
    let mut files = Vec::new();
    for image in surfaces.by_ref() {
        photographs.py().check_signals()?;
        files.push(image?.into_file(&folder.join(files.len().to_string()))?);
    }
    let lengths = [
        ("photographs", Some(surfaces.counts.len())),
        ("groups", groups.as_ref().map(Vec::len)),
        ("materials", materials.as_ref().map(Vec::len)),
    ];
    for (what, found) in lengths {
        let (found, expected) = (found.unwrap_or(rows.len()), rows.len());
        ensure!(
            found == expected,
            "{what}: found those of {found} surfaces, expected {expected}, one for each row of values"
        );
    }
    let mut files = files.into_iter();
    let listed = surfaces.counts.iter().zip(rows).enumerate();
    let listed = listed.map(|(at, (&count, values))| Listed {
        group: groups
            .as_ref()
            .map(|groups| format!("group-{}", groups[at])),
        material: materials.as_ref().map(|materials| materials[at].clone()),
        photographs: files.by_ref().take(count).collect(),
        values,
    });
    Ok(listed.collect())
}

/// Writes simulated surfaces into `folder` as a Dataset: `views` images of each from -45 to 45 degrees,
/// `size` pixels wide and high, as "png" or, in linear light, as "exr". What was stopped goes on where it
/// was.
///
/// `progress` is called with what is done, how many and of how many; what it raises comes out in the end.
///
/// Raises ValueError for numbers that no simulator has, OSError where a file cannot be written.
#[pyfunction]
#[pyo3(signature = (
    folder, *, surfaces = 400, views = 100, size = 128, seed = 1, format = "png", progress = None
))]
#[expect(clippy::too_many_arguments, reason = "most are keywords")]
pub(crate) fn simulate(
    py: Python<'_>,
    folder: PathBuf,
    surfaces: usize,
    views: usize,
    size: usize,
    seed: u64,
    format: &str,
    progress: Option<&Bound<'_, PyAny>>,
) -> Raises<Dataset> {
    let spec = SimulatorSpec {
        surfaces,
        views,
        size,
        seed,
        ..SimulatorSpec::default()
    };
    let format = serde_json::from_value::<FrameFormat>(format.into())?;
    watched(py, progress, || data::simulate(&spec, format, &folder))?;
    Ok(Dataset::open(&folder, None)?)
}

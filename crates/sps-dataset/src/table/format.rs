use serde::{Deserialize, Serialize};

use crate::PropertyOrder;

/// How a tactile table is laid out, as `[tactile]` of a `dataset.toml` or of a config says it.
///
/// `docs/dataset-format.md` has an example of each kind.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum TableFormat {
    /// One row per touch, columns named by property.
    LongCsv(LongCsv),
    /// One row per surface.
    WideCsv(WideCsv),
    /// NumPy arrays in one archive. Reading it needs the feature `npz`.
    Npz(Npz),
    /// One JSON document.
    Json(Json),
}

/// `surface,location,repeat,fRS,...`: one row per touch, columns in any order.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default, rename_all = "kebab-case", deny_unknown_fields)]
pub struct LongCsv {
    /// The file, relative to the dataset's folder. Default `tactile.csv`.
    pub file: Option<String>,
    /// Columns to leave out, by name.
    pub ignore_columns: Vec<String>,
}

/// One row per surface: its id, then one value per column.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default, rename_all = "kebab-case", deny_unknown_fields)]
pub struct WideCsv {
    /// The file, relative to the dataset's folder. Default `tactile.csv`.
    pub file: Option<String>,
    /// What the first line is. Default: the names of the columns.
    pub header: Header,
    /// The property of each column after the first; required unless the header names them.
    pub property_order: Option<PropertyOrder>,
    /// Columns to leave out, by name; only where the header names the columns.
    pub ignore_columns: Vec<String>,
    /// The rows that are the file's own mean and standard deviation.
    pub statistics: Statistics,
}

/// What the first line of a [`WideCsv`] is.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Header {
    /// `surface`, then the code of each property.
    #[default]
    Properties,
    /// Names that say nothing; `property-order` says what the columns are.
    Ignored,
    /// The first surface already; `property-order` says what the columns are.
    Absent,
}

/// Arrays of any real dtype, in C or Fortran order; NaN was not measured.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default, rename_all = "kebab-case", deny_unknown_fields)]
pub struct Npz {
    /// The file, relative to the dataset's folder. Default `tactile.npz`.
    pub file: Option<String>,
    /// What the arrays are. Default: one per surface.
    pub layout: NpzLayout,
    /// The property of each entry of the last axis; required.
    pub property_order: Option<PropertyOrder>,
    /// The arrays that are the file's own mean and standard deviation.
    pub statistics: Statistics,
}

/// What the arrays of an [`Npz`] are.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum NpzLayout {
    /// One array per surface, named by its id: `(properties)`, `(repeats, properties)` or
    /// `(locations, repeats, properties)`.
    #[default]
    Keyed,
    /// One array for all surfaces, with one axis more in front.
    Stacked(Stacked),
}

/// The arrays of [`NpzLayout::Stacked`].
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default, rename_all = "kebab-case", deny_unknown_fields)]
pub struct Stacked {
    /// The name of the array of values. Default `values`.
    pub values: String,
    /// The name of the array of surface ids; where it is not given, the rows are in the order of
    /// `surfaces.csv`.
    pub surfaces: Option<String>,
}

/// One JSON document; `null` was not measured.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default, rename_all = "kebab-case", deny_unknown_fields)]
pub struct Json {
    /// The file, relative to the dataset's folder. Default `tactile.json`.
    pub file: Option<String>,
    /// What the document is. Default: an object with a key per surface.
    pub layout: JsonLayout,
    /// The property of each entry of the innermost lists; required where there are lists.
    pub property_order: Option<PropertyOrder>,
    /// The keys that are the file's own mean and standard deviation.
    pub statistics: Statistics,
}

/// What the document of a [`Json`] is.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum JsonLayout {
    /// An object: surface id to `{"fRS": 31.5, ...}`, or to a list of values, of repeats or of
    /// locations.
    #[default]
    Keyed,
    /// A list of `{"surface": ..., "location": ..., "repeat": ..., "fRS": ...}`, one per touch.
    Records,
}

/// The file's own mean and standard deviation per property.
///
/// Readers of the published files report two such entries that are not the statistics of the
/// set, so they are never taken for surfaces, and never used unless `restore` says so.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default, rename_all = "kebab-case", deny_unknown_fields)]
pub struct Statistics {
    /// The name of the means. Default `mean`.
    pub mean: String,
    /// The name of the standard deviations. Default `std`.
    pub std: String,
    /// Whether the values were standardised by them, so that each is to be read as
    /// `value * std + mean`. Default false.
    pub restore: bool,
}

impl TableFormat {
    /// The file, relative to the dataset's folder.
    pub fn file(&self) -> &str {
        let (file, usual) = match self {
            Self::LongCsv(table) => (&table.file, "tactile.csv"),
            Self::WideCsv(table) => (&table.file, "tactile.csv"),
            Self::Npz(table) => (&table.file, "tactile.npz"),
            Self::Json(table) => (&table.file, "tactile.json"),
        };
        file.as_deref().unwrap_or(usual)
    }

    pub(crate) fn is_default(&self) -> bool {
        *self == Self::default()
    }
}

impl Default for TableFormat {
    fn default() -> Self {
        Self::LongCsv(LongCsv::default())
    }
}

impl Default for Stacked {
    fn default() -> Self {
        Self {
            values: "values".to_owned(),
            surfaces: None,
        }
    }
}

impl Default for Statistics {
    fn default() -> Self {
        Self {
            mean: "mean".to_owned(),
            std: "std".to_owned(),
            restore: false,
        }
    }
}

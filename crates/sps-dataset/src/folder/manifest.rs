use std::path::Path;

use serde::{Deserialize, Serialize};

use crate::table::{PropertyOrder, TableFormat};
use crate::{DatasetError, ViewAngles, parse_toml};

/// What `dataset.toml` says: the dataset's name, its views and how its tactile table is laid out.
///
/// ```
/// use sps_dataset::Manifest;
///
/// let text = r#"
///     name = "example"
///     properties = ["fRS", "cDF"]
///     view-angles-deg = { from = -45, to = 45, count = 100 }
/// "#;
/// let manifest = Manifest::parse("dataset.toml".as_ref(), text)?;
/// assert_eq!(manifest.view_angles_deg.as_slice().len(), 100);
/// # Ok::<(), sps_dataset::DatasetError>(())
/// ```
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub struct Manifest {
    /// What reports call the dataset.
    pub name: String,
    /// One line about it.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub description: String,
    /// Where it comes from and under which licence.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub source: String,
    /// The tactile properties it has, in the order that tables and reports use.
    pub properties: PropertyOrder,
    /// The roll angle of each view.
    pub view_angles_deg: ViewAngles,
    /// How the tactile table is laid out; `tactile.csv` in long form unless said otherwise.
    #[serde(default, skip_serializing_if = "TableFormat::is_default")]
    pub tactile: TableFormat,
}

impl Manifest {
    /// Reads the text of a `dataset.toml`; `path` is only for messages.
    ///
    /// # Errors
    /// Where the text is not TOML, a key is missing or unknown, a property is not one of the
    /// fifteen or is listed twice, or the angles are none that a sequence can have.
    pub fn parse(path: &Path, text: &str) -> Result<Self, DatasetError> {
        parse_toml(path, text)
    }
}

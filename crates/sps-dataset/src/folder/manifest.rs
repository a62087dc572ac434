use std::path::Path;

use serde::{Deserialize, Serialize};

use crate::table::{PropertyOrder, TableFormat};
use crate::{DatasetError, DatasetErrorKind, PropertyRanges, ViewAngles, parse_toml};

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
    /// The ranges that its properties cannot leave.
    #[serde(default, skip_serializing_if = "PropertyRanges::is_empty")]
    pub ranges: PropertyRanges,
    /// How the tactile table is laid out; `tactile.csv` in long form unless said otherwise.
    #[serde(default, skip_serializing_if = "TableFormat::is_default")]
    pub tactile: TableFormat,
}

impl Manifest {
    /// Reads the text of a `dataset.toml`; `path` is only for messages.
    ///
    /// # Errors
    /// Where the text is not TOML, a key is missing or unknown, a property is not one of the
    /// fifteen or is listed twice, the angles are none that a sequence can have, or a range is empty
    /// or that of a property which is not listed.
    pub fn parse(path: &Path, text: &str) -> Result<Self, DatasetError> {
        let manifest: Self = parse_toml(path, text)?;
        manifest.check_ranges().map_err(|(found, expected)| {
            let kind = DatasetErrorKind::unexpected("the ranges", found, expected);
            DatasetError::file(path, kind)
        })?;
        Ok(manifest)
    }

    /// Ranges are of properties that there are; what was found and expected if not.
    pub(super) fn check_ranges(&self) -> Result<(), (String, String)> {
        let mut ranged = self.ranges.properties();
        let Some(unlisted) = ranged.find(|&property| self.properties.position(property).is_none())
        else {
            return Ok(());
        };
        let listed: Vec<_> = self.properties.iter().map(|listed| listed.code()).collect();
        Err((
            format!("one for `{unlisted}`"),
            format!("ranges of the properties: {}", listed.join(", ")),
        ))
    }
}

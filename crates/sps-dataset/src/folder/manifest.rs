use std::collections::BTreeMap;
use std::path::Path;

use serde::{Deserialize, Serialize};
use sps_base::names::nearest;

use crate::error::Fault;
use crate::{
    DatasetError, Description, Origin, Property, PropertyOrder, PropertyRange, TableFormat,
    ViewAngles, parse_toml,
};

/// What `dataset.toml` says: the dataset's name, its views and how its tactile table is laid out.
///
/// ```
/// use sps_dataset::Manifest;
///
/// let text = r#"
///     name = "example"
///     properties = ["fRS", "friction"]
///     view-angles-deg = { from = -45, to = 45, count = 100 }
///
///     [property.friction]
///     name = "coefficient of sliding friction"
///     unit = "1"
///     range = [0.0, 2.0]
/// "#;
/// let manifest = Manifest::parse("dataset.toml".as_ref(), text)?;
/// assert_eq!(manifest.view_angles_deg.as_slice().len(), 100);
/// assert_eq!(manifest.describe(&manifest.properties[0]).name, "sliding resistance");
/// assert_eq!(manifest.describe(&manifest.properties[1]).range.unwrap().ends(), [0.0, 2.0]);
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
    /// Whether its surfaces are the paper's or simulated; left out of all others.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub origin: Option<Origin>,
    /// The properties it has, in the order that tables and reports use.
    pub properties: PropertyOrder,
    /// The roll angle of each view.
    pub view_angles_deg: ViewAngles,
    /// The ranges that its properties cannot leave, where nothing else is said of these.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub ranges: BTreeMap<Property, PropertyRange>,
    /// How the tactile table is laid out; `tactile.csv` in long form unless said otherwise.
    #[serde(default, skip_serializing_if = "TableFormat::is_default")]
    pub tactile: TableFormat,
    /// What is known of its properties.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub property: BTreeMap<Property, Description>,
}

impl Manifest {
    /// Reads the text of a `dataset.toml`; `path` is only for messages.
    ///
    /// # Errors
    /// Where the text is not TOML, a key is missing or unknown, a property has no valid code or is listed
    /// twice, the angles are none that a sequence can have, a range is empty, or something is said of a
    /// property that is not listed.
    pub fn parse(path: &Path, text: &str) -> Result<Self, DatasetError> {
        let manifest: Self = parse_toml(path, text)?;
        let checked = manifest.check();
        checked.map_err(|text| Fault::invalid(text).of_file(path))?;
        Ok(manifest)
    }

    /// What is known of a property: what the dataset says, and else what the project knows of its code.
    pub fn describe(&self, property: &Property) -> Description {
        let mut description = self.property.get(property).cloned().unwrap_or_default();
        if description.name.is_empty() {
            description.name = Description::known(property).name;
        }
        description.range = self.range(property);
        description
    }

    /// The range that a property cannot leave, where there is one.
    pub(crate) fn range(&self, property: &Property) -> Option<PropertyRange> {
        let described = self.property.get(property);
        let range = described.and_then(|described| described.range);
        range.or_else(|| self.ranges.get(property).copied())
    }

    /// What is said of properties is said once, of those that there are, in texts of one line. If not,
    /// says where, what was found, and what was expected.
    pub(super) fn check(&self) -> Result<(), String> {
        for property in self.ranges.keys().chain(self.property.keys()) {
            if self.properties.position(property).is_none() {
                let listed: Vec<_> = self.properties.iter().map(Property::code).collect();
                let near = nearest(property, listed.iter().copied());
                let near = near.map_or(String::new(), |near| format!(" (did you mean `{near}`?)"));
                return Err(format!(
                    "the ranges and descriptions: found one for `{property}`{near}, expected those of the \
                     properties: {}",
                    listed.join(", ")
                ));
            }
        }
        for (property, described) in &self.property {
            if described.range.is_some() && self.ranges.contains_key(property) {
                return Err(format!(
                    "the range of `{property}`: found one in `ranges` and one in `property.{property}`, \
                     expected one of them"
                ));
            }
            let texts = [&described.name, &described.unit, &described.description];
            let mut texts = texts.into_iter();
            if let Some(text) = texts.find(|text| text.chars().any(char::is_control)) {
                return Err(format!(
                    "`property.{property}`: found `{}`, expected a text of one line, without control \
                     characters",
                    text.escape_debug()
                ));
            }
        }
        Ok(())
    }
}

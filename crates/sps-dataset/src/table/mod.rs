//! Tactile tables in their four forms.

mod csv_lines;
mod format;
mod json;
mod json_node;
mod json_values;
mod keyed;
mod long;
mod npy;
#[cfg(feature = "npz")]
mod npz;
mod rows;
mod wide;

use std::path::Path;

use crate::files::read_file;
use crate::folder::Manifest;
use crate::{DatasetError, DatasetErrorKind, Property, RangePolicy, Surface};

pub(crate) use csv_lines::{check_cells, csv_lines};
pub use format::{
    Header, Json, JsonLayout, LongCsv, Npz, NpzLayout, Stacked, Statistics, TableFormat, WideCsv,
};
pub use npy::read_npy;
pub(crate) use rows::TactileRead;
use rows::Wanted;

/// Reads the table of a dataset in `folder`; its columns become the properties of
/// the manifest, in that order.
pub(crate) fn read_table(
    folder: &Path,
    format: &TableFormat,
    surfaces: &[Surface],
    manifest: &Manifest,
    policy: RangePolicy,
    limit: u64,
) -> Result<TactileRead, DatasetError> {
    let path = &folder.join(format.file());
    let bytes = read_file(path, limit)?;
    let raw = match format {
        TableFormat::LongCsv(format) => long::read(path, &bytes, format)?,
        TableFormat::WideCsv(format) => wide::read(path, &bytes, format)?,
        TableFormat::Json(format) => json::read(path, &bytes, format)?,
        #[cfg(feature = "npz")]
        TableFormat::Npz(format) => npz::read(path, &bytes, format, surfaces, limit)?,
        #[cfg(not(feature = "npz"))]
        TableFormat::Npz(_) => {
            let expected = "any other form, for this was built without the feature `npz`";
            let kind = DatasetErrorKind::unexpected("the form of the table", "NPZ", expected);
            return Err(DatasetError::file(path, kind));
        }
    };
    Wanted {
        path,
        surfaces,
        manifest,
        policy,
    }
    .assemble(raw)
}

/// The property that a column's name stands for, which must not be among those already `listed`.
fn property_of_column<'a>(
    path: &Path,
    line: u64,
    name: &str,
    mut listed: impl Iterator<Item = &'a Property>,
) -> Result<Property, DatasetError> {
    let property = name.parse();
    let property: Property = property.map_err(|invalid| {
        DatasetError::line(path, line, DatasetErrorKind::InvalidCode(invalid))
    })?;
    if listed.any(|other| *other == property) {
        let kind = DatasetErrorKind::unexpected("the header", format!("`{name}` twice"), "it once");
        return Err(DatasetError::line(path, line, kind));
    }
    Ok(property)
}

fn no_such_column(path: &Path, line: u64, name: &str, header: &str) -> DatasetError {
    let found = if header.is_empty() {
        "nothing".to_owned()
    } else {
        format!("`{header}`")
    };
    let kind = DatasetErrorKind::unexpected("the header", found, format!("a column `{name}`"));
    DatasetError::line(path, line, kind)
}

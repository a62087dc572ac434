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

use crate::error::Fault;
use crate::files::read_file;
use crate::folder::Manifest;
use crate::{DatasetError, DatasetErrorKind, InvalidCode, Property, RangePolicy, Surface};

pub(crate) use csv_lines::csv_lines;
pub use format::{
    Header, Json, JsonLayout, LongCsv, Npz, NpzLayout, Stacked, Statistics, TableFormat, WideCsv,
};
pub use npy::read_npy;
pub(crate) use rows::TactileRead;
use rows::assemble;

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
        TableFormat::LongCsv(format) => long::read(&bytes, format),
        TableFormat::WideCsv(format) => wide::read(&bytes, format),
        TableFormat::Json(format) => json::read(&bytes, format),
        #[cfg(feature = "npz")]
        TableFormat::Npz(format) => npz::read(&bytes, format, surfaces, limit),
        #[cfg(not(feature = "npz"))]
        TableFormat::Npz(_) => {
            let expected = "any other form, for this was built without the feature `npz`";
            Err(DatasetErrorKind::unexpected("the form of the table", "NPZ", expected).into())
        }
    };
    raw.and_then(|raw| assemble(raw, surfaces, manifest, policy))
        .map_err(|fault: Fault| fault.of_file(path))
}

/// The property that a column's name stands for.
fn property_of_column(name: &str) -> Result<Property, DatasetErrorKind> {
    name.parse().map_err(|invalid: InvalidCode| {
        let text = format!("{invalid}; `ignore-columns` leaves a column out");
        DatasetErrorKind::Invalid(text)
    })
}

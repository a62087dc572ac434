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

use crate::error::Fault;
use crate::folder::Manifest;
use crate::{InvalidCode, Property, ReadSettings, Surface};

pub(crate) use csv_lines::csv_lines;
pub use format::{
    Header, Json, JsonLayout, LongCsv, Npz, NpzLayout, Stacked, Statistics, TableFormat, WideCsv,
};
pub use npy::read_npy;
pub(crate) use rows::TactileRead;
use rows::assemble;

/// Reads the table of a dataset; its columns become the properties of the manifest, in that order.
pub(crate) fn read_table(
    bytes: &[u8],
    format: &TableFormat,
    surfaces: &[Surface],
    manifest: &Manifest,
    settings: &ReadSettings,
) -> Result<TactileRead, Fault> {
    let raw = match format {
        TableFormat::LongCsv(format) => long::read(bytes, format),
        TableFormat::WideCsv(format) => wide::read(bytes, format),
        TableFormat::Json(format) => json::read(bytes, format),
        #[cfg(feature = "npz")]
        TableFormat::Npz(format) => npz::read(bytes, format, surfaces, settings.table_bytes),
        #[cfg(not(feature = "npz"))]
        TableFormat::Npz(_) => {
            let expected = "any other form, for this was built without the feature `npz`";
            Err(Fault::unexpected("the form of the table", "NPZ", expected))
        }
    };
    assemble(raw?, surfaces, manifest, settings.tactile.out_of_range)
}

/// The property that a column's name stands for.
fn property_of_column(name: &str) -> Result<Property, Fault> {
    name.parse().map_err(|invalid: InvalidCode| {
        Fault::invalid(format!("{invalid}; `ignore-columns` leaves a column out"))
    })
}

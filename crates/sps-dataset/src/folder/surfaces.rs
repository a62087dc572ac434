use std::collections::HashMap;
use std::path::Path;

use crate::table::{check_cells, csv_lines};
use crate::{DatasetError, DatasetErrorKind, Place, Surface};

/// The columns of `surfaces.csv`, in this order.
const HEADER: [&str; 3] = ["surface", "material", "group"];

/// Names of files with a longer stem cannot be made on common file systems.
const LONGEST_ID: usize = 200;

/// Reads `surfaces.csv`.
pub(super) fn read_surfaces(path: &Path, bytes: &[u8]) -> Result<Vec<Surface>, DatasetError> {
    let lines = csv_lines(path, bytes)?;
    let Some((header, lines)) = lines.split_first() else {
        let kind = DatasetErrorKind::unexpected("the header", "nothing", HEADER.join(","));
        return Err(DatasetError::line(path, 1, kind));
    };
    if !header.cells.iter().eq(HEADER) {
        let found = header.cells.iter().collect::<Vec<_>>().join(",");
        let kind = DatasetErrorKind::unexpected("the header", found, HEADER.join(","));
        return Err(DatasetError::line(path, header.number, kind));
    }
    let mut first_seen = HashMap::new();
    let mut surfaces = Vec::with_capacity(lines.len());
    for line in lines {
        check_cells(path, line, HEADER.len())?;
        let cell = |column| line.cell(column).to_owned();
        let surface = Surface {
            id: cell(0),
            material: cell(1),
            group: cell(2),
        };
        check_surface_id(&surface.id).map_err(|InvalidSurfaceId { found, expected }| {
            let kind = DatasetErrorKind::unexpected("a surface's id", found, expected);
            DatasetError::line(path, line.number, kind)
        })?;
        if let Some(first) = first_seen.insert(surface.id.clone(), line.number) {
            let kind = DatasetErrorKind::twice(&surface.id, &Place::Line(first));
            return Err(DatasetError::line(path, line.number, kind));
        }
        surfaces.push(surface);
    }
    if surfaces.is_empty() {
        let kind = DatasetErrorKind::unexpected("its rows", "none", "at least one surface");
        return Err(DatasetError::file(path, kind));
    }
    Ok(surfaces)
}

/// A table is read from below the dataset's folder and from nowhere else: each part of its path is
/// held to the rules of an id, which names a folder too.
pub(super) fn check_table(folder: &Path, file: &str) -> Result<(), DatasetError> {
    let refused = |InvalidSurfaceId { expected, .. }| {
        let expected = format!("a path below the dataset's folder, each part {expected}");
        let found = format!("`{}`", file.escape_debug());
        let kind = DatasetErrorKind::unexpected("the `file` of the tactile table", found, expected);
        DatasetError::file(folder, kind)
    };
    file.split('/')
        .try_for_each(check_surface_id)
        .map_err(refused)
}

/// A surface's id that cannot name a folder.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("found {found} as a surface's id, expected {expected}")]
pub struct InvalidSurfaceId {
    /// The id, with control characters written out.
    pub found: String,
    /// What it must be.
    pub expected: &'static str,
}

/// An id names a folder, so it must stay inside the one above.
///
/// # Errors
/// Where it is empty, has a slash, colon or control character, begins with a dot or is longer than
/// 200 bytes.
pub fn check_surface_id(id: &str) -> Result<(), InvalidSurfaceId> {
    let bad = |c: char| matches!(c, '/' | '\\' | ':') || c.is_control();
    let expected = if id.is_empty() {
        "a name"
    } else if id.starts_with('.') {
        "a name that does not begin with a dot"
    } else if id.chars().any(bad) {
        "a name without slashes, colons and control characters"
    } else if id.len() > LONGEST_ID {
        "a name of at most 200 bytes"
    } else {
        return Ok(());
    };
    let found = format!("`{}`", id.escape_debug());
    Err(InvalidSurfaceId { found, expected })
}

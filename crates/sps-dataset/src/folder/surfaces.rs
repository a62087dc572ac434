use std::collections::HashMap;

use crate::Surface;
use crate::error::Fault;
use crate::table::csv_lines;

/// The columns of `surfaces.csv`, in this order.
pub(super) const HEADER: [&str; 3] = ["surface", "material", "group"];

/// Names of files with a longer stem cannot be made on common file systems.
const LONGEST_ID: usize = 200;

/// Reads `surfaces.csv`.
pub(super) fn read_surfaces(bytes: &[u8]) -> Result<Vec<Surface>, Fault> {
    let (header, lines) = csv_lines(bytes)?;
    if !header.cells.iter().eq(HEADER) {
        return Err(header.unexpected_header(&header.shown(), &HEADER.join(",")));
    }
    let mut first_seen = HashMap::new();
    let mut surfaces = Vec::with_capacity(lines.len());
    for line in lines {
        line.check_cells(HEADER.len())?;
        let [id, material, group] = [0, 1, 2].map(|column| line.cell(column).to_owned());
        check_surface_id(&id).map_err(|InvalidSurfaceId { found, expected }| {
            Fault::unexpected("a surface's id", found, expected).at(line.place())
        })?;
        if let Some(first) = first_seen.insert(id.clone(), line.place()) {
            return Err(Fault::twice(&id, &first).at(line.place()));
        }
        surfaces.push(Surface {
            id,
            material,
            group,
        });
    }
    if surfaces.is_empty() {
        return Err(Fault::unexpected(
            "its rows",
            "none",
            "at least one surface",
        ));
    }
    Ok(surfaces)
}

/// A table is read from below the dataset's folder and from nowhere else: each part of its path is
/// held to the rules of an id, which names a folder too.
pub(super) fn check_table(file: &str) -> Result<(), Fault> {
    let mut parts = file.split('/');
    let checked = parts.try_for_each(check_surface_id);
    checked.map_err(|InvalidSurfaceId { expected, .. }| {
        let expected = format!("a path below the dataset's folder, each part {expected}");
        let found = format!("`{}`", file.escape_debug());
        let what = "the `file` of the tactile table";
        Fault::unexpected(what, found, expected)
    })
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

//! Embeddings that were computed elsewhere: arrays, or files.

use std::path::{Path, PathBuf};

use anyhow::{Result, bail};
use numpy::{AllowTypeChange, PyArrayLikeDyn};
use pyo3::prelude::*;
use sps::importing::Import;
use sps_estimator::Precomputed;
use sps_models::encoders::Block;

use crate::images::write;

/// What the one block of an array is called.
const EMBEDDINGS: &str = "embeddings";

/// An array (surfaces, width) or (surfaces, views, width).
pub(crate) type Array<'py> = PyArrayLikeDyn<'py, f32, AllowTypeChange>;

/// The rows of an array, and how many surfaces and views it has.
pub(crate) fn rows(array: &Array<'_>) -> Result<(Precomputed, [usize; 2])> {
    let array = array.as_array();
    let (extent, width) = match *array.shape() {
        [surfaces, width] => ([surfaces, 1], width),
        [surfaces, views, width] => ([surfaces, views], width),
        ref found => bail!(
            "embeddings of shape {found:?}, expected (surfaces, width) or (surfaces, views, width)"
        ),
    };
    let blocks = vec![Block {
        name: EMBEDDINGS.to_owned(),
        width,
    }];
    let rows = Precomputed::new(blocks, Vec::new(), array.iter().copied().collect())?;
    Ok((rows, extent))
}

/// A file of embeddings, an array or a file, whose rows are in the order of the dataset that `import` made of
/// the photographs in a folder, or of those that were listed. It is written into `scratch`, unless a dataset was
/// there before.
pub(crate) fn file(
    embeddings: &Bound<'_, PyAny>,
    import: Option<&Import>,
    folder: Option<&Path>,
    scratch: &Path,
) -> Result<PathBuf> {
    let (name, mut found) = match embeddings.extract::<PathBuf>() {
        Ok(path) if import.is_none() => return Ok(path),
        Ok(path) => {
            let name = path.file_name().unwrap_or_default();
            (name.to_owned(), Precomputed::read(&path)?)
        }
        Err(_) => (EMBEDDINGS.into(), rows(&embeddings.extract()?)?.0),
    };
    if let Some(import) = import {
        found = import.rows_of(found, folder)?;
    }
    let path = scratch.join(name);
    write(&path, &found.to_bytes()?)?;
    Ok(path)
}

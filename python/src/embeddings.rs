//! Embeddings that were computed elsewhere: arrays, or files.

use std::path::{Path, PathBuf};

use numpy::{AllowTypeChange, PyArrayLikeDyn};
use pyo3::prelude::*;
use sps::importing::Import;
use sps_base::files::write_file;
use sps_estimator::Precomputed;
use sps_models::encoders::Block;

use crate::errors::{any_error, estimator_error, file_error, value_error};

/// What the one block of an array is called.
const EMBEDDINGS: &str = "embeddings";

/// An array (surfaces, width) or (surfaces, views, width).
pub(crate) type Array<'py> = PyArrayLikeDyn<'py, f32, AllowTypeChange>;

/// The rows of an array, and how many surfaces and views it has.
pub(crate) fn rows(array: &Array<'_>) -> PyResult<(Precomputed, [usize; 2])> {
    let array = array.as_array();
    let (extent, width) = match *array.shape() {
        [surfaces, width] => ([surfaces, 1], width),
        [surfaces, views, width] => ([surfaces, views], width),
        ref found => {
            return Err(value_error(format_args!(
                "embeddings of shape {found:?}, expected (surfaces, width) or (surfaces, views, width)"
            )));
        }
    };
    let blocks = vec![Block {
        name: EMBEDDINGS.to_owned(),
        width,
    }];
    let rows = Precomputed::new(blocks, Vec::new(), array.iter().copied().collect());
    Ok((rows.map_err(|error| estimator_error(&error))?, extent))
}

/// A file of embeddings, an array or a file, whose rows are in the order of the dataset that `import` made of
/// the photographs in a folder, or of those that were listed. It is written into `scratch`, unless a dataset was
/// there before.
pub(crate) fn file(
    embeddings: &Bound<'_, PyAny>,
    import: Option<&Import>,
    folder: Option<&Path>,
    scratch: &Path,
) -> PyResult<PathBuf> {
    let (name, mut found) = match embeddings.extract::<PathBuf>() {
        Ok(path) if import.is_none() => return Ok(path),
        Ok(path) => {
            let read = Precomputed::read(&path).map_err(|error| estimator_error(&error))?;
            (path.file_name().unwrap_or_default().to_owned(), read)
        }
        Err(_) => (EMBEDDINGS.into(), rows(&embeddings.extract()?)?.0),
    };
    if let Some(import) = import {
        found = import.rows_of(found, folder).map_err(any_error)?;
    }
    let bytes = found.to_bytes();
    let bytes = bytes.map_err(|error| estimator_error(&error))?;
    let path = scratch.join(name);
    write_file(&path, &bytes).map_err(|error| file_error(&error, &path))?;
    Ok(path)
}

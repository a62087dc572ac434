//! Embeddings that were computed elsewhere.

use std::collections::HashMap;
use std::fs;
use std::path::Path;

use sps_models::encoders::Block;
use sps_weights::{RawTensor, Storage};

use crate::error::{Error, Result, refuse};

/// The name of the one block of a file that has no other, and of all blocks side by side where it has several.
const EMBEDDINGS: &str = "embeddings";
/// The note in a safetensors file that names the photograph of each row.
const FILES: &str = "files";
/// Numbers in a file, and in a row, at most.
const MOST: u64 = 1 << 30;
const WIDEST: usize = 1 << 20;

/// Embeddings that were computed elsewhere, a row for each photograph, in blocks.
///
/// ```
/// use sps_estimator::Precomputed;
/// use sps_models::encoders::Block;
///
/// let blocks = vec![Block { name: "embeddings".to_owned(), width: 2 }];
/// let files = ["oak.jpg", "denim.jpg"].map(str::to_owned).to_vec();
/// let rows = Precomputed::new(blocks, files, vec![0.1, 0.2, 0.3, 0.4])?;
/// let read = Precomputed::from_bytes(&rows.to_bytes()?)?;
/// assert_eq!(read.rows_of(&["denim.jpg".to_owned()])?, [0.3, 0.4]);
/// # Ok::<(), sps_estimator::Error>(())
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct Precomputed {
    blocks: Vec<Block>,
    files: Vec<String>,
    values: Vec<f32>,
}

impl Precomputed {
    /// Takes rows of numbers, `(rows, width of all blocks)`, row-major, and the file of the photograph of each
    /// row, or of none.
    ///
    /// # Errors
    /// No block, one without a number, numbers that do not fill rows or are not finite, other than one file for
    /// each row.
    pub fn new(blocks: Vec<Block>, files: Vec<String>, values: Vec<f32>) -> Result<Self> {
        let new = Self {
            blocks,
            files,
            values,
        };
        let widths: Vec<usize> = new.blocks.iter().map(|block| block.width).collect();
        let add = |sum: usize, width: &usize| sum.checked_add(*width);
        let width = widths.iter().try_fold(0, add).unwrap_or(usize::MAX);
        if widths.contains(&0) || !(1..=WIDEST).contains(&width) {
            let found = format!("blocks of widths {widths:?}");
            let expected = format!("1 or more, together at most {WIDEST}");
            return refuse("embeddings", found, expected);
        }
        if !new.values.len().is_multiple_of(new.width()) {
            let found = format!("{} numbers", new.values.len());
            let expected = format!("rows of {}", new.width());
            return refuse("embeddings", found, expected);
        }
        if let Some(value) = new.values.iter().find(|value| !value.is_finite()) {
            return refuse("embeddings", value, "finite numbers");
        }
        if !new.files.is_empty() && new.files.len() != new.rows() {
            let expected = format!("{}, one for each row", new.rows());
            return refuse(FILES, new.files.len(), expected);
        }
        Ok(new)
    }

    /// Reads a file: safetensors, `.pth`, or `.npy`.
    ///
    /// In safetensors and `.pth`, each tensor is a block, `(rows, width)`, under its name; blocks are in the
    /// order of their names, and a tensor `embeddings` beside others is all of them side by side. One tensor may
    /// have any name. The metadata of a
    /// safetensors file may have `files`, a JSON list that names the photograph of each row. An `.npy` file is
    /// one block, `(rows, width)`.
    ///
    /// # Errors
    /// A file that cannot be read or is none of these, tensors of other shapes, and what [`Precomputed::new`]
    /// says.
    pub fn read(path: &Path) -> Result<Self> {
        let length = fs::metadata(path).map_err(Error::file(path))?.len();
        if length > 8 * MOST {
            let problem = format!("{length} bytes, expected at most {}", 8 * MOST);
            return Err(Error::artefact(path, problem));
        }
        let bytes = fs::read(path).map_err(Error::file(path))?;
        Self::from_bytes(&bytes).map_err(|error| Error::artefact(path, error))
    }

    /// As [`Precomputed::read`], the content of a file.
    ///
    /// # Errors
    /// As [`Precomputed::read`].
    pub fn from_bytes(bytes: &[u8]) -> Result<Self> {
        let wrong = |found: String| Error::input("embeddings", found, "(rows, width)");
        if bytes.starts_with(b"\x93NUMPY") {
            let (shape, values) = sps_dataset::read_npy(bytes, MOST).map_err(wrong)?;
            let [_, width] = shape[..] else {
                return Err(wrong(format!("shape {shape:?}")));
            };
            let name = EMBEDDINGS.to_owned();
            let values = values.into_iter().map(|value| value as f32);
            return Self::new(vec![Block { name, width }], Vec::new(), values.collect());
        }
        let tensors = sps_weights::read(bytes);
        let mut tensors = tensors.map_err(|error| wrong(error.to_string()))?;
        tensors.sort_by(|(one, _), (other, _)| one.cmp(other));
        match &mut tensors[..] {
            [(name, _)] => EMBEDDINGS.clone_into(name),
            _ => tensors.retain(|(name, _)| name != EMBEDDINGS),
        }
        let rows = tensors.first().and_then(|(_, tensor)| tensor.shape.first());
        let rows = *rows.ok_or_else(|| wrong("no tensor with rows".to_owned()))?;
        let mut blocks = Vec::new();
        for (name, RawTensor { shape, .. }) in &tensors {
            match shape[..] {
                [own, width] if own == rows && width > 0 => blocks.push(Block {
                    name: name.clone(),
                    width,
                }),
                _ => {
                    let expected = format!("({rows}, width)");
                    return refuse(format!("the tensor {name}"), format!("{shape:?}"), expected);
                }
            }
        }
        let row = |row: usize| {
            let parts = tensors.iter().zip(&blocks);
            parts.flat_map(move |((_, tensor), block)| {
                &tensor.values[row * block.width..][..block.width]
            })
        };
        let values = (0..rows).flat_map(row).copied().collect();
        let files = match sps_weights::note(bytes, FILES) {
            Ok(text) => serde_json::from_str(&text)
                .map_err(|error| Error::input(FILES, error, "a JSON list of texts"))?,
            Err(_) => Vec::new(),
        };
        Self::new(blocks, files, values)
    }

    /// A safetensors file as [`Precomputed::read`] takes it.
    ///
    /// # Errors
    /// Two blocks of one name.
    pub fn to_bytes(&self) -> Result<Vec<u8>> {
        let (rows, width) = (self.rows(), self.width());
        let tensor = |start: usize, own: usize| RawTensor {
            shape: vec![rows, own],
            values: (0..rows)
                .flat_map(|row| &self.values[row * width + start..][..own])
                .copied()
                .collect(),
        };
        let mut tensors = vec![(EMBEDDINGS, tensor(0, width))];
        let mut start = 0;
        for block in self.blocks.iter().filter(|_| self.blocks.len() > 1) {
            tensors.push((&block.name, tensor(start, block.width)));
            start += block.width;
        }
        let files = serde_json::to_string(&self.files).unwrap_or_default();
        let note = (!self.files.is_empty()).then_some((FILES, files.as_str()));
        let bytes = sps_weights::write(tensors, Storage::F32, note);
        bytes.map_err(|error| Error::input("embeddings", error, "blocks with names of their own"))
    }

    /// The blocks of a row, in their order.
    pub fn blocks(&self) -> &[Block] {
        &self.blocks
    }

    /// The length of a row.
    pub fn width(&self) -> usize {
        self.blocks.iter().map(|block| block.width).sum()
    }

    /// How many rows there are.
    pub fn rows(&self) -> usize {
        self.values.len() / self.width()
    }

    /// The file of each row's photograph; none where they are not named.
    pub fn files(&self) -> &[String] {
        &self.files
    }

    /// All rows, `(rows, width)`, row-major.
    pub fn values(&self) -> &[f32] {
        &self.values
    }

    /// The rows of these photographs, in their order. A file is a photograph's where its path ends with the
    /// photograph's: `photographs/oak/1.jpg` with `oak/1.jpg`, or with `oak/1`. Where no files are named, rows
    /// are in the order of the photographs.
    ///
    /// # Errors
    /// Another number of rows where no files are named; a photograph without a row, or with two.
    pub fn rows_of(&self, photographs: &[String]) -> Result<Vec<f32>> {
        if self.files.is_empty() {
            if self.rows() == photographs.len() {
                return Ok(self.values.clone());
            }
            let expected = format!("{}, one for each photograph", photographs.len());
            return refuse("rows of embeddings without `files`", self.rows(), expected);
        }
        let places = photographs.iter().zip(0..);
        let places: HashMap<&str, usize> = places.map(|(name, at)| (name.as_str(), at)).collect();
        let mut rows = vec![None; photographs.len()];
        for (row, file) in self.values.chunks_exact(self.width()).zip(&self.files) {
            // The longest path of a photograph, so that `oak/1.jpg` is not the row of `1.jpg`.
            let starts = file.match_indices('/').map(|(at, _)| at + 1);
            let ends = [0].into_iter().chain(starts).map(|at| &file[at..]);
            let stem = |end: &str| places.get(end.rsplit_once('.')?.0);
            let mut at = ends.filter_map(|end| places.get(end).or_else(|| stem(end)));
            if let Some(&at) = at.next()
                && rows[at].replace(row).is_some()
            {
                let found = format!("two, the second as {file}");
                return refuse(format!("rows of {}", photographs[at]), found, "one");
            }
        }
        let mut values = Vec::with_capacity(photographs.len() * self.width());
        for (row, name) in rows.into_iter().zip(photographs) {
            let missing = || {
                let first = self.files.first().map_or("", String::as_str);
                let expected = format!("its path in `files`, which begin with {first}");
                Error::input(format!("a row of {name}"), "none", expected)
            };
            values.extend(row.ok_or_else(missing)?);
        }
        Ok(values)
    }
}

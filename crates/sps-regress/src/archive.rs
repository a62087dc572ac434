//! Fitted models as safetensors: what is large as tensors, the rest as JSON in the metadata.

use std::collections::HashMap;
use std::fmt::Display;

use safetensors::tensor::TensorView;
use safetensors::{Dtype, SafeTensorError, SafeTensors};
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};

use crate::data::Embeddings;
use crate::error::{Error, Result};

/// A format of files.
pub(crate) struct Archive {
    /// What errors call a file.
    pub(crate) what: &'static str,
    /// The one key of the metadata: several would be written in an order that changes.
    pub(crate) key: &'static str,
    /// The version, which the metadata hold as `format`.
    pub(crate) format: u32,
}

/// Of the metadata of any version.
#[derive(Deserialize)]
struct Version {
    format: u32,
}

impl Archive {
    /// The content of a file; the same models give the same bytes.
    pub(crate) fn write(&self, metadata: &impl Serialize, contents: &[Content]) -> Result<Vec<u8>> {
        let metadata = serde_json::to_string(metadata)
            .map_err(|error| self.refused(error, "finite numbers"))?;
        let views = contents.iter().map(|content| {
            let shape = content.shape.clone();
            let view = TensorView::new(content.dtype, shape, &content.bytes)?;
            Ok((&content.name, view))
        });
        let metadata = HashMap::from([(self.key.to_owned(), metadata)]);
        views
            .collect::<Result<Vec<_>, SafeTensorError>>()
            .and_then(|views| safetensors::serialize(views, Some(metadata)))
            .map_err(|error| self.refused(error, "safetensors"))
    }

    /// The metadata and tensors of a file.
    pub(crate) fn read<'a, M: DeserializeOwned>(
        &'static self,
        bytes: &'a [u8],
    ) -> Result<(M, Contents<'a>)> {
        let not_tensors = |error| self.refused(error, "safetensors");
        let (_, header) = SafeTensors::read_metadata(bytes).map_err(not_tensors)?;
        let text = header.metadata().as_ref().and_then(|all| all.get(self.key));
        let missing = || self.refused(format_args!("no {:?}", self.key), "a file of them");
        let text = text.ok_or_else(missing)?;
        let invalid = |error| self.refused(error, "valid metadata");
        let Version { format } = serde_json::from_str(text).map_err(invalid)?;
        if format != self.format {
            let found = format_args!("format {format}");
            return Err(self.refused(found, format_args!("format {}", self.format)));
        }
        let contents = Contents {
            archive: self,
            file: SafeTensors::deserialize(bytes).map_err(not_tensors)?,
        };
        Ok((serde_json::from_str(text).map_err(invalid)?, contents))
    }

    /// The error of a file with something else in it than there should be.
    pub(crate) fn refused(&self, found: impl Display, expected: impl Display) -> Error {
        Error::input(self.what, found, expected)
    }
}

/// A tensor on its way into a file.
pub(crate) struct Content {
    name: String,
    dtype: Dtype,
    shape: Vec<usize>,
    bytes: Vec<u8>,
}

impl Content {
    /// `(bytes)`, u8.
    pub(crate) fn bytes(name: String, bytes: Vec<u8>) -> Self {
        Self {
            name,
            dtype: Dtype::U8,
            shape: vec![bytes.len()],
            bytes,
        }
    }

    /// The training surfaces that some models share, f32, `(surfaces, views, width)`, and those models' `what`,
    /// f64, `(models, surfaces)`.
    pub(crate) fn set(
        at: usize,
        embeddings: &Embeddings,
        what: &str,
        rows: &[&[f64]],
    ) -> [Self; 2] {
        let surfaces = embeddings.surfaces();
        let seen = embeddings.values().iter();
        let values = rows.iter().copied().flatten();
        [
            Self {
                name: format!("{at}/embeddings"),
                dtype: Dtype::F32,
                shape: vec![surfaces, embeddings.views(), embeddings.width()],
                bytes: seen.flat_map(|value| value.to_le_bytes()).collect(),
            },
            Self {
                name: format!("{at}/{what}"),
                dtype: Dtype::F64,
                shape: vec![rows.len(), surfaces],
                bytes: values.flat_map(|value| value.to_le_bytes()).collect(),
            },
        ]
    }
}

/// The blocks that embeddings of one encoder are made of, as files keep them: none where they are one.
pub(crate) fn stored_blocks<'a>(
    mut embeddings: impl Iterator<Item = &'a Embeddings>,
) -> Vec<usize> {
    match embeddings.next().map(Embeddings::blocks) {
        None | Some([_]) => Vec::new(),
        Some(blocks) => blocks.to_vec(),
    }
}

/// What models of one set of training surfaces have of these, model by model.
pub(crate) type Rows = std::vec::IntoIter<Vec<f64>>;

/// The tensors of a file.
pub(crate) struct Contents<'a> {
    archive: &'static Archive,
    file: SafeTensors<'a>,
}

impl<'a> Contents<'a> {
    /// Refuses another number of tensors.
    pub(crate) fn check_count(&self, expected: usize) -> Result<()> {
        match self.file.len() {
            found if found == expected => Ok(()),
            found => {
                let found = format_args!("{found} tensors");
                Err(self.archive.refused(found, expected))
            }
        }
    }

    /// What [`Content::bytes`] wrote.
    pub(crate) fn bytes(&self, name: &str) -> Result<&'a [u8]> {
        let ([_], bytes) = self.tensor(name, Dtype::U8)?;
        Ok(bytes)
    }

    /// What [`Content::set`] wrote, of embeddings in [blocks](stored_blocks).
    pub(crate) fn set(
        &self,
        at: usize,
        what: &str,
        blocks: &[usize],
    ) -> Result<(Embeddings, Rows)> {
        let embeddings = self.embeddings(&format!("{at}/embeddings"), blocks)?;
        let rows = self.rows(&format!("{at}/{what}"), embeddings.surfaces())?;
        Ok((embeddings, rows.into_iter()))
    }

    /// Rows of finite numbers.
    fn rows(&self, name: &str, length: usize) -> Result<Vec<Vec<f64>>> {
        let ([rows, found], bytes) = self.tensor(name, Dtype::F64)?;
        if found != length || length == 0 {
            let found = format_args!("{name} of shape [{rows}, {found}]");
            let expected = format_args!("rows of {length}");
            return Err(self.archive.refused(found, expected));
        }
        let (values, _) = bytes.as_chunks::<8>();
        let values: Vec<f64> = values.iter().map(|b| f64::from_le_bytes(*b)).collect();
        if let Some(value) = values.iter().find(|value| !value.is_finite()) {
            let found = format_args!("{value} in {name}");
            return Err(self.archive.refused(found, "finite numbers"));
        }
        Ok(values.chunks(length).map(<[f64]>::to_vec).collect())
    }

    /// Embeddings of one surface or more.
    fn embeddings(&self, name: &str, blocks: &[usize]) -> Result<Embeddings> {
        let (shape, bytes) = self.tensor::<3>(name, Dtype::F32)?;
        // With these the product of the others might be more than a number holds.
        if shape.contains(&0) {
            let found = format_args!("{name} of shape {shape:?}");
            let expected = "a surface, a view and a feature";
            return Err(self.archive.refused(found, expected));
        }
        let (values, _) = bytes.as_chunks::<4>();
        let values: Vec<f32> = values.iter().map(|b| f32::from_le_bytes(*b)).collect();
        let embeddings = Embeddings::new(values, shape)?;
        match blocks {
            [] => Ok(embeddings),
            blocks => embeddings.in_blocks(blocks),
        }
    }

    /// The shape and bytes of a tensor, when it has this type and so many axes.
    fn tensor<const AXES: usize>(
        &self,
        name: &str,
        dtype: Dtype,
    ) -> Result<([usize; AXES], &'a [u8])> {
        let tensor = self.file.tensor(name);
        let tensor = tensor.map_err(|error| self.archive.refused(error, name))?;
        match tensor.shape().try_into() {
            Ok(shape) if tensor.dtype() == dtype => Ok((shape, tensor.data())),
            _ => Err(self.archive.refused(
                format_args!("{name} of type {:?}, {:?}", tensor.dtype(), tensor.shape()),
                format_args!("{dtype:?} of {AXES} axes"),
            )),
        }
    }
}

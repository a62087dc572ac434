//! Fitted regressions as safetensors. The training surfaces that some share are there once, as
//! `i/embeddings`, f32, `(surfaces, views, width)`, and their coefficients beside them as
//! `i/coefficients`, f64, `(regressions, surfaces)`; the metadata hold the rest as JSON.

use std::collections::HashMap;
use std::fmt::Display;
use std::sync::Arc;

use candle_core::{Device, Tensor};
use safetensors::tensor::TensorView;
use safetensors::{Dtype, SafeTensors};
use serde::{Deserialize, Serialize};

use super::fit::{Expansion, Fit};
use super::{Kernel, Support, TrainedKernelRidge, TrainedKernelRidges};
use crate::data::Embeddings;
use crate::error::{Error, Result};
use crate::heads::Trial;
use crate::regressor::check_finite;

const KEY: &str = "sps-kernel-ridges";
const FORMAT: u32 = 1;
/// What errors call a file.
const WHAT: &str = "kernel ridge regressions";

#[derive(Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
struct Metadata {
    format: u32,
    supports: Vec<StoredSupport>,
    ridges: Vec<Stored>,
}

#[derive(Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
struct StoredSupport {
    kernel: Kernel,
    scales: Vec<f64>,
}

#[derive(Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
struct Stored {
    trial: Trial,
    support: usize,
    intercept: f64,
    left_out_error: Option<f64>,
    /// None for the mean, which has no coefficients.
    expansion: Option<Chosen>,
}

#[derive(Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
struct Chosen {
    width: f64,
    penalty: f64,
}

/// A tensor on its way into a file.
type Content = (String, Dtype, Vec<usize>, Vec<u8>);

impl TrainedKernelRidges {
    /// The file's content, safetensors; the same regressions give the same bytes.
    ///
    /// # Errors
    ///
    /// A number that is not finite.
    pub fn to_bytes(&self) -> Result<Vec<u8>> {
        for TrainedKernelRidge { fit, support, .. } in &self.ridges {
            let numbers = fit.left_out_error.iter().chain(&support.scales).chain(
                fit.expansion
                    .iter()
                    .flat_map(|expansion| &expansion.coefficients),
            );
            check_finite(WHAT, numbers.copied().chain([fit.intercept]))?;
        }
        let mut metadata = Metadata {
            format: FORMAT,
            supports: Vec::new(),
            ridges: self.ridges.iter().map(Stored::of).collect(),
        };
        let mut contents: Vec<Content> = Vec::new();
        for (at, sharing) in self.sharing().iter().enumerate() {
            let support = sharing.support;
            metadata.supports.push(StoredSupport {
                kernel: support.kernel,
                scales: support.scales.clone(),
            });
            for &ridge in &sharing.ridges {
                metadata.ridges[ridge].support = at;
            }
            let ridges = sharing.ridges.iter().map(|&ridge| &self.ridges[ridge]);
            contents.push(coefficients(at, support, ridges));
            contents.push(embeddings(at, &support.embeddings));
        }
        let metadata =
            serde_json::to_string(&metadata).map_err(|error| refused(error, "finite numbers"))?;
        let views = contents.iter().map(|(name, dtype, shape, bytes)| {
            Ok((name, TensorView::new(*dtype, shape.clone(), bytes)?))
        });
        let metadata = HashMap::from([(KEY.to_owned(), metadata)]);
        views
            .collect::<Result<Vec<_>, safetensors::SafeTensorError>>()
            .and_then(|views| safetensors::serialize(views, Some(metadata)))
            .map_err(|error| refused(error, "safetensors"))
    }

    /// Reads what [`TrainedKernelRidges::to_bytes`] gave.
    ///
    /// # Errors
    ///
    /// Bytes that are not fitted regressions of this format.
    pub fn from_bytes(bytes: &[u8]) -> Result<Self> {
        let metadata = read_metadata(bytes)?;
        let file =
            SafeTensors::deserialize(bytes).map_err(|error| refused(error, "safetensors"))?;
        if file.len() != 2 * metadata.supports.len() {
            return Err(refused(
                format_args!("{} tensors", file.len()),
                "two for each set of training surfaces",
            ));
        }
        let mut supports = Vec::with_capacity(metadata.supports.len());
        for (at, support) in metadata.supports.into_iter().enumerate() {
            supports.push(read_support(&file, at, support)?);
        }
        let mut ridges = Vec::with_capacity(metadata.ridges.len());
        for stored in metadata.ridges {
            let Some((support, rows)) = supports.get_mut(stored.support) else {
                let found = format_args!("training surfaces {}", stored.support);
                return Err(refused(found, "some that are there"));
            };
            ridges.push(stored.with(support, rows)?);
        }
        if supports.iter_mut().any(|(_, rows)| rows.next().is_some()) {
            return Err(refused("coefficients of no regression", "none such"));
        }
        Ok(Self { ridges })
    }
}

impl Stored {
    /// Its training surfaces are still to be named.
    fn of(ridge: &TrainedKernelRidge) -> Self {
        Self {
            trial: ridge.trial.clone(),
            support: 0,
            intercept: ridge.fit.intercept,
            left_out_error: ridge.fit.left_out_error,
            expansion: ridge.fit.expansion.as_ref().map(|expansion| Chosen {
                width: expansion.width,
                penalty: expansion.penalty,
            }),
        }
    }

    fn with(
        self,
        support: &Arc<Support>,
        rows: &mut impl Iterator<Item = Vec<f64>>,
    ) -> Result<TrainedKernelRidge> {
        let expansion = match self.expansion {
            None => None,
            Some(Chosen { width, penalty }) => {
                positive("width", width)?;
                let missing = || refused("too few coefficients", "some for each regression");
                Some(Expansion {
                    width,
                    penalty,
                    coefficients: rows.next().ok_or_else(missing)?,
                })
            }
        };
        Ok(TrainedKernelRidge {
            trial: self.trial,
            fit: Fit {
                intercept: self.intercept,
                left_out_error: self.left_out_error,
                expansion,
            },
            support: Arc::clone(support),
        })
    }
}

fn coefficients<'a>(
    at: usize,
    support: &Support,
    ridges: impl Iterator<Item = &'a TrainedKernelRidge>,
) -> Content {
    let expansions: Vec<_> = ridges.filter_map(|r| r.fit.expansion.as_ref()).collect();
    let values = expansions.iter().flat_map(|e| &e.coefficients);
    let shape = vec![expansions.len(), support.embeddings.surfaces()];
    let bytes = values.flat_map(|value| value.to_le_bytes()).collect();
    (format!("{at}/coefficients"), Dtype::F64, shape, bytes)
}

fn embeddings(at: usize, embeddings: &Embeddings) -> Content {
    let shape = [
        embeddings.surfaces(),
        embeddings.views(),
        embeddings.width(),
    ];
    let values = (0..shape[0]).flat_map(|surface| embeddings.surface(surface));
    let bytes = values.flat_map(|value| value.to_le_bytes()).collect();
    (
        format!("{at}/embeddings"),
        Dtype::F32,
        shape.to_vec(),
        bytes,
    )
}

fn read_metadata(bytes: &[u8]) -> Result<Metadata> {
    let (_, header) =
        SafeTensors::read_metadata(bytes).map_err(|error| refused(error, "safetensors"))?;
    let text = header.metadata().as_ref().and_then(|all| all.get(KEY));
    let text = text.ok_or_else(|| refused(format_args!("no {KEY:?}"), "fitted regressions"))?;
    let metadata: Metadata =
        serde_json::from_str(text).map_err(|error| refused(error, "valid metadata"))?;
    if metadata.format != FORMAT {
        return Err(refused(
            format_args!("format {}", metadata.format),
            format_args!("format {FORMAT}"),
        ));
    }
    Ok(metadata)
}

/// Training surfaces, and the rows of coefficients that belong to them.
fn read_support(
    file: &SafeTensors<'_>,
    at: usize,
    stored: StoredSupport,
) -> Result<(Arc<Support>, std::vec::IntoIter<Vec<f64>>)> {
    let (shape, bytes) = tensor(file, &format!("{at}/embeddings"), Dtype::F32)?;
    let (chunks, _) = bytes.as_chunks::<4>();
    let values: Vec<f32> = chunks.iter().map(|b| f32::from_le_bytes(*b)).collect();
    let embeddings = Embeddings::new(&Tensor::from_vec(values, shape, &Device::Cpu)?)?;
    if embeddings.surfaces() == 0 || embeddings.views() != stored.scales.len() {
        return Err(refused(
            format_args!(
                "{} surfaces of {} views, {} scales",
                embeddings.surfaces(),
                embeddings.views(),
                stored.scales.len()
            ),
            "a surface, and a scale for each view",
        ));
    }
    for &scale in &stored.scales {
        positive("scale", scale)?;
    }
    let (shape, bytes) = tensor(file, &format!("{at}/coefficients"), Dtype::F64)?;
    if shape.len() != 2 || shape[1] != embeddings.surfaces() {
        let expected = format_args!("{} a regression", embeddings.surfaces());
        return Err(refused(format_args!("coefficients {shape:?}"), expected));
    }
    let (chunks, _) = bytes.as_chunks::<8>();
    let values: Vec<f64> = chunks.iter().map(|b| f64::from_le_bytes(*b)).collect();
    if let Some(value) = values.iter().find(|value| !value.is_finite()) {
        return Err(refused(format_args!("coefficient {value}"), "finite ones"));
    }
    let rows = values.chunks(embeddings.surfaces()).map(<[f64]>::to_vec);
    let rows: Vec<_> = rows.collect();
    let support = Support {
        kernel: stored.kernel,
        embeddings,
        scales: stored.scales,
    };
    Ok((Arc::new(support), rows.into_iter()))
}

fn tensor<'a>(file: &SafeTensors<'a>, name: &str, dtype: Dtype) -> Result<(Vec<usize>, &'a [u8])> {
    let tensor = file.tensor(name).map_err(|error| refused(error, name))?;
    if tensor.dtype() != dtype {
        return Err(refused(
            format_args!("{name} of type {:?}", tensor.dtype()),
            format_args!("{dtype:?}"),
        ));
    }
    Ok((tensor.shape().to_vec(), tensor.data()))
}

fn positive(what: &str, value: f64) -> Result<()> {
    if value > 0.0 {
        return Ok(());
    }
    Err(refused(format_args!("{what} {value}"), "above 0"))
}

fn refused(found: impl Display, expected: impl Display) -> Error {
    Error::input(WHAT, found, expected)
}

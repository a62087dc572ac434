//! Fitted regressions as safetensors. The training surfaces that some share are there once, as
//! `i/embeddings`, f32, `(surfaces, views, width)`, and their coefficients beside them as
//! `i/coefficients`, f64, `(regressions, surfaces)`; the metadata hold the rest as JSON. Those of a first stage stand
//! before the others, each after what is estimated of the training surfaces.

use std::sync::Arc;

use serde::{Deserialize, Serialize};

use super::first_stage::{FirstFit, FirstStage};
use super::fit::{Expansion, Fit};
use super::kernel::Proximity;
use super::{Kernel, Shape, Sharing, Support, TrainedKernelRidge};
use crate::archive::{Archive, Content, Contents, Rows, stored_blocks};
use crate::error::Result;
use crate::plan::Trial;
use crate::regressor::check_finite;

static FILE: Archive = Archive {
    what: "kernel ridge regressions",
    key: "sps-kernel-ridges",
    format: 1,
};

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
    /// Of the regressions that say no other.
    kernel: Kernel,
    /// Of each view and block.
    scales: Vec<f64>,
    /// The blocks of a view; none where it is one.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    blocks: Vec<usize>,
    /// The fits of a first stage; none where there is but one stage.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    first: Vec<StoredFirst>,
}

#[derive(Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
struct StoredFirst {
    unit: f64,
    intercept: f64,
    left_out_error: Option<f64>,
    expansion: Option<Chosen>,
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
    #[serde(default, skip_serializing_if = "Option::is_none")]
    kernel: Option<Kernel>,
    width: f64,
    #[serde(default)]
    leaning: f64,
    penalty: f64,
}

pub(super) fn to_bytes(models: &[TrainedKernelRidge]) -> Result<Vec<u8>> {
    for TrainedKernelRidge { fit, support, .. } in models {
        let coefficients = fit.expansion.iter().flat_map(|e| &e.coefficients);
        let numbers = fit.left_out_error.iter().chain(&support.scales);
        let numbers = numbers.chain(coefficients).chain([&fit.intercept]);
        check_finite(FILE.what, numbers.copied())?;
        for first in first_fits(support) {
            let numbers = first.fit.coefficients().into_iter().flatten();
            let numbers = numbers.chain([&first.fit.intercept, &first.unit]);
            check_finite(FILE.what, numbers.chain(&first.left_out).copied())?;
        }
    }
    // `support` is set below, where the regressions that share one stand together.
    let stored = |ridge: &TrainedKernelRidge| {
        let usual = usual(ridge.support.proximity);
        Stored {
            trial: ridge.trial.clone(),
            support: 0,
            intercept: ridge.fit.intercept,
            left_out_error: ridge.fit.left_out_error,
            expansion: ridge.fit.expansion.as_ref().map(|e| Chosen::of(e, usual)),
        }
    };
    let mut metadata = Metadata {
        format: FILE.format,
        supports: Vec::new(),
        ridges: models.iter().map(stored).collect(),
    };
    let mut contents = Vec::new();
    for (at, sharing) in Sharing::of(models).iter().enumerate() {
        let support = sharing.support;
        metadata.supports.push(StoredSupport {
            kernel: usual(support.proximity),
            scales: support.scales.clone(),
            blocks: stored_blocks([&support.embeddings].into_iter()),
            first: first_fits(support).map(StoredFirst::of).collect(),
        });
        for &ridge in &sharing.ridges {
            metadata.ridges[ridge].support = at;
        }
        let ridges = sharing.ridges.iter().map(|&ridge| &models[ridge]);
        let first = first_fits(support)
            .flat_map(|first| [Some(&first.left_out[..]), first.fit.coefficients()]);
        let rows = first.chain(ridges.map(|ridge| ridge.fit.coefficients()));
        let rows: Vec<&[f64]> = rows.flatten().collect();
        contents.extend(Content::set(at, &support.embeddings, "coefficients", &rows));
    }
    FILE.write(&metadata, &contents)
}

pub(super) fn from_bytes(bytes: &[u8]) -> Result<Vec<TrainedKernelRidge>> {
    let (metadata, contents) = FILE.read::<Metadata>(bytes)?;
    // Two for each set of training surfaces.
    contents.check_count(2 * metadata.supports.len())?;
    let supports = metadata.supports.into_iter().enumerate();
    let supports = supports.map(|(at, stored)| read_support(&contents, at, stored));
    let mut supports = supports.collect::<Result<Vec<_>>>()?;
    let mut ridges = Vec::with_capacity(metadata.ridges.len());
    for stored in metadata.ridges {
        let Some((support, usual, rows)) = supports.get_mut(stored.support) else {
            let found = format_args!("training surfaces {}", stored.support);
            return Err(FILE.refused(found, "some that are there"));
        };
        let expansion = stored.expansion.map(|chosen| chosen.read(*usual, rows));
        ridges.push(TrainedKernelRidge {
            trial: stored.trial,
            fit: Fit {
                intercept: stored.intercept,
                left_out_error: stored.left_out_error,
                expansion: expansion.transpose()?,
            },
            support: Arc::clone(support),
        });
    }
    let mut rows = supports.iter_mut().map(|(_, _, rows)| rows);
    if rows.any(|rows| rows.next().is_some()) {
        return Err(FILE.refused("coefficients of no regression", "none such"));
    }
    Ok(ridges)
}

/// Training surfaces, the kernel of regressions that say no other, and the rows of coefficients that belong to
/// them.
fn read_support(
    contents: &Contents<'_>,
    at: usize,
    stored: StoredSupport,
) -> Result<(Arc<Support>, Kernel, Rows)> {
    let (embeddings, mut rows) = contents.set(at, "coefficients", &stored.blocks)?;
    let kernels = embeddings.views() * embeddings.blocks().len();
    if kernels != stored.scales.len() {
        let scales = stored.scales.len();
        let found = format_args!("{kernels} blocks of views, {scales} scales");
        return Err(FILE.refused(found, "a scale for each"));
    }
    for &scale in &stored.scales {
        positive("scale", scale)?;
    }
    let first = stored.first.into_iter().map(|first| {
        positive("unit", first.unit)?;
        let left_out = next(&mut rows)?;
        let expansion = first
            .expansion
            .map(|chosen| chosen.read(stored.kernel, &mut rows));
        Ok(FirstFit {
            fit: Fit {
                intercept: first.intercept,
                left_out_error: first.left_out_error,
                expansion: expansion.transpose()?,
            },
            unit: first.unit,
            left_out,
        })
    });
    let first = first.collect::<Result<Vec<_>>>()?;
    let proximity = Proximity::of(&[Shape::even(stored.kernel, 1.0)]);
    if proximity == Proximity::Product && !first.is_empty() {
        return Err(FILE.refused("a first stage of linear kernels", "other kernels"));
    }
    let support = Support {
        proximity,
        embeddings,
        scales: stored.scales,
        first: (!first.is_empty()).then(|| FirstStage::new(first)),
    };
    Ok((Arc::new(support), stored.kernel, rows))
}

fn first_fits(support: &Support) -> impl Iterator<Item = &FirstFit> {
    support.first.iter().flat_map(|stage| &stage.fits)
}

impl StoredFirst {
    fn of(FirstFit { fit, unit, .. }: &FirstFit) -> Self {
        Self {
            unit: *unit,
            intercept: fit.intercept,
            left_out_error: fit.left_out_error,
            expansion: fit
                .expansion
                .as_ref()
                .map(|e| Chosen::of(e, Kernel::Exponential)),
        }
    }
}

impl Chosen {
    fn of(expansion: &Expansion, usual: Kernel) -> Self {
        Self {
            kernel: Some(expansion.shape.kernel).filter(|kernel| *kernel != usual),
            width: expansion.shape.width,
            leaning: expansion.shape.leaning,
            penalty: expansion.penalty,
        }
    }

    /// With its coefficients, the next of these rows.
    fn read(self, usual: Kernel, rows: &mut Rows) -> Result<Expansion> {
        let shape = Shape {
            kernel: self.kernel.unwrap_or(usual),
            width: self.width,
            leaning: self.leaning,
        };
        positive("width", shape.width)?;
        if Proximity::of(&[shape]) != Proximity::of(&[Shape::even(usual, 1.0)]) {
            return Err(FILE.refused("a linear kernel among others", "none such"));
        }
        Ok(Expansion {
            shape,
            penalty: self.penalty,
            coefficients: next(rows)?,
        })
    }
}

fn next(rows: &mut Rows) -> Result<Vec<f64>> {
    let missing = || FILE.refused("too few coefficients", "some for each regression");
    rows.next().ok_or_else(missing)
}

/// The kernel that a file need not say of each regression.
fn usual(proximity: Proximity) -> Kernel {
    match proximity {
        Proximity::Distance => Kernel::Exponential,
        Proximity::Product => Kernel::Linear,
    }
}

fn positive(what: &str, value: f64) -> Result<()> {
    if value > 0.0 {
        return Ok(());
    }
    Err(FILE.refused(format_args!("{what} {value}"), "above 0"))
}

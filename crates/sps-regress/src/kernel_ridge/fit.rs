use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::evd::{self, ComputeEigenvectors};
use faer::{Col, Mat, Par, Spec};

use super::kernel::Shape;
use crate::dense::{cleanly, product};
use crate::error::{Error, Result};
use crate::left_out::{LeftOut, LeftOutBlock};

/// The centred kernel matrix of some surfaces on its principal axes, where every penalty is
/// compared in closed form. All fits to the same surfaces share it.
pub(super) struct Spectrum {
    shape: Shape,
    penalties: Vec<f64>,
    /// Mean of each column of the kernel matrix.
    means: Vec<f64>,
    /// Trace of the centred kernel matrix: what a penalty is told in.
    trace: f64,
    /// Eigenvalues of the centred kernel matrix, none below zero.
    values: Vec<f64>,
    /// Its eigenvectors, as columns.
    vectors: Mat<f64>,
    /// The identity less the hat matrix, by penalty.
    blocks: Vec<Vec<LeftOutBlock>>,
}

/// The surfaces' kernel expansion `f(x) = intercept + sum of coefficient times k(x, surface)`.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Fit {
    pub(super) intercept: f64,
    /// Mean squared error when each part is left out; none of one surface alone. As the least of many, it
    /// lies slightly below the error of a new one.
    pub(super) left_out_error: Option<f64>,
    /// None where the mean of the readings does best.
    pub(super) expansion: Option<Expansion>,
}

#[derive(Clone, Debug, PartialEq)]
pub(super) struct Expansion {
    pub(super) shape: Shape,
    pub(super) penalty: f64,
    /// One per training surface.
    pub(super) coefficients: Vec<f64>,
}

impl Spectrum {
    /// Decomposes a kernel matrix, of which both triangles are there.
    pub(super) fn new(
        mut kernel: Mat<f64>,
        shape: Shape,
        penalties: &[f64],
        left_out: &LeftOut,
    ) -> Result<Self> {
        let means = centre(&mut kernel);
        let (values, vectors) = decompose(&kernel)?;
        let mut spectrum = Self {
            shape,
            penalties: penalties.to_vec(),
            means,
            trace: (0..kernel.nrows()).map(|i| kernel[(i, i)]).sum(),
            values,
            vectors,
            blocks: Vec::new(),
        };
        spectrum.blocks = spectrum.blocks(left_out);
        Ok(spectrum)
    }

    fn blocks(&self, left_out: &LeftOut) -> Vec<Vec<LeftOutBlock>> {
        let surfaces = self.values.len();
        // The intercept's own leverage.
        let level = 1.0 / surfaces as f64;
        let squared = Mat::from_fn(surfaces, surfaces, |i, j| self.vectors[(i, j)].powi(2));
        let kept = Mat::from_fn(surfaces, self.penalties.len(), |k, p| self.kept(k, p));
        let slack = product(squared.as_ref(), &kept);
        let several = |part: &[usize], penalty: usize| {
            let rows = Mat::from_fn(part.len(), surfaces, |i, k| self.vectors[(part[i], k)]);
            let kept = Mat::from_fn(surfaces, part.len(), |k, i| {
                rows[(i, k)] * kept[(k, penalty)]
            });
            let mut block = product(rows.as_ref(), &kept);
            let values = block.col_iter_mut().flat_map(faer::ColMut::iter_mut);
            values.for_each(|value| *value -= level);
            block
        };
        let of = |p| left_out.blocks(|i| slack[(i, p)] - level, |part| several(part, p));
        (0..self.penalties.len()).map(of).collect()
    }

    /// The part of the readings along an axis that a penalty leaves as residual.
    fn kept(&self, axis: usize, penalty: usize) -> f64 {
        let ridge = self.penalties[penalty] * self.trace;
        ridge / (self.values[axis] + ridge)
    }

    /// The mean squared error when each part is left out, by penalty. The values are centred.
    fn left_out_errors(&self, values: &[f64], left_out: &LeftOut) -> Vec<f64> {
        let along = self.along(values);
        let kept = Mat::from_fn(values.len(), self.penalties.len(), |k, p| {
            along[k] * self.kept(k, p)
        });
        let residuals = product(self.vectors.as_ref(), &kept);
        let error = |(penalty, blocks): (usize, &Vec<LeftOutBlock>)| {
            left_out.squared_error(|i| residuals[(i, penalty)], blocks)
        };
        self.blocks.iter().enumerate().map(error).collect()
    }

    /// What is estimated of each part by the others, with the penalty that a fit chose.
    pub(super) fn left_out_estimates(
        &self,
        values: &[f64],
        left_out: &LeftOut,
        penalty: f64,
    ) -> Option<Vec<f64>> {
        let penalty = self.penalties.iter().position(|of| *of == penalty)?;
        let level = mean(values);
        let centred: Vec<f64> = values.iter().map(|value| value - level).collect();
        let along = self.along(&centred);
        let kept = Mat::from_fn(values.len(), 1, |k, _| along[k] * self.kept(k, penalty));
        let residuals = product(self.vectors.as_ref(), &kept);
        let errors = left_out.errors(|i| residuals[(i, 0)], &self.blocks[penalty]);
        Some(values.iter().zip(errors).map(|(v, e)| v - e).collect())
    }

    /// Of this kernel.
    pub(super) fn shape(&self) -> Shape {
        self.shape
    }

    /// The values on the principal axes.
    fn along(&self, values: &[f64]) -> Vec<f64> {
        let on_axis = |axis: faer::ColRef<'_, f64>| {
            let products = axis.iter().zip(values).map(|(a, v)| a * v);
            products.sum()
        };
        self.vectors.col_iter().map(on_axis).collect()
    }

    fn expansion(&self, values: &[f64], penalty: usize) -> Expansion {
        let ridge = self.penalties[penalty] * self.trace;
        let along = self.along(values);
        let mut coefficients = vec![0.0; values.len()];
        for ((axis, along), value) in self.vectors.col_iter().zip(along).zip(&self.values) {
            let factor = along / (value + ridge);
            for (coefficient, &direction) in coefficients.iter_mut().zip(axis.iter()) {
                *coefficient += factor * direction;
            }
        }
        Expansion {
            shape: self.shape,
            penalty: self.penalties[penalty],
            coefficients,
        }
    }
}

impl Fit {
    /// The kernel and penalty of least error when each part is left out, or the mean of `values`
    /// where that is as good.
    pub(super) fn best(spectra: &[Spectrum], values: &[f64], left_out: &LeftOut) -> Self {
        let level = mean(values);
        let centred: Vec<f64> = values.iter().map(|value| value - level).collect();
        let mut best = (left_out.error_of_the_mean(&centred), None);
        // Surfaces that do not differ leave nothing to learn from.
        for spectrum in spectra.iter().filter(|spectrum| spectrum.trace > 0.0) {
            let errors = spectrum.left_out_errors(&centred, left_out);
            for (penalty, error) in errors.into_iter().enumerate() {
                if best.0.is_some_and(|least| error < least) {
                    best = (Some(error), Some((spectrum, penalty)));
                }
            }
        }
        let (left_out_error, chosen) = best;
        let Some((spectrum, penalty)) = chosen else {
            return Self {
                intercept: level,
                left_out_error,
                expansion: None,
            };
        };
        Self {
            left_out_error,
            ..Self::with(spectrum, values, penalty)
        }
    }

    pub(super) fn coefficients(&self) -> Option<&[f64]> {
        self.expansion.as_ref().map(|e| &e.coefficients[..])
    }

    /// The estimates of so many surfaces by the kernels of these shapes, `(training surfaces, surfaces)`.
    pub(super) fn estimates(
        &self,
        shapes: &[Shape],
        kernels: &[Mat<f64>],
        surfaces: usize,
    ) -> Vec<f64> {
        let mut estimates = vec![self.intercept; surfaces];
        if let Some(expansion) = &self.expansion {
            let of_shape = shapes.iter().zip(kernels);
            for (_, kernel) in of_shape.filter(|(shape, _)| **shape == expansion.shape) {
                for (estimate, column) in estimates.iter_mut().zip(kernel.col_iter()) {
                    let terms = column.iter().zip(&expansion.coefficients);
                    *estimate += terms.map(|(k, c)| k * c).sum::<f64>();
                }
            }
        }
        estimates
    }

    /// The fit with one of the penalties; its error is still to be told.
    pub(super) fn with(spectrum: &Spectrum, values: &[f64], penalty: usize) -> Self {
        let level = mean(values);
        let centred: Vec<f64> = values.iter().map(|value| value - level).collect();
        let expansion = spectrum.expansion(&centred, penalty);
        let terms = expansion.coefficients.iter().zip(&spectrum.means);
        Self {
            intercept: level - terms.map(|(c, m)| c * m).sum::<f64>(),
            left_out_error: None,
            expansion: Some(expansion),
        }
    }
}

pub(super) fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len().max(1) as f64
}

/// Takes the mean off each column and row of a symmetric matrix; returns the means of the columns.
fn centre(kernel: &mut Mat<f64>) -> Vec<f64> {
    let samples = kernel.nrows().max(1) as f64;
    let sum = |column: faer::ColRef<'_, f64>| column.iter().sum::<f64>() / samples;
    let means: Vec<f64> = kernel.col_iter().map(sum).collect();
    let all = mean(&means);
    for (column, of_column) in kernel.col_iter_mut().zip(&means) {
        for (value, of_row) in column.iter_mut().zip(&means) {
            *value += all - of_column - of_row;
        }
    }
    means
}

/// Eigenvalues, none below zero, and eigenvectors as columns.
///
/// The call names sequential execution, so that no setting elsewhere can change a bit.
fn decompose(matrix: &Mat<f64>) -> Result<(Vec<f64>, Mat<f64>)> {
    let size = matrix.nrows();
    let mut vectors = Mat::zeros(size, size);
    let mut values = Col::<f64>::zeros(size);
    let scratch = evd::self_adjoint_evd_scratch::<f64>(
        size,
        ComputeEigenvectors::Yes,
        Par::Seq,
        Spec::default(),
    );
    cleanly(|| {
        evd::self_adjoint_evd(
            matrix.as_ref(),
            values.as_mut().as_diagonal_mut(),
            Some(vectors.as_mut()),
            Par::Seq,
            MemStack::new(&mut MemBuffer::new(scratch)),
            Spec::default(),
        )
    })
    .map_err(|_| Error::input("kernel matrix", "no decomposition", "one that converges"))?;
    Ok((values.iter().map(|value| value.max(0.0)).collect(), vectors))
}

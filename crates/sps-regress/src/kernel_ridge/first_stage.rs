//! The first of two fits: what it estimates of all properties is one block more for the second.

use faer::Mat;
use sps_base::parallel;

use super::fit::{Fit, Spectrum, mean};
use super::kernel::{Proximity, Shape};
use crate::left_out::LeftOut;

/// Fits to the readings of several properties of the same surfaces.
#[derive(Debug, PartialEq)]
pub(super) struct FirstStage {
    pub(super) fits: Vec<FirstFit>,
    /// Median distance between the training surfaces' estimates.
    scale: f64,
}

#[derive(Debug, PartialEq)]
pub(super) struct FirstFit {
    pub(super) fit: Fit,
    /// Standard deviation of the readings, the unit of estimates.
    pub(super) unit: f64,
    /// What is estimated of each training surface by the others, or of each unit of them.
    pub(super) left_out: Vec<f64>,
}

impl FirstStage {
    pub(super) fn new(fits: Vec<FirstFit>) -> Self {
        let mut stage = Self { fits, scale: 1.0 };
        stage.scale = Proximity::Distance.scale(&stage.distances(&stage.left_out()), None);
        stage
    }

    /// Of these values of each property.
    pub(super) fn of(spectra: &[Spectrum], values: &[Vec<f64>], left_out: &LeftOut) -> Self {
        let fits = parallel::map(values, |values| {
            let fit = Fit::best(spectra, values, left_out);
            let level = mean(values);
            let squared = values.iter().map(|value| (value - level).powi(2));
            let deviation = (squared.sum::<f64>() / values.len() as f64).sqrt();
            let estimates = fit.expansion.as_ref().and_then(|chosen| {
                let spectrum = spectra.iter().find(|of| of.shape() == chosen.shape)?;
                spectrum.left_out_estimates(values, left_out, chosen.penalty)
            });
            let estimates = estimates.filter(|estimates| estimates.iter().all(|x| x.is_finite()));
            FirstFit {
                fit,
                unit: if deviation > 0.0 { deviation } else { 1.0 },
                left_out: estimates.unwrap_or_else(|| vec![level; values.len()]),
            }
        });
        Self::new(fits)
    }

    /// By property, of each training surface.
    fn left_out(&self) -> Vec<&[f64]> {
        self.fits.iter().map(|fit| &fit.left_out[..]).collect()
    }

    /// Adds to kernels of these shapes, `(training surfaces, others)`, those of what is estimated, by property, of the
    /// others.
    pub(super) fn add<'k, E: AsRef<[f64]>>(
        &self,
        kernels: impl Iterator<Item = (Shape, &'k mut Mat<f64>)>,
        estimates: &[E],
    ) {
        let distances = self.distances(estimates);
        for (shape, kernel) in kernels {
            for (kernel, distances) in kernel.col_iter_mut().zip(distances.col_iter()) {
                for (value, &distance) in kernel.iter_mut().zip(distances.iter()) {
                    *value += shape.at(distance, self.scale);
                }
            }
        }
    }

    /// The same between training surfaces.
    pub(super) fn add_own<'k>(&self, kernels: impl Iterator<Item = (Shape, &'k mut Mat<f64>)>) {
        self.add(kernels, &self.left_out());
    }

    /// From each training surface to each of those that are estimated so.
    fn distances<E: AsRef<[f64]>>(&self, estimates: &[E]) -> Mat<f64> {
        let surfaces = self.fits.first().map_or(0, |fit| fit.left_out.len());
        let others = estimates.first().map_or(0, |of| of.as_ref().len());
        Mat::from_fn(surfaces, others, |i, j| {
            let fits = self.fits.iter().zip(estimates);
            let apart =
                fits.map(|(fit, of)| ((fit.left_out[i] - of.as_ref()[j]) / fit.unit).powi(2));
            apart.sum::<f64>().sqrt()
        })
    }
}

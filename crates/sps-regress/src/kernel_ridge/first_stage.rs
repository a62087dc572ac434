//! The first of two fits: what it estimates of all properties is one block more for the second.

use faer::Mat;
use sps_base::parallel;

use super::fit::{Fit, Spectrum, mean};
use super::kernel::{Proximity, Shape};
use crate::groups::Group;

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

    /// Of the properties of a group.
    pub(super) fn of(spectra: &[Spectrum], group: &Group<'_>) -> Self {
        let fits = parallel::map(&group.jobs, |job| {
            let fit = Fit::best(spectra, &job.values, &group.left_out);
            let level = mean(&job.values);
            let squared = job.values.iter().map(|value| (value - level).powi(2));
            let deviation = (squared.sum::<f64>() / job.values.len() as f64).sqrt();
            let left_out = fit.expansion.as_ref().and_then(|chosen| {
                let spectrum = spectra.iter().find(|of| of.shape() == chosen.shape)?;
                spectrum.left_out_estimates(&job.values, &group.left_out, chosen.penalty)
            });
            let left_out = left_out.filter(|estimates| estimates.iter().all(|x| x.is_finite()));
            FirstFit {
                fit,
                unit: if deviation > 0.0 { deviation } else { 1.0 },
                left_out: left_out.unwrap_or_else(|| vec![level; job.values.len()]),
            }
        });
        Self::new(fits)
    }

    /// `(surfaces, properties)`.
    fn left_out(&self) -> Vec<Vec<f64>> {
        self.fits.iter().map(|fit| fit.left_out.clone()).collect()
    }

    /// Adds to the kernel of this shape, `(training surfaces, others)`, that of the others' estimates, by property.
    pub(super) fn add(&self, kernel: &mut Mat<f64>, shape: Shape, estimates: &[Vec<f64>]) {
        let distances = self.distances(estimates);
        for (kernel, distances) in kernel.col_iter_mut().zip(distances.col_iter()) {
            for (value, &distance) in kernel.iter_mut().zip(distances.iter()) {
                *value += shape.at(distance, self.scale);
            }
        }
    }

    /// The same between training surfaces.
    pub(super) fn add_own(&self, kernel: &mut Mat<f64>, shape: Shape) {
        self.add(kernel, shape, &self.left_out());
    }

    fn distances(&self, estimates: &[Vec<f64>]) -> Mat<f64> {
        let count = |estimates: Option<&Vec<f64>>| estimates.map_or(0, Vec::len);
        let surfaces = count(self.fits.first().map(|fit| &fit.left_out));
        Mat::from_fn(surfaces, count(estimates.first()), |i, j| {
            let fits = self.fits.iter().zip(estimates);
            let apart = fits.map(|(fit, other)| ((fit.left_out[i] - other[j]) / fit.unit).powi(2));
            apart.sum::<f64>().sqrt()
        })
    }
}

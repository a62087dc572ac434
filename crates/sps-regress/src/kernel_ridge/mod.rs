//! Kernel ridge regression from embeddings to tactile values: a strong, cheap baseline for every network.

mod design;
mod first_stage;
mod fit;
mod kernel;
mod set_losses;
mod store;

use std::ops::Range;
use std::sync::Arc;

use faer::Mat;
use serde::{Deserialize, Serialize};
use sps_base::parallel;

use crate::data::Embeddings;
use crate::error::{Error, Result};
use crate::fitted::{Fitted, FittedModel};
use crate::groups::{Group, fit_groups, sharing};
use crate::plan::{Plan, TrainingData, Trial};
use crate::regressor::{check_fits, check_positive};
use first_stage::FirstStage;
use fit::{Fit, Spectrum};
pub use kernel::{Kernel, Shape};
use kernel::{Part, Points, Proximity};
pub use set_losses::SetLosses;

/// Surfaces that are estimated at once.
const ROWS: usize = 512;

/// Settings of [`KernelRidge`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields, default)]
pub struct KernelRidgeConfig {
    /// The kernels to choose from, all of them linear or none. Default: exponential of width 4, with
    /// [`Shape::leaning`] 0 or 4.
    pub kernels: Vec<Shape>,
    /// The penalties to choose from, each in units of the kernel's variance: `l` in
    /// `|y - f|² / n + l v |f|²`, of `n` surfaces, with `v` the mean diagonal element of the centred kernel
    /// matrix.
    pub penalties: Vec<f64>,
    /// The most training surfaces that a fit uses, 4000 by default: of more, as many are drawn at random, by
    /// the plan's seed and the rerun. Time grows with the third power of their number, memory with its
    /// square. [`SetLosses`] take all that they are given.
    pub at_most: usize,
    /// Whether each property is fitted twice. The first fits estimate all properties, of a training surface without its
    /// own readings; to the second fit these estimates are one block more, which counts as much as all others together.
    /// Default: false.
    ///
    /// Stacked single-target regression (Spyromitros-Xioufis, Tsoumakas, Groves and Vlahavas, "Multi-target regression
    /// via input space expansion", Machine Learning 104, 2016). All properties are those with a reading of every
    /// surface that the fit stands on, whether the plan asks for them or not; of one alone there is no second fit.
    /// [`SetLosses`] do without.
    pub stacked_targets: bool,
}

impl Default for KernelRidgeConfig {
    fn default() -> Self {
        Self {
            kernels: [0.0, 4.0]
                .map(|leaning| Shape {
                    leaning,
                    ..Shape::even(Kernel::Exponential, 4.0)
                })
                .to_vec(),
            penalties: vec![
                1e-6, 1e-5, 3.16e-5, 1e-4, 3.16e-4, 1e-3, 3.16e-3, 0.01, 0.0316, 0.1, 0.316, 1.0,
                3.16,
            ],
            at_most: 4000,
            stacked_targets: false,
        }
    }
}

/// Kernel ridge regression (Saunders, Gammerman and Vovk 1998) with an intercept; kernel and penalty
/// are those that predict best when each training surface, or unit of them
/// ([`TrainingData::units`]), is left out in turn, which has a closed form (Golub, Heath and Wahba
/// 1979).
///
/// The mean of the training readings is one of the choices, and is taken where nothing predicts
/// better: an unpredictable property falls back to it.
///
/// Several views: the mean of the views' kernels, the first compared with the first, and so on. One view: the
/// weighted mean of its blocks' kernels, each with its own scale; [`Shape`] gives the weights.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct KernelRidge(KernelRidgeConfig);

impl KernelRidge {
    /// Checks a configuration.
    ///
    /// # Errors
    /// No penalty or kernel, a penalty or width that is not above zero, a leaning that is not finite, linear kernels
    /// among others; no surface to stand on.
    pub fn new(config: KernelRidgeConfig) -> Result<Self> {
        let widths: Vec<f64> = config.kernels.iter().map(|shape| shape.width).collect();
        check_positive("penalties of kernel ridge regression", &config.penalties)?;
        check_positive("widths of kernels", &widths)?;
        if let Some(shape) = config.kernels.iter().find(|s| !s.leaning.is_finite()) {
            let expected = "a finite number";
            return Err(Error::input("leaning of a kernel", shape.leaning, expected));
        }
        let linear = config.kernels.iter().filter(|s| s.kernel == Kernel::Linear);
        if !(linear.count() == 0 || Proximity::all_linear(&config.kernels)) {
            let found = "linear ones among others";
            let expected = "none but linear ones, or none of these";
            return Err(Error::input("kernels to choose from", found, expected));
        }
        if config.stacked_targets && Proximity::all_linear(&config.kernels) {
            let expected = "none with stacked targets";
            return Err(Error::input(
                "kernels to choose from",
                "linear ones",
                expected,
            ));
        }
        if config.at_most == 0 {
            let what = "surfaces that kernel ridge regression stands on";
            return Err(Error::input(what, 0, "at least 1"));
        }
        Ok(Self(config))
    }

    /// The configuration.
    pub fn config(&self) -> &KernelRidgeConfig {
        &self.0
    }

    /// Fits every trial of the plan, on the threads of the current rayon pool. A trial's fit
    /// depends on its own data alone.
    ///
    /// # Errors
    /// A plan that does not fit the data, a trial without fixed views, a property without a
    /// training reading.
    pub fn train(&self, data: &TrainingData<'_>, plan: &Plan) -> Result<TrainedKernelRidges> {
        let plan = plan.thinned(self.0.at_most);
        let ridges = fit_groups(data, &plan, |group| self.fit(group))?;
        Ok(Fitted(ridges))
    }

    fn fit(&self, group: &Group<'_>) -> Result<Vec<TrainedKernelRidge>> {
        let (scales, mut kernels) = self.kernels(&group.embeddings);
        let spectra = |kernels: Vec<(Shape, Mat<f64>)>| {
            let spectra = parallel::map(kernels, |(shape, kernel)| {
                Spectrum::new(kernel, shape, &self.0.penalties, &group.left_out)
            });
            spectra.into_iter().collect::<Result<Vec<_>>>()
        };
        let mut first = None;
        if self.0.stacked_targets {
            let values = group.read_of_all();
            if values.len() > 1 {
                let spectra = spectra(kernels.clone())?;
                let stage = FirstStage::of(&spectra, &values, &group.left_out);
                stage.add_own(kernels.iter_mut().map(|(shape, kernel)| (*shape, kernel)));
                first = Some(stage);
            }
        }
        let spectra = spectra(kernels)?;
        let support = Arc::new(Support {
            proximity: Proximity::of(&self.0.kernels),
            embeddings: group.embeddings.clone(),
            scales,
            first,
        });
        Ok(parallel::map(&group.jobs, |job| TrainedKernelRidge {
            trial: job.trial.clone(),
            fit: Fit::best(&spectra, &job.values, &group.left_out),
            support: Arc::clone(&support),
        }))
    }

    /// The scale of each block of each view, and the matrix of the surfaces by each kernel.
    fn kernels(&self, embeddings: &Embeddings) -> (Vec<f64>, Vec<(Shape, Mat<f64>)>) {
        let surfaces = embeddings.surfaces();
        let proximity = Proximity::of(&self.0.kernels);
        let zeros = |shape| (shape, Mat::zeros(surfaces, surfaces));
        let mut sums: Vec<_> = self.shapes(embeddings).into_iter().map(zeros).collect();
        let mut scales = Vec::new();
        for part in Part::all(embeddings) {
            let points = Points::new(proximity, embeddings, part);
            let (proximities, scale) = points.among_themselves();
            scales.push(scale);
            parallel::each(&mut sums, |(shape, sum)| {
                points.add(sum, &proximities, scale, *shape);
            });
        }
        (scales, sums)
    }

    /// The kernels that differ: how far they lean makes no difference to one block.
    fn shapes(&self, embeddings: &Embeddings) -> Vec<Shape> {
        let mut shapes: Vec<Shape> = Vec::new();
        for &shape in &self.0.kernels {
            let shape = match embeddings.blocks() {
                [_] => Shape::even(shape.kernel, shape.width),
                _ => shape,
            };
            if !shapes.contains(&shape) {
                shapes.push(shape);
            }
        }
        shapes
    }
}

/// The training surfaces of some regressions.
#[derive(Debug, PartialEq)]
struct Support {
    proximity: Proximity,
    /// The views in the order of the trial's.
    embeddings: Embeddings,
    /// Of each block of each view.
    scales: Vec<f64>,
    /// Whose estimates are one block more, where there are two stages.
    first: Option<FirstStage>,
}

impl Support {
    fn first_fits(&self) -> impl Iterator<Item = &Fit> {
        let fits = self.first.iter().flat_map(|stage| &stage.fits);
        fits.map(|first| &first.fit)
    }

    /// Matrices `(training surfaces, those in the range)`, one for each of the kernels, that of the first estimates
    /// among them.
    fn kernels(
        &self,
        embeddings: &Embeddings,
        range: &Range<usize>,
        shapes: &[Shape],
    ) -> Vec<Mat<f64>> {
        let mut kernels = self.kernels_of_embeddings(embeddings, range, shapes);
        if let Some(stage) = &self.first {
            let estimate = |fit: &Fit| fit.estimates(shapes, &kernels, range.len());
            let estimates: Vec<_> = self.first_fits().map(estimate).collect();
            stage.add(shapes.iter().copied().zip(&mut kernels), &estimates);
        }
        kernels
    }

    fn kernels_of_embeddings(
        &self,
        embeddings: &Embeddings,
        range: &Range<usize>,
        shapes: &[Shape],
    ) -> Vec<Mat<f64>> {
        let zeros = |_: &Shape| Mat::zeros(self.embeddings.surfaces(), range.len());
        let mut sums: Vec<Mat<f64>> = shapes.iter().map(zeros).collect();
        for (part, &scale) in Part::all(&self.embeddings).zip(&self.scales) {
            let points = Points::new(self.proximity, &self.embeddings, part);
            let proximities = points.proximities(embeddings, range.clone());
            for (sum, &shape) in sums.iter_mut().zip(shapes) {
                points.add(sum, &proximities, scale, shape);
            }
        }
        sums
    }
}

/// One fitted kernel ridge regression.
#[derive(Clone, Debug, PartialEq)]
pub struct TrainedKernelRidge {
    trial: Trial,
    fit: Fit,
    /// Shared by the regressions on the same views of the same surfaces.
    support: Arc<Support>,
}

impl TrainedKernelRidge {
    /// The penalty that was chosen, in the units of [`KernelRidgeConfig::penalties`]; `None` where
    /// the mean of the training readings is the estimate.
    pub fn penalty(&self) -> Option<f64> {
        self.fit.expansion.as_ref().map(|e| e.penalty)
    }

    /// The kernel that was chosen; `None` where the mean of the training readings is the estimate.
    pub fn shape(&self) -> Option<Shape> {
        self.fit.expansion.as_ref().map(|e| e.shape)
    }

    /// Mean squared error, in squared measured units, of each training surface or unit when it is left out,
    /// with the kernel and penalty that were chosen; `None` of a single surface. As the least of many, it lies
    /// slightly below the error of a new one; with [stacked targets](KernelRidgeConfig::stacked_targets) further, as
    /// the first fits to the other surfaces saw its readings.
    pub fn left_out_error(&self) -> Option<f64> {
        self.fit.left_out_error
    }
}

/// Fitted kernel ridge regressions.
pub type TrainedKernelRidges = Fitted<TrainedKernelRidge>;

impl FittedModel for TrainedKernelRidge {
    const KIND: &'static str = "kernel-ridges";

    fn trial(&self) -> &Trial {
        &self.trial
    }

    /// On the threads of the current rayon pool. Regressions that share training surfaces and kernel
    /// are estimated together, which takes little more time than one.
    fn estimate(models: &[Self], embeddings: &Embeddings) -> Result<Vec<Vec<f64>>> {
        let starts = (0..embeddings.surfaces()).step_by(ROWS);
        let ranges = starts.map(|start| start..embeddings.surfaces().min(start + ROWS));
        let ranges: Vec<Range<usize>> = ranges.collect();
        let mut all = vec![Vec::new(); models.len()];
        for one in Sharing::of(models) {
            let what = "embeddings for kernel ridge regression";
            check_fits(what, embeddings, &one.support.embeddings)?;
            let estimate = |range: &Range<usize>| one.estimate(models, embeddings, range);
            for part in parallel::map(&ranges, estimate) {
                for (&at, estimates) in one.ridges.iter().zip(part) {
                    all[at].extend(estimates);
                }
            }
        }
        Ok(all)
    }

    /// Regressions on the same surfaces share the distances to them, and those of one shape the
    /// kernel. An element of a kernel counts as one.
    fn multiply_adds(models: &[Self]) -> u64 {
        let of = |sharing: &Sharing<'_>| {
            let embeddings = &sharing.support.embeddings;
            let fits = sharing.ridges.iter().map(|&at| &models[at].fit);
            let fits = fits.chain(sharing.support.first_fits());
            let expansions = fits.filter(|fit| fit.expansion.is_some());
            let distances = match sharing.shapes.len() {
                0 => 0,
                shapes => embeddings.width() + embeddings.blocks().len() * shapes,
            };
            let first = match sharing.support.first_fits().count() {
                0 => 0,
                fits => fits + sharing.shapes.len(),
            };
            let distances = embeddings.views() * distances + first;
            (embeddings.surfaces() * (distances + expansions.count())) as u64
        };
        Sharing::of(models).iter().map(of).sum()
    }

    fn to_bytes(models: &[Self]) -> Result<Vec<u8>> {
        store::to_bytes(models)
    }

    fn from_bytes(bytes: &[u8]) -> Result<Vec<Self>> {
        store::from_bytes(bytes)
    }
}

/// The regressions that share their training surfaces, by their place among all, and the kernels
/// that they chose.
struct Sharing<'a> {
    support: &'a Arc<Support>,
    ridges: Vec<usize>,
    shapes: Vec<Shape>,
}

impl<'a> Sharing<'a> {
    fn of(models: &'a [TrainedKernelRidge]) -> Vec<Self> {
        let shared = sharing(models.iter().map(|ridge| &ridge.support));
        let of = |(support, ridges): (&'a Arc<Support>, Vec<usize>)| {
            let mut shapes = Vec::new();
            let fits = ridges.iter().map(|&at| &models[at].fit);
            let fits = fits.chain(support.first_fits());
            for shape in fits.filter_map(|fit| fit.expansion.as_ref().map(|e| e.shape)) {
                if !shapes.contains(&shape) {
                    shapes.push(shape);
                }
            }
            Self {
                support,
                ridges,
                shapes,
            }
        };
        shared.into_iter().map(of).collect()
    }

    /// The estimates for some surfaces, by regression.
    fn estimate(
        &self,
        models: &[TrainedKernelRidge],
        embeddings: &Embeddings,
        range: &Range<usize>,
    ) -> Vec<Vec<f64>> {
        let kernels = self.support.kernels(embeddings, range, &self.shapes);
        let fits = self.ridges.iter().map(|&at| &models[at].fit);
        fits.map(|fit| fit.estimates(&self.shapes, &kernels, range.len()))
            .collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// However far a kernel leans, all weights are 1 together.
    #[test]
    fn kernels_lean() {
        for (leaning, expected) in [(1e308, [0.0, 0.0, 1.0]), (-1e308, [1.0, 0.0, 0.0])] {
            let shape = Shape {
                leaning,
                ..Shape::even(Kernel::Exponential, 1.0)
            };
            assert_eq!([0, 1, 2].map(|block| shape.weight(block, 3)), expected);
        }
        // Of one block alone both are one kernel, which is fitted once.
        let one = Embeddings::new(vec![0.5; 8], [1, 1, 8]).unwrap();
        let blocks = one.clone().in_blocks(&[4, 4]).unwrap();
        let shapes = [one, blocks].map(|of| KernelRidge::default().shapes(&of).len());
        assert_eq!(shapes, [1, 2]);
    }
}

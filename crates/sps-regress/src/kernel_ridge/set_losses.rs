use faer::Mat;
use sps_base::parallel;

use super::fit::{Fit, Spectrum};
use super::kernel::Shape;
use super::{KernelRidge, KernelRidgeConfig};
use crate::data::{Embeddings, check_indices};
use crate::error::{Error, Result};
use crate::left_out::LeftOut;
use crate::plan::TrainingData;

/// What a set of views is worth: the error of a [`KernelRidge`] that is fitted anew to the set, each
/// training surface, or unit of them, left out in turn, in closed form. With [`Kernel::Linear`](super::Kernel) it is
/// that of ridge regression.
///
/// Properties with readings of the same training surfaces share one decomposition for each kernel;
/// where gaps differ, each pattern of gaps costs as much as all properties without.
///
/// Every view's kernel is kept, one triangle in f32: `2 n²` bytes for `n` surfaces, for each view,
/// kernel and pattern of gaps.
#[derive(Debug)]
pub struct SetLosses {
    shapes: Vec<Shape>,
    penalties: Vec<f64>,
    properties: usize,
    views: usize,
    patterns: Vec<Pattern>,
}

/// The properties with readings of the same surfaces.
#[derive(Debug)]
struct Pattern {
    surfaces: Vec<usize>,
    left_out: LeftOut,
    columns: Vec<Column>,
    /// By view and kernel: the columns of the lower triangle, one after the other.
    kernels: Vec<Vec<Vec<f32>>>,
}

#[derive(Debug)]
struct Column {
    property: usize,
    values: Vec<f64>,
    variance: f64,
}

impl SetLosses {
    /// Compares the training surfaces in each of their views, on the threads of the current rayon
    /// pool.
    ///
    /// # Errors
    /// A configuration that [`KernelRidge::new`] refuses, tables that do not fit each other, no training surface or one twice, a
    /// surface or property that is not in the tables, a property without a training reading.
    pub fn new(
        data: &TrainingData<'_>,
        properties: &[String],
        training: &[usize],
        config: &KernelRidgeConfig,
    ) -> Result<Self> {
        let ridge = KernelRidge::new(config.clone())?;
        data.check()?;
        check_indices("training surface", training, data.embeddings.surfaces())?;
        let mut training = training.to_vec();
        training.sort_unstable();
        if training.windows(2).any(|pair| pair[0] == pair[1]) {
            return Err(Error::input("training surfaces", "one twice", "each once"));
        }
        let mut patterns: Vec<Pattern> = Vec::new();
        for (property, name) in properties.iter().enumerate() {
            let (surfaces, column) = Column::of(data, property, name, &training)?;
            match patterns.iter_mut().find(|one| one.surfaces == surfaces) {
                Some(pattern) => pattern.columns.push(column),
                None => patterns.push(Pattern {
                    left_out: LeftOut::of(&surfaces, data.units),
                    surfaces,
                    columns: vec![column],
                    kernels: Vec::new(),
                }),
            }
        }
        for pattern in &mut patterns {
            pattern.kernels = kernels(&ridge, data.embeddings, &pattern.surfaces)?;
        }
        Ok(Self {
            shapes: ridge.shapes(data.embeddings),
            penalties: config.penalties.clone(),
            properties: properties.len(),
            views: data.embeddings.views(),
            patterns,
        })
    }

    /// The loss of a set of views, one for each property, in units of the variance of its training
    /// readings, with the kernel and penalty that are best for it; never above that of the mean of
    /// the readings, which is a little above 1, and 0 for readings that do not vary. The order of
    /// the set does not matter; a view may be in it several times.
    ///
    /// # Errors
    /// No view, or one that is not there.
    pub fn losses(&self, set: &[usize]) -> Result<Vec<f64>> {
        check_indices("view of a set", set, self.views)?;
        if set.is_empty() {
            return Err(Error::input("set of views", "none", "at least one"));
        }
        let mut set = set.to_vec();
        set.sort_unstable();
        let mut losses = vec![0.0; self.properties];
        for pattern in &self.patterns {
            let spectra = self.shapes.iter().enumerate().map(|(at, shape)| {
                let views = set.iter().map(|&view| &pattern.kernels[view][at]);
                let kernel = mean(views, pattern.surfaces.len());
                Spectrum::new(kernel, *shape, &self.penalties, &pattern.left_out)
            });
            let spectra = spectra.collect::<Result<Vec<_>>>()?;
            for column in pattern.columns.iter().filter(|one| one.variance > 0.0) {
                let error = Fit::best(&spectra, &column.values, &pattern.left_out).left_out_error;
                losses[column.property] = error.unwrap_or(0.0) / column.variance;
            }
        }
        Ok(losses)
    }
}

impl Column {
    /// The surfaces that have a reading, and their readings.
    fn of(
        data: &TrainingData<'_>,
        property: usize,
        name: &str,
        training: &[usize],
    ) -> Result<(Vec<usize>, Self)> {
        let Some(column) = data.readings.column(name) else {
            let known = data.readings.properties().join(", ");
            let expected = format_args!("one of {known}");
            return Err(Error::input("property of a set's loss", name, expected));
        };
        let read = |&surface: &usize| Some((surface, data.readings.get(surface, column)?));
        let (surfaces, values): (Vec<usize>, Vec<f64>) = training.iter().filter_map(read).unzip();
        if values.is_empty() {
            let found = format_args!("none of {name}");
            return Err(Error::input("training readings", found, "at least one"));
        }
        let level = values.iter().sum::<f64>() / values.len() as f64;
        let squared = values.iter().map(|value| (value - level).powi(2));
        let variance = squared.sum::<f64>() / values.len() as f64;
        let column = Self {
            property,
            values,
            variance,
        };
        Ok((surfaces, column))
    }
}

/// The matrices of each view of these surfaces, one for each kernel.
fn kernels(
    ridge: &KernelRidge,
    embeddings: &Embeddings,
    surfaces: &[usize],
) -> Result<Vec<Vec<Vec<f32>>>> {
    let of_view = |view| -> Result<Vec<Vec<f32>>> {
        let (_, kernels) = ridge.kernels(&embeddings.select(surfaces, &[view])?);
        Ok(kernels.iter().map(|(_, one)| lower_triangle(one)).collect())
    };
    let views = parallel::map(0..embeddings.views(), of_view);
    views.into_iter().collect()
}

fn lower_triangle(kernel: &Mat<f64>) -> Vec<f32> {
    let size = kernel.nrows();
    let column = |j: usize| (j..size).map(move |i| kernel[(i, j)] as f32);
    (0..size).flat_map(column).collect()
}

/// The mean kernel of the views of a set, both triangles.
fn mean<'a>(views: impl ExactSizeIterator<Item = &'a Vec<f32>>, size: usize) -> Mat<f64> {
    let mut sums = vec![0.0; size * (size + 1) / 2];
    let count = views.len() as f64;
    for view in views {
        for (sum, &value) in sums.iter_mut().zip(view) {
            *sum += f64::from(value);
        }
    }
    let mut kernel = Mat::zeros(size, size);
    let mut rest = sums.iter().map(|sum| sum / count);
    for j in 0..size {
        for (i, value) in (j..size).zip(&mut rest) {
            kernel[(i, j)] = value;
            kernel[(j, i)] = value;
        }
    }
    kernel
}

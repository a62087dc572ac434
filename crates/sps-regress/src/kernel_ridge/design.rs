//! Which surfaces to measure next.

use faer::Mat;

use super::KernelRidge;
use crate::data::{Embeddings, check_indices};
use crate::error::{Error, Result};

/// The variance of a reading's error, where that of a surface is 1 before anything is measured: how little
/// a second surface that looks the same would tell.
const NOISE: f64 = 0.003;

impl KernelRidge {
    /// The surfaces to measure next, `count` of those that are not among `measured`, the most telling first:
    /// each in its turn is the one whose reading takes most off the variance that kernel ridge regression
    /// would leave, summed over all surfaces (Cohn, Ghahramani and Jordan, "Active Learning with Statistical
    /// Models", JAIR 4, 1996). Readings themselves are not looked at, so that it begins with none. The
    /// kernel is the mean of those to choose from.
    ///
    /// Time grows with the number of surfaces squared, times `measured` and `count`; memory with its square.
    ///
    /// # Errors
    /// An index of no surface; more surfaces than [`at_most`](super::KernelRidgeConfig::at_most).
    pub fn most_telling(
        &self,
        embeddings: &Embeddings,
        measured: &[usize],
        count: usize,
    ) -> Result<Vec<usize>> {
        let surfaces = embeddings.surfaces();
        check_indices("measured surfaces", measured, surfaces)?;
        if surfaces > self.0.at_most {
            let expected = format!("at most {}", self.0.at_most);
            return Err(Error::input("surfaces to choose from", surfaces, expected));
        }
        let mut left = self.mean_kernel(embeddings);
        let mut open = vec![true; surfaces];
        for &surface in measured.iter().filter(|&&at| std::mem::take(&mut open[at])) {
            measure(&mut left, surface);
        }
        let mut chosen = Vec::new();
        for _ in 0..count {
            let candidates = (0..surfaces).filter(|&at| open[at]);
            let gains = candidates.map(|at| (gain(&left, at), at));
            let best =
                gains.max_by(|one, other| one.0.total_cmp(&other.0).then(other.1.cmp(&one.1)));
            let Some((_, best)) = best else { break };
            open[best] = false;
            measure(&mut left, best);
            chosen.push(best);
        }
        Ok(chosen)
    }

    /// The mean of the kernels' matrices, brought to a mean variance of 1.
    fn mean_kernel(&self, embeddings: &Embeddings) -> Mat<f64> {
        let surfaces = embeddings.surfaces();
        let (_, kernels) = self.kernels(embeddings);
        let sum = |i: usize, j: usize| kernels.iter().map(|(_, kernel)| kernel[(i, j)]).sum();
        let mut mean: Mat<f64> = Mat::from_fn(surfaces, surfaces, sum);
        let trace: f64 = (0..surfaces).map(|at| mean[(at, at)]).sum();
        if trace > 0.0 {
            let scale = surfaces as f64 / trace;
            for column in mean.col_iter_mut() {
                column.iter_mut().for_each(|value| *value *= scale);
            }
        }
        mean
    }
}

/// What measuring a surface takes off the summed variance.
fn gain(left: &Mat<f64>, surface: usize) -> f64 {
    let squares = left.col(surface).iter().map(|value| value * value);
    squares.sum::<f64>() / (left[(surface, surface)] + NOISE)
}

/// Takes off the covariance what a reading of the surface tells.
fn measure(left: &mut Mat<f64>, surface: usize) {
    let column: Vec<f64> = left.col(surface).iter().copied().collect();
    let variance = column[surface] + NOISE;
    for (j, own) in left.col_iter_mut().enumerate() {
        let share = column[j] / variance;
        let both = own.iter_mut().zip(&column);
        both.for_each(|(value, other)| *value -= share * other);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What is left after some measurements is the covariance of a Gaussian process (Rasmussen and Williams
    /// 2006, equation 2.24), by a product and an inverse in place of the steps.
    #[test]
    fn steps_leave_the_covariance_of_a_gaussian_process() {
        let points = [0.0_f64, 0.4, 1.0, 1.7, 2.1];
        let kernel = Mat::from_fn(5, 5, |i, j| (-(points[i] - points[j]).abs() / 4.0).exp());
        let mut left = kernel.clone();
        measure(&mut left, 1);
        measure(&mut left, 3);
        let (a, b) = (kernel[(1, 1)] + NOISE, kernel[(1, 3)]);
        let d = kernel[(3, 3)] + NOISE;
        let determinant = a * d - b * b;
        for i in 0..5 {
            for j in 0..5 {
                let [x, y] = [kernel[(i, 1)], kernel[(i, 3)]];
                let [u, v] = [kernel[(j, 1)], kernel[(j, 3)]];
                let told = (x * (d * u - b * v) + y * (a * v - b * u)) / determinant;
                assert!((left[(i, j)] - (kernel[(i, j)] - told)).abs() < 1e-9);
            }
        }
    }
}

use faer::Mat;
use ndarray::{Array1, Array2, ArrayView1, Axis};

use super::TrainedRidge;
use crate::data::Embeddings;
use crate::error::Result;
use crate::left_out::{LeftOut, LeftOutBlock};
use crate::pca::Pca;
use crate::plan::Trial;

/// The features of some surfaces on their principal axes, where the columns are centred and
/// orthogonal, and each penalty's fit has a closed form. All fits to the same surfaces share it.
pub(super) struct Axes<'a> {
    components: Pca,
    /// What each column was multiplied with.
    factors: Array1<f64>,
    mean: Array1<f64>,
    scores: Array2<f64>,
    penalties: Vec<Penalty>,
    left_out: &'a LeftOut,
}

/// One of the penalties to choose from.
struct Penalty {
    /// In units of the features' mean variance.
    relative: f64,
    /// What turns the product of values with a column into its weight; none for columns of zeros.
    shrinking: Array1<f64>,
    blocks: Vec<LeftOutBlock>,
}

impl<'a> Axes<'a> {
    pub(super) fn new(
        features: &Embeddings,
        penalties: &[f64],
        left_out: &'a LeftOut,
    ) -> Result<Self> {
        let factors = features.balance().into_iter();
        let factors: Array1<f64> = factors.map(f64::from).collect();
        let rows = features.table() * &factors;
        let components = Pca::fit(rows.view(), rows.ncols())?;
        let scores = components.transform(rows.view());
        // Mean variance of a feature.
        let variance = components.explained_variance().iter().sum::<f64>() / rows.ncols() as f64;
        let penalty = |&penalty| Penalty::new(&scores, penalty, variance, left_out);
        Ok(Self {
            penalties: penalties.iter().map(penalty).collect(),
            mean: rows.mean_axis(Axis(0)).unwrap_or_default(),
            scores,
            components,
            factors,
            left_out,
        })
    }

    /// Fits `values`, one per surface, with the best of the penalties.
    pub(super) fn fit(&self, trial: &Trial, values: &[f64]) -> TrainedRidge {
        let values = ArrayView1::from(values);
        let level = values.mean().unwrap_or_default();
        let centred = &values - level;
        let penalties = self.penalties.iter();
        let errors = penalties.map(|penalty| (penalty, self.left_out_error(&centred, penalty)));
        let best = errors.min_by(|(_, a), (_, b)| a.total_cmp(b));
        let weights = best.map_or_else(
            || Array1::zeros(self.mean.len()),
            |(best, _)| {
                let on_axes = self.scores.t().dot(&centred) * &best.shrinking;
                self.components.components().t().dot(&on_axes)
            },
        );
        TrainedRidge {
            trial: trial.clone(),
            penalty: best.map_or(1.0, |(best, _)| best.relative),
            intercept: level - self.mean.dot(&weights),
            weights: (weights * &self.factors).to_vec(),
        }
    }

    /// Mean squared error by the fits that leave each part out.
    fn left_out_error(&self, centred: &Array1<f64>, penalty: &Penalty) -> f64 {
        let on_axes = self.scores.t().dot(centred) * &penalty.shrinking;
        let residuals = centred - &self.scores.dot(&on_axes);
        let left_out = self.left_out;
        left_out.squared_error(|i| residuals[i], &penalty.blocks)
    }
}

impl Penalty {
    fn new(scores: &Array2<f64>, relative: f64, variance: f64, left_out: &LeftOut) -> Self {
        let absolute = relative * variance;
        let samples = scores.nrows() as f64;
        let one = |column: ArrayView1<'_, f64>| {
            let size = column.dot(&column) + samples * absolute;
            if size > 0.0 { 1.0 / size } else { 0.0 }
        };
        let shrinking: Array1<f64> = scores.columns().into_iter().map(one).collect();
        let alone = |i: usize| {
            let products = &scores.row(i) * &scores.row(i);
            1.0 - 1.0 / samples - products.dot(&shrinking)
        };
        let several = |part: &[usize]| {
            let rows = scores.select(Axis(0), part);
            let leverage = rows.dot(&(&rows * &shrinking).t());
            Mat::from_fn(part.len(), part.len(), |i, j| {
                let identity = if i == j { 1.0 } else { 0.0 };
                identity - 1.0 / samples - leverage[[i, j]]
            })
        };
        let blocks = left_out.blocks(alone, several);
        Self {
            relative,
            shrinking,
            blocks,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::plan::Views;
    use faer::linalg::solvers::Solve;
    use ndarray::Array;

    fn embeddings(surfaces: usize, width: usize) -> Embeddings {
        let value = |i: usize| ((i * i * 7 + i * 13) % 101) as f32 / 50.0 - 1.0;
        let values: Vec<f32> = (0..surfaces * width).map(value).collect();
        Embeddings::new(values, [surfaces, 1, width]).unwrap()
    }

    fn values(surfaces: usize) -> Vec<f64> {
        let value = |i: usize| 20.0 + ((i * 31) % 17) as f64;
        (0..surfaces).map(value).collect()
    }

    /// The normal equations, solved densely.
    fn direct(rows: &Array2<f64>, values: &[f64], penalty: f64) -> (Vec<f64>, f64) {
        let samples = rows.nrows() as f64;
        let mean = rows.mean_axis(Axis(0)).unwrap();
        let centred = rows - &mean;
        let level = values.iter().sum::<f64>() / samples;
        let gram = centred.t().dot(&centred) + Array2::<f64>::eye(rows.ncols()) * samples * penalty;
        let values = Array::from_iter(values.iter().map(|v| v - level));
        let right = centred.t().dot(&values);
        let gram = faer::Mat::from_fn(gram.nrows(), gram.ncols(), |i, j| gram[[i, j]]);
        let right = faer::Mat::from_fn(right.len(), 1, |i, _| right[i]);
        let weights = gram.partial_piv_lu().solve(&right);
        let weights: Vec<f64> = (0..rows.ncols()).map(|i| weights[(i, 0)]).collect();
        let offset: f64 = weights.iter().zip(&mean).map(|(w, m)| w * m).sum();
        (weights, level - offset)
    }

    fn fit(features: &Embeddings, values: &[f64], penalties: &[f64]) -> TrainedRidge {
        let alone = alone(values.len());
        let axes = Axes::new(features, penalties, &alone).unwrap();
        axes.fit(&trial(), values)
    }

    fn trial() -> Trial {
        Trial {
            property: "p".into(),
            rerun: 0,
            views: Views::Fixed(vec![0]),
        }
    }

    /// Each surface is left out for itself.
    fn alone(surfaces: usize) -> LeftOut {
        LeftOut::of(&(0..surfaces).collect::<Vec<_>>(), None)
    }

    fn mean_variance(rows: &Array2<f64>) -> f64 {
        rows.var_axis(Axis(0), 1.0).mean().unwrap()
    }

    #[test]
    fn the_fit_solves_the_normal_equations() {
        for (surfaces, width) in [(40, 6), (12, 30)] {
            let features = embeddings(surfaces, width);
            let values = values(surfaces);
            let fit = fit(&features, &values, &[0.3]);
            let rows = features.table();
            let (weights, intercept) = direct(&rows, &values, 0.3 * mean_variance(&rows));
            for (found, expected) in fit.weights.iter().zip(&weights) {
                assert!((found - expected).abs() < 1e-8, "{found} {expected}");
            }
            assert!((fit.intercept - intercept).abs() < 1e-8);
        }
    }

    /// Surfaces one by one, and in units of 1 to 7 of them.
    #[test]
    fn the_penalty_is_the_best_when_each_unit_is_left_out() {
        let penalties = [0.01, 0.1, 1.0, 10.0];
        let features = embeddings(25, 10);
        let values = values(25);
        let rows = features.table();
        let scale = mean_variance(&rows);
        let all: Vec<usize> = (0..25).collect();
        let level = values.iter().sum::<f64>() / 25.0;
        let centred: Array1<f64> = values.iter().map(|v| v - level).collect();
        let uneven = |i: usize| (f64::from(i as u32) * 2.0 + 0.25).sqrt() as usize;
        for units in [all.clone(), all.iter().map(|&i| uneven(i)).collect()] {
            let error = |penalty: f64| -> f64 {
                let left_out = |out: usize| {
                    let others = all.iter().copied().filter(|&i| units[i] != units[out]);
                    let others: Vec<usize> = others.collect();
                    let kept: Vec<f64> = others.iter().map(|&i| values[i]).collect();
                    // n times the penalty stays what it is with all surfaces.
                    let penalty = penalty * scale * 25.0 / others.len() as f64;
                    let (weights, intercept) =
                        direct(&rows.select(Axis(0), &others), &kept, penalty);
                    let row = rows.row(out);
                    let estimate: f64 = row.iter().zip(&weights).map(|(x, w)| x * w).sum();
                    (values[out] - intercept - estimate).powi(2)
                };
                all.iter().map(|&out| left_out(out)).sum::<f64>() / 25.0
            };
            let parts = LeftOut::of(&all, Some(&units));
            let axes = Axes::new(&features, &penalties, &parts).unwrap();
            for one in &axes.penalties {
                let found = axes.left_out_error(&centred, one);
                assert!((found / error(one.relative) - 1.0).abs() < 1e-9);
            }
            let less = |a: &f64, b: &f64| error(*a).total_cmp(&error(*b));
            let best = penalties.into_iter().min_by(less);
            assert_eq!(Some(axes.fit(&trial(), &values).penalty), best);
        }
    }

    #[test]
    fn equal_surfaces_get_the_mean() {
        let features = Embeddings::new(vec![1.0; 15], [5, 1, 3]).unwrap();
        let fit = fit(&features, &[1.0, 2.0, 3.0, 4.0, 5.0], &[0.1]);
        assert_eq!(fit.predict(&features).unwrap(), [3.0; 5]);
    }
}

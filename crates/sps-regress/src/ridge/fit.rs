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

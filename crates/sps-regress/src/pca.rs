//! Principal components.

use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::svd::{self, ComputeSvdVectors};
use faer::{Mat, Par, Spec};
use ndarray::{Array1, Array2, ArrayView2, Axis};

use crate::dense::cleanly;
use crate::error::{Error, Result};

/// Principal components of a table, by a full singular value decomposition in f64.
///
/// The components are ordered by the variance they explain. Their sign is fixed: the loading that
/// is largest in magnitude is positive (the first such, in case of a tie).
///
/// Checked against scikit-learn's `PCA(svd_solver="full")`.
#[derive(Clone, Debug)]
pub struct Pca {
    mean: Array1<f64>,
    components: Array2<f64>,
    explained_variance: Vec<f64>,
}

impl Pca {
    /// Fits to `rows`, `(samples, features)`, keeping at most `components` components.
    ///
    /// Fewer are kept when the table has fewer: never more than `samples - 1`, `features`, or
    /// the directions in which the rows differ by more than rounding. A table of equal rows keeps
    /// none.
    ///
    /// # Errors
    /// No rows, a value that is not finite, or a decomposition that did not converge.
    pub fn fit(rows: ArrayView2<'_, f64>, components: usize) -> Result<Self> {
        let what = "principal components";
        let mean = rows.mean_axis(Axis(0));
        let mean = mean.ok_or_else(|| Error::input(what, "no rows", "at least one"))?;
        if let Some(((row, _), value)) = rows.indexed_iter().find(|(_, v)| !v.is_finite()) {
            let found = format_args!("{value} in row {row}");
            return Err(Error::input(what, found, "finite values"));
        }
        let (samples, features) = rows.dim();
        let centred = Mat::from_fn(samples, features, |row, column| {
            rows[[row, column]] - mean[column]
        });
        let (singular, directions) = decompose(&centred)?;
        // Below this, a singular value is rounding of the values or of their mean.
        let largest = rows.iter().fold(0.0_f64, |max, v| max.max(v.abs()));
        let rounding = samples.max(features) as f64 * f64::EPSILON * largest;
        let kept = singular.iter().take(components);
        let kept = kept.take_while(|&&s| s > rounding).count();
        let loading = |(k, feature)| directions[(feature, k)];
        let variance = |s: &f64| s * s / (samples as f64 - 1.0);
        Ok(Self {
            mean,
            components: fix_signs(Array2::from_shape_fn((kept, features), loading)),
            explained_variance: singular[..kept].iter().map(variance).collect(),
        })
    }

    /// The components, `(components, features)`, each of unit length.
    pub fn components(&self) -> ArrayView2<'_, f64> {
        self.components.view()
    }

    /// Variance explained by each component, with `samples - 1` in the denominator.
    pub fn explained_variance(&self) -> &[f64] {
        &self.explained_variance
    }

    /// The scores of `rows`, `(samples, features)` with the features of the fit, as
    /// `(samples, components)`.
    pub fn transform(&self, rows: ArrayView2<'_, f64>) -> Array2<f64> {
        (&rows - &self.mean).dot(&self.components.t())
    }
}

/// Singular values in descending order, and the right singular vectors as columns.
///
/// The call names sequential execution, so that no setting elsewhere can change a bit.
fn decompose(table: &Mat<f64>) -> Result<(Vec<f64>, Mat<f64>)> {
    let (rows, columns) = table.shape();
    let size = rows.min(columns);
    let mut left = Mat::zeros(rows, size);
    let mut right = Mat::zeros(columns, size);
    let mut singular = faer::Col::<f64>::zeros(size);
    let scratch = svd::svd_scratch::<f64>(
        rows,
        columns,
        ComputeSvdVectors::Thin,
        ComputeSvdVectors::Thin,
        Par::Seq,
        Spec::default(),
    );
    cleanly(|| {
        svd::svd(
            table.as_ref(),
            singular.as_mut().as_diagonal_mut(),
            Some(left.as_mut()),
            Some(right.as_mut()),
            Par::Seq,
            MemStack::new(&mut MemBuffer::new(scratch)),
            Spec::default(),
        )
    })
    .map_err(|_| {
        let (what, expected) = ("principal components", "one that converges");
        Error::input(what, "no decomposition", expected)
    })?;
    Ok((singular.iter().copied().collect(), right))
}

fn fix_signs(mut components: Array2<f64>) -> Array2<f64> {
    for mut component in components.rows_mut() {
        let larger = |a: f64, &b: &f64| if b.abs() > a.abs() { b } else { a };
        if component.iter().fold(0.0, larger) < 0.0 {
            component.mapv_inplace(|loading| -loading);
        }
    }
    components
}

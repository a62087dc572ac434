use ndarray::{Array2, array};
use safetensors::SafeTensors;
use sps_regress::Pca;

use crate::golden;

#[test]
fn principal_components_are_scikit_learns() {
    let values = golden::uniform("golden/pca", 60 * 40);
    let mut rows = Array2::from_shape_vec((60, 40), values).unwrap();
    for (column, mut values) in rows.columns_mut().into_iter().enumerate() {
        values *= 1.3_f64.powi(-(column as i32));
    }
    let pca = Pca::fit(rows.view(), 8).unwrap();
    let folder = env!("CARGO_MANIFEST_DIR");
    let file = std::fs::read(format!("{folder}/../../fixtures/golden/pca.safetensors")).unwrap();
    let file = SafeTensors::deserialize(&file).unwrap();
    let expected = |name| -> Vec<f64> {
        let (values, _) = file.tensor(name).unwrap().data().as_chunks::<8>();
        values.iter().map(|b| f64::from_le_bytes(*b)).collect()
    };
    let variance = expected("explained_variance");
    assert!(golden::error(pca.explained_variance(), &variance) < 1e-13);
    let scores = pca.transform(rows.view()).mapv(f64::abs);
    let scores = scores.iter().copied().collect::<Vec<_>>();
    assert!(golden::error(&scores, &expected("abs_scores")) < 1e-12);
    for component in pca.components().rows() {
        let larger = |a: f64, &b: &f64| if b.abs() > a.abs() { b } else { a };
        assert!(component.iter().fold(0.0, larger) > 0.0);
        assert!((component.dot(&component) - 1.0).abs() < 1e-13);
    }
}

#[test]
fn rows_that_are_not_finite_are_refused() {
    let rows = array![[0.0, f64::NAN]];
    let error = Pca::fit(rows.view(), 1).unwrap_err();
    assert!(error.to_string().contains("NaN in row 0"), "{error}");
    assert!(Pca::fit(Array2::zeros((0, 3)).view(), 1).is_err());
}

mod hard_cases {
    use sps_regress::Standardiser;

    use super::*;

    /// Less the mean over the spread, rounding or not.
    fn naively_standardised(values: &[f64]) -> Vec<f64> {
        let n = values.len() as f64;
        let mean = values.iter().sum::<f64>() / n;
        let spread = (values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / n).sqrt();
        values.iter().map(|v| (v - mean) / spread).collect()
    }

    fn within(case: &str, error: f64, bound: f64, naive: f64) {
        println!("{case}: error {error:.1e}, bound {bound:.0e}, naive form {naive:.1e}");
        assert!(error <= bound, "{case}");
        assert!(naive.is_nan() || naive > bound, "{case}: the naive form");
    }

    fn table(rows: &[[f64; 3]]) -> Array2<f64> {
        Array2::from_shape_fn((rows.len(), 3), |(row, column)| rows[row][column])
    }

    /// Two points span one direction: its variance is half the squared distance.
    #[test]
    fn fewer_samples_than_components() {
        let rows = table(&[[1.0, 2.0, 3.0], [4.0, 6.0, 3.0]]);
        let pca = Pca::fit(rows.view(), 3).unwrap();
        assert!(golden::error(pca.explained_variance(), &[12.5]) < 1e-15);
        let component = pca.components().row(0).to_vec();
        assert!(golden::error(&component, &[0.6, 0.8, 0.0]) < 1e-15);
        let scores = pca.transform(rows.view());
        assert_eq!(scores.ncols(), 1);
        let error = golden::error(&scores.column(0).to_vec(), &[-2.5, 2.5]);
        // A second direction, across the first, holds rounding: standardised it is noise of one.
        let across = rows.map_axis(ndarray::Axis(1), |row| 0.08 * row[0] - 0.06 * row[1]);
        let naive = naively_standardised(across.as_slice().unwrap())[0].abs();
        within("two samples, three components", error, 1e-15, naive);
        let one = Pca::fit(rows.slice(ndarray::s![..1, ..]), 3).unwrap();
        assert!(one.explained_variance().is_empty());
    }

    /// Equal rows have no direction. The mean of equal values is off by rounding, and a component
    /// made of that, standardised, would be noise of variance one.
    #[test]
    fn duplicate_rows() {
        let rows = Array2::from_shape_fn((7, 3), |(_, column)| [0.1, 1e3, -7.7][column]);
        let naive = naively_standardised(&rows.column(0).to_vec())[0].abs();
        within("duplicate rows", 0.0, 0.0, naive);
        let directions = |rows: Array2<f64>| {
            let pca = Pca::fit(rows.view(), 3).unwrap();
            pca.explained_variance().len()
        };
        assert_eq!(directions(rows), 0);
        let rows =
            Array2::from_shape_fn((14, 3), |(row, c)| [0.1, 1e3, -7.7][c] + (row % 2) as f64);
        assert_eq!(directions(rows), 1);
    }

    /// A constant feature stays zero when it is standardised. By the plain quotient it becomes
    /// the rounding of its mean over itself.
    #[test]
    fn features_of_zero_variance() {
        let columns = |mut table: Array2<f64>| {
            let standard = Standardiser::of(table.iter().copied()).unwrap();
            table.mapv_inplace(|value| standard.standardise(value));
            table
        };
        let constant = Array2::from_elem((10, 1), 0.1);
        assert!(columns(constant.clone()).iter().all(|&v| v == 0.0));
        let naive = naively_standardised(&constant.column(0).to_vec())[0].abs();
        within("zero variance", 0.0, 0.0, naive);
        // A real spread at a large offset is kept.
        let offset = Array2::from_shape_fn((4, 1), |(row, _)| 1e8 + [0.0, 1.0][row % 2]);
        let standard = columns(offset);
        assert!(golden::error(&standard.column(0).to_vec(), &[-1.0, 1.0, -1.0, 1.0]) < 1e-15);
    }

    /// The same table upside down has the same components, sign and all.
    #[test]
    fn sign_and_order_of_components() {
        let values = golden::uniform("labels.signs", 20 * 5);
        let rows = Array2::from_shape_vec((20, 5), values).unwrap();
        let mirrored = rows.slice(ndarray::s![..;-1, ..]).to_owned();
        let fit = |rows: &Array2<f64>| Pca::fit(rows.view(), 5).unwrap();
        let (one, other) = (fit(&rows), fit(&mirrored));
        let apart = |one: &Array2<f64>, other: &Array2<f64>| {
            let differences = (one - other).mapv(f64::abs);
            differences.iter().copied().fold(0.0, f64::max)
        };
        let components = |pca: &Pca| pca.components().to_owned();
        let from_below = apart(&components(&one), &components(&other));
        let variance = one.explained_variance();
        assert!(variance.windows(2).all(|pair| pair[0] >= pair[1]));
        // Negating the table negates the scores, and leaves the components.
        let minus = -&rows;
        let negated = fit(&minus);
        let of_minus = apart(&components(&one), &components(&negated));
        // By the largest score in place of the largest loading, as scikit-learn did before 1.5.
        let by_score = |pca: &Pca, rows: &Array2<f64>| {
            let scores = pca.transform(rows.view());
            let mut components = pca.components().to_owned();
            for (mut component, scores) in components.rows_mut().into_iter().zip(scores.columns()) {
                let larger = |a: f64, &b: &f64| if b.abs() > a.abs() { b } else { a };
                component *= scores.iter().fold(0.0, larger).signum();
            }
            components
        };
        let naive = apart(&by_score(&one, &rows), &by_score(&negated, &minus));
        within("sign of components", from_below.max(of_minus), 1e-12, naive);
    }
}

//! Convolutions of f32 as sums of two numbers of bf16, against f64; where there are no tiles they are those of f32.

use super::conv::cases;
use super::image;
use super::*;

/// What a convolution adds to what is stored, whose first numbers are its shifts too.
fn convolve(conv: &Conv, case: &Case, values: &[f64], stored: &[f64]) -> Vec<f64> {
    let (from, to) = (case.padded::<f32>(), case.to::<f32>());
    let shift = narrow(&stored[..case.shape.outputs]);
    let by = |threads| {
        let epilogue = Epilogue {
            accumulate: Some(1.0),
            ..Epilogue::biased(&shift, Activation::Relu)
        };
        let source = (values, &from, 0.0);
        convolved((conv, threads), source, (stored, &to), epilogue)
    };
    let alone = by(Threads::One);
    let mut pairs = by(Threads::All).into_iter().zip(&alone);
    assert!(pairs.all(|(x, y)| x.to_bits() == y.to_bits() || x.is_nan() && y.is_nan()));
    alone
}

fn check(case: &Case, scale: f64) {
    // Of 24 bits, so that both halves round.
    let scaled = |noise: Vec<f64>| noise.into_iter().map(move |x| x * scale * 1.000_077);
    let single = |x: f64| f64::from(x as f32);
    let shape = case.shape;
    let values: Vec<f64> = scaled(noise(case.numbers(), 1)).map(single).collect();
    let weights = noise(case.weights(), 2).into_iter();
    let weights: Vec<f64> = weights.map(|w| single(w * 0.1)).collect();
    let sums = case.reference(&values, &weights);
    let stored: Vec<f64> = scaled(noise(sums.len(), 4)).map(single).collect();
    let shifted = sums.iter().zip(&stored).enumerate();
    let shifted = shifted.map(|(i, (sum, x))| (sum + x + stored[i % shape.outputs]).max(0.0));
    let expected: Vec<f64> = shifted.map(|x| x / scale).collect();
    Level::on_each(|level| {
        let conv = Conv::pack_split(level, shape, &narrow(&weights));
        let found = convolve(&conv, case, &values, &stored);
        let found: Vec<f64> = found.iter().map(|x| x / scale).collect();
        let error = distance(&found, &expected);
        let what = format!("{level:?} {shape:?} {:?} times {scale:e}", case.size);
        assert!(error < 1e-5, "{what}: off by {error:.1e}");
    });
}

#[test]
fn convolutions() {
    let point = Window::square(1, 1, 0);
    // More pixels than are split at once.
    let many = Case::new(2, [1, 14, 15], [320, 8, 1], point);
    for case in cases::<f32>().into_iter().chain([many]) {
        for scale in [1.0, 1e-20, 1e30] {
            check(&case, scale);
        }
    }
}

#[test]
fn of_images() {
    for case in image::cases() {
        let single = |x: f64| f64::from((x * 1.000_077) as f32);
        let values: Vec<f64> = noise(case.numbers(), 1).into_iter().map(single).collect();
        let weights: Vec<f64> = noise(case.weights(), 2).into_iter().map(single).collect();
        let expected = case.reference(&values, &weights);
        let (source, from) = image::images::<f32>(&case, &values);
        let to = case.to::<f32>().padded(&Window::square(3, 1, 1));
        Level::on_each(|level| {
            let conv = Conv::pack_split_for_images(level, case.shape, &narrow(&weights));
            let [alone, found] = [Threads::One, Threads::All].map(|threads| {
                let mut target = vec![0.0; to.len()];
                let target_of = (&mut target[..], &to);
                conv.apply(threads, (&source, &from), target_of, Epilogue::default());
                inside(&target, &to)
            });
            let error = distance(&found, &expected);
            let what = format!("{level:?} {:?} {:?}", case.shape, case.size);
            assert!(error < 1e-5, "{what}: off by {error:.1e}");
            assert_eq!(alone, found, "{what}");
        });
    }
}

/// What is not finite stays so, where it is: infinity times a lower half of 0 is no number.
#[test]
fn numbers_beyond_all() {
    let case = Case::new(1, [1, 9, 8], [32, 16, 1], Window::square(3, 1, 1));
    let weights = vec![0.5; 16 * 32 * 9];
    let mut values = vec![1.0; 9 * 8 * 32];
    (values[0], values[35 * 32 + 3]) = (f64::INFINITY, f64::NAN);
    let stored = vec![0.0; 9 * 8 * 16];
    let in_f32 = Conv::pack(Level::Portable, case.shape, &weights);
    let in_f32 = convolve(&in_f32, &case, &values, &stored);
    Level::on_each(|level| {
        let conv = Conv::pack_split(level, case.shape, &weights);
        let found = convolve(&conv, &case, &values, &stored);
        for (found, expected) in found.iter().zip(&in_f32) {
            let same = (found - expected).abs() < 1e-3;
            assert!(
                same || !found.is_finite() && !expected.is_finite(),
                "{found} {expected}"
            );
        }
    });
}

//! Batch norm where it has nothing to divide by.

use super::others::{EPS, batch_norm};
use super::*;

/// Output and gradients of batch norm, in the order x, gamma, beta.
fn run(dims: [usize; 5], inputs: [&[f64]; 3], cotangent: &[f64]) -> [Vec<f64>; 4] {
    let (y, gradients, _) = batch_norm(dims, &inputs.map(narrow), false, &narrow(cotangent));
    let [of_x, of_gamma, of_beta] = &gradients[..] else {
        unreachable!()
    };
    [&y, of_x, of_gamma, of_beta].map(|values| wide(values))
}

#[test]
fn a_constant_channel() {
    for value in [0.0, 0.7, 1e4, 1e-40] {
        let cotangent = noise(12, 3);
        let inputs: [&[f64]; 3] = [&[value; 12], &[1.5], &[-0.25]];
        let [y, dx, dgamma, dbeta] = run([2, 1, 2, 3, 1], inputs, &cotangent);
        // Nothing deviates: the output is beta, and a gradient is divided by sqrt(eps).
        assert_eq!(y, [-0.25; 12]);
        let sum: f64 = cotangent.iter().sum();
        let slope = 1.5 / EPS.sqrt();
        let expected: Vec<f64> = cotangent.iter().map(|c| slope * (c - sum / 12.0)).collect();
        assert!(distance(&dx, &expected) < 1e-5, "{value}");
        assert_eq!(dgamma, [0.0]);
        assert!((dbeta[0] - sum).abs() < 1e-6);
    }
}

#[test]
fn values_of_ten_thousand() {
    let x: Vec<f64> = noise(2 * 5 * 5 * 4, 1).iter().map(|v| v * 1e4).collect();
    let cotangent = noise(x.len(), 2);
    let found = run([2, 1, 5, 5, 4], [&x, &[1.0; 4], &[1.0; 4]], &cotangent);
    assert!(found.iter().flatten().all(|v| v.is_finite()));
    // The gradient in closed form, in f64.
    let mut expected = vec![0.0; x.len()];
    for channel in 0..4 {
        let of = |values: &[f64]| -> Vec<f64> {
            values.iter().skip(channel).step_by(4).copied().collect()
        };
        let (x, g) = (of(&x), of(&cotangent));
        let mean = |values: &[f64]| values.iter().sum::<f64>() / 50.0;
        let centre = mean(&x);
        let squares: Vec<f64> = x.iter().map(|v| (v - centre).powi(2)).collect();
        let inverse = 1.0 / (mean(&squares) + EPS).sqrt();
        let products: Vec<f64> = x.iter().zip(&g).map(|(v, g)| (v - centre) * g).collect();
        let (along, offset) = (mean(&products) * inverse * inverse, mean(&g));
        for (i, (v, g)) in x.iter().zip(&g).enumerate() {
            expected[i * 4 + channel] = inverse * (g - offset - (v - centre) * along);
        }
    }
    assert!(distance(&found[1], &expected) < 1e-5);
}

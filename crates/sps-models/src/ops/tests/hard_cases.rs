//! Batch norm where it has nothing to divide by, and inputs that do not lie in order.

use candle_core::{Tensor, Var};

use super::batch_norm::batch_norm;
use super::{check, distance, noise, numbers, tensor};
use crate::ops::{Window, max_pool};

const EPS: f64 = 1e-5;

/// Output and gradients of batch norm, in the order x, gamma, beta.
fn run(x: &Tensor, gamma: &Tensor, beta: &Tensor, cotangent: &Tensor) -> [Vec<f64>; 4] {
    let variables = [x, gamma, beta].map(|t| Var::from_tensor(t).unwrap());
    let [x, gamma, beta] = &variables;
    let (y, _) = batch_norm([x, gamma, beta], EPS, false);
    let loss = (&y * cotangent).unwrap().sum_all().unwrap();
    let gradients = loss.backward().unwrap();
    let gradient = |variable: &Var| numbers(gradients.get(variable).unwrap());
    [numbers(&y), gradient(x), gradient(gamma), gradient(beta)]
}

#[test]
fn a_constant_channel() {
    for value in [0.0, 0.7, 1e4, 1e-40] {
        let x = tensor(&[value; 12], &[2, 2, 3, 1]);
        let cotangent = noise(12, 3);
        let (gamma, beta) = (tensor(&[1.5], &[1]), tensor(&[-0.25], &[1]));
        let cotangents = tensor(&cotangent, &[2, 2, 3, 1]);
        let [y, dx, dgamma, dbeta] = run(&x, &gamma, &beta, &cotangents);
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
    let dims = [2, 5, 5, 4];
    let one = tensor(&[1.0; 4], &[4]);
    let found = run(&tensor(&x, &dims), &one, &one, &tensor(&cotangent, &dims));
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

/// A tensor `(frames, channels, height, width)` as the operators take it, without a copy.
fn turned(x: &Tensor) -> Tensor {
    x.permute((0, 2, 3, 1)).unwrap()
}

/// The same order in a flat array of 2 x 3 x 4 x 5.
fn turned_values(x: &[f64]) -> Vec<f64> {
    let at = |i: usize| (((i / 60) * 3 + i % 3) * 4 + i / 15 % 4) * 5 + i / 3 % 5;
    (0..x.len()).map(|i| x[at(i)]).collect()
}

#[test]
fn inputs_that_do_not_lie_in_order() {
    let x = || (noise(120, 1), vec![2, 3, 4, 5]);
    let pool = Window::square(2, 2, 0);
    let largest = |x: &[Vec<f64>]| {
        let x = turned_values(&x[0]);
        let windows = (0..2 * 2 * 2 * 3).map(|i| {
            let (frame, row, column, channel) = (i / 12, i / 6 % 2, i / 3 % 2, i % 3);
            let at = |dy: usize, dx: usize| {
                x[((frame * 4 + 2 * row + dy) * 5 + 2 * column + dx) * 3 + channel]
            };
            at(0, 0).max(at(0, 1)).max(at(1, 0)).max(at(1, 1))
        });
        windows.collect()
    };
    let operator = |t: &[Tensor]| max_pool(&turned(&t[0]), pool, false).unwrap();
    check("max pooling", &[x()], &operator, &largest);
}

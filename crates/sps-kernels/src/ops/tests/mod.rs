//! Every operator against a reference in f64 that is written straight from its definition, and
//! every gradient against central differences of that reference; on each level of vectors.

mod activated;
mod batch_norm;
mod bf16;
mod bytes;
mod conv;
mod depthwise;
mod gated_residual;
mod golden3d;
mod hard_cases;
mod image;
mod others;
mod split;
mod threads;
pub(super) mod tiles;
mod windows;
mod winograd;

use super::conv::ConvShape;
use super::grid::{Grid, Window};
use super::simd::Level;

/// A function of several flat arrays, in f64.
type Reference<'a> = &'a dyn Fn(&[Vec<f64>]) -> Vec<f64>;

/// An operator: from its inputs and the gradient of its output to its output and its inputs' gradients.
type Operator<'a> = &'a dyn Fn(&[Vec<f32>], &[f32]) -> (Vec<f32>, Vec<Vec<f32>>);

const fn shape(window: Window, inputs: usize, outputs: usize, groups: usize) -> ConvShape {
    ConvShape {
        window,
        inputs,
        outputs,
        groups,
    }
}

/// Uniform in -1..1, the same for the same seed.
fn noise(len: usize, seed: u64) -> Vec<f64> {
    let mut state = seed.wrapping_mul(0x9E37_79B9_7F4A_7C15) | 1;
    (0..len)
        .map(|_| {
            state ^= state << 13;
            state ^= state >> 7;
            state ^= state << 17;
            // Few digits: the same number in f32.
            ((state >> 44) as f64) / f64::from(1 << 19) - 1.0
        })
        .collect()
}

fn narrow(values: &[f64]) -> Vec<f32> {
    values.iter().map(|&value| value as f32).collect()
}

fn wide(values: &[f32]) -> Vec<f64> {
    values.iter().copied().map(f64::from).collect()
}

/// The layout of `(frames, [time,] height, width, channels)`; rows of all times are one above the
/// other.
fn grid(dims: &[usize]) -> Grid {
    let [frames, between @ .., width, channels] = dims else {
        panic!("{dims:?}");
    };
    Grid::tight(*frames, [1, between.iter().product(), *width], *channels)
}

/// The largest difference, relative to the largest number expected.
fn distance(found: &[f64], expected: &[f64]) -> f64 {
    assert_eq!(found.len(), expected.len());
    let scale = expected.iter().fold(1e-3_f64, |m, e| m.max(e.abs()));
    let pairs = found.iter().zip(expected);
    pairs.fold(0.0, |m: f64, (f, e)| m.max((f - e).abs())) / scale
}

/// The gradient of `sum(reference * cotangent)` by central differences.
fn central_differences(
    reference: Reference<'_>,
    inputs: &[Vec<f64>],
    cotangent: &[f64],
) -> Vec<Vec<f64>> {
    const STEP: f64 = 1e-5;
    let loss = |inputs: &[Vec<f64>]| -> f64 {
        let y = reference(inputs);
        y.iter().zip(cotangent).map(|(y, c)| y * c).sum()
    };
    let mut inputs = inputs.to_vec();
    (0..inputs.len())
        .map(|which| {
            (0..inputs[which].len())
                .map(|i| {
                    let value = inputs[which][i];
                    inputs[which][i] = value + STEP;
                    let above = loss(&inputs);
                    inputs[which][i] = value - STEP;
                    let below = loss(&inputs);
                    inputs[which][i] = value;
                    (above - below) / (2.0 * STEP)
                })
                .collect()
        })
        .collect()
}

/// A convolution by its definition: sums of products over the window; around the map lies `padding`.
fn window_sums(
    shape: &ConvShape,
    [height, width]: [usize; 2],
    source: &[f64],
    weights: &[f64],
    padding: f64,
) -> Vec<f64> {
    let window = &shape.window;
    let [_, rows, columns] = window.output([1, height, width]).unwrap();
    let (inputs, outputs) = (shape.group_inputs(), shape.group_outputs());
    let [_, kernel_rows, kernel_columns] = window.size;
    let mut sums = Vec::new();
    for (y, x) in (0..rows).flat_map(|y| (0..columns).map(move |x| (y, x))) {
        for channel in 0..shape.outputs {
            let mut sum = 0.0;
            for (i, j) in (0..kernel_rows).flat_map(|i| (0..kernel_columns).map(move |j| (i, j))) {
                let row = (y * window.stride[1] + i).wrapping_sub(window.before[1]);
                let column = (x * window.stride[2] + j).wrapping_sub(window.before[2]);
                for input in 0..inputs {
                    let from = channel / outputs * inputs + input;
                    let number = if row < height && column < width {
                        source[(row * width + column) * shape.inputs + from]
                    } else {
                        padding
                    };
                    let weight = (channel * inputs + input) * kernel_rows + i;
                    sum += number * weights[weight * kernel_columns + j];
                }
            }
            sums.push(sum);
        }
    }
    sums
}

/// Holds an operator to its reference: outputs within 3e-6, gradients within 2e-5 of their
/// largest element (f32 sums against f64), on each level.
fn check(case: &str, inputs: &[Vec<f64>], operator: Operator<'_>, reference: Reference<'_>) {
    let expected = reference(inputs);
    let cotangent = noise(expected.len(), 99);
    let expected_gradients = central_differences(reference, inputs, &cotangent);
    let inputs: Vec<Vec<f32>> = inputs.iter().map(|input| narrow(input)).collect();
    Level::on_each(|level| {
        let (y, gradients) = operator(&inputs, &narrow(&cotangent));
        let error = distance(&wide(&y), &expected);
        assert!(error < 3e-6, "{case}, {level:?}: output off by {error:.1e}");
        assert_eq!(gradients.len(), expected_gradients.len());
        for (i, (found, expected)) in gradients.iter().zip(&expected_gradients).enumerate() {
            let error = distance(&wide(found), expected);
            assert!(
                error < 2e-5,
                "{case}, {level:?}: gradient {i} off by {error:.1e}"
            );
        }
    });
}

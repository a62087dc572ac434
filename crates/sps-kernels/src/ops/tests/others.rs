//! Pooling, batch norm and the end of a residual branch, against their definitions in f64.

use super::conv::taps;
use super::*;
use crate::MaxPooling;
use crate::ops::batch_norm::{Norm, NormGradients, Slopes};
use crate::ops::pointwise::Shortcut;
use crate::ops::statistics::ChannelStatistics;

/// Numbers far enough apart that no two change places within a step of the differences.
fn distinct(len: usize) -> Vec<f64> {
    let mut order: Vec<usize> = (0..len).collect();
    let keys = noise(len, 4);
    order.sort_by(|&a, &b| keys[a].total_cmp(&keys[b]));
    let step = 1.0 / 64.0;
    let number = |&i: &usize| i as f64 * step - len as f64 * step / 2.0;
    order.iter().map(number).collect()
}

/// Max pooling of `(frames, time, height, width, channels)` by its definition, to places given.
pub(super) fn pool_reference(
    x: &[f64],
    [frames, size @ .., channels]: [usize; 5],
    window: &Window,
    to: [usize; 3],
) -> Vec<f64> {
    let mut y = vec![f64::NEG_INFINITY; frames * pixels(to) * channels];
    for (pixel, _, from) in taps(frames, size, window, to) {
        for channel in 0..channels {
            let value = from.map_or(0.0, |from| x[from * channels + channel]);
            let largest = &mut y[pixel * channels + channel];
            *largest = largest.max(value);
        }
    }
    y
}

fn check_pool(name: &str, dims: [usize; 5], window: Window, ceil: bool, to: [usize; 3]) {
    let [frames, size @ .., channels] = dims;
    let pooling = MaxPooling::new(frames, size, channels, window, ceil).unwrap();
    let operator = |inputs: &[Vec<f32>], gradient: &[f32]| {
        let y = pooling.forward(&inputs[0]).unwrap();
        let of_x = pooling.backward(&inputs[0], &y, gradient).unwrap();
        (y, vec![of_x])
    };
    let inputs = [distinct(dims.iter().product())];
    check(name, &inputs, &operator, &|x| {
        pool_reference(&x[0], dims, &window, to)
    });
}

#[test]
fn max_pooling() {
    let window = Window::square(3, 2, 0);
    // The extents are PyTorch's for ceil_mode=True, but for the last, which it refuses.
    check_pool("even", [2, 1, 6, 8, 3], window, true, [1, 3, 4]);
    check_pool("odd", [1, 1, 7, 5, 1], window, true, [1, 3, 2]);
    check_pool("two", [1, 1, 2, 3, 5], window, true, [1, 1, 1]);
    check_pool("one pixel", [1, 1, 1, 1, 2], window, true, [1, 1, 1]);
    check_pool("floor", [1, 1, 6, 7, 2], window, false, [1, 2, 3]);
    let same = Window::same([3, 3, 3], [2, 2, 2], [4, 5, 6]);
    check_pool("'same'", [2, 4, 5, 6, 2], same, false, [2, 3, 3]);
    let flat = Window::same([1, 3, 3], [1, 2, 2], [2, 3, 4]);
    check_pool("'same', flat", [1, 2, 3, 4, 17], flat, false, [2, 2, 2]);
}

#[test]
fn equal_values_give_their_gradient_once() {
    let pooling = MaxPooling::new(1, [1, 3, 3], 1, Window::square(3, 2, 0), true).unwrap();
    let y = pooling.forward(&[0.0; 9]).unwrap();
    let found = pooling.backward(&[0.0; 9], &y, &vec![1.0; y.len()]);
    assert_eq!(
        found.unwrap(),
        [1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]
    );
}

pub(super) const EPS: f64 = 1e-5;

/// A feature map `(frames, time, height, width, channels)` by the batch's own statistics, rectified where `relu`
/// says so; the gradients of map, gamma and beta; the statistics.
pub(super) fn batch_norm(
    dims: [usize; 5],
    inputs: &[Vec<f32>],
    relu: bool,
    gradient: &[f32],
) -> (Vec<f32>, Vec<Vec<f32>>, ChannelStatistics) {
    let [x, gamma, beta] = inputs else {
        unreachable!()
    };
    let (grid, level) = (grid(dims), Level::detect());
    let activation = [Activation::Identity, Activation::Relu][usize::from(relu)];
    let statistics = ChannelStatistics::of(level, x, &grid);
    let norm = Norm::new(&statistics, gamma, beta, EPS);
    let mut y = vec![0.0; grid.len()];
    norm.apply(level, (x, &grid), None, (&mut y, &grid), activation);
    let sums = norm.sums(level, x, gradient, &grid, activation);
    let gradients = NormGradients::new(&norm, &sums.over_frames(grid.channels));
    let mut of_x = vec![0.0; grid.len()];
    let (ends, target) = ([&x[..], gradient], (&mut of_x[..], &grid));
    norm.backward(level, &gradients.slopes, ends, target, Some(activation));
    (y, vec![of_x, gradients.gamma, gradients.beta], statistics)
}

pub(super) fn norm_reference(x: &[Vec<f64>], relu: bool) -> Vec<f64> {
    let channels = x[1].len();
    let count = (x[0].len() / channels) as f64;
    let channel = |c: usize| x[0].iter().skip(c).step_by(channels);
    let stats = (0..channels).map(|c| {
        let mean = channel(c).sum::<f64>() / count;
        let variance = channel(c).map(|v| (v - mean) * (v - mean)).sum::<f64>() / count;
        (mean, variance)
    });
    let stats: Vec<(f64, f64)> = stats.collect();
    let norm = |(i, v): (usize, &f64)| {
        let c = i % channels;
        let y = (v - stats[c].0) / (stats[c].1 + EPS).sqrt() * x[1][c] + x[2][c];
        if relu { y.max(0.0) } else { y }
    };
    x[0].iter().enumerate().map(norm).collect()
}

#[test]
fn batch_norm_in_training() {
    for (name, dims) in [
        ("odd", [3, 1, 5, 3, 7]),
        ("one channel", [2, 1, 3, 3, 1]),
        ("four numbers", [4, 1, 1, 1, 5]),
        ("batch 1, long", [1, 1, 2, 40, 17]),
        ("three dimensions", [2, 3, 2, 2, 4]),
    ] {
        let channels = dims[4];
        let x = noise(dims.iter().product(), 1);
        let inputs = [x, noise(channels, 2), noise(channels, 3)];
        for relu in [false, true] {
            let operator = |x: &[Vec<f32>], gradient: &[f32]| {
                let (y, gradients, _) = batch_norm(dims, x, relu, gradient);
                (y, gradients)
            };
            let name = format!("{name}, relu {relu}");
            check(&name, &inputs, &operator, &|x| norm_reference(x, relu));
        }
    }
}

#[test]
fn batch_norm_reports_the_batch() {
    let values = noise(2 * 3 * 3 * 2, 1);
    let inputs = [narrow(&values), vec![1.0; 2], vec![1.0; 2]];
    let (_, _, found) = batch_norm([2, 1, 3, 3, 2], &inputs, false, &[0.0; 36]);
    assert_eq!(found.count, 18);
    for c in 0..2 {
        let channel: Vec<f64> = values.iter().skip(c).step_by(2).copied().collect();
        let mean = channel.iter().sum::<f64>() / 18.0;
        let variance = channel.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / 18.0;
        assert!((f64::from(found.mean[c]) - mean).abs() < 1e-7);
        assert!((f64::from(found.variance[c]) - variance).abs() < 1e-7);
    }
}

/// `relu(x * gate + shortcut)` of feature maps `(frames, time, height, width, channels)` and a gate
/// `(frames, channels)`, and their gradients.
fn gated_residual(
    dims: [usize; 5],
    inputs: &[Vec<f32>],
    gradient: &[f32],
) -> (Vec<f32>, Vec<Vec<f32>>) {
    let [x, gate, shortcut] = inputs else {
        unreachable!()
    };
    let (grid, level) = (grid(dims), Level::detect());
    let norm = identity(grid.channels);
    let (x, activation) = ((&x[..], &grid), Activation::Relu);
    let mut y = vec![0.0; grid.len()];
    let onto = Some((&gate[..], Shortcut::Plain(shortcut, &grid)));
    norm.apply(level, x, onto, (&mut y, &grid), activation);
    let mut masked = gradient.to_vec();
    let sums = norm.mask(level, x, (&y, &grid), &mut masked, activation);
    let slopes = Slopes {
        of_gradient: gate.clone(),
        of_x: vec![0.0; grid.channels],
        constant: vec![0.0; grid.frames * grid.channels],
    };
    let mut of_x = vec![0.0; grid.len()];
    let ends = [x.0, &masked];
    norm.backward(level, &slopes, ends, (&mut of_x, &grid), None);
    let of_gate = sums.product.iter().map(|&sum| sum as f32).collect();
    (y, vec![of_x, of_gate, masked])
}

/// A norm that changes nothing.
fn identity(channels: usize) -> Norm {
    let [zeros, ones] = [0.0, 1.0].map(|value| vec![value; channels]);
    Norm::given([&zeros, &ones, &ones, &zeros], 0.0)
}

#[test]
fn the_end_of_a_residual_branch() {
    for dims in [[3, 1, 2, 5, 7], [1; 5], [2, 2, 1, 3, 16]] {
        let [frames, .., channels] = dims;
        let len: usize = dims.iter().product();
        let inputs = [noise(len, 1), noise(frames * channels, 2), noise(len, 3)];
        let per_frame = len / frames;
        let reference = |x: &[Vec<f64>]| -> Vec<f64> {
            let end = |i: usize| {
                let gate = x[1][i / per_frame * channels + i % channels];
                (x[0][i] * gate + x[2][i]).max(0.0)
            };
            (0..len).map(end).collect()
        };
        let operator = |x: &[Vec<f32>], gradient: &[f32]| gated_residual(dims, x, gradient);
        check(&format!("{dims:?}"), &inputs, &operator, &reference);
    }
}

#[test]
fn large_offsets_cost_batch_norm_no_digits() {
    // Values of 1e4 with a spread of 1: the reference sees the same f32 numbers.
    let values = noise(4 * 6 * 6 * 3, 1).into_iter();
    let values = values.map(|v| f64::from((1e4 + v) as f32)).collect();
    let x = [values, vec![1.0, 0.5, 2.0], vec![0.0, 1.0, -1.0]];
    let inputs: Vec<Vec<f32>> = x.iter().map(|values| narrow(values)).collect();
    let gradient = vec![0.0; inputs[0].len()];
    let (found, ..) = batch_norm([4, 1, 6, 6, 3], &inputs, false, &gradient);
    // E[x^2] - E[x]^2 in f32 has no digit left here.
    let error = distance(&wide(&found), &norm_reference(&x, false));
    assert!(error < 5e-4, "{error:.1e}");
}

//! Convolution and pooling in three dimensions against PyTorch's in f64.

use safetensors::SafeTensors;

use super::*;
use crate::golden::{error, uniform};
use crate::{Convolution, MaxPooling};

/// The shape and the numbers, f64, of a tensor of a file.
fn golden(file: &str, name: &str) -> (Vec<usize>, Vec<f64>) {
    let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../fixtures/golden");
    let bytes = std::fs::read(folder.join(file)).unwrap();
    let tensors = SafeTensors::deserialize(&bytes).unwrap();
    let tensor = tensors.tensor(name).unwrap();
    assert_eq!(tensor.dtype(), safetensors::Dtype::F64, "{name}");
    let (numbers, _) = tensor.data().as_chunks::<8>();
    let numbers = numbers.iter().map(|bytes| f64::from_le_bytes(*bytes));
    (tensor.shape().to_vec(), numbers.collect())
}

/// What is given for a shape by a name.
fn input(name: &str, shape: &[usize]) -> Vec<f64> {
    let numbers = uniform(name, shape.iter().product());
    numbers.into_iter().map(|x| f64::from(x as f32)).collect()
}

/// Numbers of `(batch, channels, time, height, width)`, channels last.
fn channels_last(values: &[f64], [batch, channels, size @ ..]: [usize; 5]) -> Vec<f64> {
    let pixels: usize = size.iter().product();
    let mut out = Vec::with_capacity(values.len());
    for frame in 0..batch {
        for pixel in 0..pixels {
            out.extend((0..channels).map(|c| values[(frame * channels + c) * pixels + pixel]));
        }
    }
    out
}

fn window(size: [usize; 3], stride: [usize; 3], padding: [usize; 3]) -> Window {
    Window {
        size,
        stride,
        before: padding,
        after: padding,
    }
}

#[test]
fn convolution_forward_and_backward() {
    let stem = window([7; 3], [2; 3], [3; 3]);
    let point = window([1; 3], [1; 3], [0; 3]);
    let grouped = window([3; 3], [1, 2, 1], [1; 3]);
    let cases = [
        ([1, 3, 9, 20, 18], [8, 3, 7, 7, 7], stem, 1),
        ([2, 8, 4, 5, 6], [6, 8, 1, 1, 1], point, 1),
        ([2, 4, 5, 7, 6], [8, 2, 3, 3, 3], grouped, 2),
    ];
    for (i, (x_shape, weight_shape, window, groups)) in cases.into_iter().enumerate() {
        let name = |leaf: &str| format!("golden/conv3d.{i}.{leaf}");
        let [batch, inputs, size @ ..] = x_shape;
        let conv_shape = shape(window, inputs, weight_shape[0], groups);
        let conv = Convolution::new(batch, size, conv_shape).unwrap();
        let x = narrow(&channels_last(&input(&name("input"), &x_shape), x_shape));
        let weight = narrow(&input(&name("weight"), &weight_shape));
        let read = |leaf: &str| golden("conv3d.safetensors", &format!("{i}.{leaf}"));
        let (y_shape, expected) = read("output");
        let y_shape: [usize; 5] = y_shape.try_into().unwrap();
        let y = conv.forward(&x, &weight).unwrap();
        let found = error(&wide(&y), &channels_last(&expected, y_shape));
        assert!(found < 1e-5, "{i}: output {found:.1e}");

        let cotangent = channels_last(&input(&name("cotangent"), &y_shape), y_shape);
        let [of_x, of_weight] = conv.backward(&x, &weight, &narrow(&cotangent)).unwrap();
        let expected = channels_last(&read("grad_input").1, x_shape);
        let found = [
            error(&wide(&of_x), &expected),
            error(&wide(&of_weight), &read("grad_weight").1),
        ];
        assert!(found.iter().all(|&found| found < 1e-5), "{i}: {found:?}");
    }
}

#[test]
fn a_unit_after_pooling_with_same_padding() {
    let size = [6, 11, 9];
    let x = input("golden/i3d.input", &[1, 6, 6, 11, 9]);
    let x = narrow(&channels_last(&x, [1, 6, 6, 11, 9]));
    let same = Window::same([3; 3], [2; 3], size);
    let pooling = MaxPooling::new(1, size, 6, same, false).unwrap();
    let pooled = pooling.forward(&x).unwrap();
    let weight = narrow(&input("golden/i3d.weight", &[10, 6, 3, 3, 3]));
    let conv_shape = shape(window([3; 3], [1; 3], [1; 3]), 6, 10, 1);
    let conv = Convolution::new(1, pooling.output(), conv_shape).unwrap();
    let y = conv.forward(&pooled, &weight).unwrap();
    let parameter = |leaf: &str, offset: f64, factor: f64| -> Vec<f64> {
        let values = input(&format!("golden/i3d.bn.{leaf}"), &[10]);
        values.iter().map(|u| u * factor + offset).collect()
    };
    let (mean, variance) = (
        parameter("running_mean", 0.0, 0.1),
        parameter("running_var", 1.0, 0.5),
    );
    let (gamma, beta) = (parameter("weight", 1.0, 0.2), parameter("bias", 0.0, 0.1));
    let unit = |(i, y): (usize, &f64)| {
        let c = i % 10;
        ((y - mean[c]) / (variance[c] + 1e-3).sqrt() * gamma[c] + beta[c]).max(0.0)
    };
    let found: Vec<f64> = wide(&y).iter().enumerate().map(unit).collect();
    let (y_shape, expected) = golden("i3d_unit.safetensors", "output");
    let expected = channels_last(&expected, y_shape.try_into().unwrap());
    let found = error(&found, &expected);
    assert!(found < 1e-5, "{found:.1e}");
}

//! Convolution and pooling in three dimensions against PyTorch's in f64.

use candle_core::{DType, Tensor, Var};

use super::super::{Window, conv, max_pool};
use crate::golden::{self, error, values};

/// A tensor of PyTorch's `(batch, channels, time, height, width)`, channels last, f32.
fn channels_last(tensor: &Tensor) -> Tensor {
    let tensor = tensor.to_dtype(DType::F32).unwrap();
    tensor.permute((0, 2, 3, 4, 1)).unwrap()
}

fn input(name: &str, shape: &[usize]) -> Tensor {
    golden::tensor(name, shape).to_dtype(DType::F32).unwrap()
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
    let golden = golden::load("conv3d.safetensors");
    let cases = [
        (
            [1, 3, 9, 20, 18],
            [8, 3, 7, 7, 7],
            window([7; 3], [2; 3], [3; 3]),
            1,
        ),
        (
            [2, 8, 4, 5, 6],
            [6, 8, 1, 1, 1],
            window([1; 3], [1; 3], [0; 3]),
            1,
        ),
        (
            [2, 4, 5, 7, 6],
            [8, 2, 3, 3, 3],
            window([3; 3], [1, 2, 1], [1; 3]),
            2,
        ),
    ];
    for (i, (x_shape, weight_shape, window, groups)) in cases.into_iter().enumerate() {
        let name = |leaf: &str| format!("golden/conv3d.{i}.{leaf}");
        let x = Var::from_tensor(&input(&name("input"), &x_shape)).unwrap();
        let weight = Var::from_tensor(&input(&name("weight"), &weight_shape)).unwrap();
        let y = conv(&channels_last(&x), &weight, window, groups).unwrap();
        let expected = &golden[&format!("{i}.output")];
        let found = error(&values(&y), &values(&channels_last(expected)));
        assert!(found < 1e-5, "{i}: output {found:.1e}");

        let cotangent = channels_last(&input(&name("cotangent"), expected.dims()));
        let loss = (y * cotangent).unwrap().sum_all().unwrap();
        let gradients = loss.backward().unwrap();
        for (variable, leaf) in [(&x, "grad_input"), (&weight, "grad_weight")] {
            let found = values(gradients.get(variable).unwrap());
            let found = error(&found, &values(&golden[&format!("{i}.{leaf}")]));
            assert!(found < 1e-5, "{i}: {leaf} {found:.1e}");
        }
    }
}

#[test]
fn a_unit_after_pooling_with_same_padding() {
    let shape = [6, 11, 9];
    let x = channels_last(&input("golden/i3d.input", &[1, 6, 6, 11, 9]));
    let pooled = max_pool(&x, Window::same([3; 3], [2; 3], shape), false).unwrap();
    let weight = input("golden/i3d.weight", &[10, 6, 3, 3, 3]);
    let y = conv(&pooled, &weight, window([3; 3], [1; 3], [1; 3]), 1).unwrap();
    let parameter = |leaf: &str, offset: f64, factor: f64| {
        let u = input(&format!("golden/i3d.bn.{leaf}"), &[10]);
        ((u * factor).unwrap() + offset).unwrap()
    };
    let centred = y
        .broadcast_sub(&parameter("running_mean", 0.0, 0.1))
        .unwrap();
    let deviation = (parameter("running_var", 1.0, 0.5) + 1e-3)
        .unwrap()
        .sqrt()
        .unwrap();
    let normed = centred.broadcast_div(&deviation).unwrap();
    let scaled = normed
        .broadcast_mul(&parameter("weight", 1.0, 0.2))
        .unwrap();
    let found = scaled
        .broadcast_add(&parameter("bias", 0.0, 0.1))
        .unwrap()
        .relu()
        .unwrap();
    let expected = channels_last(&golden::load("i3d_unit.safetensors")["output"]);
    let found = error(&values(&found), &values(&expected));
    assert!(found < 1e-5, "{found:.1e}");
}

use candle_core::{DType, Device, Tensor, Var};

use super::*;
use crate::golden::{self, error, values};

/// Ten steps down `sum sin²(p c)`, as in `make_golden.py`; each step's parameters.
fn trajectory(dtype: DType, scale: f64) -> Vec<f64> {
    let f32_then = |name: &str| {
        let exact = golden::tensor(name, &[5, 3]).to_dtype(DType::F32).unwrap();
        exact.to_dtype(dtype).unwrap()
    };
    let p = Var::from_tensor(&f32_then("golden/adam.param")).unwrap();
    let config = AdamConfig {
        learning_rate: 1e-2,
        ..AdamConfig::default()
    };
    let mut adam = Adam::new(config, [p.clone()]).unwrap();
    let mut steps = Vec::new();
    for step in 0..10 {
        let c = f32_then(&format!("golden/adam.coef.{step}"));
        let loss = (p.as_tensor() * c).unwrap().sin().unwrap().sqr().unwrap();
        let loss = (loss.sum_all().unwrap() * (1.0 / scale)).unwrap();
        let gradients = loss.backward().unwrap();
        let own = gradients.get(&p).unwrap().clone();
        adam.step(&[own], &[scale; 5]).unwrap();
        steps.extend(values(&p));
    }
    steps
}

#[test]
fn adam_takes_pytorchs_steps() {
    let expected = values(&golden::load("adam.safetensors")["params"]);
    assert!(error(&trajectory(DType::F64, 1.0), &expected) < 1e-14);
    assert!(error(&trajectory(DType::F32, 1.0), &expected) < 1e-6);
}

#[test]
fn a_scale_multiplies_the_gradient_of_its_trial() {
    let expected = values(&golden::load("adam.safetensors")["params"]);
    // Powers of two are exact.
    assert!(error(&trajectory(DType::F64, 1024.0), &expected) < 1e-14);
    let p = Var::zeros((2, 3), DType::F64, &Device::Cpu).unwrap();
    let mut adam = Adam::new(AdamConfig::default(), [p.clone()]).unwrap();
    let ones = Tensor::ones((2, 3), DType::F64, &Device::Cpu).unwrap();
    adam.step(&[ones], &[0.0, 1.0]).unwrap();
    let moved = values(&p);
    assert_eq!(moved[..3], [0.0; 3]);
    assert!(error(&moved[3..], &[-1e-4; 3]) < 1e-7);
}

/// Three steps of `torch.optim.AdamW(lr=0.1, weight_decay=0.5)` on `p = [1, -2]` under the
/// constant gradient `[2, -3]`, from its documented formula: with a constant gradient both
/// corrected means are the gradient and its square, so `p <- 0.95 p - 0.1 g / (|g| + 1e-8)`.
/// With gradient 0, `p <- 0.95 p` alone, where an L2 penalty in the gradient would move by 0.1.
#[test]
fn weight_decay_is_adamws() {
    let config = AdamConfig {
        learning_rate: 0.1,
        weight_decay: 0.5,
        ..AdamConfig::default()
    };
    for (dtype, bound) in [(DType::F64, 1e-14), (DType::F32, 1e-6)] {
        let as_type = |values: [f64; 3]| {
            let tensor = Tensor::new(&[values], &Device::Cpu).unwrap();
            tensor.to_dtype(dtype).unwrap()
        };
        let gradient = [2.0, -3.0, 0.0];
        let mut expected = [1.0, -2.0, 4.0];
        let p = Var::from_tensor(&as_type(expected)).unwrap();
        let mut adam = Adam::new(config.clone(), [p.clone()]).unwrap();
        for _ in 0..3 {
            adam.step(&[as_type(gradient)], &[]).unwrap();
            for (p, g) in expected.iter_mut().zip(gradient) {
                *p = 0.95 * *p - 0.1 * g / (g.abs() + 1e-8);
            }
            assert!(error(&values(&p), &expected) < bound, "{:?}", values(&p));
        }
        // In numbers: 0.95³ - 0.1 (1 + 0.95 + 0.95²), and its like.
        let printed = [0.572_125, -1.429_5, 3.429_5];
        assert!(error(&values(&p), &printed) < 1e-6, "{:?}", values(&p));
    }
}

/// No decay: the bits of the update written without the factor.
#[test]
fn no_weight_decay_changes_no_bit() {
    let start = golden::tensor("golden/adam.param", &[5, 3]);
    let start = start.to_dtype(DType::F32).unwrap();
    let p = Var::from_tensor(&start).unwrap();
    let config = AdamConfig::default();
    let mut adam = Adam::new(config.clone(), [p.clone()]).unwrap();
    let mut expected: Vec<f32> = start.flatten_all().unwrap().to_vec1().unwrap();
    let (mut mean, mut square) = ([0.0_f32; 15], [0.0_f32; 15]);
    for step in 0..10 {
        let gradient = golden::tensor(&format!("golden/adam.coef.{step}"), &[5, 3]);
        let gradient = gradient.to_dtype(DType::F32).unwrap();
        adam.step(std::slice::from_ref(&gradient), &[]).unwrap();
        let gradient: Vec<f32> = gradient.flatten_all().unwrap().to_vec1().unwrap();
        let rate = config.learning_rate / (1.0 - config.beta1.powi(step + 1));
        let unbias = 1.0 / (1.0 - config.beta2.powi(step + 1)).sqrt();
        for i in 0..15 {
            let (b1, b2, g) = (config.beta1 as f32, config.beta2 as f32, gradient[i]);
            mean[i] = b1 * mean[i] + (1.0 - config.beta1) as f32 * g;
            square[i] = b2 * square[i] + (1.0 - config.beta2) as f32 * g * g;
            let root = unbias as f32 * square[i].sqrt() + config.epsilon as f32;
            expected[i] -= rate as f32 * mean[i] / root;
        }
        let found: Vec<f32> = p.flatten_all().unwrap().to_vec1().unwrap();
        let bits = |values: &[f32]| values.iter().map(|v| v.to_bits()).collect::<Vec<_>>();
        assert_eq!(bits(&found), bits(&expected), "step {step}");
    }
}

#[test]
fn a_gradient_that_does_not_fit_is_an_error() {
    let p = Var::zeros((2, 3), DType::F32, &Device::Cpu).unwrap();
    let mut adam = Adam::new(AdamConfig::default(), [p]).unwrap();
    let zeros = |shape: (usize, usize), dtype| Tensor::zeros(shape, dtype, &Device::Cpu).unwrap();
    assert!(adam.step::<Tensor>(&[], &[]).is_err());
    assert!(adam.step(&[zeros((2, 2), DType::F32)], &[]).is_err());
    assert!(adam.step(&[zeros((2, 3), DType::F64)], &[]).is_err());
    assert!(adam.step(&[zeros((2, 3), DType::F32)], &[]).is_ok());
    let p = Var::zeros(2, DType::U32, &Device::Cpu).unwrap();
    assert!(Adam::new(AdamConfig::default(), [p]).is_err());
}

#[test]
fn clipping_leaves_short_gradients_and_shortens_long_ones_to_the_bound() {
    let gradient = Tensor::new(&[[3.0_f32, 4.0], [0.3, 0.4]], &Device::Cpu).unwrap();
    let mut squares = [0.0; 2];
    squared_norms(&gradient, &mut squares).unwrap();
    squared_norms(&gradient, &mut squares).unwrap();
    assert!(error(&squares, &[50.0, 0.5]) < 1e-7);
    let scales = clip_scales(&squares, 1.0);
    assert!(error(&scales, &[1.0 / 50.0_f64.sqrt(), 1.0]) < 1e-7);
    assert!(squared_norms(&gradient, &mut [0.0; 3]).is_err());
}

mod hard_cases {
    use super::*;

    /// A gradient of norm 1e30 in f32: clipped to 1 it moves Adam as the unit gradient does. The
    /// sum of squares in f32 is infinite, and would scale it to nothing.
    #[test]
    fn a_gradient_norm_of_1e30_before_clipping() {
        let direction = [0.6_f64, 0.8];
        let step = |gradient: Tensor| {
            let p = Var::zeros((1, 2), DType::F32, &Device::Cpu).unwrap();
            let mut adam = Adam::new(AdamConfig::default(), [p.clone()]).unwrap();
            let mut squares = [0.0];
            squared_norms(&gradient, &mut squares).unwrap();
            let scales = clip_scales(&squares, 1.0);
            adam.step(std::slice::from_ref(&gradient), &scales).unwrap();
            let small = (gradient * 1e-30).unwrap();
            adam.step(&[small], &[]).unwrap();
            (values(&p), scales[0])
        };
        let huge = Tensor::new(&[[0.6e30_f32, 0.8e30]], &Device::Cpu).unwrap();
        let (moved, scale) = step(huge.clone());
        assert!((scale / 1e-30 - 1.0).abs() < 1e-7);
        // Adam's step for a constant gradient is the learning rate, whatever the gradient.
        let expected = direction.map(|g| -2e-4 * g / (g + 1e-8));
        let off = error(&moved, &expected);
        println!("gradient norm of 1e30: error {off:.1e}, bound 1e-6, naive form does not move");
        assert!(off < 1e-6, "{moved:?}");

        let naive = huge.sqr().unwrap().sum_all().unwrap();
        let naive: f32 = naive.to_scalar().unwrap();
        assert_eq!(1.0 / naive.sqrt(), 0.0, "the naive form");
    }
}

/// A decay of 1 divides by zero in the first step.
#[test]
fn settings_out_of_their_range_are_refused_by_name() {
    let refused = |change: &dyn Fn(&mut AdamConfig), key: &str| {
        let mut config = AdamConfig::default();
        change(&mut config);
        let message = Adam::new(config, []).unwrap_err().to_string();
        assert!(message.starts_with(key), "{message}");
    };
    for wrong in [0.0, -1.0, f64::INFINITY, f64::NAN] {
        refused(&|c| c.learning_rate = wrong, "adam.learning-rate");
    }
    refused(&|c| c.beta1 = 1.0, "adam.beta1");
    refused(&|c| c.beta2 = f64::NAN, "adam.beta2");
    refused(&|c| c.beta2 = -0.1, "adam.beta2");
    refused(&|c| c.epsilon = -1e-8, "adam.epsilon");
    refused(&|c| c.epsilon = 0.0, "adam.epsilon");
    refused(&|c| c.weight_decay = f64::INFINITY, "adam.weight-decay");
    refused(&|c| c.weight_decay = -0.1, "adam.weight-decay");
}

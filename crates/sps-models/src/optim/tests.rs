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

        let naive = huge
            .sqr()
            .unwrap()
            .sum_all()
            .unwrap()
            .to_scalar::<f32>()
            .unwrap();
        assert_eq!(1.0 / naive.sqrt(), 0.0, "the naive form");
    }
}

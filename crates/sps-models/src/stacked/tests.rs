//! Against closed forms and candle's own composition.

use candle_core::{DType, Device, Result, Tensor, Var};

use super::*;
use crate::golden::{self, error, values};
use crate::optim::Gradient;

/// The gradient of a parameter of f64.
pub(crate) fn gradient(parameter: &Parameter) -> Vec<f64> {
    let slot = parameter.gradient().unwrap();
    slot.read(|values| Ok(values.to_vec())).unwrap()
}

/// A gradient of `operator` at `z`, weighted by `by`.
fn slope(
    operator: impl Fn(&Tensor) -> Result<Tensor>,
    z: &[f64],
    shape: &[usize],
    dtype: DType,
) -> (Vec<f64>, Vec<f64>) {
    let z = Tensor::from_slice(z, shape, &Device::Cpu).unwrap();
    let z = Var::from_tensor(&z.to_dtype(dtype).unwrap()).unwrap();
    let y = operator(z.as_tensor()).unwrap();
    let gradients = y.sum_all().unwrap().backward().unwrap();
    (values(&y), values(gradients.get(&z).unwrap()))
}

#[test]
fn linear_is_the_composition_with_its_gradients() {
    let x = golden::tensor("stacked.x", &[3, 5, 7]);
    let [w, b] = [("stacked.w", vec![3, 7, 4]), ("stacked.b", vec![3, 4])]
        .map(|(name, shape)| Var::from_tensor(&golden::tensor(name, &shape)).unwrap());
    let cotangent = golden::tensor("stacked.dy", &[3, 5, 4]);
    let x = Var::from_tensor(&x).unwrap();

    let backward = |y: &Tensor| {
        let loss = (y * &cotangent).unwrap().sum_all().unwrap();
        loss.backward().unwrap()
    };
    let products = x.matmul(&w).unwrap();
    let plain = products.broadcast_add(&b.unsqueeze(1).unwrap()).unwrap();
    let expected = backward(&plain);

    let (weight, bias) = (Parameter::variable(&w), Parameter::variable(&b));
    let found = linear(&x, &weight, &bias).unwrap();
    assert!(error(&values(&found), &values(&plain)) < 1e-15);
    let gradients = backward(&found);
    let of = |variable: &Var| values(expected.get(variable).unwrap());
    assert!(error(&values(gradients.get(&x).unwrap()), &of(&x)) < 1e-15);
    assert!(error(&gradient(&weight), &of(&w)) < 1e-15);
    assert!(error(&gradient(&bias), &of(&b)) < 1e-15);

    let without = matmul(&x, &weight).unwrap();
    assert!(error(&values(&without), &values(&products)) < 1e-15);
}

#[test]
fn a_parameter_used_twice_has_the_sum_of_both_gradients_until_it_is_cleared() {
    let w = Var::from_tensor(&golden::tensor("stacked.w", &[1, 2, 2])).unwrap();
    let weight = Parameter::variable(&w);
    let ones = Tensor::ones((1, 1, 2), DType::F64, &Device::Cpu).unwrap();
    let once = || matmul(&ones, &weight).unwrap().sum_all().unwrap();
    (once() + once()).unwrap().backward().unwrap();
    assert_eq!(gradient(&weight), [2.0; 4]);
    weight.gradient().unwrap().clear();
    assert!(!weight.gradient().unwrap().is_written());
    once().backward().unwrap();
    assert_eq!(gradient(&weight), [1.0; 4]);
}

#[test]
fn shapes_that_do_not_fit_are_errors() {
    let zeros = |shape: &[usize]| Tensor::zeros(shape, DType::F32, &Device::Cpu).unwrap();
    let constant = |shape: &[usize]| Parameter::constant(zeros(shape));
    let x = zeros(&[2, 3, 4]);
    assert!(matmul(&x, &constant(&[2, 5, 1])).is_err());
    assert!(matmul(&x, &constant(&[3, 4, 1])).is_err());
    assert!(linear(&x, &constant(&[2, 4, 1]), &constant(&[2, 2])).is_err());
    assert!(matmul(&x, &Parameter::constant(golden::tensor("w", &[2, 4, 1]))).is_err());
    assert!(cross_entropy(&x, vec![Some(0); 5]).is_err());
    assert!(cross_entropy(&x, vec![Some(4); 6]).is_err());
    assert!(row_norm(&zeros(&[2, 3])).is_err());
}

#[test]
fn softplus_is_its_closed_form() {
    // e^-50, and log(2); the derivative is the logistic function.
    let (y, dy) = slope(softplus, &[-50.0, 0.0, 50.0], &[3], DType::F64);
    let tail = 1.928_749_847_963_917_8e-22;
    assert!((y[0] / tail - 1.0).abs() < 1e-14);
    assert!((y[1] - std::f64::consts::LN_2).abs() < 1e-16);
    assert_eq!(y[2], 50.0 + tail);
    assert!((dy[0] / tail - 1.0).abs() < 1e-14);
    assert_eq!(dy[1..], [0.5, 1.0]);
}

#[test]
fn leaky_relu_has_slope_a_fifth_below_zero() {
    let (y, dy) = slope(leaky_relu, &[-2.0, 0.0, 3.0], &[3], DType::F64);
    assert_eq!(y, [-0.4, 0.0, 3.0]);
    assert_eq!(dy, [0.2, 0.2, 1.0]);
}

#[test]
fn the_row_norm_of_a_triangle() {
    let (y, dy) = slope(row_norm, &[3.0, -4.0], &[1, 1, 2], DType::F64);
    assert_eq!(y, [5.0]);
    assert!(error(&dy, &[0.6, -0.8]) < 1e-15);
}

#[test]
fn cross_entropy_of_equal_logits_is_the_logarithm_of_the_classes() {
    let labels = vec![Some(2), None];
    let operator = |z: &Tensor| cross_entropy(z, labels.clone());
    let (y, dy) = slope(operator, &[7.0; 8], &[1, 2, 4], DType::F64);
    assert!((y[0] - 4.0_f64.ln()).abs() < 1e-15);
    assert_eq!(y[1], 0.0);
    assert_eq!(dy[..4], [0.25, 0.25, -0.75, 0.25]);
    assert_eq!(dy[4..], [0.0; 4]);
}

mod hard_cases {
    use super::*;

    /// `log D` and `log(1 - D)` at logits of +-1e4, f32. By way of the probability they are
    /// infinite or lost; the closed form is `-softplus(-z)`, which here is 0 or `-1e4` to within
    /// `e^-10000`.
    #[test]
    fn logits_of_ten_thousand_either_way() {
        for dtype in [DType::F32, DType::F64] {
            let z = [-1e4, -88.0, 88.0, 1e4];
            let (y, dy) = slope(softplus, &z, &[4], dtype);
            // e^-88 to 16 digits.
            let tail = 6.054_601_895_401_186e-39;
            let bound = if dtype == DType::F64 { 1e-14 } else { 1e-6 };
            assert_eq!(y[0], 0.0);
            let off = (y[1] / tail - 1.0).abs();
            println!("logits, {dtype:?}: error {off:.1e}, bound {bound:.0e}");
            assert!(off < bound, "{}", y[1]);
            assert_eq!(y[2..], [88.0, 1e4]);
            assert_eq!(dy[0], 0.0);
            assert!((dy[1] / tail - 1.0).abs() < bound);
            assert_eq!(dy[2..], [1.0, 1.0]);
        }
        let probability = 1.0 / (1.0 + 1e4_f32.exp());
        assert_eq!((-(probability.ln())), f32::INFINITY, "the naive form");
        let tail = (1.0 + (-88.0_f64).exp()).ln();
        assert_eq!(tail, 0.0, "the naive form");
    }

    /// A classifier that is sure, and right or wrong, by +-1e4.
    #[test]
    fn class_logits_of_ten_thousand_either_way() {
        let z = [1e4, -1e4, -1e4, 1e4];
        for dtype in [DType::F32, DType::F64] {
            let operator = |z: &Tensor| cross_entropy(z, vec![Some(0), Some(0)]);
            let (y, dy) = slope(operator, &z, &[1, 2, 2], dtype);
            assert_eq!(y, [0.0, 2e4]);
            assert_eq!(dy, [0.0, 0.0, -1.0, 1.0]);
        }
        let naive = (1e4_f32.exp() / (1e4_f32.exp() + (-1e4_f32).exp())).ln();
        assert!(naive.is_nan(), "the naive form");
    }

    /// The third term of the adversarial loss where the estimate is exact: the norm is 0, and so
    /// is its gradient; the root of the sum of squares has 0 / 0.
    #[test]
    fn the_norm_of_pairs_that_coincide() {
        let zero = [0.0, 0.0];
        let found = slope(row_norm, &zero, &[1, 1, 2], DType::F32);
        assert_eq!(found, (vec![0.0], zero.to_vec()));
        let naive = |x: &Tensor| x.sqr()?.sum(2)?.sqrt();
        let (_, naive) = slope(naive, &zero, &[1, 1, 2], DType::F32);
        assert!(naive[0].is_nan(), "the naive form");
    }

    /// Norms whose squares leave f32 at either end.
    #[test]
    fn the_norm_of_huge_and_tiny_errors() {
        for scale in [1e-30, 1e30] {
            let triangle = [3.0 * scale, 4.0 * scale];
            let (y, dy) = slope(row_norm, &triangle, &[1, 1, 2], DType::F32);
            let off = (y[0] / (5.0 * scale) - 1.0).abs();
            println!("norm of {scale:e}: error {off:.1e}, bound 1e-7");
            assert!(off < 1e-7);
            assert!(error(&dy, &[0.6, 0.8]) < 1e-7);
            let naive = |x: &Tensor| x.sqr()?.sum(2)?.sqrt();
            let (y, _) = slope(naive, &triangle, &[1, 1, 2], DType::F32);
            assert!((y[0] / (5.0 * scale) - 1.0).abs() > 0.9, "the naive form");
        }
    }
}

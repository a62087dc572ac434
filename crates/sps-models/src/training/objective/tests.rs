//! Linear layers by their definition; heads are in `training/tests`.

use candle_core::Device;
use sps_regress::Readings;

use super::*;
use crate::golden;
use crate::training::targets::Classes;

fn targets() -> Targets {
    let rows = [
        vec![Some(1.0), Some(10.0)],
        vec![Some(3.0), None],
        vec![Some(5.0), Some(30.0)],
    ];
    let names = vec!["a".to_owned(), "b".to_owned()];
    Targets {
        values: Some(Readings::new(names, &rows).unwrap()),
        classes: Some(Classes {
            of_image: vec![0, 1, 1],
            count: 2,
        }),
        ..Targets::default()
    }
}

fn linear(targets: Targets, width: usize) -> Result<Objective> {
    Objective::new(&TrainingConfig::default(), targets, &[0, 1, 2], width, 0)
}

fn zeros(shape: (usize, usize)) -> Tensor {
    Tensor::zeros(shape, candle_core::DType::F32, &Device::Cpu).unwrap()
}

#[test]
fn the_loss_is_that_of_its_definition() {
    let objective = linear(targets(), 2).unwrap();
    for (name, var) in objective.parameters() {
        let zero = var.zeros_like().unwrap();
        // Class 1 scores ln 3 above class 0 everywhere; values are estimated as the mean.
        let value = if name == "classes.bias" {
            Tensor::new(&[0.0f32, 3f32.ln()], &Device::Cpu).unwrap()
        } else {
            zero
        };
        var.set(&value).unwrap();
    }
    let loss = objective.loss(&zeros((3, 2)), Share::whole(&[0, 1, 2]), 0);
    let (loss, parts) = loss.unwrap();
    // Column a: standardised to -1.2247, 0, 1.2247; column b to -1, -, 1; five values.
    let values = (1.5 + 1.5 + 1.0 + 1.0) / 5.0;
    let classes = (4f64.ln() + 2.0 * (4.0f64 / 3.0).ln()) / 3.0;
    assert!((parts.values - values).abs() < 1e-6, "{parts:?}");
    assert!((parts.classes - classes).abs() < 1e-6, "{parts:?}");
    assert!((parts.accuracy - 2.0 / 3.0).abs() < 1e-6, "{parts:?}");
    let total = f64::from(loss.to_scalar::<f32>().unwrap());
    assert!((total - parts.total()).abs() < 1e-6);
}

#[test]
fn every_parameter_receives_a_gradient() {
    let objective = linear(targets(), 4).unwrap();
    let embeddings = Tensor::ones((3, 4), candle_core::DType::F32, &Device::Cpu).unwrap();
    let loss = objective.loss(&embeddings, Share::whole(&[0, 1, 2]), 0);
    let (loss, _) = loss.unwrap();
    let gradients = loss.backward().unwrap();
    for (name, var) in objective.parameters() {
        let gradient = gradients.get(var).unwrap().abs().unwrap();
        let sum = gradient.sum_all().unwrap().to_scalar::<f32>().unwrap();
        assert!(sum > 0.0, "{name}");
    }
}

mod hard_cases {
    use super::*;

    /// Scores of some 1e4, against the definition in f64.
    #[test]
    fn class_scores_of_1e4_have_their_loss() {
        let objective = linear(targets(), 2).unwrap();
        for (name, var) in objective.parameters() {
            if name == "classes.weight" {
                let rows = [[1.0_f32, 0.5], [-0.5, 0.75]];
                var.set(&Tensor::new(&rows, &Device::Cpu).unwrap()).unwrap();
            } else if name == "classes.bias" {
                var.set(&var.zeros_like().unwrap()).unwrap();
            }
        }
        let embeddings = Tensor::full(1e4f32, (3, 2), &Device::Cpu).unwrap();
        let loss = objective.loss(&embeddings, Share::whole(&[0, 1, 2]), 0);
        let (loss, parts) = loss.unwrap();
        // Class 0 scores 15,000 and class 1 2,500; one image is of class 0, two of class 1.
        let expected = 2.0 * 12_500.0 / 3.0;
        let error = (parts.classes / expected - 1.0).abs();
        let sum = 15_000_f32.exp() + 2_500_f32.exp();
        let naive = -(2_500_f32.exp() / sum).ln();
        println!("class scores of 1e4: error {error:.1e}, bound 2e-7, naive form {naive}");
        assert!(error <= 2e-7, "{parts:?}");
        assert!(naive.is_nan(), "the naive form");
        let gradients = loss.backward().unwrap();
        for (name, var) in objective.parameters() {
            let gradient = golden::numbers(gradients.get(var).unwrap());
            assert!(gradient.iter().all(|g| g.is_finite()), "{name}");
            if name == "classes.bias" {
                assert!((gradient[0] - 2.0 / 3.0).abs() <= 1e-7, "{gradient:?}");
                assert!((gradient[1] + 2.0 / 3.0).abs() <= 1e-7, "{gradient:?}");
            }
        }
    }
}

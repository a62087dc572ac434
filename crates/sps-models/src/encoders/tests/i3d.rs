//! I3D against PyTorch's in f64 (`fixtures/golden/make_i3d_golden.py`), and what it refuses.

use candle_core::{DType, Device, Tensor};

use super::relative;
use crate::Error;
use crate::encoders::I3d;
use crate::golden;
use crate::weights::{Weights, WeightsErrorKind};

fn weights() -> Vec<(String, Tensor)> {
    let specs = I3d::specs();
    specs
        .iter()
        .map(|spec| (spec.name.clone(), golden::weight(spec)))
        .collect()
}

#[test]
fn embeds_as_pytorch_does() {
    let encoder = I3d::new(Weights::from_tensors("the golden rule", weights()).unwrap()).unwrap();
    let expected = golden::load("i3d.safetensors");
    for (name, shape) in [
        ("even", [2, 3, 8, 32, 48]),
        ("odd", [1, 3, 5, 37, 29]),
        ("one", [1, 3, 1, 1, 1]),
    ] {
        let sequences = golden::tensor(&format!("golden/i3d.{name}"), &shape);
        let sequences = sequences.to_dtype(DType::F32).unwrap();
        let found = encoder.embed_normalised(&sequences).unwrap();
        let found = relative(&found, &expected[&format!("{name}.embedding")]);
        assert!(found < 1e-5, "{name}: {found:.1e}");
    }
}

#[test]
fn the_classifier_may_be_in_the_file() {
    let mut tensors = weights();
    let classifier = Tensor::zeros((400, 1024, 1, 1, 1), DType::F32, &Device::Cpu).unwrap();
    tensors.push(("logits.conv3d.weight".to_owned(), classifier));
    assert!(I3d::new(Weights::from_tensors("file", tensors.clone()).unwrap()).is_ok());
    tensors.retain(|(name, _)| name != "Mixed_4c.b2b.bn.bias");
    let error = I3d::new(Weights::from_tensors("file", tensors).unwrap()).unwrap_err();
    let Error::Weights(error) = error else {
        panic!("{error}");
    };
    assert!(matches!(
        error.kind(),
        WeightsErrorKind::Missing { tensor, .. } if tensor == "Mixed_4c.b2b.bn.bias"
    ));
}

mod hard_cases {
    use super::*;

    #[test]
    fn sequences_that_cannot_be_embedded() {
        let encoder = I3d::seeded(1).unwrap();
        for shape in [
            vec![1, 3, 8, 8],
            vec![1, 4, 2, 8, 8],
            vec![1, 3, 0, 8, 8],
            vec![0, 3, 1, 8, 8],
        ] {
            let sequences = Tensor::zeros(shape, DType::F32, &Device::Cpu).unwrap();
            let error = encoder.embed(&sequences).unwrap_err();
            assert!(matches!(
                error,
                Error::Input {
                    what: "sequences",
                    ..
                }
            ));
        }
    }

    #[test]
    fn sequences_of_one_value_and_of_odd_extents_are_finite() {
        let encoder = I3d::seeded(1).unwrap();
        for (value, shape) in [
            (0.0_f32, (2, 3, 4, 9, 7)),
            (1e-40, (1, 3, 3, 8, 8)),
            (1.0, (1, 3, 17, 1, 1)),
            (0.5, (1, 3, 1, 3, 90)),
        ] {
            let sequences = Tensor::full(value, shape, &Device::Cpu).unwrap();
            let embedding = encoder.embed(&sequences).unwrap().flatten_all().unwrap();
            let embedding: Vec<f32> = embedding.to_vec1().unwrap();
            assert!(embedding.iter().all(|v| v.is_finite()));
        }
    }
}

//! What a backward pass gives and what it refuses. `pytorch` has the numbers.

use std::sync::Arc;

use candle_core::{Tensor, Var};

use crate::differentiable::differentiable;
use crate::encoders::{Encoder, EncoderKind, TrainableEncoder};
use crate::golden::{self, input};

fn small(seed: u64) -> TrainableEncoder {
    let start = Encoder::seeded(EncoderKind::EfficientNetLiteBody, seed).unwrap();
    TrainableEncoder::new(&start).unwrap()
}

fn loss(encoder: &mut TrainableEncoder, images: &Tensor) -> Tensor {
    let embeddings = encoder.forward(images).unwrap();
    embeddings.sqr().unwrap().mean_all().unwrap()
}

/// Of the first variable.
fn gradient(encoder: &TrainableEncoder, loss: &Tensor) -> Vec<f64> {
    let gradients = encoder.backward(loss).unwrap();
    let (_, variable) = encoder.variables().next().unwrap();
    golden::values(gradients.get(variable).unwrap())
}

/// A store without the weights' gradients would train the rest and leave the encoder as it is.
#[test]
fn a_backward_pass_that_leaves_weights_out_fails() {
    let images = input("images", &[2, 3, 17, 19]);
    let (mut one, mut other) = (small(1), small(2));
    let of_one = loss(&mut one, &images);
    golden::refused(of_one.backward(), "`TrainableEncoder::backward`");

    let both = (&of_one + loss(&mut other, &images)).unwrap();
    for encoder in [&one, &other] {
        assert!(encoder.backward(&both).is_err());
        // A pass that failed listens no longer.
        assert!(of_one.backward().is_err());
    }
    assert!(one.backward(&of_one).is_ok());
}

/// As where a thread of the pool takes up another pass while it waits for others.
#[test]
fn a_pass_within_a_pass_leaves_its_gradients_alone() {
    let images = input("images", &[2, 3, 17, 19]);
    let mut encoder = small(1);
    let inner = loss(&mut encoder, &images);
    let outer = loss(&mut encoder, &images);
    let encoder = Arc::new(encoder);
    let gradient = |loss: &Tensor| gradient(&encoder, loss);
    let alone = gradient(&outer);
    let within = Arc::clone(&encoder);
    let pass = move |_: &Tensor, of_loss: &Tensor| {
        within.backward(&inner).map_err(candle_core::Error::wrap)?;
        Ok(Some(of_loss.clone()))
    };
    let value: Vec<f32> = vec![outer.to_scalar().unwrap()];
    let outer = differentiable([&outer; 2], value, (), pass).unwrap();
    assert_eq!(gradient(&outer), alone);
}

/// Passes at the same time do not take each other's gradients, and two in one loss add up.
#[test]
fn backward_passes_keep_their_gradients_apart() {
    let images = input("images", &[2, 3, 17, 19]);
    let mut encoder = small(1);
    let once = loss(&mut encoder, &images);
    let twice = (&once + loss(&mut encoder, &images)).unwrap();
    let gradient = |loss: &Tensor| gradient(&encoder, loss);
    let (alone, double) = (gradient(&once), gradient(&twice));
    assert!(alone.iter().zip(&double).all(|(a, d)| 2.0 * a == *d));
    std::thread::scope(|scope| {
        let passes = [&once, &twice].map(|loss| scope.spawn(|| gradient(loss)));
        let [first, second] = passes.map(|pass| pass.join().unwrap());
        assert_eq!((first, second), (alone, double));
    });
}

#[test]
fn images_that_are_variables_are_refused() {
    let images = Var::from_tensor(&input("images", &[2, 3, 17, 19])).unwrap();
    let computed = (images.as_tensor() * 0.5).unwrap();
    let start = Encoder::seeded(EncoderKind::SqueezeNet1_0, 1).unwrap();
    for images in [images.as_tensor(), &computed] {
        let mut other = TrainableEncoder::new(&start).unwrap();
        for refused in [
            small(1).forward(images),
            other.forward(images),
            start.embed(images),
        ] {
            let error = refused.unwrap_err();
            let expected = "images: found a variable, or computed from one, expected constants";
            assert!(error.to_string().starts_with(expected), "{error}");
        }
        assert!(small(1).forward(&images.detach()).is_ok());
    }
}

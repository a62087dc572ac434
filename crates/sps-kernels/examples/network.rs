//! A small network, written as a list of layers: an embedding in each precision, and a step of training.

use std::collections::BTreeMap;
use std::sync::Arc;

use sps_kernels::inference::{Inference, calibrate};
use sps_kernels::network::{Conv, IMAGE, Network, Slide};
use sps_kernels::simd::Level;
use sps_kernels::training::Training;
use sps_kernels::{Images, Normalisation, Order, Precision, Result};

fn main() -> Result<()> {
    let mut network = Network::new("small", "classifier.");
    let stem = Conv::new("stem", Slide::square(3, 2, 1), 16).relu();
    let stem = network.conv(IMAGE, stem);
    let deeper = Conv::new("deeper", Slide::square(3, 2, 1), 32).relu();
    network.conv(stem, deeper);
    network.depth("deeper");

    // As a file of weights would have them.
    let wave = |i: usize| (i as f32 * 0.7).sin() * 0.1;
    let numbers = |shape: &[usize]| (0..shape.iter().product()).map(wave).collect();
    let specs = network.specs().into_iter();
    let tensors = specs.map(|spec| (spec.name, numbers(&spec.shape)));
    let tensors: BTreeMap<String, Vec<f32>> = tensors.collect();

    let image: Vec<f32> = (0..3 * 64 * 64).map(|i| 0.5 + wave(i)).collect();
    let images = [&image[..]];
    let images = Images::new(&images, Order::Pixels, [1, 64, 64], Normalisation::IMAGENET)?;
    let level = Level::detect();
    let scales = calibrate(&network, &tensors, &[images], level)?;
    for precision in Precision::ALL {
        let inference = Inference::new(&network, &tensors, precision, Some(&scales), level)?;
        let embeddings = inference.embed(&images)?;
        assert_eq!(embeddings.len(), network.width());
        println!("{precision}: {:.4?} ..", &embeddings[..4]);
    }

    let training = Training::new(Arc::new(network));
    let forward = training.forward(Arc::new(tensors), &images)?;
    // The gradient of a loss that is the sum of the embedding.
    let gradients = forward.pass.backward(&[1.0; 32])?;
    for (name, gradient) in &gradients.0 {
        println!("{name}: {} gradients", gradient.len());
    }
    assert_eq!(gradients.0["stem.weight"].len(), 16 * 3 * 3 * 3);
    Ok(())
}

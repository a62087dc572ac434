//! bf16 beside f32, layer by layer.

use std::collections::BTreeMap;

use super::*;
use crate::golden::{uniform, weight};
use crate::images::{Normalisation, Order};
use crate::networks::se_resnext50;
use crate::ops::tests::inside;
use crate::ops::words::Bf16Pair;

type Numbers = BTreeMap<String, Vec<f32>>;

/// What leaves the stem and each bottleneck.
fn layers<W: Word>(weights: &Numbers, image: &[f32], size: [usize; 3]) -> Vec<Vec<f64>> {
    let network = se_resnext50("SE-ResNeXt-50");
    let fused = Fused::<W>::new(&network, weights, None, (Level::detect(), false)).unwrap();
    let images = Images {
        pixels: &[image],
        order: Order::Planes,
        size,
        normalisation: Normalisation::NONE,
    };
    let mut layers = Vec::new();
    fused.each_map(Threads::One, &images, |map, memory, grid| {
        let layer = map.checked_sub(1).map(|number| &network.layers[number]);
        if matches!(layer, Some(Layer::MaxPool(_) | Layer::Residual { .. })) {
            layers.push(inside(memory, grid));
        }
    });
    layers
}

/// The norm of the difference relative to that of what is expected.
fn relative(found: &[f64], expected: &[f64]) -> f64 {
    let norm = |values: &mut dyn Iterator<Item = f64>| values.map(|v| v * v).sum::<f64>().sqrt();
    let difference = norm(&mut found.iter().zip(expected).map(|(f, e)| f - e));
    difference / norm(&mut expected.iter().copied())
}

/// The tensors of a network by the golden rule, each number as `change` makes it.
fn weights(change: impl Fn(f32) -> f32) -> Numbers {
    let specs = se_resnext50("SE-ResNeXt-50").specs().into_iter();
    let numbers = specs.map(|spec| {
        let numbers = weight(&spec.name, &spec.shape).into_iter().map(&change);
        (spec.name, numbers.collect())
    });
    numbers.collect()
}

/// A number of bf16 with what follows cut off.
fn truncated_to_bf16(number: f32) -> f32 {
    f32::from_bits(number.to_bits() & 0xffff_0000)
}

/// Rounding to the eight bits of a bf16 is off by at most 2⁻⁸ of a number, to both sides alike.
/// What all layers so far have added to the error then grows as a walk does, with the square root of
/// their number. Numbers cut off to eight bits err to one side, and their errors add up.
#[test]
fn bf16_beside_f32_layer_by_layer() {
    let image = uniform("golden/eval97", 3 * 97 * 131);
    let image: Vec<f32> = image.iter().map(|&x| x as f32).collect();
    let size = [1, 97, 131];
    let given = weights(|weight| weight);
    let exact = layers::<f32>(&given, &image, size);
    let rounded = layers::<Bf16Pair>(&given, &image, size);
    let naive = layers::<Bf16Pair>(&weights(truncated_to_bf16), &image, size);
    assert_eq!(exact.len(), 17);
    for (layer, (found, expected)) in rounded.iter().zip(&exact).enumerate() {
        let bound = 2.0_f64.powi(-8) * ((1 + layer) as f64).sqrt();
        let error = relative(found, expected);
        let truncated = relative(&naive[layer], expected);
        println!("after layer {layer}: {error:.1e} of {bound:.1e}, cut off {truncated:.1e}");
        assert!(error < bound && truncated > bound, "after layer {layer}");
    }
}

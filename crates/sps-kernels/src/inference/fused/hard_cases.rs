//! bf16 beside f32, layer by layer.

use std::collections::BTreeMap;

use super::*;
use crate::golden::{uniform, weight};
use crate::images::{Normalisation, Order};
use crate::network::{Gate, Slide};
use crate::ops::words::Bf16Pair;

/// The layers of an SE-ResNeXt-50, whose kin the paper's encoder is.
fn network() -> Network {
    let mut net = Network::new("SE-ResNeXt-50", "last_linear.");
    let point = |name: String, outputs| {
        Conv::new(&name[..], Slide::square(1, 1, 0), outputs).norm(name.replace("conv", "bn"))
    };
    let stem = Conv::new("conv1", Slide::square(7, 2, 3), 64).norm("bn1");
    let stem = net.conv(IMAGE, stem.relu());
    let mut x = net.max_pool(stem, Slide::square(3, 2, 0), true);
    for (stage, blocks) in [3, 4, 6, 3].into_iter().enumerate() {
        for block in 0..blocks {
            x = bottleneck(&mut net, x, stage, block, &point);
        }
    }
    net.depth("stage-4");
    net
}

fn bottleneck(
    net: &mut Network,
    x: Map,
    stage: usize,
    block: usize,
    point: &dyn Fn(String, usize) -> Conv,
) -> Map {
    let (middle, outputs) = (128 << stage, 256 << stage);
    let name = |leaf: &str| format!("layer{stage}.{block}.{leaf}");
    let stride = if block == 0 && stage > 0 { 2 } else { 1 };
    let reduced = net.conv(x, point(name("conv1"), middle).relu());
    let grouped = Conv::new(name("conv2"), Slide::square(3, stride, 1), middle);
    let grouped = net.conv(reduced, grouped.norm(name("bn2")).groups(32).relu());
    let shortcut = if block == 0 {
        let conv = Conv::new(name("conv4"), Slide::square(1, stride, 0), outputs);
        net.conv(x, conv.norm(name("bn4")))
    } else {
        x
    };
    let gate = Gate {
        layers: ["fc1", "fc2"].map(name),
        channels: outputs,
        hidden: outputs / 16,
    };
    net.residual(
        grouped,
        point(name("conv3"), outputs).relu(),
        Some(gate),
        shortcut,
    )
}

type Numbers = BTreeMap<String, Vec<f32>>;

/// The numbers of a feature map, pixel by pixel.
fn numbers<W: Word>(memory: &[W], grid: &Grid) -> Vec<f64> {
    let pixel = |&place: &usize| W::numbers(&memory[place..][..grid.words]);
    let places = grid.places();
    places.iter().flat_map(pixel).map(f64::from).collect()
}

/// What leaves the stem and each bottleneck.
fn layers<W: Word>(weights: &Numbers, image: &[f32], size: [usize; 3]) -> Vec<Vec<f64>> {
    let network = network();
    let fused = Fused::<W>::new(&network, weights, None, Level::detect()).unwrap();
    let images = Images {
        pixels: &[image],
        order: Order::Planes,
        size,
        normalisation: Normalisation::NONE,
    };
    let grids = fused.grids(1, size);
    let mut slots: Vec<_> = (0..fused.slots.count).map(|_| Slot::default()).collect();
    fused.lay_out(Threads::One, image, &images, &grids[IMAGE], &mut slots);
    let mut layers = Vec::new();
    for (number, layer) in network.layers.iter().enumerate() {
        fused.run(Threads::One, number, &grids, &mut slots);
        if matches!(layer, Layer::MaxPool(_) | Layer::Residual { .. }) {
            let map = number + 1;
            layers.push(numbers(&slots[fused.slots.of(map)].memory, &grids[map]));
        }
    }
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
    let specs = network().specs().into_iter();
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
        assert!(
            error < bound,
            "after layer {layer}: {error:.1e} of {bound:.1e}"
        );
        assert!(truncated > bound);
    }
}

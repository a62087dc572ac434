//! What follows from a network's list of layers, and the networks in f64 against PyTorch's
//! (`fixtures/golden/make_golden_encoders.py`).

use std::collections::BTreeMap;

use candle_core::{DType, Tensor, Var};
use sps_kernels::network::{IMAGE, Layer};

use crate::encoders::plain::Plain;
use crate::encoders::{Depths, Encoder, EncoderKind};
use crate::golden::{self, error, norm, numbers, relative, values};
use crate::weights::Weights;

/// Other names of EfficientNet-Lite0's tensors.
fn other_names() -> impl Fn(&str) -> String {
    let names =
        golden::json("encoders_grad_norms.json")["efficientnet_lite0.lukemelas_names"].take();
    move |name| names[name].as_str().unwrap().to_owned()
}

/// The embedding of a pass in training by candle's operators in f64, and the gradients by name.
fn plain_pass(
    kind: EncoderKind,
    images: &str,
    cotangent: &str,
) -> (Tensor, BTreeMap<String, Tensor>) {
    let exact = |(name, weight): (&str, &Tensor)| {
        let weight = weight.to_dtype(DType::F64).unwrap();
        (name.to_owned(), Var::from_tensor(&weight).unwrap())
    };
    let encoder = golden::encoder(kind);
    let variables: Vec<(String, Var)> = encoder.weights().iter().map(exact).collect();
    let tensors = variables.iter();
    let tensors = tensors.map(|(name, variable)| (name.clone(), variable.as_tensor().clone()));
    let weights = Weights::sharing("the golden rule", tensors);
    let network = kind.network().at(&Depths::Last).unwrap();
    let images = golden::tensor(images, &[4, 3, 64, 64]);
    let embedding = Plain::training(&network, &weights).embed(&images).unwrap();
    let cotangent = golden::tensor(cotangent, embedding.dims());
    let loss = (&embedding * cotangent).unwrap().mean_all().unwrap();
    let store = loss.backward().unwrap();
    let gradients = variables.into_iter();
    let gradients =
        gradients.filter_map(|(name, variable)| Some((name, store.get(&variable)?.clone())));
    (embedding, gradients.collect())
}

/// Without rounding, the gradients by candle's operators are PyTorch's: none hangs on which side of zero a
/// rectifier's input falls.
#[test]
fn gradients_are_those_of_pytorch() {
    let expected = golden::load("se_resnext50.safetensors");
    let (images, cotangent) = ("golden/train64", "golden/train64.cotangent");
    let (embedding, gradients) = plain_pass(EncoderKind::SeResNext50, images, cotangent);
    let found = error(&values(&embedding), &values(&expected["train64.embedding"]));
    assert!(found < 1e-11, "embedding {found:.1e}");
    let mut seen = 0;
    for (name, gradient) in &gradients {
        if let Some(expected) = expected.get(&format!("train64.grad.{name}")) {
            let found = relative(gradient, expected);
            assert!(found < 1e-9, "gradient of {name} {found:.1e}");
            seen += 1;
        }
    }
    assert_eq!(seen, 8);

    let expected = golden::load("encoders.safetensors");
    let tables = golden::json("encoders_grad_norms.json");
    for (kind, name) in [
        (EncoderKind::ResNet18, "resnet18"),
        (EncoderKind::ResNet50, "resnet50"),
        (EncoderKind::SqueezeNet1_1, "squeezenet1_1"),
        (EncoderKind::EfficientNetLite0, "efficientnet_lite0"),
    ] {
        let norms: BTreeMap<String, f64> = serde_json::from_value(tables[name].clone()).unwrap();
        let [images, cotangent] = ["train", "cotangent"].map(|of| format!("golden/{name}.{of}"));
        let (embedding, gradients) = plain_pass(kind, &images, &cotangent);
        let found = relative(&embedding, &expected[&format!("{name}.train.embedding")]);
        assert!(found < 1e-6, "{kind}: embedding {found:.1e}");
        assert!(gradients.keys().eq(norms.keys()), "{kind}");
        // Behind a norm that the next norm undoes, a gradient is 0 but for rounding.
        let errors = norms.iter().map(|(name, expected)| {
            (norm(&values(&gradients[name])) - expected).abs() / expected.max(1e-9)
        });
        let worst = errors.fold(0.0, f64::max);
        println!("{kind}: gradients' norms {worst:.1e}");
        assert!(worst < 1e-6, "{kind}: {worst:.1e}");
    }
}

/// One embedding by the names of either package.
#[test]
fn efficientnet_lite0_by_the_names_of_another_package() {
    let other_name = other_names();
    let kind = EncoderKind::EfficientNetLite0;
    let weights = |rename: &dyn Fn(&str) -> String| {
        let mut weights = golden::weights(kind, rename);
        let classifier = golden::input("classifier", &[1000, 1280]);
        weights.replace(&rename("classifier.weight"), classifier);
        weights
    };
    let own = Encoder::new(kind, weights(&str::to_owned)).unwrap();
    let other = Encoder::new(kind, weights(&other_name)).unwrap();
    assert_eq!(own.content_hash(), other.content_hash());

    // A tensor that is there by both names: neither is dropped without a word.
    let spec = &kind.specs()[0];
    let name = other_name(&spec.name);
    let mut both = weights(&str::to_owned);
    both.replace(&name, golden::weight(spec));
    let error = Encoder::new(kind, both).unwrap_err().to_string();
    let named = error.contains(&name) && error.contains("has no place");
    assert!(named, "{error}");
}

/// The body takes all of its tensors from the whole network, by the names of either package; it embeds as candle's operators say.
#[test]
fn the_body_of_an_efficientnet_starts_from_the_whole() {
    let body = EncoderKind::EfficientNetLiteBody;
    let whole = EncoderKind::EfficientNetLite0;
    let start = |weights| Encoder::warm_started(body, weights, 0).unwrap();
    let (encoder, drawn) = start(golden::weights(whole, str::to_owned));
    assert_eq!(drawn, [""; 0]);
    let (renamed, drawn) = start(golden::weights(whole, other_names()));
    assert_eq!(drawn, [""; 0]);
    assert_eq!(encoder.content_hash(), renamed.content_hash());

    let images = golden::input("pixels", &[2, 3, 65, 40]).abs().unwrap();
    let found = encoder.embed(&images).unwrap();
    let plain = encoder.embed_plain(&images).unwrap();
    let error = relative(&found, &plain);
    assert!(error < 1e-6, "{error:.1e}");
}

#[test]
fn what_a_warm_start_does_not_find_is_drawn() {
    let kind = EncoderKind::ResNet18;
    let seeded = Encoder::seeded(kind, 3).unwrap();
    let from = golden::weights(EncoderKind::ResNet50, str::to_owned);
    let (encoder, drawn) = Encoder::warm_started(kind, from, 3).unwrap();
    // The stem is one, of the rest only norms of as many channels.
    assert!(drawn.iter().any(|name| name == "layer1.0.conv1.weight"));
    for spec in kind.specs() {
        let of = |weights: &Weights| numbers(weights.get(&spec.name).unwrap());
        let expected = if drawn.contains(&spec.name) {
            of(seeded.weights())
        } else {
            numbers(&golden::weight(&spec))
        };
        assert_eq!(of(encoder.weights()), expected, "{}", spec.name);
    }

    let other = golden::weights(EncoderKind::SqueezeNet1_0, str::to_owned);
    let started = Encoder::warm_started(kind, other, 3);
    golden::refused(started, "no tensor of which resnet18 has");
}

/// In-place addition takes the shortcut's memory, and rows of images have the padding of one window in memory.
#[test]
fn nothing_reads_a_shortcut_after_its_branch_and_one_layer_reads_the_image() {
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
        let reads = |layer: &&Layer| layer.inputs().any(|map| map == IMAGE);
        assert_eq!(network.layers.iter().filter(reads).count(), 1, "{kind}");
        let [conv] = network.layers[0].convs() else {
            panic!("{kind} begins with another layer");
        };
        assert_eq!((conv.input, conv.inputs), (IMAGE, 3), "{kind}");
    }
}

/// As printed by the networks' authors and keepers, classifiers included, in G: table 2 of "Squeeze-and-
/// Excitation Networks" (CVPR 2018), torchvision's pages of the others. I3D's are as PyTorch's own counter has
/// them for the network of the script.
#[test]
fn multiply_adds_are_those_printed() {
    for (kind, classifier, printed) in [
        (EncoderKind::SeResNext50, 2048 * 1000, 4.25),
        (EncoderKind::SqueezeNet1_0, 13 * 13 * 512 * 1000, 0.82),
        (EncoderKind::ResNet18, 512 * 1000, 1.81),
        (EncoderKind::ResNet50, 2048 * 1000, 4.09),
        (EncoderKind::SqueezeNet1_1, 13 * 13 * 512 * 1000, 0.35),
    ] {
        let count = kind.multiply_adds([1, 224, 224]).unwrap() + classifier;
        let found = count as f64 / 1e9;
        assert!((found / printed - 1.0).abs() < 0.01, "{kind}: {found} G");
    }
    let count = EncoderKind::I3d.multiply_adds([16, 224, 224]);
    assert_eq!(count, Some(27_787_569_152));
}

#[test]
fn an_image_too_small_or_too_large_has_no_multiply_adds() {
    assert_eq!(EncoderKind::SqueezeNet1_0.multiply_adds([1, 6, 64]), None);
    let least = EncoderKind::EfficientNetLiteBody.multiply_adds([1, 1, 1]);
    assert!(least.is_some());
    // What no number holds.
    for kind in EncoderKind::ALL {
        for size in [[1, usize::MAX, usize::MAX], [1, 1 << 32, 1 << 32]] {
            assert_eq!(kind.multiply_adds(size), None, "{kind}");
        }
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

//! Networks against PyTorch's and against the same in f64, and on hard inputs.

mod depths;
mod hard_cases;
mod i3d;
mod int8;
mod networks;
mod pytorch;
mod training;
mod windows;

use std::sync::{Arc, LazyLock};

use candle_core::{DType, Tensor, Var};
use sps_kernels::Normalisation;
use sps_kernels::simd::Level;

use super::plain::{Plain, normalise};
use super::{Encoder, EncoderKind, Precision, TrainableEncoder};
use crate::golden::{self, numbers};
use crate::weights::Weights;

/// The last feature map of a network in f64, `(n, width, rows, columns)`, by candle's operators, which
/// are held to PyTorch's in `networks`; of images as [`Encoder::embed`] takes them.
fn exact_features(encoder: &Encoder, images: &Tensor) -> Tensor {
    let double = |tensor: &Tensor| tensor.to_dtype(DType::F64).unwrap();
    let tensors = encoder.weights().iter();
    let tensors = tensors.map(|(name, tensor)| (name.to_owned(), double(tensor)));
    let weights = Weights::sharing("f64", tensors);
    let images = normalise(&double(images), &encoder.network.normalisation).unwrap();
    let net = Plain::new(&encoder.network, &weights);
    net.features(&images).unwrap().pop().unwrap()
}

/// Embeds images that are normalised already, as the network's layers take them.
fn embed_normalised(encoder: &Encoder, images: &Tensor) -> Tensor {
    let mut encoder = encoder.clone();
    Arc::make_mut(&mut encoder.network).normalisation = Normalisation::NONE;
    encoder.embed(images).unwrap()
}

/// The networks of images.
fn of_images() -> impl Iterator<Item = EncoderKind> {
    let all = EncoderKind::ALL.into_iter();
    all.filter(|kind| !kind.takes_sequences())
}

/// An encoder that can compute in int8.
fn calibrated(encoder: Encoder) -> Encoder {
    let images = golden::input("calibration", &[4, 3, 72, 72]);
    let images = ((images * 0.5).unwrap() + 0.5).unwrap();
    encoder.calibrated(&[&images]).unwrap()
}

/// A pass in training over normalised images: the embeddings, the mean of their product with a cotangent,
/// and its gradients, in the order of the variables.
fn pass(
    encoder: &mut TrainableEncoder,
    images: &Tensor,
    cotangent: &str,
) -> (Tensor, Tensor, Vec<(String, Tensor)>) {
    Arc::make_mut(&mut encoder.network).normalisation = Normalisation::NONE;
    let embeddings = encoder.forward(images).unwrap();
    let cotangent = golden::input(cotangent, embeddings.dims());
    let loss = (&embeddings * cotangent).unwrap().mean_all().unwrap();
    let store = encoder.backward(&loss).unwrap();
    let gradient =
        |(name, variable): (&str, &Var)| (name.to_owned(), store.get(variable).unwrap().clone());
    let gradients = encoder.variables().map(gradient).collect();
    (embeddings, loss, gradients)
}

/// Seeded networks that can compute in int8, with norms and without, with groups, gates and depth-wise layers.
static SMALL_ONES: LazyLock<[Encoder; 3]> = LazyLock::new(|| {
    use EncoderKind::{EfficientNetLiteBody, SeResNext50, SqueezeNet1_0};
    let kinds = [SeResNext50, SqueezeNet1_0, EfficientNetLiteBody];
    kinds.map(|kind| calibrated(Encoder::seeded(kind, 1).unwrap()))
});

/// One hash, one embedding to the last bit, whatever instructions the processor has.
#[test]
fn encoders_of_one_content_hash_embed_alike() {
    let images = golden::input("pixels", &[2, 3, 65, 40]);
    for encoder in &*SMALL_ONES {
        let kind = encoder.kind();
        for precision in Precision::ALL {
            let embed = || {
                let encoder = encoder.clone().with_precision(precision).unwrap();
                let embedding = embed_normalised(&encoder, &images);
                (encoder.content_hash(), numbers(&embedding))
            };
            let (hash, embedding) = embed();
            Level::on_each(|level| {
                let (found_hash, found) = embed();
                let alike = (found_hash == hash, found == embedding);
                let case = format!("{kind} {precision} {level:?}: {alike:?}");
                assert!(matches!(alike, (true, true) | (false, _)), "{case}");
                println!("{case}");
            });
        }
    }
}

/// Images, or sequences, embed alike as pixels; what is not of their size is refused.
fn pixels_embed_alike(encoder: &Encoder, images: &Tensor) {
    let &[count, _, .., height, width] = images.dims() else {
        panic!("{images:?}");
    };
    let rank = images.rank();
    let axes: Vec<usize> = [0].into_iter().chain(2..rank).chain([1]).collect();
    let pixels = numbers(&images.permute(axes).unwrap());
    let each: Vec<&[f32]> = pixels.chunks_exact(pixels.len() / count).collect();
    let embed = |pixels: &[&[f32]], size| encoder.embed_pixels(pixels, size);
    let expected = numbers(&encoder.embed(images).unwrap());
    let (kind, precision) = (encoder.kind(), encoder.precision());
    let found = embed(&each, [height, width]).unwrap();
    assert_eq!(found, expected, "{kind} {precision}");
    let two_frames = &pixels[..2 * 3 * height * width];
    let odd = &two_frames[1..];
    for wrong in [vec![], vec![two_frames, each[0]], vec![odd], vec![&[]]] {
        assert!(embed(&wrong, [height, width]).is_err());
    }
    for wrong in [[height, width + 1], [0, width], [usize::MAX; 2]] {
        assert!(embed(&each, wrong).is_err(), "{wrong:?}");
    }
}

#[test]
fn pixels_embed_as_the_same_images_and_sequences_do() {
    let images = |shape: &[usize]| golden::input("pixels", shape).abs().unwrap();
    for encoder in &*SMALL_ONES {
        for precision in Precision::ALL {
            let encoder = encoder.clone().with_precision(precision).unwrap();
            pixels_embed_alike(&encoder, &images(&[3, 3, 40, 33]));
        }
    }
    let i3d = golden::encoder(EncoderKind::I3d);
    pixels_embed_alike(&i3d, &images(&[2, 3, 3, 20, 17]));
}

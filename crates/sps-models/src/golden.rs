//! Tensors as the scripts in `fixtures/golden` fill them, the files they wrote, and how far results are off.

use std::collections::HashMap;
use std::fmt::Display;
use std::path::PathBuf;
use std::sync::OnceLock;

use candle_core::{DType, Device, Tensor};
use sps_kernels::simd::Level;

use crate::encoders::{Encoder, EncoderKind};
#[cfg(feature = "heads")]
use crate::heads::{Adversarial, Classification, CrossModal, Model};
#[cfg(feature = "heads")]
use crate::labels::LabelSource;
use crate::weights::{TensorSpec, Weights};

#[path = "../../../fixtures/golden/rule.rs"]
mod rule;
#[path = "../../../fixtures/golden/weights.rs"]
mod weights;

pub(crate) use rule::{error, uniform};

/// Candle's threads keep processors busy while they wait, which other tests need: it gets one thread, and two for matrix
/// products by the mask, without which it counts processors in a file for each. Nobody reads the environment before `main`.
#[cfg(target_os = "linux")]
#[expect(unsafe_code, reason = "nothing safe runs before the first test")]
#[used]
#[unsafe(link_section = ".init_array")]
static BEFORE_MAIN: extern "C" fn() = {
    extern "C" fn settings() {
        unsafe { std::env::set_var("CANDLE_NUM_THREADS", "1") };
        unsafe { std::env::set_var("CANDLE_CPU_MASK", "0-1") };
    }
    settings
};

/// Such values as a tensor, f64.
pub(crate) fn tensor(name: &str, shape: &[usize]) -> Tensor {
    let values = uniform(name, shape.iter().product());
    Tensor::from_vec(values, shape, &Device::Cpu).unwrap()
}

/// The same in f32, which holds all their digits.
pub(crate) fn input(name: &str, shape: &[usize]) -> Tensor {
    tensor(name, shape).to_dtype(DType::F32).unwrap()
}

/// The first bound with fused multiply-add, the second without it, at the portable level.
pub(crate) fn bound(bounds: [f64; 2]) -> f64 {
    bounds[usize::from(matches!(Level::detect(), Level::Portable))]
}

/// A network's tensor as the scripts fill it, f32.
pub(crate) fn weight(spec: &TensorSpec) -> Tensor {
    let values = weights::weight(&spec.name, &spec.shape);
    Tensor::from_vec(values, spec.shape.as_slice(), &Device::Cpu).unwrap()
}

/// All of a network's, by the names that `rename` makes.
pub(crate) fn weights(kind: EncoderKind, rename: impl Fn(&str) -> String) -> Weights {
    let weights = encoder(kind).weights().clone();
    weights.renamed(|name| Some(rename(name)))
}

/// An encoder with these weights, made once.
pub(crate) fn encoder(kind: EncoderKind) -> Encoder {
    const KINDS: usize = EncoderKind::ALL.len();
    static ENCODERS: [OnceLock<Encoder>; KINDS] = [const { OnceLock::new() }; KINDS];
    let made = ENCODERS[kind as usize].get_or_init(|| {
        let tensors = kind.specs().into_iter();
        let tensors = tensors.map(|spec| (spec.name.clone(), weight(&spec)));
        Encoder::new(kind, Weights::sharing("the golden rule", tensors)).unwrap()
    });
    made.clone()
}

fn path(file: &str) -> PathBuf {
    let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../fixtures/golden");
    folder.join(file)
}

/// The tensors of a file.
pub(crate) fn load(file: &str) -> HashMap<String, Tensor> {
    candle_core::safetensors::load(path(file), &Device::Cpu).unwrap()
}

/// What a file of JSON holds.
pub(crate) fn json(file: &str) -> serde_json::Value {
    serde_json::from_str(&std::fs::read_to_string(path(file)).unwrap()).unwrap()
}

/// The elements of a tensor of either type, f64.
pub(crate) fn values(tensor: &Tensor) -> Vec<f64> {
    let tensor = tensor.to_dtype(DType::F64).unwrap();
    tensor.flatten_all().unwrap().to_vec1().unwrap()
}

/// The elements of a tensor of f32.
pub(crate) fn numbers(tensor: &Tensor) -> Vec<f32> {
    tensor.flatten_all().unwrap().to_vec1().unwrap()
}

/// The root of the sum of squares.
pub(crate) fn norm(values: &[f64]) -> f64 {
    values.iter().map(|v| v * v).sum::<f64>().sqrt()
}

/// The norm of the difference relative to that of what is expected.
pub(crate) fn relative(found: &Tensor, expected: &Tensor) -> f64 {
    assert_eq!(found.dims(), expected.dims());
    let (found, expected) = (values(found), values(expected));
    let squares = found.iter().zip(&expected).map(|(f, e)| (f - e).powi(2));
    let error = squares.sum::<f64>().sqrt() / norm(&expected);
    assert!(error.is_finite());
    error
}

/// The cross-modal network of the scripts for heads: all its parts, small.
#[cfg(feature = "heads")]
pub(crate) fn cross_modal() -> Model {
    Model::CrossModal(CrossModal {
        latent: 4,
        hidden: 6,
        embedding_weight: 0.3,
        adversarial: Some(Adversarial {
            weight: 0.2,
            hidden: 6,
        }),
        classification: Some(Classification {
            weight: 0.4,
            labels: LabelSource::Material {},
        }),
    })
}

/// There is no outcome, for a reason with `expected` in it.
#[track_caller]
pub(crate) fn refused<T>(outcome: Result<T, impl Display>, expected: &str) {
    let Err(error) = outcome else {
        panic!("not refused, expected {expected:?}");
    };
    let message = error.to_string();
    assert!(message.contains(expected), "{message}");
}

/// What `run` gives on so many threads.
pub(crate) fn on_threads<R: Send>(threads: usize, run: impl FnOnce() -> R + Send) -> R {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads);
    pool.build().unwrap().install(run)
}

//! Small pieces of work that are the same every time, for counting their instructions.

use std::hint::black_box;

use anyhow::{Context, Result};
use candle_core::{Device, Tensor};
use sps_dataset::{DecodeSettings, decode_image};
use sps_kernels::{ConvShape, Convolution, MaxPooling, Window};
use sps_metrics::{Intervals, Level, Metric, Samples, Scored, Scores, TrainingMean};
use sps_models::embeddings_of;
use sps_models::encoders::{Encoder, EncoderKind, TrainableEncoder};
use sps_models::heads::{Adversarial, Classification, CrossModal, Head, HeadConfig, Model};
use sps_models::labels::LabelSource;
use sps_regress::ridge::{Ridge, RidgeConfig};
use sps_regress::{Embeddings, Plan, Readings, Rerun, TrainingData};
use sps_simulate::{Simulator, SimulatorSpec};
use sps_viewselect::{Exhaustive, Nvs, Problem, Selector, SetFunction};

/// A pass of a kernel, on data that is made beforehand.
type Pass = Box<dyn FnMut() -> Result<()>>;

/// Its name, and what prepares it.
type Kernel = (&'static str, fn() -> Result<Pass>);

pub(crate) static KERNELS: [Kernel; 16] = [
    ("decode-png", || decode("denim-01/000.png")),
    ("decode-jpeg", || decode("oak-01/000.jpg")),
    ("decode-exr", || decode("tile-01/000.exr")),
    ("render", render),
    ("convolution-1x1", || forward((28, 128), (1, 1), (128, 128))),
    ("convolution-7x7", || forward((64, 3), (7, 2), (64, 3))),
    ("convolution-grouped", || {
        forward((28, 128), (3, 1), (128, 4))
    }),
    ("convolution-gradients", convolution_gradients),
    ("max-pool", max_pool),
    ("encoder", encoder),
    ("encoder-training-step", training_step),
    ("ridge", ridge),
    ("head", head),
    ("scores", scores),
    ("exhaustive", || Ok(search(Exhaustive::default()))),
    ("nvs", || Ok(search(nvs()))),
];

/// Runs a kernel twice, the second time in [`counted`].
pub(crate) fn run(name: &str) -> Result<()> {
    // The calling thread is the pool, so that all work is done by the one that is counted.
    let pool = rayon::ThreadPoolBuilder::new();
    pool.num_threads(1).use_current_thread().build_global()?;
    let kernel = KERNELS.iter().find(|(kernel, _)| *kernel == name);
    let (_, prepare) = kernel.with_context(|| format!("no kernel is called `{name}`"))?;
    let mut pass = prepare()?;
    pass()?;
    counted(&mut pass)
}

/// What callgrind counts.
#[inline(never)]
fn counted(pass: &mut Pass) -> Result<()> {
    black_box(pass())
}

fn pass<T, E: Into<anyhow::Error>>(mut work: impl FnMut() -> Result<T, E> + 'static) -> Pass {
    Box::new(move || work().map(black_box).map(drop).map_err(Into::into))
}

/// So many values, in -0.5..0.5.
fn numbers(count: usize) -> Vec<f32> {
    let value = |i: usize| (i * 7919 % 251) as f32 / 251.0 - 0.5;
    (0..count).map(value).collect()
}

/// Such values of any shape.
fn ramp(shape: &[usize]) -> Result<Tensor> {
    let values = numbers(shape.iter().product());
    Ok(Tensor::from_vec(values, shape, &Device::Cpu)?)
}

fn decode(path: &str) -> Result<Pass> {
    let path = format!("fixtures/tiny-dataset/frames/{path}");
    let bytes = std::fs::read(&path).with_context(|| format!("cannot read {path}"))?;
    let settings = DecodeSettings::default();
    Ok(pass(move || decode_image(&bytes, &settings)))
}

fn render() -> Result<Pass> {
    let simulator = Simulator::new(SimulatorSpec {
        surfaces: 1,
        size: 32,
        views: 3,
        ..SimulatorSpec::default()
    })?;
    Ok(pass(move || simulator.frame_bytes(0, 1)))
}

/// Of a square feature map of so many channels, by windows of a size and stride, to outputs that
/// see so many inputs each.
fn forward(
    (extent, channels): (usize, usize),
    (size, stride): (usize, usize),
    (outputs, inputs): (usize, usize),
) -> Result<Pass> {
    let shape = ConvShape {
        window: Window::square(size, stride, size / 2),
        inputs: channels,
        outputs,
        groups: channels / inputs,
    };
    let convolution = Convolution::new(1, [1, extent, extent], shape)?;
    let x = numbers(extent * extent * channels);
    let weight = numbers(outputs * inputs * size * size);
    Ok(pass(move || convolution.forward(&x, &weight)))
}

fn convolution_gradients() -> Result<Pass> {
    let shape = ConvShape {
        window: Window::square(3, 1, 1),
        inputs: 64,
        outputs: 64,
        groups: 1,
    };
    let convolution = Convolution::new(1, [1, 14, 14], shape)?;
    let (x, weight) = (numbers(14 * 14 * 64), numbers(64 * 64 * 9));
    Ok(pass(move || {
        let y = convolution.forward(&x, &weight)?;
        convolution.backward(&x, &weight, &vec![1.0; y.len()])
    }))
}

fn max_pool() -> Result<Pass> {
    let pooling = MaxPooling::new(1, [1, 56, 56], 64, Window::square(3, 2, 0), true)?;
    let x = numbers(56 * 56 * 64);
    Ok(pass(move || pooling.forward(&x)))
}

fn small_encoder() -> Result<Encoder> {
    Ok(Encoder::seeded(EncoderKind::EfficientNetLiteBody, 0)?)
}

fn encoder() -> Result<Pass> {
    let encoder = small_encoder()?;
    let images = (ramp(&[1, 3, 32, 32])? + 0.5)?;
    Ok(pass(move || encoder.embed(&images)))
}

fn training_step() -> Result<Pass> {
    let mut encoder = TrainableEncoder::new(&small_encoder()?)?;
    let images = (ramp(&[2, 3, 32, 32])? + 0.5)?;
    Ok(pass(move || {
        let loss = encoder.forward(&images)?.sqr()?.mean_all()?;
        encoder.backward(&loss)
    }))
}

const SURFACES: usize = 40;

/// Surfaces with an embedding and three readings each.
fn tables() -> Result<(Embeddings, Readings)> {
    let values = numbers(3 * SURFACES).into_iter();
    let values: Vec<_> = values.map(|value| Some(f64::from(value * 100.0))).collect();
    let rows: Vec<_> = values.chunks(3).map(<[_]>::to_vec).collect();
    let embeddings = embeddings_of(&ramp(&[SURFACES, 64])?)?;
    Ok((embeddings, Readings::new(names(), &rows)?))
}

fn names() -> Vec<String> {
    ["fRS", "mTX", "tCO"].map(str::to_owned).to_vec()
}

fn plan() -> Plan {
    Plan::each(1, &names(), vec![Rerun::new(0, 0..SURFACES)])
}

fn ridge() -> Result<Pass> {
    let ((embeddings, readings), plan) = (tables()?, plan());
    let ridge = Ridge::new(RidgeConfig::default())?;
    Ok(pass(move || {
        let data = TrainingData::new(&embeddings, &readings);
        ridge.train(&data, &plan)
    }))
}

/// One epoch of the paper's full model.
fn head() -> Result<Pass> {
    let labels = LabelSource::VisuoTactileCluster {
        clusters: 5,
        components: 5,
        standardise_tactile: true,
    };
    let head = Head::new(HeadConfig {
        epochs: 1,
        model: Model::CrossModal(CrossModal {
            adversarial: Some(Adversarial::default()),
            classification: Some(Classification::new(labels)),
            ..CrossModal::default()
        }),
        ..HeadConfig::default()
    })?;
    let ((embeddings, readings), plan) = (tables()?, plan());
    Ok(pass(move || {
        let data = TrainingData::new(&embeddings, &readings);
        head.train(&data, &plan, &())
    }))
}

/// Every score, and an interval around one.
fn scores() -> Result<Pass> {
    let truth: Vec<f64> = (0..50).map(|i| f64::from(i) * 37.7 % 100.0).collect();
    let wander = |(i, truth): (usize, &f64)| truth + 8.0 * (i as f64 * 1.3).sin();
    let estimate: Vec<f64> = truth.iter().enumerate().map(wander).collect();
    let mean = TrainingMean::of(&truth)?;
    Ok(pass(move || {
        let samples = Samples {
            truth: &truth,
            estimate: &estimate,
        };
        black_box(Scores::of(samples, Ok(mean)));
        let scored = Scored {
            metric: Metric::R2(mean),
            samples,
            units: None,
            rerun: 0,
        };
        Intervals::of_models(Level::P95).interval(&[scored])
    }))
}

fn nvs() -> Nvs {
    Nvs {
        evaluations: 1000,
        ..Nvs::default()
    }
}

/// Three of twenty views, where a set's loss costs next to nothing.
fn search(selector: impl Selector + 'static) -> Pass {
    let loss = SetFunction::new(20, 3, |set: &[usize]| (set[0] * set[1] + set[2]) as f64);
    pass(move || selector.select(&Problem::new(&loss)?))
}

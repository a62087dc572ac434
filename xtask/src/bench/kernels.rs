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

pub(crate) struct Kernel {
    pub name: &'static str,
    prepare: fn() -> Result<Pass>,
}

const fn kernel(name: &'static str, prepare: fn() -> Result<Pass>) -> Kernel {
    Kernel { name, prepare }
}

pub(crate) static KERNELS: [Kernel; 16] = [
    kernel("decode-png", || {
        decode("fixtures/tiny-dataset/frames/denim-01/000.png")
    }),
    kernel("decode-jpeg", || {
        decode("fixtures/tiny-dataset/frames/oak-01/000.jpg")
    }),
    kernel("decode-exr", || {
        decode("fixtures/tiny-dataset/frames/tile-01/000.exr")
    }),
    kernel("render", render),
    kernel("convolution-1x1", || {
        convolution((28, 128), (1, 1), (128, 128))
    }),
    kernel("convolution-7x7", || convolution((64, 3), (7, 2), (64, 3))),
    kernel("convolution-grouped", || {
        convolution((28, 128), (3, 1), (128, 4))
    }),
    kernel("convolution-gradients", convolution_gradients),
    kernel("max-pool", max_pool),
    kernel("encoder", encoder),
    kernel("encoder-training-step", training_step),
    kernel("ridge", ridge),
    kernel("head", head),
    kernel("scores", scores),
    kernel("exhaustive", || Ok(search(Exhaustive::default()))),
    kernel("nvs", || {
        Ok(search(Nvs {
            evaluations: 1000,
            ..Nvs::default()
        }))
    }),
];

/// Runs a kernel twice, the second time in [`counted`].
pub(crate) fn run(name: &str) -> Result<()> {
    // The calling thread is the pool, so that all work is done by the one that is counted.
    let pool = rayon::ThreadPoolBuilder::new();
    pool.num_threads(1).use_current_thread().build_global()?;
    let kernel = KERNELS.iter().find(|kernel| kernel.name == name);
    let kernel = kernel.with_context(|| format!("no kernel is called `{name}`"))?;
    let mut pass = (kernel.prepare)()?;
    pass()?;
    counted(&mut pass)
}

/// What callgrind counts.
#[inline(never)]
fn counted(pass: &mut Pass) -> Result<()> {
    black_box(pass())
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
    let bytes = std::fs::read(path).with_context(|| format!("cannot read {path}"))?;
    Ok(Box::new(move || {
        black_box(decode_image(&bytes, &DecodeSettings::default())?);
        Ok(())
    }))
}

fn render() -> Result<Pass> {
    let simulator = Simulator::new(SimulatorSpec {
        surfaces: 1,
        size: 32,
        views: 3,
        ..SimulatorSpec::default()
    })?;
    Ok(Box::new(move || {
        black_box(simulator.frame_bytes(0, 1)?);
        Ok(())
    }))
}

/// Of a square feature map of so many channels, by windows of a size and stride, to outputs that
/// see so many inputs each.
fn convolution(
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
    Ok(Box::new(move || {
        black_box(convolution.forward(&x, &weight)?);
        Ok(())
    }))
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
    Ok(Box::new(move || {
        let y = convolution.forward(&x, &weight)?;
        black_box(convolution.backward(&x, &weight, &vec![1.0; y.len()])?);
        Ok(())
    }))
}

fn max_pool() -> Result<Pass> {
    let pooling = MaxPooling::new(1, [1, 56, 56], 64, Window::square(3, 2, 0), true)?;
    let x = numbers(56 * 56 * 64);
    Ok(Box::new(move || {
        black_box(pooling.forward(&x)?);
        Ok(())
    }))
}

fn small_encoder() -> Result<Encoder> {
    Ok(Encoder::seeded(EncoderKind::EfficientNetLiteBody, 0)?)
}

fn encoder() -> Result<Pass> {
    let encoder = small_encoder()?;
    let images = (ramp(&[1, 3, 32, 32])? + 0.5)?;
    Ok(Box::new(move || {
        black_box(encoder.embed(&images)?);
        Ok(())
    }))
}

fn training_step() -> Result<Pass> {
    let mut encoder = TrainableEncoder::new(&small_encoder()?)?;
    let images = (ramp(&[2, 3, 32, 32])? + 0.5)?;
    Ok(Box::new(move || {
        let loss = encoder.forward(&images)?.sqr()?.mean_all()?;
        black_box(encoder.backward(&loss)?);
        Ok(())
    }))
}

/// Surfaces with an embedding and three readings each.
struct Tables {
    embeddings: Embeddings,
    readings: Readings,
}

impl Tables {
    const SURFACES: usize = 40;

    fn new() -> Result<Self> {
        let values: Vec<Vec<f32>> = (ramp(&[Self::SURFACES, 3])? * 100.0)?.to_vec2()?;
        let row = |row: &Vec<f32>| row.iter().map(|&value| Some(f64::from(value))).collect();
        let rows: Vec<Vec<Option<f64>>> = values.iter().map(row).collect();
        Ok(Self {
            embeddings: embeddings_of(&ramp(&[Self::SURFACES, 64])?)?,
            readings: Readings::new(names(), &rows)?,
        })
    }

    fn training_data(&self) -> TrainingData<'_> {
        TrainingData::new(&self.embeddings, &self.readings)
    }
}

fn names() -> Vec<String> {
    ["fRS", "mTX", "tCO"].map(str::to_owned).to_vec()
}

fn plan() -> Plan {
    let rerun = Rerun {
        number: 0,
        training: (0..Tables::SURFACES).collect(),
        validation: Vec::new(),
    };
    Plan::each(1, &names(), vec![rerun])
}

fn ridge() -> Result<Pass> {
    let (tables, plan, ridge) = (Tables::new()?, plan(), Ridge::new(RidgeConfig::default())?);
    Ok(Box::new(move || {
        black_box(ridge.train(&tables.training_data(), &plan)?);
        Ok(())
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
    let (tables, plan) = (Tables::new()?, plan());
    Ok(Box::new(move || {
        black_box(head.train(&tables.training_data(), &plan, &())?);
        Ok(())
    }))
}

/// Every score, and an interval around one.
fn scores() -> Result<Pass> {
    let truth: Vec<f64> = (0..50).map(|i| f64::from(i) * 37.7 % 100.0).collect();
    let wander = |(i, truth): (usize, &f64)| truth + 8.0 * (i as f64 * 1.3).sin();
    let estimate: Vec<f64> = truth.iter().enumerate().map(wander).collect();
    let mean = TrainingMean::of(&truth)?;
    Ok(Box::new(move || {
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
        black_box(Intervals::of_models(Level::P95).interval(&[scored])?);
        Ok(())
    }))
}

/// Three of twenty views, where a set's loss costs next to nothing.
fn search(selector: impl Selector + 'static) -> Pass {
    let loss = SetFunction::new(20, 3, |set: &[usize]| {
        set.iter().map(|&view| (view as f64 - 7.0).powi(2)).sum()
    });
    Box::new(move || {
        let problem = Problem::new(&loss)?;
        black_box(selector.select(&problem)?);
        Ok(())
    })
}

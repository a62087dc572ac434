//! How hard the simulated task is: ridge regression on an encoder's features of one view and of
//! three, the table of `docs/simulator.md`.
//!
//! `cargo run --release -p xtask --example usefulness -- --weights squeezenet1_0.safetensors`

use anyhow::{Context, Result, ensure};
use candle_core::{Device, Tensor};
use clap::Parser;
use sps_dataset::{
    FrameIndex, KFold, Source, SplitPlan, TactileSettings, Unit, decode_frames, toccare,
};
use sps_metrics::{Intervals, Level, Metric, Samples, Scored};
use sps_models::encoders::{Encoder, EncoderKind};
use sps_regress::ridge::{Ridge, RidgeConfig};
use sps_regress::{Embeddings, FittedRegressor, Plan, Readings, Rerun, TrainingData, Trial, Views};
use sps_simulate::{Simulator, SimulatorSpec};

/// R² of ridge regression on simulated surfaces, every surface held out once
#[derive(Parser)]
struct Args {
    /// The encoder
    #[arg(long, default_value = "squeezenet1-0")]
    encoder: EncoderKind,
    /// Its weights
    #[arg(long)]
    weights: std::path::PathBuf,
    /// Seeds of the simulator; surfaces of all of them are scored together
    #[arg(long, value_delimiter = ',', default_value = "1,2,3")]
    seeds: Vec<u64>,
    /// Surfaces of each seed
    #[arg(long, default_value_t = 400)]
    surfaces: usize,
    /// Pixels of a view
    #[arg(long, default_value_t = 96)]
    size: usize,
    /// Search all 35 triples of -45, -30, .., 45 degrees for the best of each property
    #[arg(long)]
    triples: bool,
}

/// Every 15 degrees.
const ANGLES: [f64; 7] = [-45.0, -30.0, -15.0, 0.0, 15.0, 30.0, 45.0];
const NADIR: usize = 3;
/// Compared with nadir.
const SPREAD: [[usize; 3]; 2] = [[0, 3, 6], [1, 3, 5]];
const FOLDS: usize = 10;

/// One property: measured values, and the estimates of fits that had not seen them.
#[derive(Clone, Default)]
struct HeldOut {
    truth: Vec<f64>,
    estimate: Vec<f64>,
}

/// Measured values and features of one simulated set.
struct Set {
    embeddings: Embeddings,
    readings: Readings,
    folds: Vec<Rerun>,
}

impl Set {
    fn new(encoder: &Encoder, args: &Args, seed: u64) -> Result<Self> {
        let simulator = Simulator::new(SimulatorSpec {
            seed,
            surfaces: args.surfaces,
            size: args.size,
            views: ANGLES.len(),
            ..SimulatorSpec::default()
        })?;
        let averages = simulator
            .tactile()
            .averages(&TactileSettings::default(), args.surfaces);
        let rows: Vec<Vec<Option<f64>>> = (0..args.surfaces)
            .map(|s| toccare::ALL.map(|p| averages.value(s, p.code)).to_vec())
            .collect();
        let plan = SplitPlan::KFold(KFold {
            folds: FOLDS,
            by: Some(Unit::Surface),
        });
        let splits = plan.splits(simulator.surfaces(), seed, 0)?;
        let folds = splits.into_iter().zip(0..).map(|(split, number)| Rerun {
            number,
            training: split.train,
            validation: Vec::new(),
        });
        Ok(Self {
            embeddings: embed(encoder, &simulator)?,
            readings: Readings::new(codes(), &rows)?,
            folds: folds.collect(),
        })
    }

    /// For each property the values, and the estimates of the folds that did not see them.
    fn estimates(&self, views: &[usize]) -> Result<Vec<HeldOut>> {
        let trials = self.folds.iter().flat_map(|fold| {
            codes().into_iter().map(|property| Trial {
                property,
                rerun: fold.number,
                views: Views::Fixed(views.to_vec()),
            })
        });
        let plan = Plan {
            seed: 0,
            trials: trials.collect(),
            reruns: self.folds.clone(),
        };
        let data = TrainingData::new(&self.embeddings, &self.readings);
        let ridges = Ridge::new(RidgeConfig::default())?.train(&data, &plan)?;
        let all: Vec<usize> = (0..self.embeddings.surfaces()).collect();
        let estimates = ridges.predict(&self.embeddings.select(&all, views)?)?;
        let mut held_out = vec![HeldOut::default(); toccare::ALL.len()];
        for (estimate, k) in estimates.iter().zip(0..) {
            let column = k % toccare::ALL.len();
            let training = &self.folds[k / toccare::ALL.len()].training;
            for &surface in all.iter().filter(|surface| !training.contains(surface)) {
                let value = self.readings.get(surface, column);
                held_out[column].truth.push(value.context("a reading")?);
                held_out[column].estimate.push(estimate.values[surface]);
            }
        }
        Ok(held_out)
    }
}

fn codes() -> Vec<String> {
    toccare::ALL.map(|p| p.code.to_owned()).to_vec()
}

/// (surfaces, views, width).
fn embed(encoder: &Encoder, simulator: &Simulator) -> Result<Embeddings> {
    let (surfaces, size) = (simulator.surfaces().len(), simulator.spec().size);
    let mut values = Vec::new();
    for surface in 0..surfaces {
        let wanted = (0..ANGLES.len()).map(|view| FrameIndex { surface, view });
        let frames = decode_frames(simulator, &wanted.collect::<Vec<_>>())?;
        let pixels: Vec<f32> = frames.into_iter().flat_map(|frame| frame.data).collect();
        let images = Tensor::from_vec(pixels, (ANGLES.len(), size, size, 3), &Device::Cpu)?;
        let features = encoder.embed(&images.permute((0, 3, 1, 2))?)?;
        values.extend(features.flatten_all()?.to_vec1::<f32>()?);
    }
    let shape = [surfaces, ANGLES.len(), encoder.width()];
    Ok(Embeddings::new(values, shape)?)
}

/// Values and estimates of every property over the surfaces of all seeds.
fn pooled(sets: &[Set], views: &[usize]) -> Result<Vec<HeldOut>> {
    let mut pooled = vec![HeldOut::default(); toccare::ALL.len()];
    for set in sets {
        for (all, one) in pooled.iter_mut().zip(set.estimates(views)?) {
            all.truth.extend(one.truth);
            all.estimate.extend(one.estimate);
        }
    }
    Ok(pooled)
}

fn r2(HeldOut { truth, estimate }: &HeldOut) -> Result<f64> {
    let samples = Samples { truth, estimate };
    Ok(Metric::R2OwnMean.score(samples)?.value)
}

fn scores(pooled: &[HeldOut]) -> Result<Vec<f64>> {
    pooled.iter().map(r2).collect()
}

fn named(views: &[usize]) -> String {
    let angles: Vec<String> = views.iter().map(|&v| ANGLES[v].to_string()).collect();
    angles.join(", ")
}

fn row(name: &str, cells: &[String]) {
    println!("| {name} | {} |", cells.join(" | "));
}

fn with_mean(scores: &[f64]) -> Vec<String> {
    let mean = scores.iter().sum::<f64>() / scores.len() as f64;
    let cells = scores.iter().map(|r2| format!("{r2:.2}"));
    cells.chain([format!("{mean:.3}")]).collect()
}

fn main() -> Result<()> {
    let args = Args::parse();
    ensure!(!args.seeds.is_empty(), "no seeds");
    let encoder = Encoder::load(args.encoder, &args.weights, &Device::Cpu)?;
    let sets = args
        .seeds
        .iter()
        .map(|&seed| Set::new(&encoder, &args, seed))
        .collect::<Result<Vec<_>>>()?;
    let mut header = codes();
    header.push("mean".to_owned());
    row("views", &header);
    println!("|{}", "---|".repeat(header.len() + 1));
    for (set, seed) in sets.iter().zip(&args.seeds) {
        let nadir = scores(&set.estimates(&[NADIR])?)?;
        row(&format!("0, seed {seed}"), &with_mean(&nadir));
    }
    let nadir = pooled(&sets, &[NADIR])?;
    row("0", &with_mean(&scores(&nadir)?));
    for views in SPREAD {
        let spread = pooled(&sets, &views)?;
        row(&named(&views), &with_mean(&scores(&spread)?));
        row("gain", &gains(&nadir, &spread)?);
    }
    if args.triples {
        best_triples(&sets)?;
    }
    Ok(())
}

/// The difference with its paired 95 % interval over surfaces.
fn gains(first: &[HeldOut], second: &[HeldOut]) -> Result<Vec<String>> {
    let gain = |(a, b): (&HeldOut, &HeldOut)| {
        let scored = |estimate| Scored {
            metric: Metric::R2OwnMean,
            samples: Samples {
                truth: &a.truth,
                estimate,
            },
            units: None,
            rerun: 0,
        };
        let (more, less) = (scored(&b.estimate), scored(&a.estimate));
        let interval = Intervals::of_models(Level::P95).difference(&[more], &[less])?;
        let (low, high) = (interval.low, interval.high);
        Ok(format!("{:.3} [{low:.3}, {high:.3}]", interval.estimate))
    };
    first.iter().zip(second).map(gain).collect()
}

/// The triple with the highest R² for each property, and that R² less the mean over triples.
fn best_triples(sets: &[Set]) -> Result<()> {
    let mut found = Vec::new();
    for a in 0..ANGLES.len() {
        for b in a + 1..ANGLES.len() {
            for c in b + 1..ANGLES.len() {
                let views = [a, b, c];
                found.push((views, scores(&pooled(sets, &views)?)?));
            }
        }
    }
    for (column, property) in toccare::properties().into_iter().enumerate() {
        let mean = found.iter().map(|(_, r2)| r2[column]).sum::<f64>() / found.len() as f64;
        let best = found
            .iter()
            .max_by(|a, b| a.1[column].total_cmp(&b.1[column]));
        let (views, r2) = best.context("a triple")?;
        println!(
            "{property}: ({}), R² {:.3}, {:+.3} from the mean triple",
            named(views),
            r2[column],
            r2[column] - mean
        );
    }
    Ok(())
}

//! The training loop of one stack.

use candle_core::{Device, Tensor, Var};
use rand::Rng;
use rand::seq::SliceRandom;
use rand_chacha::ChaCha8Rng;

use super::config::HeadConfig;
use super::job::Job;
use super::losses::{Batch, Losses};
use super::network::{Fill, Network, Spec, is_discriminator};
use super::plan::{TrainingData, Views};
use super::trained::{EpochLosses, TrainedHead};
use super::{HeadError, Observer, input};
use crate::error::Result;
use crate::optim::{Adam, clip_scales, squared_norms};
use crate::rng;
use crate::stacked::{GradientSlot, Parameter};

/// Trains the jobs together, one stacked network for all.
pub(super) fn train_stack(
    config: &HeadConfig,
    data: &TrainingData<'_>,
    seed: u64,
    jobs: &[&Job<'_>],
    observer: &dyn Observer,
) -> Result<Vec<TrainedHead>> {
    let Some(first) = jobs.first() else {
        return Ok(Vec::new());
    };
    let dims = first.dims(config, data.embeddings);
    let mut parameters = Initial::new(seed, jobs);
    let network = Network::new(&mut parameters, config, dims)?;
    let parameters = parameters.parameters;
    let mut sides = Side::of(config, &parameters, jobs.len())?;
    let mut batches = Batches::new(config, data, seed, jobs);
    let mut histories = vec![Vec::with_capacity(config.epochs); jobs.len()];
    for epoch in 0..config.epochs {
        batches.shuffle(epoch);
        let mut means = Means::new(jobs.len());
        for start in (0..batches.rows()).step_by(config.batch_size) {
            let (batch, counts) = batches.at(start)?;
            let losses = Losses::of(&config.model, &network, &batch)?;
            means.add(&losses, &counts)?;
            sides.iter().for_each(Side::clear);
            losses.total(&config.model)?.backward()?;
            for side in &mut sides {
                side.step(config)?;
            }
        }
        for ((job, history), losses) in jobs.iter().zip(&mut histories).zip(means.finish()) {
            losses.check(job, epoch)?;
            history.push(losses);
        }
        observer.epoch(jobs.len(), epoch + 1, config.epochs);
    }
    jobs.iter()
        .zip(histories)
        .enumerate()
        .map(|(at, (job, history))| {
            let own = parameters.iter().map(|parameter| {
                let tensor = parameter.variable.as_detached_tensor().get(at)?.copy()?;
                Ok((parameter.name.clone(), tensor))
            });
            let own = own.collect::<Result<_>>()?;
            Ok(TrainedHead::new(job, dims, own, history))
        })
        .collect()
}

/// How many parameters one trial has.
pub(super) fn parameter_count(
    config: &HeadConfig,
    data: &TrainingData<'_>,
    job: &Job<'_>,
) -> usize {
    struct Count(usize);
    impl Fill for Count {
        fn fill(&mut self, spec: &Spec<'_>) -> Result<Parameter> {
            self.0 += spec.shape.iter().product::<usize>();
            let nothing = Tensor::zeros(0, candle_core::DType::F32, &Device::Cpu)?;
            Ok(Parameter::constant(nothing))
        }
    }
    let mut count = Count(0);
    let dims = job.dims(config, data.embeddings);
    match Network::new(&mut count, config, dims) {
        Ok(_) => count.0,
        Err(_) => 0,
    }
}

/// Fresh weights: uniform within one over the root of the layer's inputs, as PyTorch's `Linear`.
struct Initial<'a> {
    seed: u64,
    jobs: &'a [&'a Job<'a>],
    parameters: Vec<Trained>,
}

/// A parameter of the stack while it is trained.
struct Trained {
    name: String,
    variable: Var,
    gradient: GradientSlot,
}

impl<'a> Initial<'a> {
    fn new(seed: u64, jobs: &'a [&'a Job<'a>]) -> Self {
        Self {
            seed,
            jobs,
            parameters: Vec::new(),
        }
    }
}

impl Fill for Initial<'_> {
    fn fill(&mut self, spec: &Spec<'_>) -> Result<Parameter> {
        let count: usize = spec.shape.iter().product();
        let bound = 1.0 / (spec.fan_in.max(1) as f32).sqrt();
        let mut values = Vec::with_capacity(self.jobs.len() * count);
        for job in self.jobs {
            let purpose = format!("init/{}/{}", job.trial.property, spec.name);
            let mut rng = rng::stream(self.seed, &purpose, job.trial.rerun);
            values.extend((0..count).map(|_| rng.random_range(-bound..bound)));
        }
        let shape: Vec<usize> = std::iter::once(self.jobs.len())
            .chain(spec.shape.iter().copied())
            .collect();
        let variable = Var::from_vec(values, shape, &Device::Cpu)?;
        let parameter = Parameter::variable(&variable);
        self.parameters.push(Trained {
            name: spec.name.to_owned(),
            variable,
            gradient: parameter.gradient().cloned().unwrap_or_default(),
        });
        Ok(parameter)
    }
}

/// One side of the adversarial game with its optimiser; without a game there is one side.
struct Side {
    names: Vec<String>,
    gradients: Vec<GradientSlot>,
    trials: usize,
    adam: Adam,
}

impl Side {
    fn of(config: &HeadConfig, parameters: &[Trained], trials: usize) -> Result<Vec<Self>> {
        let (against, with): (Vec<_>, Vec<_>) = parameters
            .iter()
            .partition(|parameter| is_discriminator(&parameter.name));
        [with, against]
            .into_iter()
            .filter(|side| !side.is_empty())
            .map(|side| {
                let variables = side.iter().map(|parameter| parameter.variable.clone());
                Ok(Self {
                    adam: Adam::new(config.adam.clone(), variables)?,
                    names: side.iter().map(|p| p.name.clone()).collect(),
                    gradients: side.iter().map(|p| p.gradient.clone()).collect(),
                    trials,
                })
            })
            .collect()
    }

    fn clear(&self) {
        self.gradients.iter().for_each(GradientSlot::clear);
    }

    fn step(&mut self, config: &HeadConfig) -> Result<()> {
        let mut names = self.names.iter().zip(&self.gradients);
        if let Some((name, _)) = names.find(|(_, gradient)| !gradient.is_written()) {
            let name = name.clone();
            return Err(HeadError::NoGradient { name }.into());
        }
        let mut scales = Vec::new();
        if let Some(largest) = config.clip_norm {
            let mut squares = vec![0.0; self.trials];
            for gradient in &self.gradients {
                squared_norms(gradient, &mut squares)?;
            }
            scales = clip_scales(&squares, largest);
        }
        self.adam.step(&self.gradients, &scales)
    }
}

/// The mini-batches of a stack. Trials of one rerun go through the same surfaces in the same order.
struct Batches<'a> {
    config: &'a HeadConfig,
    data: &'a TrainingData<'a>,
    seed: u64,
    jobs: &'a [&'a Job<'a>],
    /// Positions among the training surfaces, by trial.
    orders: Vec<Vec<usize>>,
    /// Draws the views of trials that have no fixed ones.
    views: Vec<ChaCha8Rng>,
    /// Batches given so far.
    step: usize,
}

impl<'a> Batches<'a> {
    fn new(
        config: &'a HeadConfig,
        data: &'a TrainingData<'a>,
        seed: u64,
        jobs: &'a [&'a Job<'a>],
    ) -> Self {
        let views = jobs.iter().map(|job| {
            let purpose = format!("views/{}", job.trial.property);
            rng::stream(seed, &purpose, job.trial.rerun)
        });
        Self {
            config,
            data,
            seed,
            jobs,
            orders: vec![Vec::new(); jobs.len()],
            views: views.collect(),
            step: 0,
        }
    }

    fn rows(&self) -> usize {
        self.orders.first().map_or(0, Vec::len)
    }

    fn shuffle(&mut self, epoch: usize) {
        for (order, job) in self.orders.iter_mut().zip(self.jobs) {
            let purpose = format!("order/{}", job.trial.rerun);
            order.clear();
            order.extend(0..job.surfaces.len());
            order.shuffle(&mut rng::stream(self.seed, &purpose, epoch as u64));
        }
    }

    /// The batch from `start` on, and how many readings each trial has in it.
    fn at(&mut self, start: usize) -> Result<(Batch, Vec<f64>)> {
        let end = (start + self.config.batch_size).min(self.rows());
        let (trials, rows) = (self.jobs.len(), end - start);
        let width = self.data.embeddings.width();
        let inputs = self.config.input.slots() * width;
        let mut visual = Vec::with_capacity(trials * rows * inputs);
        let mut tactile = Vec::with_capacity(trials * rows);
        let mut measured = Vec::with_capacity(trials * rows);
        let mut labels = Vec::with_capacity(trials * rows);
        for ((job, order), rng) in self.jobs.iter().zip(&self.orders).zip(&mut self.views) {
            for &at in &order[start..end] {
                let drawn;
                let views = match &job.trial.views {
                    Views::Fixed(views) => views,
                    Views::Steps(steps) => &steps[self.step % steps.len()],
                    Views::Random => {
                        drawn = self.config.input.draw(self.data.embeddings.views(), rng);
                        &drawn
                    }
                };
                push_visual(self.config, self.data, job, at, views, &mut visual);
                tactile.push(job.tactile[at].unwrap_or(0.0));
                measured.push(job.tactile[at].is_some());
                labels.push(job.labels.as_ref().and_then(|labels| labels.of()[at]));
            }
        }
        let labelled: Vec<bool> = labels.iter().map(Option::is_some).collect();
        self.step += 1;
        let (weight, counts) = mean_weights(&measured, rows);
        let (label_weight, _) = mean_weights(&labelled, rows);
        let cpu = &Device::Cpu;
        let batch = Batch {
            visual: Tensor::from_vec(visual, (trials, rows, inputs), cpu)?,
            width,
            tactile: Tensor::from_vec(tactile, (trials, rows, 1), cpu)?,
            weight: Tensor::from_vec(weight, (trials, rows), cpu)?,
            labels,
            label_weight: Tensor::from_vec(label_weight, (trials, rows), cpu)?,
        };
        Ok((batch, counts))
    }
}

fn push_visual(
    config: &HeadConfig,
    data: &TrainingData<'_>,
    job: &Job<'_>,
    at: usize,
    views: &[usize],
    out: &mut Vec<f32>,
) {
    let surface = job.surfaces[at];
    let (input, statistics) = (&config.input, &job.statistics);
    input::push(input, statistics, data.embeddings, surface, views, out);
}

/// For each trial, one over the number of rows that count in each of these, and that number.
fn mean_weights(counts: &[bool], rows: usize) -> (Vec<f32>, Vec<f64>) {
    let mut weights = Vec::with_capacity(counts.len());
    let mut numbers = Vec::new();
    for trial in counts.chunks(rows.max(1)) {
        let number = trial.iter().filter(|&&counts| counts).count();
        let weight = 1.0 / number.max(1) as f32;
        weights.extend(trial.iter().map(|&c| if c { weight } else { 0.0 }));
        numbers.push(number as f64);
    }
    (weights, numbers)
}

/// Where a loss is recorded.
type LossField = fn(&mut EpochLosses) -> &mut f64;

/// Means of the losses over an epoch, by trial.
struct Means {
    sums: Vec<EpochLosses>,
    counts: Vec<f64>,
}

impl Means {
    fn new(trials: usize) -> Self {
        Self {
            sums: vec![EpochLosses::default(); trials],
            counts: vec![0.0; trials],
        }
    }

    fn add(&mut self, losses: &Losses, counts: &[f64]) -> Result<()> {
        for (total, count) in self.counts.iter_mut().zip(counts) {
            *total += count;
        }
        let terms: [(Option<&Tensor>, LossField); 6] = [
            (Some(&losses.estimation), |l| &mut l.estimation),
            (losses.embedding.as_ref(), |l| &mut l.embedding),
            (losses.reconstruction.as_ref(), |l| &mut l.reconstruction),
            (losses.generator.as_ref(), |l| &mut l.generator),
            (losses.discriminator.as_ref(), |l| &mut l.discriminator),
            (losses.classification.as_ref(), |l| &mut l.classification),
        ];
        for (term, field) in terms {
            let Some(term) = term else { continue };
            let values = term.to_vec1::<f32>()?;
            for ((sum, value), count) in self.sums.iter_mut().zip(values).zip(counts) {
                *field(sum) += f64::from(value) * count;
            }
        }
        Ok(())
    }

    fn finish(self) -> impl Iterator<Item = EpochLosses> {
        self.sums
            .into_iter()
            .zip(self.counts)
            .map(|(sum, count)| sum.scaled(1.0 / count.max(1.0)))
    }
}

impl EpochLosses {
    fn check(&self, job: &Job<'_>, epoch: usize) -> Result<()> {
        match self.all().into_iter().find(|loss| !loss.is_finite()) {
            None => Ok(()),
            Some(loss) => Err(HeadError::Diverged {
                property: job.trial.property.clone(),
                rerun: job.trial.rerun,
                epoch: epoch + 1,
                loss,
            }
            .into()),
        }
    }
}

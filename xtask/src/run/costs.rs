//! What one estimate costs, measured without the cache.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Instant;

use anyhow::Result;
use candle_core::{Device, Tensor};
use sps_dataset::{Frame, FrameKey, RollAngle, Source, Split, Surface, TactileTable, Units};
use sps_models::Embeddings;
use sps_models::heads::HeadConfig;
use sps_models::ridge::{Ridge, RidgeConfig};

use super::fit::{Fitted, fit, fit_some};
use super::trials::{TrialSpec, plan};
use super::views::TrialViews;
use super::{Splits, Stage};
use crate::config::Method;
use crate::journal::Stop;
use crate::memory;
use crate::results::Costs;

/// Surfaces that the costs are measured on, all groups of properties together.
const SURFACES: usize = 8;
/// Surfaces that they are measured on at least in each group.
const FEWEST: usize = 2;
/// How often each surface is estimated at most, and seconds after which a method's are no more.
const ROUNDS: usize = 5;
const ENOUGH_SECONDS: f64 = 1.0;

/// Whose costs are asked for.
pub(crate) struct Asked<'a> {
    pub stage: &'a Stage,
    pub method: &'a Method,
    pub trials: &'a [TrialSpec],
    /// Where the method stopped, if it looks at one view after the other.
    pub stops: &'a [Stop],
}

/// Estimates properties of some held-out surfaces one by one, from the frame on: those together
/// that look at the same views. Of a method that looks at one view after the other, one property,
/// at each number of views; these are weighed by how often the method stopped there.
///
/// The methods take turns, round by round: what else the machine does comes and goes within
/// seconds, and falls on all of them alike. The time does not depend on what the weights are, so a
/// model of each method's shape is fitted to a few surfaces for it: the run's own models need not
/// be kept.
pub(crate) fn measure<S: Source>(
    source: &S,
    splits: &Splits,
    asked: &[Asked<'_>],
) -> Result<Vec<Costs>> {
    let source = Counted::new(source);
    let turns = asked.iter().map(|asked| Turn::new(&source, splits, asked));
    let mut turns = turns.collect::<Result<Vec<_>>>()?;
    // Memory made ready and simulated surfaces built, so that the first pays no more than others.
    for turn in &turns {
        turn.pass()?;
    }
    for _ in 0..ROUNDS {
        for turn in &mut turns {
            turn.take()?;
        }
    }
    Ok(turns.iter().map(Turn::costs).collect())
}

/// A method whose costs are measured.
struct Turn<'a, S> {
    measuring: Measuring<'a, S>,
    way: Way,
    /// The share of estimates that end after each step.
    ends: Vec<f64>,
    /// What had been spent after each step of each estimate.
    estimates: Vec<Vec<Spent>>,
    seconds: f64,
}

/// How a method looks at its views.
enum Way {
    /// At once: the models of properties that look at the same views, with these.
    Together(Vec<(Vec<Vec<usize>>, Fitted)>),
    /// One after the other, in this order: for each number of views an estimator, and a regression
    /// of its errors.
    OneByOne(Vec<usize>, Vec<[Fitted; 2]>),
}

impl<'a, S: Source> Turn<'a, S> {
    fn new(source: &'a Counted<'a, S>, splits: &'a Splits, asked: &Asked<'a>) -> Result<Self> {
        let split = &splits.all[0];
        let few = Split {
            train: split.train.iter().copied().take(2 * SURFACES).collect(),
            validation: split.validation.iter().copied().take(SURFACES).collect(),
        };
        let readings = &asked.stage.tables.readings;
        let measured = |trial: &&TrialSpec| {
            let column = readings.column(trial.property.code());
            let reading = |&s: &usize| readings.get(s, column?);
            trial.rerun == 0 && few.train.iter().any(|s| reading(s).is_some())
        };
        let trials: Vec<&TrialSpec> = asked.trials.iter().filter(measured).collect();
        let mut measuring = Measuring {
            source,
            stage: asked.stage,
            method: quick(asked.method)?,
            units: &splits.units,
            few,
        };
        let (way, ends) = match trials.first() {
            Some(trial) if asked.method.adaptive.is_some() => {
                let order = trial.views.shown();
                let models =
                    (1..=order.len()).map(|views| measuring.models(trial, &order[..views]));
                let models = models.collect::<Result<_>>()?;
                let ends = shares(asked.stops, order.len());
                (Way::OneByOne(order, models), ends)
            }
            _ => {
                let groups = measuring.groups(&trials)?;
                let each = (SURFACES / groups.len().max(1)).max(FEWEST);
                measuring.few.validation.truncate(each);
                (Way::Together(groups), vec![1.0])
            }
        };
        Ok(Self {
            measuring,
            way,
            ends,
            estimates: Vec::new(),
            seconds: 0.0,
        })
    }

    /// One more pass, unless there have been enough.
    fn take(&mut self) -> Result<()> {
        if self.seconds < ENOUGH_SECONDS {
            let (estimates, seconds) = timed(|| self.pass())?;
            self.estimates.extend(estimates);
            self.seconds += seconds;
        }
        Ok(())
    }

    /// Each surface estimated once: what had been spent after each step.
    fn pass(&self) -> Result<Vec<Vec<Spent>>> {
        let measuring = &self.measuring;
        let surfaces = &measuring.few.validation;
        let mut all = Vec::new();
        match &self.way {
            Way::Together(groups) => {
                for (fillings, model) in groups {
                    for &surface in surfaces {
                        all.push(vec![measuring.estimate(model, fillings, surface)?]);
                    }
                }
            }
            Way::OneByOne(order, models) => {
                for &surface in surfaces {
                    all.push(measuring.walk(models, order, surface)?);
                }
            }
        }
        Ok(all)
    }

    fn costs(&self) -> Costs {
        let ends = self.ends.iter().enumerate();
        let weighed = ends.filter(|(_, share)| **share > 0.0).map(|(at, &share)| {
            let spent: Vec<Spent> = self.estimates.iter().map(|steps| steps[at]).collect();
            (share, self.measuring.costs(&spent))
        });
        Costs::weighed(&weighed.collect::<Vec<_>>())
    }
}

/// The share of `stops` at each number of views.
fn shares(stops: &[Stop], most: usize) -> Vec<f64> {
    let at = |views| stops.iter().filter(|stop| stop.views == views).count();
    let shares = (1..=most).map(|views| at(views) as f64 / stops.len().max(1) as f64);
    shares.collect()
}

/// The method, trained for one epoch.
fn quick(method: &Method) -> Result<Method> {
    let mut method = method.clone();
    method.estimator = method.estimator.with_heads(&|config| HeadConfig {
        epochs: 1,
        ..config.clone()
    })?;
    Ok(method)
}

/// What is measured, and on what.
struct Measuring<'a, S> {
    source: &'a Counted<'a, S>,
    stage: &'a Stage,
    method: Method,
    units: &'a Units,
    few: Split,
}

/// What one estimate took.
#[derive(Clone, Copy, Default)]
struct Spent {
    decode: f64,
    encode: f64,
    head: f64,
    frames_decoded: usize,
    frames_encoded: usize,
    multiply_adds: Option<u64>,
    /// Bytes allocated at most, beside what was there before.
    memory: usize,
}

impl<S: Source> Measuring<'_, S> {
    /// Models of the trials that look at the same views, with these.
    fn groups(&self, trials: &[&TrialSpec]) -> Result<Vec<(Vec<Vec<usize>>, Fitted)>> {
        let mut groups: BTreeMap<&[Vec<usize>], Vec<&TrialSpec>> = BTreeMap::new();
        for trial in trials {
            let group = groups.entry(&trial.views.fillings).or_default();
            group.push(trial);
        }
        let fitted = groups.into_iter().map(|(fillings, trials)| {
            let plan = plan(0, std::slice::from_ref(&self.few), trials.into_iter());
            let data = (&self.stage.tables, self.units);
            let model = fit_some(&self.method, data, &plan, &())?;
            Ok((fillings.to_vec(), model))
        });
        fitted.collect()
    }

    /// Estimates one surface.
    fn estimate(&self, model: &Fitted, fillings: &[Vec<usize>], surface: usize) -> Result<Spent> {
        let (spent, memory) = memory::peak(|| self.estimated(model, fillings, surface));
        Ok(Spent { memory, ..spent? })
    }

    fn estimated(&self, model: &Fitted, fillings: &[Vec<usize>], surface: usize) -> Result<Spent> {
        let views: BTreeSet<usize> = fillings.iter().flatten().copied().collect();
        let views: Vec<usize> = views.into_iter().collect();
        let before = self.source.frames();
        let (frames, decode) = timed(|| self.decode(surface, &views))?;
        let each = self.stage.embedder.encoder().frames();
        let frames_decoded = each * (self.source.frames() - before);
        let (values, encode) = timed(|| self.stage.embedder.embed(&frames))?;
        let ((), head) = timed(|| {
            let embeddings = self.embeddings(values)?;
            for filling in fillings {
                let slots = filling
                    .iter()
                    .filter_map(|view| views.binary_search(view).ok());
                let slots: Vec<usize> = slots.collect();
                model.models().predict(&embeddings.select(&[0], &slots)?)?;
            }
            Ok(())
        })?;
        let of_heads = fillings.len() as u64 * model.models().multiply_adds();
        Ok(Spent {
            decode,
            encode,
            head,
            frames_decoded,
            frames_encoded: each * frames.len(),
            multiply_adds: self.of_encoder(&frames).map(|count| count + of_heads),
            memory: 0,
        })
    }

    /// The estimator of some views, and the regression of its errors.
    fn models(&self, trial: &TrialSpec, views: &[usize]) -> Result<[Fitted; 2]> {
        let trial = TrialSpec {
            views: TrialViews::fixed(views.to_vec()),
            ..trial.clone()
        };
        let plan = plan(0, std::slice::from_ref(&self.few), [&trial].into_iter());
        let tables = &self.stage.tables;
        let method = self.method.with_views(views.len())?;
        let errors = Ridge::new(RidgeConfig::default())?;
        let errors = errors.train(&tables.training_data(self.units), &plan)?;
        let estimator = fit(&method, (tables, self.units), &plan, &())?;
        Ok([estimator, Fitted::Ridges(errors)])
    }

    /// What has been spent after each view.
    fn walk(&self, models: &[[Fitted; 2]], order: &[usize], surface: usize) -> Result<Vec<Spent>> {
        let mut values = Vec::new();
        let mut sum = Spent {
            multiply_adds: Some(0),
            ..Spent::default()
        };
        let mut all = Vec::new();
        for (models, &view) in models.iter().zip(order) {
            let (step, memory) = memory::peak(|| self.step(models, view, surface, &mut values));
            let step = step?;
            let counts = sum.multiply_adds.zip(step.multiply_adds);
            sum = Spent {
                decode: sum.decode + step.decode,
                encode: sum.encode + step.encode,
                head: sum.head + step.head,
                frames_decoded: sum.frames_decoded + step.frames_decoded,
                frames_encoded: sum.frames_encoded + step.frames_encoded,
                multiply_adds: counts.map(|(sum, step)| sum + step),
                memory: sum.memory.max(memory),
            };
            all.push(sum);
        }
        Ok(all)
    }

    /// Looks at one view more; `values` are the embeddings so far.
    fn step(
        &self,
        models: &[Fitted],
        view: usize,
        surface: usize,
        values: &mut Vec<f32>,
    ) -> Result<Spent> {
        let before = self.source.frames();
        let (frames, decode) = timed(|| self.decode(surface, &[view]))?;
        let (embedding, encode) = timed(|| self.stage.embedder.embed(&frames))?;
        values.extend(embedding);
        let ((), head) = timed(|| {
            let embeddings = self.embeddings(values.clone())?;
            for model in models {
                model.models().predict(&embeddings)?;
            }
            Ok(())
        })?;
        let of_heads: u64 = models
            .iter()
            .map(|fitted| fitted.models().multiply_adds())
            .sum();
        Ok(Spent {
            decode,
            encode,
            head,
            frames_decoded: self.source.frames() - before,
            frames_encoded: frames.len(),
            multiply_adds: self.of_encoder(&frames).map(|count| count + of_heads),
            memory: 0,
        })
    }

    fn decode(&self, surface: usize, views: &[usize]) -> Result<Vec<Frame>> {
        let views = views.iter().map(|&view| self.stage.tables.views[view]);
        let frames = views.map(|view| self.source.frame(surface, view));
        Ok(frames.collect::<Result<_, _>>()?)
    }

    /// Embeddings of one surface.
    fn embeddings(&self, values: Vec<f32>) -> Result<Embeddings> {
        let width = self.stage.embedder.width();
        let shape = (1, values.len() / width, width);
        let tensor = Tensor::from_vec(values, shape, &Device::Cpu)?;
        Ok(Embeddings::new(&tensor)?)
    }

    fn of_encoder(&self, frames: &[Frame]) -> Option<u64> {
        let embedder = &self.stage.embedder;
        let counts = frames.iter().map(|frame| embedder.multiply_adds(frame));
        counts.sum()
    }

    /// Medians of the seconds, means of the counts, and the most memory.
    fn costs(&self, all: &[Spent]) -> Costs {
        let count = all.len().max(1) as f64;
        let mean = |of: fn(&Spent) -> usize| all.iter().map(of).sum::<usize>() as f64 / count;
        let multiply_adds = all.iter().map(|spent| spent.multiply_adds);
        let multiply_adds = multiply_adds
            .sum::<Option<u64>>()
            .filter(|_| !all.is_empty());
        let memory = all.iter().map(|spent| spent.memory).max();
        Costs {
            frames_decoded: mean(|spent| spent.frames_decoded),
            frames_encoded: mean(|spent| spent.frames_encoded),
            seconds: median(all, |spent| spent.decode + spent.encode + spent.head),
            decode_seconds: median(all, |spent| spent.decode),
            encode_seconds: median(all, |spent| spent.encode),
            head_seconds: median(all, |spent| spent.head),
            peak_memory_bytes: memory.map(|bytes| (bytes + self.stage.encoder_bytes) as f64),
            multiply_adds: multiply_adds.map(|sum| sum as f64 / count),
            encoder_train_seconds: 0.0,
        }
    }
}

fn median(all: &[Spent], of: fn(&Spent) -> f64) -> Option<f64> {
    let mut values: Vec<f64> = all.iter().map(of).collect();
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied()
}

/// What `work` gives, and its seconds.
fn timed<T>(work: impl FnOnce() -> Result<T>) -> Result<(T, f64)> {
    let start = Instant::now();
    let done = work()?;
    Ok((done, start.elapsed().as_secs_f64()))
}

/// A source that counts the frames it is asked for.
struct Counted<'a, S> {
    source: &'a S,
    frames: AtomicUsize,
}

impl<'a, S: Source> Counted<'a, S> {
    fn new(source: &'a S) -> Self {
        Self {
            source,
            frames: AtomicUsize::new(0),
        }
    }

    /// How many so far.
    fn frames(&self) -> usize {
        self.frames.load(Ordering::Relaxed)
    }
}

impl<S: Source> Source for Counted<'_, S> {
    type Error = S::Error;

    fn name(&self) -> &str {
        self.source.name()
    }

    fn surfaces(&self) -> &[Surface] {
        self.source.surfaces()
    }

    fn view_angles(&self) -> &[RollAngle] {
        self.source.view_angles()
    }

    fn tactile(&self) -> &TactileTable {
        self.source.tactile()
    }

    fn frame(&self, surface: usize, view: usize) -> Result<Frame, S::Error> {
        self.frames.fetch_add(1, Ordering::Relaxed);
        self.source.frame(surface, view)
    }

    fn frame_key(&self, surface: usize, view: usize) -> Result<FrameKey, S::Error> {
        self.source.frame_key(surface, view)
    }
}

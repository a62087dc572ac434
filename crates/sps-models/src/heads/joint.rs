//! The heads of all properties as one loss of what an encoder sees, through which it is trained.

use std::collections::BTreeMap;
use std::fmt;

use candle_core::{Device, Tensor, Var};
use rand::seq::index;
use sps_base::streams::named_stream;
use sps_regress::{Plan, Rerun, TrainingData, Views, check_indices};

use super::batches::rows_that_count;
use super::config::{HeadConfig, Input};
use super::job::{self, Job};
use super::losses::{Batch, Losses};
use super::network::Dims;
use super::stack::{Stack, StackParameter};
use super::trained::EpochLosses;
use crate::error::Result;
use crate::optim::Gradient;

/// One network for each property on the same views of the same surfaces.
///
/// The loss is the mean over the properties of the paper's objective (section 4.1).
pub(crate) struct JointHeads {
    config: HeadConfig,
    dims: Dims,
    seed: u64,
    views: usize,
    stack: Stack,
    /// Centre and factor of each feature, `(1, 1, width)`, from what the encoder saw before it was
    /// trained.
    mean: Tensor,
    factor: Tensor,
    /// The standardised reading of each property and surface.
    tactile: Vec<Vec<Option<f32>>>,
    /// Of the training surfaces, by surface.
    labels: BTreeMap<usize, Option<u32>>,
}

/// Which draw of what is drawn anew for each step.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Draw {
    Step(usize),
    Validation,
}

/// Surfaces that go through the network at once, and those of the whole step that they are of: each loss
/// is their share of the mean over the step.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Share<'a> {
    pub(crate) surfaces: &'a [usize],
    pub(crate) of: &'a [usize],
}

impl<'a> Share<'a> {
    /// All of a step at once.
    pub(crate) fn whole(surfaces: &'a [usize]) -> Self {
        Self {
            surfaces,
            of: surfaces,
        }
    }
}

impl fmt::Debug for JointHeads {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut heads = f.debug_struct("JointHeads");
        heads.field("config", &self.config).finish_non_exhaustive()
    }
}

impl JointHeads {
    /// Fresh networks for the properties that any training surface has a reading of; `data` holds what
    /// the encoder sees of each surface before it is trained, in the views that it is trained on.
    pub(crate) fn new(
        config: HeadConfig,
        data: &TrainingData<'_>,
        training: &[usize],
        seed: u64,
    ) -> Result<Self> {
        config.check()?;
        let views: Vec<usize> = (0..data.embeddings.views()).collect();
        let rerun = Rerun::new(0, training.to_vec());
        let plan = Plan::each(seed, &read(data, training)?, vec![rerun]);
        let plan = plan.with_views(&Views::Fixed(views.clone()));
        let fixed = match config.input {
            Input::Relations { .. } => None,
            _ => config.input.views(),
        };
        plan.check(fixed, data)?;
        let jobs = job::prepare(&config, data, &plan)?;
        let jobs: Vec<&Job<'_>> = jobs.iter().collect();
        let Some(first) = jobs.first() else {
            let expected = "at least one that a training surface has a reading of";
            return Err(crate::Error::input("properties", "none", expected));
        };
        let dims = first.dims(&config, data.embeddings);
        let row = |values: &[f32]| Tensor::from_slice(values, (1, 1, dims.width), &Device::Cpu);
        let labels = first.labels.iter().flat_map(|labels| &labels.of).copied();
        let labels = first.training.surfaces.iter().copied().zip(labels);
        let surfaces = 0..data.readings.surfaces();
        let tactile = jobs.iter().map(|job| {
            let column = data.readings.column(&job.trial.property);
            let reading = |surface| data.readings.get(surface, column?);
            let standard = |t| job.target.standardise(t) as f32;
            surfaces.clone().map(|s| reading(s).map(standard)).collect()
        });
        Ok(Self {
            dims,
            seed,
            views: views.len(),
            mean: row(&first.statistics.mean)?,
            factor: row(&first.statistics.factor)?,
            tactile: tactile.collect(),
            labels: labels.collect(),
            stack: Stack::drawn(&config, dims, seed, &jobs)?,
            config,
        })
    }

    /// Views of a surface.
    pub(crate) fn views(&self) -> usize {
        self.views
    }

    /// The parameters, by name; each of all properties, `(properties, ..)`.
    pub(crate) fn parameters(&self) -> impl Iterator<Item = (String, &Var)> {
        let parameters = self.stack.parameters.iter();
        parameters.map(|parameter| (parameter.name.clone(), &parameter.variable))
    }

    /// The losses of some surfaces, of which `embeddings`, `(surfaces, views, width)`, is what the
    /// encoder sees: what to differentiate, and its parts, each a mean over the properties before
    /// its weight. All surfaces of a step are seen by one draw.
    pub(crate) fn loss(
        &self,
        embeddings: &Tensor,
        share: Share<'_>,
        draw: Draw,
    ) -> Result<(Tensor, EpochLosses)> {
        let batch = self.batch(self.visual(embeddings, draw)?, share)?;
        let losses = Losses::of(&self.stack.network, &batch)?;
        let each = 1.0 / self.tactile.len() as f64;
        let mut means = EpochLosses::default();
        for (field, term) in losses.terms() {
            let values = term.to_vec1::<f32>()?;
            *field(&mut means) = values.iter().map(|&v| f64::from(v) * each).sum();
        }
        for parameter in &self.stack.parameters {
            parameter.gradient.clear();
        }
        Ok(((losses.total(&self.config.model)? * each)?, means))
    }

    /// The squared error of some surfaces, in units of the training readings' variance: a mean over
    /// the properties that any of them has a reading of.
    pub(crate) fn error(&self, embeddings: &Tensor, surfaces: &[usize]) -> Result<f64> {
        let visual = self.visual(embeddings, Draw::Validation)?;
        let estimates = self.stack.network.estimate(&visual)?;
        let estimates: Vec<f32> = estimates.flatten_all()?.to_vec1()?;
        let estimates = estimates.chunks_exact(surfaces.len().max(1));
        let rows = self.tactile.iter().zip(estimates);
        let mut errors = Vec::new();
        for (tactile, estimates) in rows {
            let pairs = surfaces.iter().zip(estimates);
            let own = pairs
                .filter_map(|(&s, estimate)| Some(f64::from(*estimate) - f64::from(tactile[s]?)));
            let squares: Vec<f64> = own.map(|error| error * error).collect();
            if !squares.is_empty() {
                errors.push(squares.iter().sum::<f64>() / squares.len() as f64);
            }
        }
        Ok(errors.iter().sum::<f64>() / errors.len().max(1) as f64)
    }

    /// The parameters' gradients after a backward pass from [`JointHeads::loss`], in their order.
    pub(crate) fn gradients(&self) -> Result<Vec<Tensor>> {
        let gradient = |parameter: &StackParameter| {
            let shape = parameter.variable.shape();
            let tensor = |values: &[f32]| Tensor::from_slice(values, shape, &Device::Cpu);
            Ok(parameter.read(tensor)?)
        };
        self.stack.parameters.iter().map(gradient).collect()
    }

    /// `(properties, surfaces, slots x width)`, scaled.
    fn visual(&self, embeddings: &Tensor, draw: Draw) -> Result<Tensor> {
        let (surfaces, ..) = embeddings.dims3()?;
        let slots = match &self.config.input {
            Input::Single {} | Input::LateFusion { .. } => embeddings.clone(),
            Input::ViewPooling {} => embeddings.max_keepdim(1)?,
            Input::Relations { .. } => {
                let slots = Tensor::new(self.relations(draw), &Device::Cpu)?;
                embeddings.contiguous()?.index_select(&slots, 1)?
            }
        };
        let centred = slots.broadcast_sub(&self.mean)?;
        let scaled = centred.broadcast_mul(&self.factor)?;
        let inputs = self.dims.slots * self.dims.width;
        let one = scaled.reshape((1, surfaces, inputs))?;
        Ok(one.broadcast_as((self.tactile.len(), surfaces, inputs))?)
    }

    /// The views that fill the slots of relations: in each relation distinct ones, in order.
    fn relations(&self, draw: Draw) -> Vec<u32> {
        let Input::Relations { scales } = &self.config.input else {
            return Vec::new();
        };
        let mut rng = match draw {
            Draw::Step(step) => named_stream(self.seed, "training/relations", step as u64),
            Draw::Validation => named_stream(self.seed, "training/validation-relations", 0),
        };
        let mut slots = Vec::new();
        for scale in scales {
            for _ in 0..scale.relations {
                let mut views = index::sample(&mut rng, self.views, scale.views).into_vec();
                views.sort_unstable();
                slots.extend(views.into_iter().map(|view| view as u32));
            }
        }
        slots
    }

    fn batch(&self, visual: Tensor, Share { surfaces, of }: Share<'_>) -> Result<Batch> {
        let readings = |surfaces: &[usize]| -> Vec<Option<f32>> {
            let of = |tactile: &Vec<Option<f32>>| surfaces.iter().map(|&s| tactile[s]).collect();
            self.tactile.iter().flat_map::<Vec<_>, _>(of).collect()
        };
        let labels = |surfaces: &[usize]| -> Vec<Option<u32>> {
            let label = |s: &usize| self.labels.get(s).copied().flatten();
            let labels: Vec<_> = surfaces.iter().map(label).collect();
            labels.repeat(self.tactile.len())
        };
        let measured = rows_that_count(&readings(of), of.len());
        let labelled = rows_that_count(&labels(of), of.len());
        let (tactile, labels) = (readings(surfaces), labels(surfaces));
        let (tactile, labels) = ((&tactile[..], &measured[..]), (labels, &labelled[..]));
        Ok(Batch::new(visual, self.dims.width, tactile, labels)?)
    }
}

/// The properties that any of these surfaces has a reading of.
fn read(data: &TrainingData<'_>, surfaces: &[usize]) -> Result<Vec<String>> {
    let readings = data.readings;
    check_indices("training surface", surfaces, readings.surfaces())?;
    let is_read = |column: usize| surfaces.iter().any(|&s| readings.get(s, column).is_some());
    let properties = readings.properties().iter().enumerate();
    let read = properties.filter(|(column, _)| is_read(*column));
    Ok(read.map(|(_, property)| property.clone()).collect())
}

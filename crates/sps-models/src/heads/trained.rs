use candle_core::{Device, Tensor};
use serde::{Deserialize, Serialize};
use sps_base::parallel;
use sps_regress::{DivergedTrial, Embeddings, Estimates, Standardiser, Trial};

use super::Head;
use super::config::{HeadConfig, Input};
use super::input::InputStatistics;
use super::network::{Dims, Network, Spec};
use crate::error::{Error, Result};
use crate::stacked::Parameter;
use crate::weights::Weights;

/// Rows that prediction computes at once. Always this many, the last ones filled with zeros: so
/// a surface's estimate has the same bits whichever surfaces stand beside it.
const ROWS: usize = 32;

/// The mean of each loss over one epoch, before its weight; zero for a loss that is not used.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub struct EpochLosses {
    /// `L_est`, in units of the training readings' variance.
    pub estimation: f64,
    /// `L_emb`.
    pub embedding: f64,
    /// The generator's part of `L_adv`.
    pub generator: f64,
    /// The discriminator's part of `L_adv`, as it is minimised.
    pub discriminator: f64,
    /// `L_class`.
    pub classification: f64,
}

impl EpochLosses {
    const FIELDS: [LossField; 5] = [
        |l| &mut l.estimation,
        |l| &mut l.embedding,
        |l| &mut l.generator,
        |l| &mut l.discriminator,
        |l| &mut l.classification,
    ];

    pub(super) fn all(&self) -> [f64; 5] {
        let mut own = *self;
        Self::FIELDS.map(|field| *field(&mut own))
    }

    pub(super) fn scaled(mut self, by: f64) -> Self {
        for field in Self::FIELDS {
            *field(&mut self) *= by;
        }
        self
    }
}

/// Where a loss is recorded.
pub(super) type LossField = fn(&mut EpochLosses) -> &mut f64;

/// The epoch whose weights a head has, under [`EarlyStopping`](super::EarlyStopping).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub struct KeptEpoch {
    /// Its number, from 1; 0 where none was better than the training mean, which the head then
    /// says for every surface.
    pub epoch: usize,
    /// `L_est` on the validation part, in units of the training readings' variance: of the
    /// training mean, and after each epoch that was run; [`f64::MAX`] where it is not finite.
    pub errors: Vec<f64>,
}

/// One trained network, for one property and rerun.
#[derive(Clone, Debug)]
pub struct TrainedHead {
    pub(super) trial: Trial,
    pub(super) dims: Dims,
    pub(super) statistics: InputStatistics,
    pub(super) target: Standardiser,
    /// Without the trials' axis: a weight as `(inputs, outputs)`, a bias as `(outputs)`. The rows of
    /// `visual.weight` are the slots one after the other.
    pub(super) parameters: Weights,
    pub(super) history: Vec<EpochLosses>,
    pub(super) kept: Option<KeptEpoch>,
}

impl TrainedHead {
    /// What it was trained for.
    pub fn trial(&self) -> &Trial {
        &self.trial
    }

    /// The losses, epoch by epoch.
    pub fn history(&self) -> &[EpochLosses] {
        &self.history
    }

    /// Which epoch's weights it has; `None` without early stopping, for the last one's.
    pub fn kept_epoch(&self) -> Option<&KeptEpoch> {
        self.kept.as_ref()
    }

    /// Multiply-adds of the layers between embeddings and estimate.
    pub(super) fn multiply_adds(&self, config: &HeadConfig) -> u64 {
        let weights = self.parameters.iter();
        let weights = weights.filter(|(name, _)| name.ends_with(".weight"));
        let counts = weights.map(|(name, weight)| times(config, name) * weight.elem_count());
        counts.sum::<usize>() as u64
    }

    /// Estimates in measured units, one per surface.
    ///
    /// The views of `embeddings` are the ones to use, in the order of the slots: as many as the
    /// head has slots, any number for view pooling.
    fn estimate(&self, config: &HeadConfig, embeddings: &Embeddings) -> Result<Vec<f64>> {
        self.check(config, embeddings)?;
        // A stack of one.
        let mut stored = |spec: &Spec<'_>| {
            let tensor = self.parameters.get(spec.name)?;
            Ok(Parameter::constant(tensor.unsqueeze(0)?))
        };
        let network = Network::new(&mut stored, config, self.dims)?;
        let views: Vec<usize> = (0..embeddings.views()).collect();
        let surfaces: Vec<usize> = (0..embeddings.surfaces()).collect();
        let inputs = self.dims.slots * self.dims.width;
        let mut estimates = Vec::with_capacity(surfaces.len());
        let (input, statistics) = (&config.input, &self.statistics);
        for some in surfaces.chunks(ROWS) {
            let mut visual = Vec::with_capacity(ROWS * inputs);
            for &surface in some {
                statistics.push_seen(input, embeddings, surface, &views, &mut visual);
            }
            visual.resize(ROWS * inputs, 0.0);
            let visual = Tensor::from_vec(visual, (1, ROWS, inputs), &Device::Cpu)?;
            let values = network.estimate(&visual)?.flatten_all()?.to_vec1::<f32>()?;
            let values = values.iter().take(some.len());
            estimates.extend(values.map(|&v| self.target.mean + self.target.std * f64::from(v)));
        }
        Ok(estimates)
    }

    fn check(&self, config: &HeadConfig, embeddings: &Embeddings) -> Result<()> {
        let (views, width) = (embeddings.views(), embeddings.width());
        let expected = match config.input.views() {
            _ if width != self.dims.width => format!("width {}", self.dims.width),
            Some(wanted) if wanted != views => format!("{wanted} views"),
            _ => return Ok(()),
        };
        let found = format_args!("{views} views of width {width}");
        Err(Error::input("embeddings for prediction", found, expected))
    }
}

/// How often an estimate goes through the layer of a weight; the layers that only training needs
/// count for nothing.
fn times(config: &HeadConfig, weight: &str) -> usize {
    let mut parts = weight.split('.');
    match (parts.next(), &config.input) {
        (Some("visual" | "generator" | "value"), _) => 1,
        (Some("relations"), Input::Relations { scales }) => {
            let scale = parts.next().and_then(|at| at.parse::<usize>().ok());
            let scale = scale.and_then(|at| scales.get(at));
            scale.map_or(0, |scale| scale.relations)
        }
        _ => 0,
    }
}

/// Trained networks of one configuration.
#[derive(Clone, Debug)]
pub struct TrainedHeads {
    pub(super) head: Head,
    pub(super) heads: Vec<TrainedHead>,
    pub(super) diverged: Vec<DivergedTrial>,
}

impl TrainedHeads {
    /// The configuration that all of them share.
    pub fn config(&self) -> &HeadConfig {
        self.head.config()
    }

    /// The networks, in the order of the plan; those of [`TrainedHeads::diverged`] are not there.
    pub fn heads(&self) -> &[TrainedHead] {
        &self.heads
    }

    /// The trials without a network, in the order of the plan.
    pub fn diverged(&self) -> &[DivergedTrial] {
        &self.diverged
    }

    /// The heads and diverged trials for which `keep` says so.
    #[must_use]
    pub fn filter(&self, keep: impl Fn(&Trial) -> bool) -> Self {
        let heads = self.heads.iter().filter(|head| keep(&head.trial));
        let diverged = self.diverged.iter().filter(|one| keep(&one.trial));
        Self {
            head: self.head.clone(),
            heads: heads.cloned().collect(),
            diverged: diverged.cloned().collect(),
        }
    }

    /// The estimates of every head for every surface.
    ///
    /// The views of `embeddings` are the ones to use, in the order of the slots: as many as the
    /// heads have slots, any number for view pooling.
    ///
    /// # Errors
    /// Embeddings of another width or number of views than the heads take.
    pub fn predict(&self, embeddings: &Embeddings) -> Result<Vec<Estimates>> {
        let estimates = parallel::map(&self.heads, |head| {
            Ok(Estimates {
                property: head.trial.property.clone(),
                rerun: head.trial.rerun,
                values: head.estimate(self.config(), embeddings)?,
            })
        });
        estimates.into_iter().collect()
    }
}

//! Networks of one shape side by side, while they are trained.

use candle_core::{Device, Result as Computed, Var, WithDType};
use rand::Rng;
use sps_base::streams::named_stream;

use super::config::HeadConfig;
use super::job::Job;
use super::network::{Dims, Network, Spec};
use crate::error::Result;
use crate::optim::Gradient;
use crate::stacked::{GradientSlot, Parameter};
use crate::weights::Weights;

/// One network for each of some jobs, and their parameters.
pub(super) struct Stack {
    pub(super) network: Network,
    pub(super) parameters: Vec<StackParameter>,
}

/// A parameter of all networks, `(trials, ..)`.
#[derive(Clone)]
pub(super) struct StackParameter {
    pub(super) name: String,
    pub(super) variable: Var,
    pub(super) gradient: GradientSlot,
}

impl Gradient for StackParameter {
    fn read<T: WithDType, R>(&self, body: impl FnOnce(&[T]) -> Computed<R>) -> Computed<R> {
        if !self.gradient.is_written() {
            candle_core::bail!("parameter {} has no gradient", self.name)
        }
        self.gradient.read(body)
    }
}

impl Stack {
    /// With fresh weights: uniform within one over the root of the layer's inputs, as PyTorch's
    /// `Linear`.
    pub(super) fn drawn(
        config: &HeadConfig,
        dims: Dims,
        seed: u64,
        jobs: &[&Job<'_>],
    ) -> Result<Self> {
        let mut parameters = Vec::new();
        let mut fill = |spec: &Spec<'_>| {
            let count: usize = spec.shape.iter().product();
            let bound = 1.0 / (spec.fan_in.max(1) as f32).sqrt();
            let mut values = Vec::with_capacity(jobs.len() * count);
            for job in jobs {
                let purpose = format!("init/{}/{}", job.trial.property, spec.name);
                let mut rng = named_stream(seed, &purpose, job.trial.rerun);
                values.extend((0..count).map(|_| rng.random_range(-bound..bound)));
            }
            let shape = [&[jobs.len()], spec.shape].concat();
            let variable = Var::from_vec(values, shape, &Device::Cpu)?;
            let parameter = Parameter::variable(&variable);
            parameters.push(StackParameter {
                name: spec.name.to_owned(),
                variable,
                gradient: parameter.gradient().cloned().unwrap_or_default(),
            });
            Ok(parameter)
        };
        let network = Network::new(&mut fill, config, dims)?;
        Ok(Self {
            network,
            parameters,
        })
    }

    /// A copy of one trial's part.
    pub(super) fn of_trial(&self, at: usize) -> Result<Weights> {
        let own = self.parameters.iter().map(|parameter| {
            let tensor = parameter.variable.as_detached_tensor().get(at)?.copy()?;
            Ok((parameter.name.clone(), tensor))
        });
        let own = own.collect::<Result<Vec<_>>>()?;
        Ok(Weights::sharing("a trained head", own))
    }
}

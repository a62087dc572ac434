use std::cell::RefCell;

use candle_core::{CpuStorage, InplaceOp1, Layout, Tensor, Var, WithDType, bail};
use serde::{Deserialize, Serialize};
use sps_kernels::simd::{Kernel, Lanes, Level};

use super::Gradient;
use crate::error::{Error, Result, require};
use crate::stacked::{Element, for_element};

/// Adam's settings.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields, default)]
pub struct AdamConfig {
    /// Step size. Paper, section 4.2: 1e-4.
    pub learning_rate: f64,
    /// Decay of the mean of the gradient. PyTorch's default.
    pub beta1: f64,
    /// Decay of the mean of its square. PyTorch's default.
    pub beta2: f64,
    /// Added to the root of the mean square. PyTorch's default.
    pub epsilon: f64,
    /// Share of a parameter that a step takes away, relative to the step size: AdamW's decoupled
    /// weight decay (Loshchilov and Hutter 2019, algorithm 2), which the adaptive scale of the
    /// gradient leaves alone. Default: none, plain Adam.
    pub weight_decay: f64,
}

impl Default for AdamConfig {
    fn default() -> Self {
        Self {
            learning_rate: 1e-4,
            beta1: 0.9,
            beta2: 0.999,
            epsilon: 1e-8,
            weight_decay: 0.0,
        }
    }
}

impl AdamConfig {
    /// Refuses the first value that is out of its range, by its key.
    pub(crate) fn check(&self) -> Result<()> {
        let above_zero = (f64::MIN_POSITIVE..=f64::MAX, "above 0");
        let not_below_zero = (0.0..=f64::MAX, "0 or more");
        let share = (0.0..=1.0_f64.next_down(), "0 or more, below 1");
        for (key, value, (range, expected)) in [
            ("adam.learning-rate", self.learning_rate, &above_zero),
            ("adam.epsilon", self.epsilon, &above_zero),
            ("adam.beta1", self.beta1, &share),
            ("adam.beta2", self.beta2, &share),
            ("adam.weight-decay", self.weight_decay, &not_below_zero),
        ] {
            require(range.contains(&value), key, value, expected)?;
        }
        Ok(())
    }
}

/// Adam (Kingma and Ba 2015) as PyTorch computes it, one pass over each parameter; with a weight
/// decay PyTorch's `AdamW`, which lets every parameter decay, biases too.
///
/// A parameter holds the weights of several independent trials, stacked along its first axis; a
/// step may scale the gradient of each trial by its own factor. The update is elementwise, so a
/// trial's bits do not depend on what is stacked beside it.
#[derive(Debug)]
pub(crate) struct Adam {
    config: AdamConfig,
    /// Each with the running means of its gradient and of its square.
    parameters: Vec<(Var, [CpuStorage; 2])>,
    steps: u32,
}

impl Adam {
    /// Starts with both moments at zero. Parameters are f32 or f64, on the CPU.
    pub(crate) fn new(
        config: AdamConfig,
        parameters: impl IntoIterator<Item = Var>,
    ) -> Result<Self> {
        config.check()?;
        let with_moments = |parameter: Var| {
            let zeros = for_element!(parameter, T => {
                T::to_cpu_storage_owned(vec![T::from_f64(0.0); parameter.elem_count()])
            });
            Ok((parameter, [zeros.clone(), zeros]))
        };
        let parameters = parameters.into_iter().map(with_moments);
        Ok(Self {
            config,
            parameters: parameters.collect::<candle_core::Result<_>>()?,
            steps: 0,
        })
    }

    /// Sets the step size of the steps to come.
    pub(crate) fn set_learning_rate(&mut self, learning_rate: f64) {
        self.config.learning_rate = learning_rate;
    }

    /// Steps made so far.
    pub(crate) fn steps(&self) -> u32 {
        self.steps
    }

    /// The running means of each parameter's gradient and of its square, as tensors of the
    /// parameter's shape; of parameters of f32.
    pub(crate) fn moments(&self) -> Result<Vec<[Tensor; 2]>> {
        let tensors = self.parameters.iter().map(|(parameter, [mean, square])| {
            let tensor = |moments| {
                let moments = f32::cpu_storage_as_slice(moments)?;
                Tensor::from_slice(moments, parameter.dims(), parameter.device())
            };
            Ok([tensor(mean)?, tensor(square)?])
        });
        tensors.collect()
    }

    /// Goes on from the state that [`Adam::steps`] and [`Adam::moments`] told; `moments` gives
    /// those of a parameter by its index.
    pub(crate) fn restore(
        &mut self,
        steps: u32,
        moments: impl Fn(usize) -> Result<[Tensor; 2]>,
    ) -> Result<()> {
        for (index, (parameter, kept)) in self.parameters.iter_mut().enumerate() {
            for (kept, tensor) in kept.iter_mut().zip(moments(index)?) {
                if tensor.dims() != parameter.dims() {
                    let found = format_args!("{:?}", tensor.dims());
                    let expected = format_args!("{:?}", parameter.dims());
                    return Err(Error::input("moments", found, expected));
                }
                *kept = CpuStorage::F32(tensor.flatten_all()?.to_vec1()?);
            }
        }
        self.steps = steps;
        Ok(())
    }

    /// One step along `gradients`, given in the order of the parameters.
    ///
    /// `scales` has one factor per trial (per index of the first axis), by which its gradient is
    /// multiplied first; an empty slice means 1.
    pub(crate) fn step<G: Gradient>(&mut self, gradients: &[G], scales: &[f64]) -> Result<()> {
        if gradients.len() != self.parameters.len() {
            let expected = format_args!("{}, one per parameter", self.parameters.len());
            return Err(Error::input("gradients", gradients.len(), expected));
        }
        self.steps = self.steps.saturating_add(1);
        let factors = Factors::new(&self.config, self.steps);
        for ((parameter, moments), gradient) in self.parameters.iter_mut().zip(gradients) {
            step(parameter, moments, gradient, factors, scales)?;
        }
        Ok(())
    }
}

/// One parameter's part of a step.
fn step(
    parameter: &Var,
    moments: &mut [CpuStorage; 2],
    gradient: &impl Gradient,
    factors: Factors,
    scales: &[f64],
) -> candle_core::Result<()> {
    let trials = parameter.dims().first().copied().unwrap_or(1).max(1);
    let trial = parameter.elem_count() / trials;
    for_element!(parameter, T => gradient.read(|gradient: &[T]| {
        let [Some(mean), Some(square)] = moments.each_mut().map(T::slice_mut) else {
            bail!("adam: moments of another type")
        };
        parameter.inplace_op1(&Update {
            gradient,
            moments: RefCell::new([mean, square]),
            factors,
            scales,
            trial,
        })
    }))
}

/// What is the same for every element of a step.
#[derive(Clone, Copy)]
struct Factors {
    beta1: f64,
    beta2: f64,
    /// `learning rate / (1 - beta1^t)`.
    rate: f64,
    /// `1 / sqrt(1 - beta2^t)`.
    unbias: f64,
    epsilon: f64,
    /// `1 - learning rate * weight decay`.
    keep: f64,
}

impl Factors {
    fn new(config: &AdamConfig, steps: u32) -> Self {
        let power = |beta: f64| beta.powi(steps.min(i32::MAX as u32) as i32);
        Self {
            beta1: config.beta1,
            beta2: config.beta2,
            rate: config.learning_rate / (1.0 - power(config.beta1)),
            unbias: 1.0 / (1.0 - power(config.beta2)).sqrt(),
            epsilon: config.epsilon,
            keep: 1.0 - config.learning_rate * config.weight_decay,
        }
    }
}

struct Update<'a, T> {
    gradient: &'a [T],
    moments: RefCell<[&'a mut [T]; 2]>,
    factors: Factors,
    scales: &'a [f64],
    /// Elements per trial.
    trial: usize,
}

/// A parameter with what moves it.
struct Pass<'a, T> {
    factors: Factors,
    scales: &'a [f64],
    trial: usize,
    parameter: &'a mut [T],
    gradient: &'a [T],
    mean: &'a mut [T],
    square: &'a mut [T],
}

/// `m <- b1 m + (1 - b1) g`, `v <- b2 v + (1 - b2) g²`,
/// `p <- keep p - rate m / (unbias sqrt(v) + epsilon)`; without a decay `keep` is 1 and `keep p` has
/// the bits of `p`.
macro_rules! kernel {
    ($type:ty) => {
        impl Kernel for Pass<'_, $type> {
            type Output = ();

            #[inline(always)]
            fn run<S: Lanes>(self, _: S) {
                let f = self.factors;
                let (b1, b2) = (f.beta1 as $type, f.beta2 as $type);
                let (c1, c2) = ((1.0 - f.beta1) as $type, (1.0 - f.beta2) as $type);
                let (rate, unbias) = (f.rate as $type, f.unbias as $type);
                let (epsilon, keep) = (f.epsilon as $type, f.keep as $type);
                let len = self.trial.max(1);
                let gradients = self.gradient.chunks_exact(len);
                let elements = self.parameter.chunks_exact_mut(len).zip(gradients);
                let squares = self.square.chunks_exact_mut(len);
                let moments = self.mean.chunks_exact_mut(len).zip(squares);
                for (trial, ((p, g), (m, v))) in elements.zip(moments).enumerate() {
                    let scale = self.scales.get(trial).copied().unwrap_or(1.0) as $type;
                    for ((p, &g), (m, v)) in p.iter_mut().zip(g).zip(m.iter_mut().zip(v)) {
                        let g = g * scale;
                        *m = b1 * *m + c1 * g;
                        *v = b2 * *v + c2 * g * g;
                        *p = keep * *p - rate * *m / (unbias * v.sqrt() + epsilon);
                    }
                }
            }
        }
    };
}

kernel!(f32);
kernel!(f64);

/// One pass over all trials, by the widest vectors of the machine: products and sums are rounded one by one
/// at every width, so the bits are the same.
impl<T: Element> InplaceOp1 for Update<'_, T>
where
    for<'a> Pass<'a, T>: Kernel,
{
    fn name(&self) -> &'static str {
        "adam"
    }

    fn cpu_fwd(&self, parameter: &mut CpuStorage, layout: &Layout) -> candle_core::Result<()> {
        let Some((start, end)) = layout.contiguous_offsets() else {
            bail!("adam: the parameter is not contiguous")
        };
        let (gradient, count) = (self.gradient, end - start);
        if gradient.len() != count {
            bail!("adam: {} gradients for {count} parameters", gradient.len())
        }
        let Some(parameter) = T::slice_mut(parameter) else {
            bail!("adam: the gradient's type is not the parameter's")
        };
        let [mean, square] = &mut *self.moments.borrow_mut();
        Level::detect().run(Pass {
            factors: self.factors,
            scales: self.scales,
            trial: self.trial,
            parameter: &mut parameter[start..end],
            gradient,
            mean,
            square,
        });
        Ok(())
    }
}

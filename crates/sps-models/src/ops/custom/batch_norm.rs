use std::sync::{Arc, OnceLock};

use candle_core::{CpuStorage, CustomOp3, Layout, Result, Shape, Tensor, bail};

use super::{grid, values, with_values};
use crate::error::Error;
use crate::ops::batch_norm::{Norm, NormGradients};
use crate::ops::grid::Grid;
use crate::ops::moments::Moments;
use crate::ops::simd::Level;

/// What batch norm made of one batch.
#[derive(Debug, Clone)]
pub struct BatchNorm {
    /// The normed feature map, of the input's shape.
    pub output: Tensor,
    /// The batch's mean, `(channels)`.
    pub mean: Vec<f32>,
    /// The batch's variance, `(channels)`, over its count.
    pub variance: Vec<f32>,
    /// Numbers in one channel.
    pub count: usize,
}

/// Batch norm by the batch's own statistics (Ioffe and Szegedy, 2015), of
/// `(frames, [time,] height, width, channels)`, with `gamma` and `beta` `(channels)`; rectified
/// where `relu` says so. Differentiable in all three.
///
/// # Errors
///
/// When the shapes do not fit, a channel has fewer than two numbers, or a tensor is not f32 on
/// the CPU.
pub fn batch_norm(
    x: &Tensor,
    gamma: &Tensor,
    beta: &Tensor,
    eps: f64,
    relu: bool,
) -> crate::error::Result<BatchNorm> {
    let fits = |grid: &Grid| {
        let channels = [grid.channels];
        gamma.dims() == channels && beta.dims() == channels && grid.len() >= 2 * grid.channels
    };
    if !grid(x.dims()).is_some_and(|grid| grid.channels > 0 && fits(&grid)) {
        return Err(Error::input(
            "batch norm in training",
            format!(
                "x {:?}, gamma {:?}, beta {:?}",
                x.dims(),
                gamma.dims(),
                beta.dims()
            ),
            "x (frames, [time,] height, width, channels) of at least two numbers a channel, gamma \
             and beta (channels)",
        ));
    }
    let saved = Arc::new(OnceLock::new());
    let op = BatchNormOp {
        eps,
        relu,
        saved: Arc::clone(&saved),
    };
    let (gamma, beta) = (gamma.contiguous()?, beta.contiguous()?);
    let output = x.contiguous()?.apply_op3(&gamma, &beta, op)?;
    let Some(Saved { moments, .. }) = saved.get() else {
        return Err(Error::Tensor(candle_core::Error::msg(
            "batch norm kept nothing",
        )));
    };
    Ok(BatchNorm {
        output,
        mean: moments.mean.clone(),
        variance: moments.variance.clone(),
        count: moments.count,
    })
}

struct BatchNormOp {
    eps: f64,
    relu: bool,
    /// What the forward pass leaves for the backward pass.
    saved: Arc<OnceLock<Saved>>,
}

struct Saved {
    moments: Moments,
    norm: Norm,
}

impl CustomOp3 for BatchNormOp {
    fn name(&self) -> &'static str {
        "channels-last batch norm"
    }

    fn cpu_fwd(
        &self,
        x: &CpuStorage,
        x_layout: &Layout,
        gamma: &CpuStorage,
        gamma_layout: &Layout,
        beta: &CpuStorage,
        beta_layout: &Layout,
    ) -> Result<(CpuStorage, Shape)> {
        let Some(grid) = grid(x_layout.dims()) else {
            bail!("batch norm of {:?}", x_layout.dims())
        };
        let level = Level::detect();
        let x = values(x, x_layout)?;
        let moments = Moments::of(level, x, &grid);
        let (gamma, beta) = (values(gamma, gamma_layout)?, values(beta, beta_layout)?);
        let norm = Norm::new(&moments, gamma, beta, self.eps);
        let mut y = vec![0.0; grid.len()];
        norm.apply(level, x, (&mut y, &grid), self.relu);
        self.saved.get_or_init(|| Saved { moments, norm });
        Ok((CpuStorage::F32(y), x_layout.shape().clone()))
    }

    fn bwd(
        &self,
        x: &Tensor,
        gamma: &Tensor,
        beta: &Tensor,
        _: &Tensor,
        gradient: &Tensor,
    ) -> Result<(Option<Tensor>, Option<Tensor>, Option<Tensor>)> {
        let (Some(grid), Some(Saved { moments, norm })) = (grid(x.dims()), self.saved.get()) else {
            bail!("batch norm has not run forward")
        };
        let level = Level::detect();
        let mut dx = vec![0.0; grid.len()];
        let gradients = with_values(x, |x| {
            with_values(gradient, |gradient| {
                let sums = norm.sums(level, x, gradient, &grid, self.relu);
                let sums = sums.over_frames(grid.channels);
                let gradients = NormGradients::new(norm, moments.count, &sums);
                let slopes = &gradients.slopes;
                norm.backward(level, slopes, x, gradient, (&mut dx, &grid), self.relu);
                Ok(gradients)
            })
        })?;
        let device = x.device();
        Ok((
            Some(Tensor::from_vec(dx, x.dims(), device)?),
            Some(Tensor::from_vec(gradients.gamma, gamma.dims(), device)?),
            Some(Tensor::from_vec(gradients.beta, beta.dims(), device)?),
        ))
    }
}

use candle_core::{Result, bail};

use super::Gradient;

/// Adds, for each trial, the squared norm of its part of `gradient`, f32, to `sums`.
///
/// In f64: the square of 1e30 is beyond f32, and a sum that has overflowed would scale every
/// gradient to zero.
/// Refuses a gradient that does not divide into as many trials as `sums` has.
pub(crate) fn squared_norms(gradient: &impl Gradient, sums: &mut [f64]) -> Result<()> {
    gradient.read(|elements: &[f32]| {
        let (found, trials) = (elements.len(), sums.len());
        let trial = found / trials.max(1);
        if trial == 0 || trial * trials != found {
            bail!("a gradient of {found} elements for {trials} trials")
        }
        for (sum, trial) in sums.iter_mut().zip(elements.chunks_exact(trial)) {
            let squares = trial.iter().map(|&g| f64::from(g)).map(|g| g * g);
            *sum += squares.sum::<f64>();
        }
        Ok(())
    })
}

/// The factor that brings each gradient's norm down to `largest`; 1 where it is not above.
///
/// `norm` itself is scaled out, without PyTorch's 1e-6 in the denominator.
pub(crate) fn clip_scales(squared_norms: &[f64], largest: f64) -> Vec<f64> {
    let norms = squared_norms.iter().map(|square| square.sqrt());
    let scales = norms.map(|norm| if norm > largest { largest / norm } else { 1.0 });
    scales.collect()
}

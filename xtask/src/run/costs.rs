//! What one estimate costs, measured without the cache.

use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Instant;

use anyhow::Result;
use candle_core::{Device, Tensor};
use sps_dataset::{Frame, FrameKey, RollAngle, Source, Split, Surface, TactileTable};
use sps_models::Embeddings;

use super::Stage;
use super::fit::fit;
use super::trials::{TrialSpec, plan};
use crate::config::{Estimator, Method};
use crate::results::Costs;

/// Surfaces that the costs are measured on.
const SURFACES: usize = 8;

/// Estimates all properties of some held-out surfaces one by one, from the frame on.
///
/// The time does not depend on what the weights are, so a model of the method's shape is fitted to
/// a few surfaces for it: the run's own models need not be kept.
pub(crate) fn measure<S: Source>(
    source: &S,
    stage: &Stage,
    method: &Method,
    split: &Split,
    trials: &[TrialSpec],
) -> Result<Costs> {
    let Stage {
        embedder, tables, ..
    } = stage;
    let few = Split {
        train: split.train.iter().copied().take(2 * SURFACES).collect(),
        validation: split.validation.iter().copied().take(SURFACES).collect(),
    };
    let measured = |trial: &&TrialSpec| {
        let column = tables.readings.column(trial.property.code());
        let reading = |&s: &usize| tables.readings.get(s, column?);
        trial.rerun == 0 && few.train.iter().any(|s| reading(s).is_some())
    };
    let plan = plan(
        0,
        std::slice::from_ref(&few),
        trials.iter().filter(measured),
    );
    let model = fit(&quick(method)?, tables, &plan, &())?;
    let counted = Counted::new(source);
    let estimate = |surface: usize| -> Result<usize> {
        let frames = tables
            .views
            .iter()
            .map(|&view| counted.frame(surface, view))
            .collect::<Result<Vec<Frame>, _>>()?;
        let values = embedder.embed(&frames)?;
        let shape = (1, frames.len(), embedder.width());
        let tensor = Tensor::from_vec(values, shape, &Device::Cpu)?;
        model.predict(&Embeddings::new(&tensor)?)?;
        Ok(frames.len())
    };
    if let Some(&first) = few.validation.first() {
        // Memory and caches made ready, so that the first method pays no more than the others.
        estimate(first)?;
        counted.frames.store(0, Ordering::Relaxed);
    }
    let mut encoded = 0;
    let mut seconds = Vec::new();
    for &surface in &few.validation {
        let start = Instant::now();
        encoded += estimate(surface)?;
        seconds.push(start.elapsed().as_secs_f64());
    }
    seconds.sort_by(f64::total_cmp);
    let surfaces = few.validation.len().max(1) as f64;
    Ok(Costs {
        frames_decoded: counted.frames.load(Ordering::Relaxed) as f64 / surfaces,
        frames_encoded: encoded as f64 / surfaces,
        seconds: seconds.get(seconds.len() / 2).copied(),
    })
}

/// The method, trained for one epoch.
fn quick(method: &Method) -> Result<Method> {
    let mut method = method.clone();
    if let Estimator::Head(head) = &mut method.estimator {
        let mut config = head.config().clone();
        config.epochs = 1;
        *head = sps_models::heads::Head::new(config)?;
    }
    Ok(method)
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

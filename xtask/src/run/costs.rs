//! What one estimate costs, measured without the cache.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Instant;

use anyhow::Result;
use candle_core::{Device, Tensor};
use sps_dataset::{Frame, FrameKey, RollAngle, Source, Split, Surface, TactileTable};
use sps_models::Embeddings;

use super::Stage;
use super::fit::{Fitted, fit};
use super::trials::{TrialSpec, plan};
use crate::config::{self, Method};
use crate::results::Costs;

/// Surfaces that the costs are measured on, all groups of properties together.
const SURFACES: usize = 8;
/// Surfaces that they are measured on at least in each group.
const FEWEST: usize = 2;

/// Estimates properties of some held-out surfaces one by one, from the frame on: those together
/// that look at the same views.
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
    let few = Split {
        train: split.train.iter().copied().take(2 * SURFACES).collect(),
        validation: split.validation.iter().copied().take(SURFACES).collect(),
    };
    let readings = &stage.tables.readings;
    let measured = |trial: &&TrialSpec| {
        let column = readings.column(trial.property.code());
        let reading = |&s: &usize| readings.get(s, column?);
        trial.rerun == 0 && few.train.iter().any(|s| reading(s).is_some())
    };
    let mut groups: BTreeMap<&[Vec<usize>], Vec<&TrialSpec>> = BTreeMap::new();
    for trial in trials.iter().filter(measured) {
        groups.entry(&trial.views.fillings).or_default().push(trial);
    }
    let each = (SURFACES / groups.len().max(1)).max(FEWEST);
    let surfaces = few.validation.len().min(each);
    let counted = Counted::new(source);
    let quick = quick(method)?;
    let mut seconds = Vec::new();
    let mut encoded = 0;
    for (fillings, trials) in &groups {
        let plan = plan(0, std::slice::from_ref(&few), trials.iter().copied());
        let estimator = Estimator {
            source: &counted,
            stage,
            model: fit(&quick, &stage.tables, &plan, &())?,
            fillings,
        };
        let surfaces = &few.validation[..surfaces];
        if seconds.is_empty() {
            // Memory made ready and simulated surfaces built, so that the first method pays no
            // more than the others.
            for &surface in surfaces {
                estimator.estimate(surface)?;
            }
            counted.frames.store(0, Ordering::Relaxed);
        }
        for &surface in surfaces {
            let start = Instant::now();
            encoded += estimator.estimate(surface)?;
            seconds.push(start.elapsed().as_secs_f64());
        }
    }
    seconds.sort_by(f64::total_cmp);
    let estimates = seconds.len().max(1) as f64;
    Ok(Costs {
        frames_decoded: counted.frames.load(Ordering::Relaxed) as f64 / estimates,
        frames_encoded: encoded as f64 / estimates,
        seconds: seconds.get(seconds.len() / 2).copied(),
    })
}

/// A model with all that it needs to estimate from frames.
struct Estimator<'a, S> {
    source: &'a Counted<'a, S>,
    stage: &'a Stage,
    model: Fitted,
    fillings: &'a [Vec<usize>],
}

impl<S: Source> Estimator<'_, S> {
    /// Estimates one surface; how many frames were encoded for it.
    fn estimate(&self, surface: usize) -> Result<usize> {
        let Stage {
            embedder, tables, ..
        } = self.stage;
        let views: BTreeSet<usize> = self.fillings.iter().flatten().copied().collect();
        let views: Vec<usize> = views.into_iter().collect();
        let frames = views
            .iter()
            .map(|&view| self.source.frame(surface, tables.views[view]))
            .collect::<Result<Vec<Frame>, _>>()?;
        let values = embedder.embed(&frames)?;
        let shape = (1, frames.len(), embedder.width());
        let embeddings = Embeddings::new(&Tensor::from_vec(values, shape, &Device::Cpu)?)?;
        for filling in self.fillings {
            let slots = filling
                .iter()
                .filter_map(|view| views.binary_search(view).ok());
            let slots: Vec<usize> = slots.collect();
            self.model.predict(&embeddings.select(&[0], &slots)?)?;
        }
        Ok(frames.len())
    }
}

/// The method, trained for one epoch.
fn quick(method: &Method) -> Result<Method> {
    let mut method = method.clone();
    if let config::Estimator::Head(head) = &mut method.estimator {
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

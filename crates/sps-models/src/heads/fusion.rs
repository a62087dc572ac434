//! The loss of many sets of views at once, for a late fusion that is trained and frozen.

// The kernel is compiled with its level's instructions only if all of it is inlined.
#![allow(clippy::inline_always)]

use faer::{Accum, MatMut, MatRef};
use sps_base::{Unexpected, parallel};
use sps_kernels::simd::{Kernel, Lanes, Level};
use sps_regress::dense::multiply;
use sps_regress::{Embeddings, TrainingData, Trial, check_indices};

use super::config::{Input, Model};
use super::trained::{TrainedHead, TrainedHeads};
use crate::error::{Error, Result};

/// Surfaces that lie side by side in memory.
const TILE: usize = 16;
/// Sets that are computed together where they share all views but the last.
const TOGETHER: usize = 4;

/// The loss of any ordered set of views for one trained late fusion.
///
/// Up to its rectifier the network is linear in each slot's embedding (paper, section 4.2: the
/// fusion layer; and the generator's first layer behind it, for nothing stands between the two).
/// So the term of every slot, view and surface is computed once, and a set costs one addition per
/// slot, a rectifier and a dot product: `t = b + w · max(0, sum_m term(m, view_m))`.
///
/// Memory: 4 bytes for each of slots x views x surfaces x hidden units.
#[derive(Clone, Debug)]
pub struct FusionLoss {
    slots: usize,
    views: usize,
    surfaces: usize,
    level: Level,
    /// `(slots, tiles, views, units, TILE)`; lanes beyond the last surface are zero throughout.
    terms: Vec<f32>,
    /// Weights of the units, `(units)`.
    output: Vec<f32>,
    /// What the estimate lacks to be the error: bias less reading, standardised, `(tiles, TILE)`.
    offsets: Vec<f32>,
}

impl FusionLoss {
    /// Slots of the fusion layer: views in a set.
    pub fn slots(&self) -> usize {
        self.slots
    }

    /// Views that may fill a slot.
    pub fn views(&self) -> usize {
        self.views
    }

    /// Surfaces that the loss is a mean over: those asked for that have a reading.
    pub fn surfaces(&self) -> usize {
        self.surfaces
    }

    /// Writes the mean squared error of the estimates for each set, in units of the variance of
    /// the head's training readings.
    ///
    /// `sets` is `(sets, slots)`, row-major. Sets that follow one another and differ in the last
    /// view alone share the sum over the others. A set's loss has the same bits whichever sets
    /// stand beside it.
    ///
    /// # Errors
    /// Not one loss per set, or a view that is not there.
    pub fn losses(&self, sets: &[usize], losses: &mut [f64]) -> Result<()> {
        if sets.len() != losses.len() * self.slots {
            let found = format_args!("{} views for {} losses", sets.len(), losses.len());
            let expected = format_args!("{} views per set", self.slots);
            return Err(Error::input("sets of views", found, expected));
        }
        check_indices("view of a set", sets, self.views)?;
        let mut squares = vec![[0.0; TILE]; losses.len()];
        self.level.run(Errors {
            of: self,
            sets,
            squares: &mut squares,
        });
        for (loss, squares) in losses.iter_mut().zip(&squares) {
            let sum: f64 = squares.iter().map(|&square| f64::from(square)).sum();
            *loss = sum / self.surfaces as f64;
        }
        Ok(())
    }

    fn units(&self) -> usize {
        self.output.len()
    }

    fn tiles(&self) -> usize {
        self.offsets.len() / TILE
    }

    /// The terms of one slot, tile and view, `(units, TILE)`.
    #[inline(always)]
    fn term(&self, slot: usize, tile: usize, view: usize) -> &[f32] {
        let at = (slot * self.tiles() + tile) * self.views + view;
        &self.terms[at * self.units() * TILE..][..self.units() * TILE]
    }
}

/// Adds up the squared errors of each set, lane by lane.
struct Errors<'a> {
    of: &'a FusionLoss,
    sets: &'a [usize],
    squares: &'a mut [[f32; TILE]],
}

impl Kernel for Errors<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Lanes>(mut self, lanes: S) {
        let mut shared = vec![0.0; self.of.units() * TILE];
        for tile in 0..self.of.tiles() {
            let mut start = 0;
            while start < self.squares.len() {
                let end = self.end_of_run(start);
                self.sum_shared(tile, start, &mut shared);
                while start + TOGETHER <= end {
                    self.add::<S, TOGETHER>(lanes, tile, start, &shared);
                    start += TOGETHER;
                }
                while start < end {
                    self.add::<S, 1>(lanes, tile, start, &shared);
                    start += 1;
                }
            }
        }
    }
}

impl Errors<'_> {
    #[inline(always)]
    fn set(&self, index: usize) -> &[usize] {
        &self.sets[index * self.of.slots..][..self.of.slots]
    }

    /// One past the last set that shares all views but the last with set `start`.
    #[inline(always)]
    fn end_of_run(&self, start: usize) -> usize {
        let last = self.of.slots - 1;
        let first = &self.set(start)[..last];
        let mut end = start + 1;
        while end < self.squares.len() && &self.set(end)[..last] == first {
            end += 1;
        }
        end
    }

    /// The sum of the terms of all slots but the last, in the order of the slots.
    #[inline(always)]
    fn sum_shared(&self, tile: usize, set: usize, shared: &mut [f32]) {
        shared.fill(0.0);
        let views = &self.set(set)[..self.of.slots - 1];
        for (slot, &view) in views.iter().enumerate() {
            for (sum, term) in shared.iter_mut().zip(self.of.term(slot, tile, view)) {
                *sum += term;
            }
        }
    }

    /// The squared errors of `K` sets from `start` on, which share `shared`.
    #[inline(always)]
    fn add<S: Lanes, const K: usize>(
        &mut self,
        lanes: S,
        tile: usize,
        start: usize,
        shared: &[f32],
    ) {
        let of = self.of;
        let last = of.slots - 1;
        let terms: [&[f32]; K] = std::array::from_fn(|k| {
            let view = self.sets[(start + k) * of.slots + last];
            of.term(last, tile, view)
        });
        let terms = terms.map(|term| S::as_simd_f32s(term).0);
        let shared = S::as_simd_f32s(shared).0;
        let offsets = S::as_simd_f32s(&of.offsets[tile * TILE..][..TILE]).0;
        let zero = lanes.splat_f32s(0.0);
        let vectors = TILE / S::F32_LANES;
        for at in 0..vectors {
            let mut estimates = [offsets[at]; K];
            for (unit, &weight) in of.output.iter().enumerate() {
                let weight = lanes.splat_f32s(weight);
                let here = unit * vectors + at;
                for (estimate, term) in estimates.iter_mut().zip(&terms) {
                    let sum = lanes.add_f32s(shared[here], term[here]);
                    *estimate = lanes.fma(weight, lanes.at_least(zero, sum), *estimate);
                }
            }
            for (k, &error) in estimates.iter().enumerate() {
                let squares = S::as_mut_simd_f32s(&mut self.squares[start + k]).0;
                squares[at] = lanes.fma(error, error, squares[at]);
            }
        }
    }
}

impl TrainedHeads {
    /// The loss of sets of views for the head that was trained for `trial`, over those of
    /// `surfaces` that have a reading of its property.
    ///
    /// # Errors
    /// No head for the trial, a head that is no late fusion, tables that do not fit it, a surface
    /// that is not there, or none with a reading.
    pub fn fusion_loss(
        &self,
        trial: &Trial,
        data: &TrainingData<'_>,
        surfaces: &[usize],
    ) -> Result<FusionLoss> {
        let wrong = |found: String, expected: &str| {
            let what = format!("views of {}, rerun {}", trial.property, trial.rerun);
            Err(sps_regress::Error::Plan(Unexpected::new(what, found, expected)).into())
        };
        let Some(head) = self.heads.iter().find(|head| &head.trial == trial) else {
            return wrong("no head".into(), "a trained one");
        };
        let config = self.head.config();
        if !matches!(config.input, Input::LateFusion { .. } | Input::Single {}) {
            return wrong(format!("input {:?}", config.input), "late fusion");
        }
        let (found, expected) = (data.embeddings.width(), head.dims.width);
        if found != expected {
            let [found, expected] = [found, expected].map(|width| format!("width {width}"));
            return Err(Error::input("embeddings of sets of views", found, expected));
        }
        check_indices("surface", surfaces, data.embeddings.surfaces())?;
        let column = data.readings.column(&trial.property);
        let reading = |&surface: &usize| Some((surface, data.readings.get(surface, column?)?));
        let measured: Vec<(usize, f64)> = surfaces.iter().filter_map(reading).collect();
        if measured.is_empty() {
            return wrong("no reading".into(), "at least one");
        }
        let affine = Affine::of(head, &config.model)?;
        let mut offsets = vec![0.0; measured.len().next_multiple_of(TILE)];
        for (offset, &(_, reading)) in offsets.iter_mut().zip(&measured) {
            *offset = (f64::from(affine.output_bias) - head.target.standardise(reading)) as f32;
        }
        let surfaces: Vec<usize> = measured.iter().map(|&(surface, _)| surface).collect();
        Ok(FusionLoss {
            slots: head.dims.slots,
            views: data.embeddings.views(),
            surfaces: measured.len(),
            level: Level::detect(),
            terms: terms(head, &affine, data.embeddings, &surfaces),
            output: affine.output,
            offsets,
        })
    }
}

/// The terms of every slot, tile and view; see [`FusionLoss::terms`].
fn terms(
    head: &TrainedHead,
    affine: &Affine,
    embeddings: &Embeddings,
    surfaces: &[usize],
) -> Vec<f32> {
    let (units, slots) = (affine.output.len(), head.dims.slots);
    let (views, tiles) = (embeddings.views(), surfaces.len().div_ceil(TILE));
    // Of each view, `(slots x units, surfaces)`.
    let of_views: Vec<Vec<f32>> = parallel::map(0..views, |view| {
        let mut rows = Vec::with_capacity(surfaces.len() * head.dims.width);
        for &surface in surfaces {
            let features = embeddings.get(surface, view).unwrap_or_default();
            head.statistics.push(features, &mut rows);
        }
        let mut out = vec![0.0; slots * units * surfaces.len()];
        multiply(
            MatMut::from_row_major_slice_mut(&mut out, slots * units, surfaces.len()),
            Accum::Replace,
            MatRef::from_row_major_slice(&affine.weight, slots * units, head.dims.width),
            MatRef::from_row_major_slice(&rows, surfaces.len(), head.dims.width).transpose(),
        );
        out
    });
    let mut terms = vec![0.0; slots * tiles * views * units * TILE];
    let lanes = terms.chunks_exact_mut(TILE).enumerate();
    for (at, lanes) in lanes {
        let (at, unit) = (at / units, at % units);
        let (at, view) = (at / views, at % views);
        let (slot, tile) = (at / tiles, at % tiles);
        let row = &of_views[view][(slot * units + unit) * surfaces.len()..][..surfaces.len()];
        let bias = if slot == 0 { affine.bias[unit] } else { 0.0 };
        for (lane, value) in lanes.iter_mut().zip(&row[tile * TILE..]) {
            *lane = value + bias;
        }
    }
    terms
}

/// A head as one affine map to rectified units and their weighted sum.
struct Affine {
    /// `(slots, units, width)`.
    weight: Vec<f32>,
    /// `(units)`.
    bias: Vec<f32>,
    /// `(units)`.
    output: Vec<f32>,
    output_bias: f32,
}

impl Affine {
    fn of(head: &TrainedHead, model: &Model) -> Result<Self> {
        let values = |name: &str| -> Result<Vec<f32>> {
            Ok(head.parameters.get(name)?.flatten_all()?.to_vec1()?)
        };
        match model {
            Model::Regression {} => {
                // The positive and the negative part of the value.
                let weight = values("value.weight")?.into_iter().map(f64::from);
                let both: Vec<f64> = weight.flat_map(|w| [w, -w]).collect();
                Ok(Self {
                    weight: by_slot(&both, head.dims.width, 2),
                    bias: vec![0.0; 2],
                    output: vec![1.0, -1.0],
                    output_bias: values("value.bias")?[0],
                })
            }
            Model::CrossModal(model) => {
                let hidden = values("generator.hidden.weight")?;
                let (latent, units) = (model.latent, model.hidden);
                let weight = product(&values("visual.weight")?, &hidden, latent, units);
                let through = product(&values("visual.bias")?, &hidden, latent, units);
                let bias = through.iter().zip(values("generator.hidden.bias")?);
                let bias = bias.map(|(t, b)| (t + f64::from(b)) as f32);
                Ok(Self {
                    weight: by_slot(&weight, head.dims.width, units),
                    bias: bias.collect(),
                    output: values("generator.output.weight")?,
                    output_bias: values("generator.output.bias")?[0],
                })
            }
        }
    }
}

/// `(rows, inner) (inner, columns)`, in f64.
fn product(left: &[f32], right: &[f32], inner: usize, columns: usize) -> Vec<f64> {
    let mut out = vec![0.0; left.len() / inner * columns];
    for (row, out) in left.chunks_exact(inner).zip(out.chunks_exact_mut(columns)) {
        for (&x, right) in row.iter().zip(right.chunks_exact(columns)) {
            for (sum, &y) in out.iter_mut().zip(right) {
                *sum += f64::from(x) * f64::from(y);
            }
        }
    }
    out
}

/// From `(slots x width, units)` to `(slots, units, width)`.
fn by_slot(weight: &[f64], width: usize, units: usize) -> Vec<f32> {
    let slots = weight.chunks_exact(width * units);
    slots
        .flat_map(|slot| {
            (0..units).flat_map(move |unit| (0..width).map(move |f| slot[f * units + unit] as f32))
        })
        .collect()
}

//! The known limit: how well a perfect reader of images could do.

use std::collections::BTreeMap;

use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use sps_dataset::toccare;

use super::latent::{Reader, Scores};
use super::parameters::Specimen;
use super::stream::{Purpose, Stream};
use super::touch::{self, Values};

/// The limit of one property.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub struct Ceiling {
    /// Coefficient of determination of the best estimate from one view at nadir.
    pub nadir: f64,
    /// Its standard error.
    pub nadir_error: f64,
    /// Coefficient of determination of the best estimate from all views.
    pub all: f64,
    /// Its standard error.
    pub all_error: f64,
}

/// The limits of all fifteen properties.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub struct Ceilings {
    /// Simulated surfaces that they were measured on.
    pub surfaces: usize,
    /// Places at which each surface was touched.
    pub locations: u32,
    /// The limit of each property, by the paper's acronym.
    pub properties: BTreeMap<String, Ceiling>,
}

/// Measures the limits by Monte Carlo on `surfaces` surfaces, each touched at `locations` places.
///
/// With `x` all that images show of a surface and `t` a value of touch, no estimate from images
/// does better than `E[t | x]`, whose coefficient of determination is `Var(E[t | x]) / Var(t)`.
/// For two draws `t`, `t'` that share `x` and are otherwise independent, `Cov(t, t')` is
/// `Var(E[t | x])` (Sobol, Math. Comput. Simul. 55, 2001). `x` holds the material and what the table
/// in `docs/simulator.md` says. Errors are from the spread over 20 batches; the two limits of a
/// property share their draws, so their difference is more certain than either.
pub fn ceilings(seed: u64, surfaces: usize, locations: u32) -> Ceilings {
    const BATCHES: usize = 20;
    let per_batch = surfaces.div_ceil(BATCHES).max(2);
    let batches = (0..BATCHES).into_par_iter().map(|batch| {
        let first = batch * per_batch;
        batch_ratios(seed, first..first + per_batch, locations.max(1))
    });
    let batches: Vec<[[f64; 15]; 2]> = batches.collect();
    let properties = toccare::ALL.into_iter().enumerate().map(|(i, property)| {
        let (nadir, nadir_error) = mean_and_error(batches.iter().map(|b| b[0][i]));
        let (all, all_error) = mean_and_error(batches.iter().map(|b| b[1][i]));
        let ceiling = Ceiling {
            nadir,
            nadir_error,
            all,
            all_error,
        };
        (property.code.to_owned(), ceiling)
    });
    Ceilings {
        surfaces: per_batch * BATCHES,
        locations,
        properties: properties.collect(),
    }
}

/// `Cov(t, t') / Var(t)` for one view and for all views.
fn batch_ratios(seed: u64, range: std::ops::Range<usize>, locations: u32) -> [[f64; 15]; 2] {
    let triples: Vec<[Values; 3]> = range
        .map(|index| {
            let specimen = Specimen::draw(seed, index);
            // Both readers are asked about the same other surface, touched at the same places of its
            // own: what the second sees beyond the first is all that differs.
            let other =
                Scores::draw_own(&mut Stream::new(seed, Purpose::REDRAW, &[specimen.index]));
            let touched = |own: &Scores, visit: u64| {
                let places = u64::from(locations);
                touch::mean_values(&specimen, own, visit * places..(visit + 1) * places)
            };
            let redrawn = |reader| touched(&specimen.own.redrawn(&other, reader), 1);
            [
                touched(&specimen.own, 0),
                redrawn(Reader::OneView),
                redrawn(Reader::AllViews),
            ]
        })
        .collect();
    [1, 2].map(|column| {
        std::array::from_fn(|i| {
            let pairs = triples.iter().map(|t| (t[0][i], t[column][i]));
            covariance_ratio(pairs)
        })
    })
}

fn covariance_ratio(pairs: impl Iterator<Item = (f64, f64)> + Clone) -> f64 {
    let count = pairs.clone().count() as f64;
    let mean = pairs.clone().map(|(a, b)| 0.5 * (a + b)).sum::<f64>() / count;
    let covariance: f64 = pairs.clone().map(|(a, b)| (a - mean) * (b - mean)).sum();
    let squares = pairs.map(|(a, b)| 0.5 * ((a - mean) * (a - mean) + (b - mean) * (b - mean)));
    covariance / squares.sum::<f64>()
}

fn mean_and_error(values: impl ExactSizeIterator<Item = f64> + Clone) -> (f64, f64) {
    let count = values.len() as f64;
    let mean = values.clone().sum::<f64>() / count;
    let variance = values.map(|v| (v - mean) * (v - mean)).sum::<f64>() / (count - 1.0);
    (mean, (variance / count).sqrt())
}

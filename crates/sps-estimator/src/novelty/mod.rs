//! Whether a photograph is like those that a model was fitted on.

use std::collections::HashMap;
use std::ops::Range;

use safetensors::tensor::{Dtype, SafeTensors, TensorView};
use sps_base::parallel;
use sps_regress::Embeddings;
use sps_regress::nearest::squared_distance;

use crate::error::{Error, Result, refuse};

/// Neighbours that a distance is the mean over.
const NEIGHBOURS: usize = 5;

/// The least mark of a surface that was kept aside to calibrate; a surface that was fitted to has 0.
const ASIDE: f32 = 1.0;

/// The mark of one of each unit of those kept aside.
const ONE_OF_UNIT: f32 = 2.0;

/// A surface that a model was fitted on, for people to look at.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Shown {
    /// What the dataset calls it.
    pub name: String,
    /// A small PNG of it; empty where none is kept.
    pub photograph: Vec<u8>,
}

/// In the file's header, the names of the surfaces as a JSON list.
const NAMES: &str = "surfaces";

/// Surfaces that others are held against.
///
/// The score of a surface is the mean of its five smallest Euclidean distances to the others, between
/// embeddings each block of which is brought to unit length, of several views side by side. The p-value
/// of a new surface is the share of all surfaces, the new one among them, whose score is at least as large, each scored
/// among all others: full conformal prediction (Vovk, Gammerman and Shafer, "Algorithmic Learning in
/// a Random World", 2005, section 2.2) with a distance to neighbours for the measure of strangeness.
/// Where the new surface and those fitted on are exchangeable, a p-value of at most q comes up with a
/// probability of at most q, whatever the distribution.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Familiar {
    surfaces: usize,
    views: usize,
    width: usize,
    /// `(surfaces, views, width)`; each block of each view of unit length.
    units: Vec<f32>,
    /// The place of each among the surfaces that were handed to the fit; none once it is read from a file.
    pub places: Vec<usize>,
    /// What is known of each for people; nothing of models that were fitted to bare numbers.
    pub shown: Vec<Shown>,
    /// The mark of each. New surfaces are watched by those that were kept aside; by none where the encoder learned from
    /// the others.
    marks: Vec<f32>,
    /// For each number of views asked with, the smallest squared distances of each surface to others,
    /// ascending, `(surfaces, neighbours)`.
    nearest: Vec<(usize, Vec<f32>)>,
}

impl Familiar {
    /// Keeps surfaces, `(surfaces, views, width)`, to be held against by their first so many views, for
    /// each of `steps`; a reason where there are not two surfaces.
    pub(crate) fn of(embeddings: &Embeddings, steps: &[usize]) -> Result<Self, String> {
        let (surfaces, views) = (embeddings.surfaces(), embeddings.views());
        if surfaces < 2 {
            return Err(format!(
                "found {surfaces} surface to hold photographs against, expected at least 2"
            ));
        }
        let mut familiar = Self {
            surfaces,
            views,
            width: embeddings.width(),
            units: units(embeddings),
            places: Vec::new(),
            shown: Vec::new(),
            marks: vec![0.0; surfaces],
            nearest: Vec::new(),
        };
        for &step in steps {
            let of_surface = |at: usize| {
                let one = &familiar.surface(at)[..step * familiar.width];
                let others = familiar.distances(one).enumerate();
                let others = others.filter(|(other, _)| *other != at);
                smallest(others.map(|(_, distance)| distance))
            };
            let nearest = parallel::map(0..surfaces, of_surface).concat();
            familiar.nearest.push((step, nearest));
        }
        Ok(familiar)
    }

    /// The same, with the place of each surface among those that were handed to the fit. Of these, `aside` were kept
    /// aside to calibrate; `one_of_each` has one of each unit of them.
    pub(crate) fn at(self, places: Vec<usize>, aside: &[usize], one_of_each: &[usize]) -> Self {
        let among = |some: &[usize], place| f32::from(some.contains(place));
        let marks = places.iter();
        let marks = marks.map(|place| among(aside, place) + among(one_of_each, place));
        Self {
            marks: marks.collect(),
            places,
            ..self
        }
    }

    /// The p-value of each surface, `(surfaces, views, width)`: how likely it is that one like those
    /// fitted on lies as far from them.
    ///
    /// # Errors
    /// Embeddings of another width, or of a number of views that was not fitted.
    pub(crate) fn p_values(&self, embeddings: &Embeddings) -> Result<Vec<f64>> {
        let (views, width) = (embeddings.views(), embeddings.width());
        let mut steps = self.nearest.iter();
        let step = steps.find(|(step, _)| (*step, self.width) == (views, width));
        let Some((step, nearest)) = step else {
            let found = format!("{views} views of width {width}");
            let expected = format!("{} of width {}", self.views, self.width);
            return refuse("embeddings to hold against others", found, expected);
        };
        let known = nearest.chunks_exact(self.neighbours());
        let known = known.map(|nearest| (nearest, mean(nearest.iter().copied())));
        let known: Vec<(&[f32], f64)> = known.collect();
        let new = units(embeddings);
        let new = new.chunks_exact(step * self.width);
        Ok(parallel::map(new, |new| self.p_value(new, &known)))
    }

    /// `known` has the smallest squared distances of each surface to others, and its score among these alone.
    fn p_value(&self, new: &[f32], known: &[(&[f32], f64)]) -> f64 {
        let neighbours = self.neighbours();
        let distances: Vec<f32> = self.distances(new).collect();
        let of_new = smallest(distances.iter().copied());
        // One more than the others have, with only two surfaces: scores go by as many.
        let score = mean(of_new.into_iter().take(neighbours));
        let others = distances.iter().zip(known);
        let strange = others.filter(|&(&distance, &(nearest, alone))| {
            // No nearer than its neighbours, the new surface is none of them.
            if nearest.last().is_none_or(|furthest| distance >= *furthest) {
                return alone >= score;
            }
            let with_new = nearest.iter().copied().chain([distance]);
            mean(smallest(with_new).into_iter().take(neighbours)) >= score
        });
        (1 + strange.count()) as f64 / (self.surfaces + 1) as f64
    }

    /// The surfaces nearest to one that some of the embeddings are of, and how far they are on average,
    /// nearest first.
    pub(crate) fn nearest(&self, embeddings: &Embeddings, of: Range<usize>) -> Vec<(usize, f64)> {
        let looks = of.len() as f64;
        let mut distances = vec![0.0; self.surfaces];
        for look in of {
            let look = units_of(embeddings, look);
            for (sum, square) in distances.iter_mut().zip(self.distances(&look)) {
                *sum += f64::from(square).sqrt() / looks;
            }
        }
        let mut nearest: Vec<(usize, f64)> = distances.into_iter().enumerate().collect();
        nearest.sort_by(|a, b| a.1.total_cmp(&b.1));
        nearest.truncate(NEIGHBOURS);
        nearest
    }

    /// How far one surface of each unit that was kept aside lies from those fitted to, by all views; none
    /// where there are not both.
    pub(crate) fn scores_aside(&self) -> Vec<f64> {
        if self.marks.iter().all(|mark| *mark >= ASIDE) {
            return Vec::new();
        }
        let aside = (0..self.surfaces).filter(|&at| self.marks[at] >= ONE_OF_UNIT);
        parallel::map(aside, |at| self.score_of(self.surface(at)))
    }

    /// How far a surface, `(1, views, width)`, lies from those fitted to.
    pub(crate) fn score(&self, embeddings: &Embeddings) -> f64 {
        self.score_of(&units(embeddings))
    }

    fn score_of(&self, one: &[f32]) -> f64 {
        let fitted = self.distances(one).enumerate();
        let fitted = fitted.filter(|(at, _)| self.marks[*at] < ASIDE);
        mean(smallest(fitted.map(|(_, distance)| distance)).into_iter())
    }

    fn neighbours(&self) -> usize {
        NEIGHBOURS.min(self.surfaces - 1)
    }

    fn surface(&self, at: usize) -> &[f32] {
        let length = self.views * self.width;
        &self.units[at * length..][..length]
    }

    /// The squared distances of one surface's first views to those of all.
    fn distances(&self, one: &[f32]) -> impl Iterator<Item = f32> {
        let all = self.units.chunks_exact(self.views * self.width);
        all.map(|other| squared_distance(one, &other[..one.len()]))
    }

    /// A safetensors file: `units`, `nearest.M` for each number of views M, `aside`, the mark of each surface,
    /// and `photograph.N` of the Nth of [`NAMES`].
    pub(crate) fn to_bytes(&self) -> Result<Vec<u8>> {
        let of_numbers = |name: String, shape: &[usize], values: &[f32]| {
            let bytes = values.iter().flat_map(|value| value.to_le_bytes());
            (name, Dtype::F32, shape.to_vec(), bytes.collect::<Vec<u8>>())
        };
        let shape = [self.surfaces, self.views, self.width];
        let mut tensors = vec![
            of_numbers("units".to_owned(), &shape, &self.units),
            of_numbers("aside".to_owned(), &shape[..1], &self.marks),
        ];
        for (step, nearest) in &self.nearest {
            let shape = [self.surfaces, self.neighbours()];
            tensors.push(of_numbers(format!("nearest.{step}"), &shape, nearest));
        }
        for (at, shown) in self.shown.iter().enumerate() {
            let (name, bytes) = (format!("photograph.{at}"), shown.photograph.clone());
            tensors.push((name, Dtype::U8, vec![bytes.len()], bytes));
        }
        let refused = |error| Error::input("surfaces to hold against", error, "tensors");
        let all = tensors.iter().map(|(name, dtype, shape, bytes)| {
            Ok((name, TensorView::new(*dtype, shape.clone(), bytes)?))
        });
        let all = all.collect::<Result<Vec<_>, _>>();
        let names: Vec<&str> = self.shown.iter().map(|shown| shown.name.as_str()).collect();
        let names = serde_json::to_string(&names).unwrap_or_default();
        let header = HashMap::from([(NAMES.to_owned(), names)]);
        safetensors::serialize(all.map_err(refused)?, Some(header)).map_err(refused)
    }

    /// Reads what [`Familiar::to_bytes`] wrote; a reason where it is none.
    pub(crate) fn from_bytes(bytes: &[u8]) -> Result<Self, String> {
        let tensors = SafeTensors::deserialize(bytes).map_err(|error| error.to_string())?;
        let tensor = |name: &str| {
            let tensor = tensors.tensor(name).map_err(|error| error.to_string())?;
            if tensor.dtype() != Dtype::F32 {
                return Err(format!("{name} is of {:?}, expected F32", tensor.dtype()));
            }
            let values = tensor.data().as_chunks().0;
            let values: Vec<f32> = values.iter().map(|b| f32::from_le_bytes(*b)).collect();
            match values.iter().find(|value| !value.is_finite()) {
                Some(value) => Err(format!("{name} has {value}, expected finite numbers")),
                None => Ok((tensor.shape().to_vec(), values)),
            }
        };
        let (shape, units) = tensor("units")?;
        let &[surfaces, views, width] = shape.as_slice() else {
            return Err(format!("units of shape {shape:?}, expected three axes"));
        };
        if surfaces < 2 || views == 0 || width == 0 {
            return Err(format!(
                "units of shape {shape:?}, expected two surfaces or more"
            ));
        }
        let (found, marks) = tensor("aside")?;
        if found != [surfaces] {
            return Err(format!("aside of shape {found:?}, expected [{surfaces}]"));
        }
        let mut familiar = Self {
            surfaces,
            views,
            width,
            units,
            places: Vec::new(),
            shown: shown(bytes, &tensors, surfaces)?,
            marks,
            nearest: Vec::new(),
        };
        for step in 1..=views {
            let name = format!("nearest.{step}");
            if !tensors.names().contains(&name.as_str()) {
                continue;
            }
            let (found, nearest) = tensor(&name)?;
            let expected = [surfaces, familiar.neighbours()];
            if found != expected {
                return Err(format!("{name} of shape {found:?}, expected {expected:?}"));
            }
            familiar.nearest.push((step, nearest));
        }
        Ok(familiar)
    }

    /// Whether it can be asked with these numbers of views of this width.
    pub(crate) fn answers(&self, steps: &[usize], width: usize) -> bool {
        let known = |step: &usize| self.nearest.iter().any(|(known, _)| known == step);
        self.width == width && steps.iter().all(known)
    }
}

/// What a file has of so many surfaces for people.
fn shown(bytes: &[u8], tensors: &SafeTensors<'_>, surfaces: usize) -> Result<Vec<Shown>, String> {
    let names = sps_weights::note(bytes, NAMES).unwrap_or_else(|_| "[]".to_owned());
    let names: Vec<String> = serde_json::from_str(&names).map_err(|error| error.to_string())?;
    if ![0, surfaces].contains(&names.len()) {
        return Err(format!("found {} names, expected {surfaces}", names.len()));
    }
    let shown = names.into_iter().enumerate().map(|(at, name)| {
        let tensor = tensors.tensor(&format!("photograph.{at}"));
        let photograph = tensor.map_err(|error| error.to_string())?.data().to_vec();
        Ok(Shown { name, photograph })
    });
    shown.collect()
}

/// The embeddings, each block of each view of unit length; zeros stay zeros.
fn units(embeddings: &Embeddings) -> Vec<f32> {
    let mut units = embeddings.values().to_vec();
    let views = units.chunks_exact_mut(embeddings.width().max(1));
    parallel::each(views, |view| to_units(view, embeddings.blocks()));
    units
}

fn units_of(embeddings: &Embeddings, surface: usize) -> Vec<f32> {
    let unit = |view: usize| {
        let mut view = embeddings.get(surface, view).unwrap_or_default().to_vec();
        to_units(&mut view, embeddings.blocks());
        view
    };
    (0..embeddings.views()).flat_map(unit).collect()
}

/// Brings each block of one view to unit length.
fn to_units(mut row: &mut [f32], blocks: &[usize]) {
    for &width in blocks {
        let (block, rest) = row.split_at_mut(width.min(row.len()));
        let squares: f64 = block.iter().map(|&x| f64::from(x).powi(2)).sum();
        let length = if squares > 0.0 { squares.sqrt() } else { 1.0 };
        for x in block {
            *x = (f64::from(*x) / length) as f32;
        }
        row = rest;
    }
}

/// The smallest of some distances, ascending.
fn smallest(distances: impl Iterator<Item = f32>) -> Vec<f32> {
    let mut smallest: Vec<f32> = Vec::with_capacity(NEIGHBOURS + 1);
    for distance in distances {
        if smallest.len() < NEIGHBOURS || distance < smallest[NEIGHBOURS - 1] {
            let at = smallest.partition_point(|other| *other <= distance);
            smallest.insert(at, distance);
            smallest.truncate(NEIGHBOURS);
        }
    }
    smallest
}

/// The mean distance of squared ones.
fn mean(squares: impl Iterator<Item = f32>) -> f64 {
    let (mut sum, mut count) = (0.0, 0.0);
    for square in squares {
        sum += f64::from(square).sqrt();
        count += 1.0;
    }
    sum / f64::max(count, 1.0)
}

#[cfg(test)]
mod tests;

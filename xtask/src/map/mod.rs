//! Maps of a property over a photograph, as pictures and as numbers.

mod npy;
mod picture;

use std::path::{Path, PathBuf};

use anyhow::{Context, Result};
use sps_estimator::{Estimator, Frame, Map, Predicted, Sight};

use crate::files::write_atomically;

/// What is drawn of one photograph.
pub(crate) struct Wanted<'a> {
    pub property: &'a str,
    pub sight: Sight,
    /// Places are hatched whose p-value is at most this.
    pub unfamiliar: f64,
}

impl Wanted<'_> {
    /// Writes `STEM.png` and `STEM.npy`, (rows, columns, 4), f64: estimate, lower and upper end of its
    /// interval, and p-value, each NaN where there is none. In words, what they show.
    pub(crate) fn write(
        &self,
        model: &Estimator,
        photograph: &Frame,
        stem: &Path,
    ) -> Result<String> {
        let map = model.map(photograph, model.stride(), self.sight)?;
        let places = self.places(&map)?;
        let numbers = npy::bytes([map.rows, map.columns, 4], places.iter().flatten());
        write_atomically(&with_ending(stem, ".npy"), &numbers)?;
        let picture = picture::draw(photograph, &map, &places, self);
        let path = with_ending(stem, ".png");
        write_atomically(&path, &picture.png()?)?;
        let mean = places.iter().map(|place| place[0]).sum::<f64>() / places.len() as f64;
        Ok(format!(
            "{}: {} {mean:.1} on average over {} x {} places",
            path.display(),
            self.property,
            map.rows,
            map.columns
        ))
    }

    /// Estimate, interval and p-value of each place.
    fn places(&self, map: &Map) -> Result<Vec<[f64; 4]>> {
        let of_property = |predicted: &&Predicted| predicted.property == self.property;
        let predicted = map.predictions.properties.iter().find(of_property);
        let predicted = predicted.with_context(|| {
            let known = map
                .predictions
                .properties
                .iter()
                .map(|p| p.property.as_str());
            let known = known.collect::<Vec<_>>().join(", ");
            format!(
                "--map: the model does not estimate {}, but {known}",
                self.property
            )
        })?;
        let place = |at: usize| {
            let interval = predicted.intervals.as_ref().ok().map(|all| all[at]);
            let familiar = map.predictions.familiar.as_ref().map(|all| all[at]);
            [
                predicted.values[at],
                interval.map_or(f64::NAN, |interval| interval.low),
                interval.map_or(f64::NAN, |interval| interval.high),
                familiar.unwrap_or(f64::NAN),
            ]
        };
        Ok((0..map.rows * map.columns).map(place).collect())
    }
}

/// The path with an ending after the whole of its name, whatever dots are in it.
fn with_ending(stem: &Path, ending: &str) -> PathBuf {
    let mut name = stem.as_os_str().to_owned();
    name.push(ending);
    name.into()
}

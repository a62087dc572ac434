//! Maps of a property over a photograph, as pictures and as numbers.

mod npy;
mod picture;
mod scale;

use std::path::{Path, PathBuf};

use anyhow::{Error, Result, ensure};
use serde::Serialize;
use sps_base::names::UnknownName;
use sps_estimator::{Described, Estimator, Frame, Map, Sight};
use sps_experiment::files::write_atomically;
use tracing::warn;

pub(crate) use self::picture::source;
use self::scale::Scale;

/// What is drawn of one photograph.
pub(crate) struct Wanted {
    property: String,
    /// Its place among those of the model.
    at: usize,
    sight: Sight,
    /// Places are hatched whose p-value is at most this.
    unfamiliar: f64,
}

impl Wanted {
    /// One of the properties of a model, which must be able to map.
    pub(crate) fn new(
        model: &Estimator,
        property: &str,
        sight: Sight,
        unfamiliar: f64,
    ) -> Result<Self> {
        ensure!(
            model.fitted().steps().eq([1]),
            "the model looks at {} photographs of a surface, and a map is of one: train a method \
            without `views`, which looks at one straight down",
            model.views_in_words()
        );
        let known = || model.fitted().properties();
        let at = known().position(|known| known == property);
        Ok(Self {
            property: property.to_owned(),
            at: at.ok_or_else(|| Error::msg(UnknownName::new("property", property, known())))?,
            sight,
            unfamiliar,
        })
    }

    /// Writes `STEM.png` and `STEM.npy`, (rows, columns, 4), f64: estimate, lower and upper end of its interval, and
    /// p-value, each NaN where there is none. The picture names the photograph. In words, what they show.
    pub(crate) fn write(
        &self,
        model: &Estimator,
        (photograph, path): (&Frame, &Path),
        stem: &Path,
    ) -> Result<String> {
        let map = self.of(model, photograph)?;
        let Map { rows, columns, .. } = map.grid;
        if rows * columns == 1 {
            let [height, width] = map.grid.window;
            warn!(
                "{}: one place, for the photograph is no larger than those that the model was fitted \
                on, {width} x {height} pixels: map one that shows more of the surface, or bring it to \
                more pixels by --resize where it does",
                path.display()
            );
        }
        let numbers = map.places.iter().flatten();
        let numbers = npy::bytes([rows, columns, 4], numbers);
        write_atomically(&with_ending(stem, ".npy"), &numbers)?;
        let drawn = with_ending(stem, ".png");
        write_atomically(&drawn, &map.png(photograph, path)?)?;
        let hatched = model.fitted().no_familiar();
        let hatched = hatched.map_or_else(String::new, |reason| {
            format!("; nothing is hatched, for there is no p-value: {reason}")
        });
        let values = map.places.iter().map(|place| place[0]);
        let mean = values.sum::<f64>() / map.places.len() as f64;
        let (drawn, property) = (drawn.display(), &self.property);
        let (mean, scale) = (map.scale.shown(mean), map.scale.in_words());
        Ok(format!(
            "{drawn}: {property} {mean} on average over {rows} x {columns} places, {scale}{hatched}"
        ))
    }

    /// The map of a photograph, which has the model's scale.
    pub(crate) fn of(
        &self,
        model: &Estimator,
        photograph: &Frame,
    ) -> sps_estimator::Result<Mapped<'_>> {
        let map = model.map(photograph, model.stride(), self.sight)?;
        let places = self.places(&map);
        let fitted = model.fitted();
        let deviation = fitted.deviations().nth(self.at).unwrap_or(1.0);
        let scale = Scale::of(&places, fitted.level().get(), deviation);
        Ok(Mapped {
            wanted: self,
            grid: map,
            places,
            scale,
        })
    }

    /// Estimate, interval and p-value of each place.
    fn places(&self, map: &Map) -> Vec<[f64; 4]> {
        let predicted = &map.predictions.properties[self.at];
        let place = |at: usize| {
            let intervals = predicted.intervals.as_ref();
            let [low, high] = intervals.map_or([f64::NAN; 2], |all| [all[at].low, all[at].high]);
            let familiar = map.predictions.familiar.as_ref();
            let familiar = familiar.map_or(f64::NAN, |all| all[at]);
            [predicted.values[at], low, high, familiar]
        };
        (0..map.rows * map.columns).map(place).collect()
    }
}

/// A map of one property.
pub(crate) struct Mapped<'a> {
    wanted: &'a Wanted,
    pub grid: Map,
    /// Of each place, row by row, its estimate, the lower and upper end of its interval, and its p-value;
    /// NaN where there is none.
    pub places: Vec<[f64; 4]>,
    scale: Scale,
}

impl Mapped<'_> {
    /// The content of a PNG file: colours over the photograph, which it names, and a legend.
    pub(crate) fn png(&self, photograph: &Frame, path: &Path) -> Result<Vec<u8>> {
        let of = (photograph, &self.grid);
        picture::draw(of, &self.places, self.wanted, &self.scale).png(path)
    }

    pub(crate) fn numbers(&self, model: &Estimator) -> Numbers<'_> {
        let all = |at: usize| self.places.iter().map(move |place| place[at]);
        let known = |at: usize| all(at).all(f64::is_finite).then(|| all(at).collect());
        let property = self.wanted.property.as_str();
        Numbers {
            property,
            described: model.about().describe(property),
            level: model.fitted().level().get(),
            rows: self.grid.rows,
            columns: self.grid.columns,
            window: self.grid.window,
            centres: &self.grid.centres,
            values: all(0).collect(),
            low: known(1),
            high: known(2),
            familiar: known(3),
        }
    }
}

/// The numbers of a map, row by row. What a place does not have is none for all.
#[derive(Serialize)]
pub(crate) struct Numbers<'a> {
    property: &'a str,
    #[serde(flatten)]
    described: Described,
    level: f64,
    rows: usize,
    columns: usize,
    window: [usize; 2],
    centres: &'a [[f64; 2]],
    values: Vec<f64>,
    low: Option<Vec<f64>>,
    high: Option<Vec<f64>>,
    familiar: Option<Vec<f64>>,
}

/// The path with an ending after the whole of its name, whatever dots are in it.
pub(crate) fn with_ending(stem: &Path, ending: &str) -> PathBuf {
    let mut name = stem.as_os_str().to_owned();
    name.push(ending);
    name.into()
}

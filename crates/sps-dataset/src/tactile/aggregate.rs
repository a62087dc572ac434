use serde::{Deserialize, Serialize};

use super::{RangePolicy, Reading, TactileTable};
use crate::Property;

/// What is made of the readings of a surface.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default, rename_all = "kebab-case", deny_unknown_fields)]
pub struct TactileSettings {
    /// What is done with values outside of their property's range. Default `keep`.
    pub out_of_range: RangePolicy,
    /// How the repeats at one location become one value. Default `mean`, as in the paper.
    pub repeats: Average,
    /// How the locations of a surface become one value. Default `mean`, as in the paper.
    pub locations: Average,
}

/// How several values become one.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Average {
    /// The arithmetic mean.
    #[default]
    Mean,
    /// The middle value; of an even count, the mean of the middle two.
    Median,
}

/// One property of one surface: all its readings as one value, and how far they spread.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cell {
    /// The repeats averaged within each location, then the locations.
    pub value: f64,
    /// How many readings it rests on.
    pub readings: usize,
    /// At how many locations.
    pub locations: usize,
    /// Standard deviation of repeats about the mean of their location, pooled over locations
    /// (n - 1 per location); `None` where no location has two repeats.
    pub repeat_std: Option<f64>,
    /// Sample standard deviation of the locations' values; `None` with fewer than two.
    pub location_std: Option<f64>,
}

/// One [`Cell`] per surface and property.
#[derive(Clone, Debug, PartialEq)]
pub struct SurfaceAverages {
    properties: Vec<Property>,
    /// `(surfaces, properties)`.
    cells: Vec<Option<Cell>>,
}

impl TactileTable {
    /// Averages the readings of each of `surfaces` surfaces: repeats within a location first, then
    /// locations, so that a location counts once however often it was touched.
    ///
    /// A property with no reading at all stays missing. Readings of surfaces beyond `surfaces` are
    /// left out. The order of the readings does not matter.
    ///
    /// ```
    /// use sps_dataset::{Reading, TactileSettings, TactileTable};
    ///
    /// let touch = |location, repeat, value| Reading {
    ///     surface: 0,
    ///     location,
    ///     repeat,
    ///     values: vec![Some(value)],
    /// };
    /// let table = TactileTable {
    ///     properties: vec!["friction".parse()?],
    ///     readings: vec![touch(0, 0, 10.0), touch(0, 1, 14.0), touch(1, 0, 30.0)],
    /// };
    /// let averages = table.averages(&TactileSettings::default(), 1);
    /// assert_eq!(averages.value(0, "friction"), Some(21.0)); // (12 + 30) / 2
    /// # Ok::<(), sps_dataset::InvalidCode>(())
    /// ```
    pub fn averages(&self, settings: &TactileSettings, surfaces: usize) -> SurfaceAverages {
        let mut of_surface: Vec<Vec<&Reading>> = vec![Vec::new(); surfaces];
        for reading in &self.readings {
            if let Some(readings) = of_surface.get_mut(reading.surface) {
                readings.push(reading);
            }
        }
        let cells = of_surface.iter_mut().flat_map(|readings| {
            readings.sort_by_key(|reading| (reading.location, reading.repeat));
            (0..self.properties.len()).map(|column| cell(readings, column, *settings))
        });
        SurfaceAverages {
            properties: self.properties.clone(),
            cells: cells.collect(),
        }
    }
}

/// `readings` of one surface, sorted by location and repeat.
fn cell(readings: &[&Reading], column: usize, settings: TactileSettings) -> Option<Cell> {
    let locations = readings.chunk_by(|a, b| a.location == b.location);
    let measured = |touches: &[&Reading]| -> Vec<f64> {
        let values = touches.iter().map(|touch| touch.values.get(column));
        values.filter_map(|value| *value?).collect()
    };
    let locations = locations.map(measured);
    let locations: Vec<Vec<f64>> = locations.filter(|values| !values.is_empty()).collect();
    let values = locations.iter().map(|values| settings.repeats.of(values));
    let values: Vec<f64> = values.collect();
    if values.is_empty() {
        return None;
    }
    Some(Cell {
        value: settings.locations.of(&values),
        readings: locations.iter().map(Vec::len).sum(),
        locations: locations.len(),
        repeat_std: pooled_std(&locations),
        location_std: pooled_std(&[values]),
    })
}

/// Within-group standard deviation with `n - 1` degrees of freedom per group.
fn pooled_std(groups: &[Vec<f64>]) -> Option<f64> {
    let freedom: usize = groups.iter().map(|values| values.len() - 1).sum();
    let squares = |values: &Vec<f64>| -> f64 {
        let mean = Average::Mean.of(values);
        values.iter().map(|value| (value - mean).powi(2)).sum()
    };
    let squares: f64 = groups.iter().map(squares).sum();
    (freedom > 0).then(|| (squares / freedom as f64).sqrt())
}

impl Average {
    /// The average of at least one value.
    fn of(self, values: &[f64]) -> f64 {
        match self {
            Self::Mean => {
                // About the first value, so that equal values have exactly that mean.
                let first = values[0];
                let excess: f64 = values.iter().map(|value| value - first).sum();
                first + excess / values.len() as f64
            }
            Self::Median => {
                let mut sorted = values.to_vec();
                sorted.sort_by(f64::total_cmp);
                f64::midpoint(sorted[(sorted.len() - 1) / 2], sorted[sorted.len() / 2])
            }
        }
    }
}

impl SurfaceAverages {
    /// The properties, in the order of the columns.
    pub fn properties(&self) -> &[Property] {
        &self.properties
    }

    /// How many surfaces there are.
    pub fn surfaces(&self) -> usize {
        let properties = self.properties.len();
        self.cells.len().checked_div(properties).unwrap_or(0)
    }

    /// One property of one surface; `None` where it was not measured or does not exist.
    pub fn cell(&self, surface: usize, property: &str) -> Option<Cell> {
        let column = self.properties.iter().position(|code| code == &property)?;
        *self.cells.get(surface * self.properties.len() + column)?
    }

    /// The value of [`Self::cell`].
    pub fn value(&self, surface: usize, property: &str) -> Option<f64> {
        self.cell(surface, property).map(|cell| cell.value)
    }

    /// One property of every surface, in the order of the surfaces.
    pub fn column(&self, property: &str) -> Vec<Option<f64>> {
        let values = (0..self.surfaces()).map(|surface| self.value(surface, property));
        values.collect()
    }
}

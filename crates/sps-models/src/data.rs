//! What the heads learn from: embeddings of photographs, and tactile readings.

use std::ops::Range;

use candle_core::{DType, Tensor};

use crate::error::{Error, Result};
use sps_kernels::network::places;

/// Image embeddings of surfaces, `(surfaces, views, width)`, f32, every value finite.
///
/// The features of a view may be several blocks side by side, as those of
/// [several depths](crate::encoders::Depths) are. Each is then scaled by itself, whatever is fitted to them.
#[derive(Clone, Debug, PartialEq)]
pub struct Embeddings {
    values: Vec<f32>,
    surfaces: usize,
    views: usize,
    width: usize,
    /// The widths of the blocks, which are `width` together.
    blocks: Vec<usize>,
}

impl Embeddings {
    /// Takes `(surfaces, width)` for one view of each surface, or `(surfaces, views, width)`.
    ///
    /// # Errors
    ///
    /// Another rank, no views, no width, a type that is not floating point, or a value that is
    /// not finite (the message names the surface).
    pub fn new(tensor: &Tensor) -> Result<Self> {
        let (surfaces, views, width) = match *tensor.dims() {
            [surfaces, width] => (surfaces, 1, width),
            [surfaces, views, width] => (surfaces, views, width),
            _ => {
                return Err(Error::input(
                    "embeddings",
                    format_args!("shape {:?}", tensor.dims()),
                    "(surfaces, width) or (surfaces, views, width)",
                ));
            }
        };
        if views == 0 || width == 0 {
            return Err(Error::input(
                "embeddings",
                format_args!("shape {:?}", tensor.dims()),
                "at least one view and one feature",
            ));
        }
        if !tensor.dtype().is_float() {
            return Err(Error::input(
                "embeddings",
                format_args!("type {}", tensor.dtype().as_str()),
                "floating point",
            ));
        }
        let values = tensor
            .to_dtype(DType::F32)?
            .flatten_all()?
            .to_vec1::<f32>()?;
        if let Some(at) = values.iter().position(|value| !value.is_finite()) {
            return Err(Error::input(
                "embeddings",
                format_args!("{} in surface {}", values[at], at / (views * width)),
                "finite values",
            ));
        }
        Ok(Self {
            values,
            surfaces,
            views,
            width,
            blocks: vec![width],
        })
    }

    /// The same, the features of each view made of blocks of these widths.
    ///
    /// # Errors
    ///
    /// A block of no feature, widths that are not the whole together.
    pub fn in_blocks(self, widths: &[usize]) -> Result<Self> {
        if widths.contains(&0) || widths.iter().sum::<usize>() != self.width {
            let expected = format_args!("some above 0 that are {} together", self.width);
            return Err(Error::input("blocks", format_args!("{widths:?}"), expected));
        }
        Ok(Self {
            blocks: widths.to_vec(),
            ..self
        })
    }

    /// How many surfaces.
    pub fn surfaces(&self) -> usize {
        self.surfaces
    }

    /// How many views of each surface.
    pub fn views(&self) -> usize {
        self.views
    }

    /// Features of one view.
    pub fn width(&self) -> usize {
        self.width
    }

    /// The widths of the blocks that the features of a view are made of.
    pub fn blocks(&self) -> &[usize] {
        &self.blocks
    }

    /// The places of the blocks among the features of a view.
    pub(crate) fn block_places(&self) -> impl Iterator<Item = Range<usize>> {
        places(self.blocks.iter().copied())
    }

    /// What brings each block of each view to a mean variance of 1 over these surfaces, `(views, width)`; 0 for
    /// a block that does not vary. One block alone stays as it is.
    #[cfg(feature = "regressions")]
    pub(crate) fn balance(&self) -> Vec<f32> {
        let length = self.views * self.width;
        if self.blocks.len() == 1 {
            return vec![1.0; length];
        }
        let spread = Spread::of(length, self.values.chunks_exact(length));
        let of_all_views = (0..self.views).flat_map(|_| self.blocks.iter().copied());
        let factors = places(of_all_views).flat_map(|place| {
            let common = spread.common(place.clone());
            let factor = if common > 0.0 { 1.0 / common } else { 0.0 };
            place.map(move |_| factor as f32)
        });
        factors.collect()
    }

    /// Each feature of each view times its factor.
    #[cfg(feature = "regressions")]
    pub(crate) fn scaled(&self, factors: &[f32]) -> Self {
        let values = self.values.chunks_exact(self.views * self.width);
        let scaled = values.flat_map(|row| row.iter().zip(factors).map(|(x, factor)| x * factor));
        Self {
            values: scaled.collect(),
            blocks: self.blocks.clone(),
            ..*self
        }
    }

    /// The embedding of one view of one surface, `width` values.
    pub fn get(&self, surface: usize, view: usize) -> Option<&[f32]> {
        (surface < self.surfaces && view < self.views).then(|| self.view(surface, view))
    }

    /// The given views of the given surfaces, in the order given.
    ///
    /// # Errors
    ///
    /// A surface or view that is not there, or no view at all.
    pub fn select(&self, surfaces: &[usize], views: &[usize]) -> Result<Self> {
        check_indices("surface", surfaces, self.surfaces)?;
        check_indices("view", views, self.views)?;
        if views.is_empty() {
            return Err(Error::input("views", "none", "at least one"));
        }
        let mut values = Vec::with_capacity(surfaces.len() * views.len() * self.width);
        for &surface in surfaces {
            for &view in views {
                values.extend_from_slice(self.view(surface, view));
            }
        }
        Ok(Self {
            values,
            surfaces: surfaces.len(),
            views: views.len(),
            width: self.width,
            blocks: self.blocks.clone(),
        })
    }

    /// All views of one surface, `views x width` values; `surface` must have been checked.
    pub(crate) fn surface(&self, surface: usize) -> &[f32] {
        let length = self.views * self.width;
        &self.values[surface * length..(surface + 1) * length]
    }

    /// One view; both indices must have been checked.
    pub(crate) fn view(&self, surface: usize, view: usize) -> &[f32] {
        &self.surface(surface)[view * self.width..(view + 1) * self.width]
    }
}

/// Mean and spread of each of some features.
#[derive(Clone, Debug)]
pub(crate) struct Spread {
    count: f64,
    pub(crate) mean: Vec<f64>,
    /// Sums of squared deviations (Welford).
    squares: Vec<f64>,
    largest: f64,
}

impl Spread {
    /// Over rows of so many features.
    pub(crate) fn of<R: AsRef<[f32]>>(width: usize, rows: impl Iterator<Item = R>) -> Self {
        let mut spread = Self {
            count: 0.0,
            mean: vec![0.0; width],
            squares: vec![0.0; width],
            largest: 0.0,
        };
        for row in rows {
            spread.count += 1.0;
            let parameters = spread.mean.iter_mut().zip(&mut spread.squares);
            for (&x, (mean, squares)) in row.as_ref().iter().zip(parameters) {
                let x = f64::from(x);
                let before = x - *mean;
                *mean += before / spread.count;
                *squares += before * (x - *mean);
                spread.largest = spread.largest.max(x.abs());
            }
        }
        spread
    }

    /// The deviation of one feature.
    pub(crate) fn deviation(&self, feature: usize) -> f64 {
        (self.squares[feature] / self.count.max(1.0)).sqrt()
    }

    /// The root of the mean variance of some features; exactly 0 where they are constant up to rounding.
    pub(crate) fn common(&self, features: Range<usize>) -> f64 {
        let count = features.len().max(1) as f64;
        let squares = self.squares[features].iter().sum::<f64>();
        let common = (squares / self.count.max(1.0) / count).sqrt();
        let rounding = self.count * f64::EPSILON * self.largest;
        if common <= rounding { 0.0 } else { common }
    }
}

/// Tactile readings of surfaces, in measured units; a cell that was not measured is `None`.
#[derive(Clone, Debug, PartialEq)]
pub struct Readings {
    properties: Vec<String>,
    cells: Vec<Option<f64>>,
    surfaces: usize,
}

impl Readings {
    /// Takes one row per surface, each with one cell per property, in the order of `properties`.
    ///
    /// # Errors
    ///
    /// No property, a property named twice, a row of another length, or a value that is not
    /// finite (the message names the surface and the property).
    pub fn new(properties: Vec<String>, rows: &[Vec<Option<f64>>]) -> Result<Self> {
        if properties.is_empty() {
            return Err(Error::input("readings", "no property", "at least one"));
        }
        for (at, name) in properties.iter().enumerate() {
            if properties[..at].contains(name) {
                return Err(Error::input(
                    "readings",
                    format_args!("property {name:?} twice"),
                    "each property once",
                ));
            }
        }
        let mut cells = Vec::with_capacity(rows.len() * properties.len());
        for (surface, row) in rows.iter().enumerate() {
            if row.len() != properties.len() {
                return Err(Error::input(
                    "readings",
                    format_args!("{} cells for surface {surface}", row.len()),
                    format_args!("{}", properties.len()),
                ));
            }
            for (property, cell) in properties.iter().zip(row) {
                if let Some(value) = cell.filter(|value| !value.is_finite()) {
                    return Err(Error::input(
                        "readings",
                        format_args!("{value} for {property} of surface {surface}"),
                        "a finite value, or none",
                    ));
                }
            }
            cells.extend_from_slice(row);
        }
        Ok(Self {
            properties,
            cells,
            surfaces: rows.len(),
        })
    }

    /// How many surfaces.
    pub fn surfaces(&self) -> usize {
        self.surfaces
    }

    /// The properties, in the order of the cells.
    pub fn properties(&self) -> &[String] {
        &self.properties
    }

    /// The column of a property.
    pub fn column(&self, property: &str) -> Option<usize> {
        self.properties.iter().position(|name| name == property)
    }

    /// The reading of one surface, `None` where it was not measured or is not in the table.
    pub fn get(&self, surface: usize, column: usize) -> Option<f64> {
        self.row(surface)?.get(column).copied().flatten()
    }

    /// The cells of one surface, in the order of the properties.
    pub fn row(&self, surface: usize) -> Option<&[Option<f64>]> {
        let width = self.properties.len();
        (surface < self.surfaces).then(|| &self.cells[surface * width..(surface + 1) * width])
    }
}

/// Refuses the first index that is not below `count`.
pub(crate) fn check_indices(what: &'static str, indices: &[usize], count: usize) -> Result<()> {
    match indices.iter().find(|&&index| index >= count) {
        None => Ok(()),
        Some(index) => Err(Error::input(
            what,
            format_args!("index {index}"),
            format_args!("below {count}"),
        )),
    }
}

#[cfg(all(test, feature = "regressions"))]
mod tests {
    use candle_core::Device;

    use super::*;
    use crate::golden::uniform;
    use crate::heads::{Head, HeadConfig, Input, Plan, Rerun, TrainingData, Views};
    use crate::nearest::Nearest;
    use crate::ridge::{Ridge, RidgeConfig};

    /// Two views of two blocks, 2 and 3 wide, each of which is measured in units of its own.
    fn embeddings(units: [f32; 4]) -> Embeddings {
        let values = uniform("blocks", 30 * 10).into_iter().enumerate();
        let unit = |at: usize| match at % 10 {
            0..2 => units[0],
            2..5 => units[1],
            5..7 => units[2],
            _ => units[3],
        };
        let values = values.map(|(at, value)| value as f32 * unit(at));
        let tensor = Tensor::from_vec(values.collect(), (30, 2, 5), &Device::Cpu).unwrap();
        Embeddings::new(&tensor)
            .unwrap()
            .in_blocks(&[2, 3])
            .unwrap()
    }

    #[test]
    fn every_block_of_every_view_is_brought_to_a_mean_variance_of_1() {
        let found = embeddings([1.0, 100.0, 0.01, 0.0]);
        let found = found.scaled(&found.balance());
        for (place, expected) in [(0..2, 1.0), (2..5, 1.0), (5..7, 1.0), (7..10, 0.0)] {
            let variance = |feature: usize| {
                let values: Vec<f64> = (0..30)
                    .map(|s| f64::from(found.surface(s)[feature]))
                    .collect();
                let mean = values.iter().sum::<f64>() / 30.0;
                values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / 30.0
            };
            let count = place.len() as f64;
            let mean = place.clone().map(variance).sum::<f64>() / count;
            assert!((mean - expected).abs() < 1e-5, "{place:?}: {mean}");
        }
        let one = found.clone().in_blocks(&[5]).unwrap();
        assert_eq!(one.balance(), [1.0; 10]);
    }

    /// Powers of two change no bit, so that estimates must be the same to the last.
    #[test]
    fn units_of_blocks_do_not_matter() {
        let rows: Vec<_> = uniform("touch", 30)
            .into_iter()
            .map(|v| vec![Some(v)])
            .collect();
        let readings = Readings::new(vec!["p".into()], &rows).unwrap();
        let rerun = Rerun {
            number: 0,
            training: (0..20).collect(),
            validation: Vec::new(),
        };
        let mut plan = Plan::each(1, readings.properties(), vec![rerun]);
        plan.trials[0].views = Views::Fixed(vec![0, 1]);
        let estimates = |units| {
            let embeddings = embeddings(units);
            let data = TrainingData::new(&embeddings, &readings);
            let ridge = Ridge::new(RidgeConfig::default()).unwrap();
            let ridge = ridge.train(&data, &plan).unwrap();
            let nearest = Nearest.train(&data, &plan).unwrap();
            let head = Head::new(HeadConfig {
                epochs: 2,
                input: Input::LateFusion { views: 2 },
                ..HeadConfig::default()
            });
            let head = head.unwrap().train(&data, &plan, &()).unwrap();
            [
                ridge.predict(&embeddings).unwrap()[0].values.clone(),
                nearest.predict(&embeddings).unwrap()[0].values.clone(),
                head.predict(&embeddings).unwrap()[0].values.clone(),
            ]
        };
        assert_eq!(estimates([1.0; 4]), estimates([8.0, 0.25, 8.0, 0.25]));
    }
}

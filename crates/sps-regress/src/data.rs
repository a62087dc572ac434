//! What regressors learn from: embeddings of photographs, and tactile readings.

use std::ops::Range;

use ndarray::Array2;

use crate::error::{Error, Result};

/// Image embeddings of surfaces, `(surfaces, views, width)`, f32, every value finite.
///
/// The features of a view may be several blocks side by side, as those of several depths of a network are.
/// Each is then scaled by itself, whatever is fitted to them.
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
    /// Takes the values of one surface after the other, those of a surface view by view.
    ///
    /// # Errors
    /// No views, no width, another number of values than `[surfaces, views, width]` says, or a value
    /// that is not finite (the message names the surface).
    pub fn new(values: Vec<f32>, shape: [usize; 3]) -> Result<Self> {
        let [surfaces, views, width] = shape;
        let shape = format_args!("shape {shape:?}");
        if views == 0 || width == 0 {
            let expected = "at least one view and one feature";
            return Err(Error::input("embeddings", shape, expected));
        }
        let row = views.checked_mul(width);
        let length = row.and_then(|row| row.checked_mul(surfaces));
        if length != Some(values.len()) {
            let found = format_args!("{} values", values.len());
            return Err(Error::input("embeddings", found, shape));
        }
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
    pub fn block_places(&self) -> impl Iterator<Item = Range<usize>> {
        places(self.blocks.iter().copied())
    }

    /// What brings each block of each view to a mean variance of 1 over these surfaces, `(views, width)`; 0 for
    /// a block that does not vary. One block alone stays as it is.
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

    /// With each block of each view brought to a mean variance of 1 over these surfaces; 0 where a block does not
    /// vary. One block alone stays as it is.
    #[must_use]
    pub fn balanced(&self) -> Self {
        self.scaled(&self.balance())
    }

    /// Each feature of each view times its factor.
    pub(crate) fn scaled(&self, factors: &[f32]) -> Self {
        let values = self.values.chunks_exact(self.views * self.width);
        let scaled = values.flat_map(|row| row.iter().zip(factors).map(|(x, factor)| x * factor));
        Self {
            values: scaled.collect(),
            blocks: self.blocks.clone(),
            ..*self
        }
    }

    /// The values of one surface after the other, those of a surface view by view.
    pub fn values(&self) -> &[f32] {
        &self.values
    }

    /// The same as f64, `(surfaces, views x width)`.
    pub fn table(&self) -> Array2<f64> {
        let columns = self.views * self.width;
        Array2::from_shape_fn((self.surfaces, columns), |(surface, column)| {
            f64::from(self.surface(surface)[column])
        })
    }

    /// The embedding of one view of one surface, `width` values.
    pub fn get(&self, surface: usize, view: usize) -> Option<&[f32]> {
        (surface < self.surfaces && view < self.views).then(|| self.view(surface, view))
    }

    /// The given views of the given surfaces, in the order given.
    ///
    /// # Errors
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

/// The places of blocks of such widths side by side.
pub fn places(widths: impl Iterator<Item = usize>) -> impl Iterator<Item = Range<usize>> {
    widths.scan(0, |start, width| {
        let place = *start..*start + width;
        *start = place.end;
        Some(place)
    })
}

/// Mean and spread of each of some features.
#[derive(Clone, Debug)]
pub struct Spread {
    count: f64,
    mean: Vec<f64>,
    /// Sums of squared deviations.
    squares: Vec<f64>,
    largest: f64,
}

impl Spread {
    /// Over rows of so many features, one after the other (Welford 1962).
    pub fn of<R: AsRef<[f32]>>(width: usize, rows: impl Iterator<Item = R>) -> Self {
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

    /// The mean of each feature.
    pub fn mean(&self) -> &[f64] {
        &self.mean
    }

    /// The population standard deviation of one feature, 0 of one that is not there.
    pub fn deviation(&self, feature: usize) -> f64 {
        let squares = self.squares.get(feature).copied().unwrap_or_default();
        (squares / self.count.max(1.0)).sqrt()
    }

    /// The root of the mean variance of some features; exactly 0 where they are constant up to rounding, or
    /// are not there.
    pub fn common(&self, features: Range<usize>) -> f64 {
        let squares = self.squares.get(features).unwrap_or_default();
        let count = squares.len().max(1) as f64;
        let common = (squares.iter().sum::<f64>() / self.count.max(1.0) / count).sqrt();
        let rounding = self.count * f64::EPSILON * self.largest;
        if common <= rounding { 0.0 } else { common }
    }
}

/// Tactile readings of surfaces, in measured units; a cell that was not measured is `None`.
#[derive(Clone, Debug, PartialEq)]
pub struct Readings {
    properties: Vec<String>,
    rows: Vec<Vec<Option<f64>>>,
}

impl Readings {
    /// Takes one row per surface, each with one cell per property, in the order of `properties`.
    ///
    /// # Errors
    /// No property, a property named twice, a row of another length, or a value that is not
    /// finite (the message names the surface and the property).
    pub fn new(properties: Vec<String>, rows: &[Vec<Option<f64>>]) -> Result<Self> {
        if properties.is_empty() {
            return Err(Error::input("readings", "no property", "at least one"));
        }
        for (at, name) in properties.iter().enumerate() {
            if properties[..at].contains(name) {
                let found = format_args!("property {name:?} twice");
                return Err(Error::input("readings", found, "each property once"));
            }
        }
        for (surface, row) in rows.iter().enumerate() {
            if row.len() != properties.len() {
                let found = format_args!("{} cells for surface {surface}", row.len());
                return Err(Error::input("readings", found, properties.len()));
            }
            for (property, cell) in properties.iter().zip(row) {
                if let Some(value) = cell.filter(|value| !value.is_finite()) {
                    let found = format_args!("{value} for {property} of surface {surface}");
                    let expected = "a finite value, or none";
                    return Err(Error::input("readings", found, expected));
                }
            }
        }
        Ok(Self {
            properties,
            rows: rows.to_vec(),
        })
    }

    /// How many surfaces.
    pub fn surfaces(&self) -> usize {
        self.rows.len()
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
        self.rows.get(surface).map(Vec::as_slice)
    }
}

/// Refuses the first index that is not below `count`; `what` says of what.
///
/// # Errors
/// There is such an index.
pub fn check_indices(what: &'static str, indices: &[usize], count: usize) -> Result<()> {
    match indices.iter().find(|&&index| index >= count) {
        None => Ok(()),
        Some(index) => {
            let found = format_args!("index {index}");
            Err(Error::input(what, found, format_args!("below {count}")))
        }
    }
}
